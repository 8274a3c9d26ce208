"""One import for everything: `import multicontact as mc`.

    arm = mc.mechanism("arm.xml", base="base")
    estimate = mc.identify(arm, "run.csv")
    print(estimate.summary())
    mc.write_model("arm_identified.xml", arm, estimate.consistent())
    mc.report(estimate, "results/arm")

It has the names of `ident` (identification, numpy and scipy only) and of `sim` (models and simulation, MuJoCo), which
`help(ident)` and `help(sim)` list with a line each, besides:

    scenes                      MJCF scenes: `mc.scenes.load("double_pendulum")`
    report(estimate, folder)    tables, figures and the page of an estimate, as of `multicontact identify`

A module is imported when one of its names is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import ident
import sim

if TYPE_CHECKING:
    import scenes
    from ident import *  # noqa: F403
    from multicontact.result_pages import report
    from sim import *  # noqa: F403

__version__: str

__all__ = ["report", "scenes"]
__all__ += ident.__all__
__all__ += sim.__all__
__all__.sort()

if not TYPE_CHECKING:
    # To a type checker every name would be there.
    def __getattr__(name: str) -> Any:
        if name == "__version__":
            return ident.__version__
        if name == "scenes":
            return import_module("scenes")
        if name == "report":
            return import_module("multicontact.result_pages").report
        # A package's own list: it also has rooms, one of which is named as a function of the other.
        for package in (ident, sim):
            if name in package.__all__:
                return getattr(package, name)
        raise AttributeError(f"module 'multicontact' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__

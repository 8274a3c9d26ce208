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

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any


def _other(name: str) -> str:
    """Place of another package or script of a name that comes before this package's own; empty if none does."""
    spec = find_spec(name)
    origin = None if spec is None or spec.origin is None else Path(spec.origin).resolve()
    own = Path(__file__).resolve().parents[1] / name / "__init__.py"
    return "" if origin == own else str(origin or "none")


for _name in ("ident", "sim"):
    if _place := _other(_name):
        raise ImportError(
            f"multicontact needs its own package '{_name}', but {_place} comes first on Python's path: rename that, or "
            "start Python in another folder."
        )

import ident  # noqa: E402
import sim  # noqa: E402

if TYPE_CHECKING:
    import scenes
    from ident import *  # noqa: F403
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
        # A package's own list: it also has rooms, one of which is named as a function of the other.
        for package in (ident, sim):
            if name in package.__all__:
                return getattr(package, name)
        raise AttributeError(f"module 'multicontact' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__


def report(estimate: "ident.Estimate", folder: str | Path, *, formats: Sequence[str] = ("png",)) -> Path:
    """Writes the tables, figures and page of an estimate, as `multicontact identify` does.

    In a notebook the estimate then shows a link to the page, which replays the recording.

    Args:
        estimate: The estimate.
        folder: Folder of the results, made if missing.
        formats: Formats of the figures, out of `pdf`, `png` and `svg`.

    Returns:
        The page.

    Raises:
        InputError: A format is unknown, the folder cannot be written, or another package is named `experiments`.
    """
    from ident.annotations import WORDS
    from ident.arguments import check_type, checked_path
    from ident.estimate import PAGES, Estimate

    if place := _other("experiments"):
        raise ident.InputError(
            f"A page needs multicontact's own package 'experiments', but {place} comes first on Python's path: start "
            "Python in another folder, or use the command `multicontact identify`."
        )
    check_type("estimate", estimate, Estimate, WORDS["Estimate"])
    path = checked_path("folder", folder, "the path of a folder")
    from experiments.document.result_folder import provenance
    from experiments.document.writer import Output, written
    from experiments.reports import identify_report
    from experiments.studies.user_files import following

    chosen = () if isinstance(formats, str) or not isinstance(formats, Sequence) else tuple(dict.fromkeys(formats))
    if not chosen or not {*chosen} <= {"pdf", "png", "svg"}:
        raise ident.InputError(f"formats needs some of pdf, png, svg; got {formats!r}.")
    origin, followed = provenance({"formats": chosen}), following(estimate)
    made = identify_report.document(estimate, _file(estimate), (), origin, following=followed)
    out = Output(path, chosen)
    written(made, out, stale=identify_report.OUTPUTS)
    PAGES[estimate] = page = out.folder / "report.html"
    return page


def _file(estimate: "ident.Estimate") -> Path | None:
    """File of the model; None for one that came as a specification or without a source."""
    source = estimate.prepared.mechanism.source
    file = getattr(source, "text", None) or getattr(source, "path", None)
    return Path(file) if isinstance(file, str | Path) else None

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

if TYPE_CHECKING:
    import scenes
    from ident import (
        BaseMotion,
        BaseParameters,
        Body,
        Equations,
        Estimate,
        ExcitationError,
        Frame,
        InputError,
        LogError,
        Mechanism,
        ModelError,
        Motion,
        Recording,
        Samples,
        Sensor,
        Sensors,
        Tree,
        Wrench,
        base_wrench_regressor,
        consistent_parameters,
        find_base_parameters,
        identify,
        identify_load,
        identify_payload,
        joint_torque_regressor,
        least_squares,
        read_log,
        recover_axes,
        total_wrench,
        tree_from_mdh,
    )
    from multicontact.result_pages import report
    from sim import (
        Excitation,
        base_motion,
        fall,
        mechanism,
        simulate,
        simulate_many,
        state_columns,
        tree_from_model,
        updated_spec,
        write_model,
    )

__version__: str

__all__ = [
    "BaseMotion",
    "BaseParameters",
    "Body",
    "Equations",
    "Estimate",
    "Excitation",
    "ExcitationError",
    "Frame",
    "InputError",
    "LogError",
    "Mechanism",
    "ModelError",
    "Motion",
    "Recording",
    "Samples",
    "Sensor",
    "Sensors",
    "Tree",
    "Wrench",
    "base_motion",
    "base_wrench_regressor",
    "consistent_parameters",
    "fall",
    "find_base_parameters",
    "identify",
    "identify_load",
    "identify_payload",
    "joint_torque_regressor",
    "least_squares",
    "mechanism",
    "read_log",
    "recover_axes",
    "report",
    "scenes",
    "simulate",
    "simulate_many",
    "state_columns",
    "total_wrench",
    "tree_from_mdh",
    "tree_from_model",
    "updated_spec",
    "write_model",
]

if not TYPE_CHECKING:
    # To a type checker every name would be there.
    def __getattr__(name: str) -> Any:
        if name == "__version__":
            return import_module("ident").__version__
        if name == "scenes":
            return import_module("scenes")
        if name not in __all__:
            raise AttributeError(f"module 'multicontact' has no attribute '{name}'")
        if name == "report":
            return import_module("multicontact.result_pages").report
        # A package's own list: it also has rooms, one of which is named as a function of the other.
        packages = map(import_module, ("ident", "sim"))
        return getattr(next(package for package in packages if name in package.__all__), name)


def __dir__() -> list[str]:
    return __all__

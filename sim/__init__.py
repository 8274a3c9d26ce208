"""The bridge to MuJoCo: mechanisms read from models and written back, excitation, simulation.

    mechanism(source, base)             a body and all bodies on it, from an MJCF, URDF or OpenSim model
    tree_from_model(source, base)       its kinematic tree alone
    state_columns(source, base)         indices of its states in MuJoCo's
    base_motion(source, base, …)        motion of a moving base, from MuJoCo's states
    write_model(path, mechanism, phi)   writes its model with other inertial parameters to a file
    updated_spec(mechanism, phi)        its model with other inertial parameters, as a specification
    Excitation                          a joint motion of sinusoids, with noise
    simulate(spec, excitation)          a recording of a scene's sensors along an excitation
    simulate_many(spec, …, seeds=…)     recordings with many seeds at a time
    fall(model, base, seconds=…)        a passive motion of a scene with its contact wrenches

A module is imported when one of its names is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.models.model_mechanism import mechanism
    from sim.models.model_update import updated_spec, write_model
    from sim.models.mujoco_model import base_motion, state_columns, tree_from_model
    from sim.motion.excitation import Excitation
    from sim.simulation.simulate import simulate, simulate_many
    from sim.simulation.stepped import fall

__all__ = ["Excitation", "base_motion", "fall", "mechanism", "simulate", "simulate_many", "state_columns"]
__all__ += ["tree_from_model", "updated_spec", "write_model"]

_MODULES = {
    **dict.fromkeys(("base_motion", "state_columns", "tree_from_model"), "sim.models.mujoco_model"),
    **dict.fromkeys(("simulate", "simulate_many"), "sim.simulation.simulate"),
    **dict.fromkeys(("updated_spec", "write_model"), "sim.models.model_update"),
    "Excitation": "sim.motion.excitation",
    "fall": "sim.simulation.stepped",
    "mechanism": "sim.models.model_mechanism",
}
"""Module of each name."""

if not TYPE_CHECKING:
    # To a type checker every name would be there.
    def __getattr__(name: str) -> Any:
        if name not in _MODULES:
            raise AttributeError(f"module 'sim' has no attribute '{name}'")
        return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return __all__

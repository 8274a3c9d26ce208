"""Geometric dynamic identification of mechanisms from base and contact wrenches (numpy and scipy only).

    identify(mechanism, recording)                       base parameters from a recording, judged: an `Estimate`
    identify_payload(robot, recording, …)                parameters of a load beyond a wrist sensor
    identify_load(robot, without, loaded, …)             parameters of a load by recordings with and without it
    Estimate                                             ψ and covariance; predict, compare, consistent, verdict
    Mechanism                                            a tree with gravity, prior φ, sites, ranges, drives
    Motion                                               joint states over time, and motion of the base
    BaseMotion                                           poses, twists and accelerations of a base
    Tree                                                 bodies and their joints
    Body                                                 one body and the joint that carries it
    Frame                                                a row of a modified Denavit-Hartenberg table
    tree_from_mdh(frames)                                the tree of such a table
    recover_axes(tree, poses)                            joint axes from measured poses of the bodies
    read_log(path, mechanism)                            a recording from a log, columns mapped by TOML
    Recording                                            measured channels by name, and sensors
    Sensor                                               place and direction of a measured wrench
    Wrench                                               a measured wrench
    total_wrench(tree, q, …)                             total wrench of the ground and all contacts (Eq. 15-18)
    base_wrench_regressor(tree, q, dq, ddq, gravity=…)   Y of the base wrench (Eq. 14)
    joint_torque_regressor(tree, q, dq, ddq, gravity=…)  Y of the joint torques (Eq. 11)
    find_base_parameters(tree, gravity=…)                identifiable parameters: rank, names, regrouping
    BaseParameters                                       a regrouping
    Sensors                                              measured quantities, for the structure
    consistent_parameters(psi, …)                        physical bodies near a prior that have given ψ
    Equations                                            channels and columns to fit
    Samples                                              a motion and measured channels
    least_squares(equations, source)                     ordinary or weighted least squares of pieces of any length
    InputError                                           invalid input; its kinds:
    ModelError                                           an invalid model or mechanism
    LogError                                             an invalid recording or mapping of its columns
    ExcitationError                                      a motion that does not separate parameters

Conventions, used everywhere: SI units and radians; twists are `[v; ω]`, wrenches `[F; τ]`; `T_ab` is the pose of
frame b in frame a, so `T_ac = T_ab @ T_bc`; {0} is the base frame. A module is imported when one of its names is first
used.
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ident.errors import ExcitationError, InputError, LogError, ModelError
    from ident.estimate import Estimate
    from ident.estimation.equations import Equations
    from ident.estimation.samples import Samples
    from ident.identification import identify
    from ident.mechanism.body import Body
    from ident.mechanism.dh import Frame, tree_from_mdh
    from ident.mechanism.mechanism import Mechanism
    from ident.mechanism.motion import BaseMotion, Motion
    from ident.mechanism.recovered_axes import recover_axes
    from ident.mechanism.tree import Tree
    from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
    from ident.parameters.base_parameters import BaseParameters, find_base_parameters
    from ident.parameters.consistency import consistent_parameters
    from ident.parameters.structure import Sensors
    from ident.payload.beyond_sensor import identify_payload
    from ident.payload.load import identify_load
    from ident.recordings.log import read_log
    from ident.recordings.recording import Recording
    from ident.recordings.wrench import Sensor, Wrench, total_wrench
    from ident.regression.ordinary import least_squares

__version__: str

__all__ = ["BaseMotion", "BaseParameters", "Body", "Equations", "Estimate", "ExcitationError", "Frame", "InputError"]
__all__ += ["LogError", "Mechanism", "ModelError", "Motion", "Recording", "Samples", "Sensor", "Sensors", "Tree"]
__all__ += ["Wrench", "base_wrench_regressor", "consistent_parameters", "find_base_parameters", "identify"]
__all__ += ["identify_load", "identify_payload", "joint_torque_regressor", "least_squares", "read_log", "recover_axes"]
__all__ += ["total_wrench", "tree_from_mdh"]

_NAMES = {
    "ident.errors": ("ExcitationError", "InputError", "LogError", "ModelError"),
    "ident.estimate": ("Estimate",),
    "ident.estimation.equations": ("Equations",),
    "ident.estimation.samples": ("Samples",),
    "ident.identification": ("identify",),
    "ident.mechanism.body": ("Body",),
    "ident.mechanism.dh": ("Frame", "tree_from_mdh"),
    "ident.mechanism.mechanism": ("Mechanism",),
    "ident.mechanism.motion": ("BaseMotion", "Motion"),
    "ident.mechanism.recovered_axes": ("recover_axes",),
    "ident.mechanism.tree": ("Tree",),
    "ident.model.regressor": ("base_wrench_regressor", "joint_torque_regressor"),
    "ident.parameters.base_parameters": ("BaseParameters", "find_base_parameters"),
    "ident.parameters.consistency": ("consistent_parameters",),
    "ident.parameters.structure": ("Sensors",),
    "ident.payload.beyond_sensor": ("identify_payload",),
    "ident.payload.load": ("identify_load",),
    "ident.recordings.log": ("read_log",),
    "ident.recordings.recording": ("Recording",),
    "ident.recordings.wrench": ("Sensor", "Wrench", "total_wrench"),
    "ident.regression.ordinary": ("least_squares",),
}
"""Names by their modules."""

_MODULES = {name: module for module, names in _NAMES.items() for name in names}

if not TYPE_CHECKING:
    # To a type checker every name would be there.
    def __getattr__(name: str) -> Any:
        if name == "__version__":
            try:
                return version("multicontact")
            except PackageNotFoundError:
                return "0+unknown"
        if name not in _MODULES:
            raise AttributeError(f"module 'ident' has no attribute '{name}'")
        return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return __all__

"""The MJCF scenes. Bodies, joint limits, servos, sensors and their noise levels are declared there and nowhere else."""

from importlib.resources import files

import mujoco
import numpy as np

NAMES = ("double_pendulum",)
"""Names that `load` knows, one for each MJCF file in this package."""


def load(name: str, *, tilt_deg: float = 0.0, azimuth_deg: float = 0.0) -> mujoco.MjSpec:
    """A scene as an editable specification.

    Args:
        name: One of `NAMES`.
        tilt_deg: Angle by which every hinge axis is turned away from its design, from X for the double pendulum.
        azimuth_deg: Direction towards which X turns, measured from +Y to +Z.

    Returns:
        The specification; `.compile()` makes the model, `.to_xml()` the MJCF text.

    Raises:
        ValueError: The scene does not exist, or the angles make no sense.
    """
    if name not in NAMES:
        raise ValueError(f"No scene is named '{name}'; the scenes are {', '.join(NAMES)}.")
    if not (np.isfinite(azimuth_deg) and 0 <= tilt_deg < 90):
        raise ValueError(
            f"A tilt needs an angle from 0° to below 90° and a finite azimuth, got {tilt_deg}° towards {azimuth_deg}°."
        )
    spec = mujoco.MjSpec.from_string(files(__name__).joinpath(f"{name}.xml").read_text(encoding="utf-8"))
    if tilt_deg:
        turn = _tilt(np.radians(tilt_deg), np.radians(azimuth_deg))
        for joint in spec.joints:
            if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
                joint.axis = turn @ joint.axis
    return spec


def _tilt(angle: float, azimuth: float) -> np.ndarray:
    """Rotation that takes X to `(cos, sin cos azimuth, sin sin azimuth)` the short way."""
    rotation = np.zeros(9)
    quaternion = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quaternion, np.array([0.0, -np.sin(azimuth), np.cos(azimuth)]), angle)
    mujoco.mju_quat2Mat(rotation, quaternion)
    return rotation.reshape(3, 3)

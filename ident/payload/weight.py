"""Mass of a payload from gravity alone, and prior bodies of that mass."""

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import ExcitationError, InputError, LogError
from ident.estimation.preparation import Prepared
from ident.estimation.weighing import TURNED, Weighing, weighed
from ident.geometry.inertia import parameter_transform, parameters_from_com
from ident.mechanism.mechanism import Mechanism
from ident.payload.payload import SIZE
from ident.recordings.wrench import GROUND, Sensor

DENSITY = 500.0
"""Density of the ball that replaces a body of unknown inertia, kg/m³; low, as tools are mostly air."""

SIGNIFICANT = 4.0
"""Number of standard deviations from which a mass is significant."""


def weighing(log: Prepared, sensor: str, stated: Sensor) -> Weighing:
    """Fit of the forces to gravity alone.

    Raises:
        LogError: A component of the wrench is missing.
        InputError: The sensor's frame or sign cannot be as stated.
        ExcitationError: The mass is not significant.
    """
    base = log.samples.motion.base
    if base is None or not np.isfinite(log.wrench).all():
        raise LogError(f"A payload needs all six components of the wrench '{sensor}', none of them constant.")
    acceleration = base.dV[:, :3] + np.cross(base.V[:, 3:], base.V[:, :3])
    gravity = log.mechanism.gravity @ base.T[:, :3, :3] - acceleration
    # Readings are not filtered, so that their noise stays white.
    out = weighed(log.recording.wrench(GROUND).on_mechanism, gravity @ stated.pose[:3, :3])
    if out.angle > TURNED:
        frame = Rotation.from_matrix(stated.pose[:3, :3] @ out.rotation.T)
        quaternion = ", ".join(f"{x:.4f}" for x in frame.as_quat(scalar_first=True, canonical=True))
        raise InputError(
            f"The forces of '{sensor}' follow gravity far better in axes turned by {np.degrees(out.angle):.0f}° from "
            f"where they were stated{' and with the opposite sign' if out.opposite else ''}: its frame in that of the "
            f"payload's body looks like quaternion = [{quaternion}]."
        )
    if out.opposite and out.mass < -SIGNIFICANT * out.std:
        raise InputError(
            f"The forces of '{sensor}' weigh {out.mass:.3f} kg: they have the opposite sign; under [wrenches.{sensor}] "
            f"applied_to_link says whether they act on the body that is named there (true) or are what it exerts "
            "(false)."
        )
    if out.mass < SIGNIFICANT * out.std:
        raise ExcitationError(
            f"The forces of '{sensor}' weigh {out.mass:.2g} ± {out.std:.1g} kg: they show no payload."
        )
    return out


def likely(part: Mechanism, fit: Weighing, place: np.ndarray) -> np.ndarray:
    """φ of bodies with the weighed mass: those of the model, scaled, or else a ball (10 b,)."""
    if part.prior is not None and part.prior[::10].sum() > 0:
        return part.prior * (fit.mass / part.prior[::10].sum())
    radius = (3 * fit.mass / (4 * np.pi * DENSITY)) ** (1 / 3)
    ball = 0.4 * fit.mass * radius**2 * np.eye(3)
    own = parameters_from_com(fit.mass, fit.moment / fit.mass, ball)
    return np.concatenate([parameter_transform(place) @ own, np.zeros(10 * (len(part.bodies) - 1))])


def known(part: Mechanism) -> dict[str, float]:
    """Standard deviations of such bodies as a prior, which are wide."""
    mass, inertia = part.known[::10], part.known.reshape(-1, 10)[:, 4:7]
    least = inertia[mass > 0].min(axis=1) / mass[mass > 0]
    return {"mass": 1.0, "center": SIZE, "inertia": float(max(1.0, SIZE**2 / max(least.max(), 1e-8)))}

"""Stribeck friction where recordings may ask for it: additional friction at low velocity, Fs(joint)."""

from ident.tolerances import DRIVE, STRIBECK
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.reversals import rubbing


def low_velocity_columns(estimate: TrajectoryEstimate) -> tuple[str, ...]:
    """Stribeck columns of the axes with Coulomb friction that changes its sign over less than `STRIBECK`.

    Where it changes over more, friction that is higher at low velocity would only correct the shape of that change.
    """
    equations, reversals = estimate.measurement.equations, estimate.reversals
    if reversals is None:
        return ()
    steep = reversals.slip < STRIBECK * equations.axes.gears
    return tuple(f"{DRIVE['stribeck']}({equations.axes.names[a]})" for a in rubbing(equations) if steep[a])

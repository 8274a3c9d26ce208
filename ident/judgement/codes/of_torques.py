"""Sentences on joint torques: sign and size, friction, drives, and bodies that were not carried."""

from collections.abc import Mapping, Sequence
from typing import Any

from ident.judgement.codes.row import Row, bracketed, followed, listed, percent


def _opposite(joints: Sequence[str]) -> str:
    return (
        f"The torques of {listed(joints)} seem to have the opposite sign: with it they are far nearer to the model's "
        "prediction. Turn the sign of their columns."
    )


def _scaled(gains: Mapping[str, float], load: str | None = None) -> str:
    or_load = "" if load is None else f" Or '{load}' carries a heavy load that the model lacks."
    return (
        f"Torques equal the model's prediction but for a factor, in brackets: {bracketed(gains)}. Check their unit, "
        f"gear ratio and motor constant.{or_load}"
    )


def _friction(shares: Mapping[str, float], drives: Sequence[str]) -> str:
    return (
        "Friction is likely and was not fitted. It would explain these shares of the residuals' variance: "
        f"{listed(f'{joint} {percent(share)}' for joint, share in shares.items())}. Fit it: --drive {' '.join(drives)}."
    )


def _bound(at_most: Mapping[str, float], units: Mapping[str, str]) -> str:
    limits = listed(f"{most:.2g} {units[name]}" for name, most in at_most.items())
    return (
        f"{listed(at_most)} {'is at its' if len(at_most) == 1 else 'are at their'} bound of zero: at most {limits} "
        "(95 %). Intervals of other parameters are those with the drive free."
    )


def _near_reversals(velocities: Mapping[str, float], at_rest: Mapping[str, float]) -> str:
    return (
        f"Torques count less at low velocity, where friction may be anything up to breakaway. They are not judged "
        f"below, in rad/s (m/s): {followed(velocities)}. Residual over signal there: "
        f"{followed(at_rest) or 'there are no such samples'}."
    )


def _smooth_coulomb(velocities: Mapping[str, float]) -> str:
    return (
        f"Coulomb friction changes its sign over a velocity v, in rad/s (m/s): {followed(velocities)}. It is fitted "
        "and predicted as Fc tanh(q̇ / v)."
    )


def _basis(joints: Sequence[str], fixed_by: Sequence[str]) -> str:
    fixed = " and ".join(fixed_by)
    return (
        f"The scale of the torques of {listed(joints)} was estimated. It is fixed by "
        f"{fixed or 'the stated one alone: masses, friction and rotors are as uncertain as that'}."
    )


def _low_velocity(values: Mapping[str, float]) -> str:
    return (
        f"Friction is higher at low velocity, in N m (N): {followed(values)}. It was fitted as Stribeck friction, Fs."
    )


def _moved(joints: Mapping[str, Mapping[str, Any]]) -> str:
    each = listed(
        f"{joint} {percent(x['inertia'], 1)} ± {percent(x['inertia_std'], 1)} ({percent(x['weight'])})"
        for joint, x in joints.items()
    )
    return (
        "Motion that the torques do not explain. Share of the model's inertia in them, with that of its weight in "
        f"brackets: {each}. A hand or something else moves the joints, or the torques are commands that something "
        "overrides. Record motion by the motors alone."
    )


def _loop(loop: str, joints: Sequence[str]) -> str:
    names = " ".join(joints)
    return (
        f"The coupling '{loop}' acts on the torques of {listed(joints)}, but the equations leave it out. Take these "
        f"torques away, --leave-out {names}; the wrench at the base is not affected."
    )


def _computed(joints: Sequence[str], largest: float) -> str:
    return (
        f"Torques are explained to {100 * largest:.1g} % without friction ({listed(joints)}): they are computed, "
        "simulated, or measured behind the gears. Computed ones repeat the controller's model: record currents or "
        "measured torques."
    )


def _not_carried(body: str, explained: float) -> str:
    return (
        f"Body '{body}' was probably not carried: without it {percent(explained)} of the torques' squared difference "
        "from the model vanishes. Base parameters are not affected; take it out of the updated model."
    )


TORQUES = {
    "motion_not_by_torques": Row(_moved, doubt=True),
    "loop_left_out": Row(_loop, doubt=True),
    "computed_torques": Row(_computed, doubt=False),
    "torque_sign": Row(_opposite, doubt=True),
    "torque_scale": Row(_scaled, doubt=True),
    "torque_scale_estimated": Row(_basis, doubt=False),
    "body_not_carried": Row(
        _not_carried,
        doubt=False,
    ),
    "friction_not_fitted": Row(_friction, doubt=None),
    "drive_at_bound": Row(_bound, doubt=False),
    "breakaway_friction": Row(_near_reversals, doubt=False),
    "low_velocity_friction": Row(_low_velocity, doubt=False),
    "smooth_coulomb_friction": Row(_smooth_coulomb, doubt=False),
}

"""Sentences on a payload that the motion does not determine."""

from collections.abc import Mapping, Sequence

from ident.judgement.codes.row import Row, bracketed, listed


def _inertias(quantities: Sequence[str]) -> str:
    return (
        f"The motion does not determine {listed(quantities)}: likely values stand in, of the model's body or of a ball "
        "of the same mass. Turn the sensor faster to determine them."
    )


def _unexplained(ratios: Mapping[str, float]) -> str:
    return (
        f"Neither weight nor motion explain the forces, residual over signal in brackets: {bracketed(ratios, '.2f')}. "
        "The controller may have taken a load out, the sensor may have been tared on the way, or something touches it. "
        "Record raw readings: set the controller's payload to 0 kg and do not tare."
    )


def _unlikely(mass: float, most: float, robot: float | None) -> str:
    beside = f"all bodies of the model weigh {robot:.3g} kg" if robot else "the strongest robots carry that at most"
    unit = f"in mN it would be {mass / 1e3:.3g} kg" if mass / 1e3 < most else "they may be raw counts"
    return (
        f"A payload of {mass:.4g} kg is above {most:.3g} kg: {beside}. The unit of the forces is likely wrong: {unit}. "
        "State the unit or the gain of the wrench in the columns file."
    )


PAYLOAD = {
    "payload_forces_unexplained": Row(_unexplained, doubt=True),
    "payload_mass_unlikely": Row(_unlikely, doubt=True),
    "payload_mass_unknown": Row(
        "The motion does not determine mass and centre of mass. Turn the sensor further, about more than one axis.",
        doubt=True,
    ),
    "payload_inertia_unknown": Row(_inertias, doubt=False),
}

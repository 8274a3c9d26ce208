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


def _unlikely(mass: float, robot: float | None) -> str:
    more = f"{mass / robot:.2g} times all bodies of the model" if robot else "more than the strongest robots carry"
    return (
        f"A payload of {mass:.4g} kg is {more}: check the unit of the forces. In mN it would be {mass / 1e3:.3g} kg; "
        "raw counts need their factor. State the unit or the gain in the columns file."
    )


PAYLOAD = {
    "payload_forces_unexplained": Row(_unexplained, doubt=True),
    "payload_mass_unlikely": Row(_unlikely, doubt=None),
    "payload_mass_unknown": Row(
        "The motion does not determine mass and centre of mass. Turn the sensor further, about more than one axis.",
        doubt=True,
    ),
    "payload_inertia_unknown": Row(_inertias, doubt=False),
    "load_not_shown": Row(
        "The recordings do not show the load's mass: {mass:.2g} ± {std:.1g} kg. Check which carry it, and on which "
        "body; turn that about several axes.",
        doubt=True,
    ),
    "load_changes_friction": Row("Friction is another with the load, and was fitted apart.", doubt=False),
}

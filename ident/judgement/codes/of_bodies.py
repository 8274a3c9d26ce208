"""Sentences on the bodies of the updated model, and on a payload that the motion does not determine."""

from collections.abc import Mapping, Sequence
from typing import Any

from ident.judgement.codes.row import Row, bracketed, listed


def _within(moved: Sequence[Mapping[str, Any]]) -> str:
    return f"The updated model has the base parameters within their joint 95 % region. {_moves(moved)}"


def _none_near(moved: Sequence[Mapping[str, Any]]) -> str:
    return f"No physical bodies near the model's have these base parameters. {_moves(moved)}"


def _moves(moved: Sequence[Mapping[str, Any]]) -> str:
    each = listed(f"{x['name']}{_of(x['body'])} by {x['z']:+.1f}" for x in moved)
    return f"In standard deviations, the updated model moves {each}." if moved else "It moves none of them."


def _of(body: str | None) -> str:
    return f" of {body}" if body else ""


def _rotors_apart(rotors: Mapping[str, float]) -> str:
    each = listed(f"{name} {x:.3g}" for name, x in rotors.items())
    return f"No links can take up all inertia about the joints; the rest is kept apart as rotor inertia, kg m²: {each}."


def _masses(beginning: str, end: str = "") -> Row:
    def sentence(masses: Mapping[str, Mapping[str, float]], factor: float) -> str:
        each = listed(f"{body} {_mass(**x)}" for body, x in masses.items())
        return f"{beginning.format(factor=factor)}: {each}.{end}"

    return Row(sentence, doubt=False)


def _mass(mass: float, lower: float | None, upper: float | None, model: float) -> str:
    if lower is None:
        limits = "" if upper is None else f"less than {upper:.3g}; "
    else:
        limits = f"more than {lower:.3g}; " if upper is None else f"{lower:.3g} to {upper:.3g}; "
    return f"{mass:.3g} kg ({limits}model: {model:.3g} kg)"


def _rotor(what: str) -> Row:
    def sentence(joints: Mapping[str, str]) -> str:
        each = listed(f"{body} (joint {joint})" for body, joint in joints.items())
        return f"Rotor inertia may explain the masses of {each}. {what}"

    return Row(sentence, doubt=False)


BODIES = {
    "model_not_contradicted": Row(
        "The estimate does not contradict the model, whose bodies stay as they are.", doubt=False
    ),
    "physical_within_region": Row(_within, doubt=False),
    "no_physical_bodies": Row(_none_near, doubt=None),
    "rotors_apart": Row(_rotors_apart, doubt=False),
    "masses_shown": _masses(
        "Masses beyond a factor of {factor:g} of the model's, which is outside their 95 % intervals"
    ),
    "masses_limited": _masses(
        "Masses that no channel contains, limited only by what other parameters of a physical body allow",
        " An unmeasured hand or contact that drives a joint has the same effect: leave such parts out.",
    ),
    "masses_hardly_shown": _masses(
        "Masses beyond a factor of {factor:g} of the model's in the updated model, which the data do not determine"
    ),
    "rotor_not_fitted": _rotor("The links take it up, as it was not fitted: add --drive rotor."),
    "rotor_inseparable": _rotor("The links take it up: this motion does not separate it, even with --drive rotor."),
    "heavier_last_link": Row(
        "The last link '{body}' carries {mass:.2g} ± {std:.1g} kg more than the model, if that is right on the other "
        "bodies: a tool? `multicontact payload` identifies it.",
        doubt=False,
    ),
}


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

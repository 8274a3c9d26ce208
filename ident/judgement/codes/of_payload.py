"""Sentences on a payload that the motion does not determine."""

from collections.abc import Sequence

from ident.judgement.codes.row import Row, listed


def _inertias(quantities: Sequence[str]) -> str:
    return (
        f"The motion does not tell {listed(quantities)}: likely values stand in, of the model's body or of a ball as "
        "heavy; they need faster turns of the sensor."
    )


PAYLOAD = {
    "payload_mass_unknown": Row(
        "The motion does not tell mass and centre of mass; turn the sensor further.", doubt=True
    ),
    "payload_inertia_unknown": Row(_inertias, doubt=False),
}

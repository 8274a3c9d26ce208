"""What of the total wrench the motion of a model in a plane cannot explain."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ident.estimation.equations import channels_out_of_plane
from ident.judgement.finding import Finding, Place

if TYPE_CHECKING:
    from ident.estimate import Estimate


def plane_findings(result: "Estimate") -> Iterator[Finding]:
    """Channels in which a mechanism may sway that its model has in a plane, and the option that leaves them out."""
    prepared = result.prepared
    hidden = channels_out_of_plane(prepared.mechanism, prepared.frame)
    if set(hidden) & set(result.channels):
        yield Finding(
            f"The model moves in the plane normal to {hidden[0][1]}; how the mechanism sways out of it, which "
            f"{', '.join(hidden)} show, it cannot explain: --leave-out {' '.join(hidden)} leaves them out.",
            False,
            Place(channels=tuple(name for name in hidden if name in result.channels)),
        )

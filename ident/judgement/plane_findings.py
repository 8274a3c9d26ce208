"""A remark on channels that the motion of a model in a plane cannot explain."""

from collections.abc import Iterator

from ident.estimation.equations import channels_out_of_plane
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.place import Place


def plane_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels out of the plane of a planar model, and on the option that leaves them out."""
    if not evidence.logs:
        return
    hidden = channels_out_of_plane(evidence.mechanism, evidence.logs[0].frame)
    if set(hidden) & set(evidence.channels):
        place = Place(channels=tuple(name for name in hidden if name in evidence.channels))
        yield Finding.of("out_of_plane", place, normal=hidden[0][1], channels=tuple(hidden))

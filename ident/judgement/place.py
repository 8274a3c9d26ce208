"""Bodies, joints, wrenches, channels and times that a finding is about."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Place:
    """Place of a finding; empty where it has none.

    Attributes:
        bodies: Names of bodies; likewise `joints`, `wrenches` and `channels`.
        span: First and last time, s.
        log: Index of the log, if there are several.
    """

    bodies: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    wrenches: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    span: tuple[float, float] | None = None
    log: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Entries that are not empty, in JSON's types."""
        names = {key: getattr(self, key) for key in ("bodies", "joints", "wrenches", "channels")}
        entries: dict[str, Any] = {key: list(value) for key, value in names.items() if value}
        entries |= {} if self.span is None else {"span": list(self.span)}
        return entries | ({"log": self.log} if self.log or self.span else {})


NOWHERE = Place()

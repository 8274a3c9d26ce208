"""What is found on an estimate."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Place:
    """Where a finding is, as far as it is somewhere.

    Attributes:
        bodies: Names of bodies; likewise `joints`, `wrenches` and `channels`.
        span: First and last time, s.
        log: Index of the log that it is in, where it is in one of several.
    """

    bodies: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    wrenches: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    span: tuple[float, float] | None = None
    log: int = 0

    def to_dict(self) -> dict[str, Any]:
        """What there is of it, in JSON's types."""
        names = {key: getattr(self, key) for key in ("bodies", "joints", "wrenches", "channels")}
        told: dict[str, Any] = {key: list(value) for key, value in names.items() if value}
        told |= {} if self.span is None else {"span": list(self.span)}
        return told | ({"log": self.log} if self.log or self.span else {})


NOWHERE = Place()


@dataclass(frozen=True)
class Finding:
    """One thing that speaks against the estimate, or that its reader should know.

    Attributes:
        text: The finding in one sentence.
        doubt: Whether it speaks against the estimate.
        place: Where it is.
    """

    text: str
    doubt: bool
    place: Place = NOWHERE

    @property
    def line(self) -> str:
        """A line of a list in the terminal."""
        return f"  {'!' if self.doubt else '-'} {self.text}"

    def to_dict(self) -> dict[str, Any]:
        """For scripts, in JSON's types."""
        return {"text": self.text, "doubt": self.doubt, "place": self.place.to_dict()}

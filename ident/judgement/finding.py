"""Findings on an estimate: a code with values, from which `FINDINGS` makes a sentence."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from ident.judgement.codes import FINDINGS, TITLES
from ident.judgement.codes.row import listed
from ident.judgement.place import NOWHERE, Place

FEW = 5
"""Number of names from which a title has none."""


@dataclass(frozen=True)
class Finding:
    """A doubt on the estimate, or a remark on it.

    Attributes:
        code: Key of `FINDINGS`.
        values: Numbers and names in its sentence.
        doubt: True if it speaks against the estimate.
        place: Its place.
    """

    code: str
    values: Mapping[str, Any]
    doubt: bool
    place: Place = NOWHERE

    @classmethod
    def of(cls, code: str, place: Place = NOWHERE, /, doubt: bool | None = None, **values: Any) -> "Finding":
        """The finding of a code.

        Args:
            code: Key of `FINDINGS`.
            place: Where it is.
            doubt: Whether it is a doubt, for codes that leave it to the judge; by default as its row says.
            values: Numbers and names in its sentence.

        Raises:
            ValueError: Both the row and the judge say whether it is a doubt, or neither does.
        """
        own = FINDINGS[code].doubt
        if (own is None) == (doubt is None):
            raise ValueError(f"'{code}' needs its doubt either from its row or from its judge.")
        return cls(code, values, bool(doubt if own is None else own), place)

    @property
    def text(self) -> str:
        """The finding in a sentence."""
        return FINDINGS[self.code].rendered(self.values)

    @property
    def title(self) -> str:
        """About seven words: what it says, and what it is about if that has few names."""
        words = TITLES.get(self.code, self.code.replace("setup", "set-up").replace("_", " "))
        names = [*self.place.channels, *self.place.wrenches, *self.place.joints, *self.place.bodies]
        return words[0].upper() + words[1:] + (f": {listed(names)}" if 0 < len(names) < FEW else "")

    @property
    def line(self) -> str:
        """Line of a list in the terminal."""
        return line_of(self.text, self.doubt)

    def to_dict(self) -> dict[str, Any]:
        """Code, values, doubt, place and sentence in JSON's types."""
        return {
            "code": self.code,
            "values": in_json(self.values),
            "doubt": self.doubt,
            "place": self.place.to_dict(),
            "text": self.text,
        }


def in_json(value: Any) -> Any:
    """A value in JSON's types; numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(key): in_json(each) for key, each in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return in_json(value.tolist())
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, str | int | None):
        return value
    return [in_json(each) for each in value]


def doubts_first(findings: Iterable[Finding]) -> list[Finding]:
    """Findings with the doubts first, otherwise in their order."""
    return sorted(findings, key=lambda each: not each.doubt)


def line_of(text: str, doubt: bool) -> str:
    """Line of a finding's sentence in a list in the terminal."""
    return f"  {'!' if doubt else '-'} {text}"

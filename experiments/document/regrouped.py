"""Parameters of a table that stand for sums of several: their mark, and a sentence with the sums."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

DAGGER = "†"
"""Mark of regrouped parameters."""


@dataclass(frozen=True)
class Regrouped:
    """Sums that parameters stand for.

    Attributes:
        sums: Sums by model, each beginning with the name of its parameter; the model is empty if there is one only.
    """

    sums: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @classmethod
    def of(cls, sums: Mapping[str, Sequence[str]]) -> "Regrouped":
        """Sums by model, without the models' names if they are the same for all."""
        first, *others = sums.values()
        return cls(sums if any(each != first for each in others) else {"": first})

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of the parameters that stand for several in some model."""
        return frozenset(_name(each) for sums in self.sums.values() for each in sums if each != _name(each))

    def sentence(self, shown: Collection[object], *, column: bool) -> str:
        """Sentence with the sums of the shown parameters, or on the table's column that has them."""
        if column:
            return "Regrouped with other parameters: the sum is in the column of regroupings."
        kept = {model: [each for each in sums if self._counts(each, shown)] for model, sums in self.sums.items()}
        parts = [(model, ", ".join(sums)) for model, sums in kept.items() if sums]
        listed = "; ".join(f"{model}: {sums}" if model else sums for model, sums in parts)
        return f"Regrouped sums{', ' if parts[0][0] else ': '}{listed}."

    @staticmethod
    def _counts(terms: str, shown: Collection[object]) -> bool:
        """True for a sum of several terms that belongs to a shown parameter."""
        return _name(terms) in shown and terms != _name(terms)


def _name(terms: str) -> str:
    """Name of the parameter that stands for a sum, its first term."""
    return terms.split(" ", 1)[0]

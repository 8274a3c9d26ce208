"""A row of the table of findings, and phrases that its sentences share."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Row:
    """Sentence and doubt of a code.

    Attributes:
        template: Format string of the values, or a function of them where grammar depends on them.
        doubt: True if it speaks against the estimate; None if that depends on the values, and the judge decides.
    """

    template: str | Callable[..., str]
    doubt: bool | None

    def rendered(self, values: Mapping[str, Any]) -> str:
        """The sentence with these values."""
        return self.template.format(**values) if isinstance(self.template, str) else self.template(**values)


def listed(names: Iterable[str]) -> str:
    """Names with commas between them."""
    return ", ".join(names)


def bracketed(values: Mapping[str, float], form: str = ".3g") -> str:
    """Names with commas between them, each with its number in brackets."""
    return listed(f"{name} ({value:{form}})" for name, value in values.items())


def followed(values: Mapping[str, float], form: str = ".2g") -> str:
    """Names with commas between them, each followed by its number."""
    return listed(f"{name} {value:{form}}" for name, value in values.items())


def in_log(log: int | None) -> str:
    """Phrase ` in log N`, with a leading space; empty for None."""
    return "" if log is None else f" in log {log}"


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent."""
    return f"{round(100 * share, digits) + 0.0:.{digits}f} %"


def number_of(number: int, noun: str) -> str:
    """A number with its noun, in the plural for all but one."""
    return f"{number} {noun}{'s' * (number != 1)}"

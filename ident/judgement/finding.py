"""What is found on an estimate."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that speaks against the estimate, or that its reader should know.

    Attributes:
        text: The finding in one sentence.
        doubt: Whether it speaks against the estimate.
    """

    text: str
    doubt: bool

    @property
    def line(self) -> str:
        """A line of a list in the terminal."""
        return f"  {'!' if self.doubt else '-'} {self.text}"

"""Followers: joints whose coordinate is a function of another's, as the shin slides on the thigh when the knee bends.

    q_f = f(q)        q̇_f = f'(q) q̇        q̈_f = f'(q) q̈ + f''(q) q̇²        τ += f'(q) τ_f

f is a polynomial, so that it can be evaluated for numbers, arrays, signals of a tape and symbols.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from ident.errors import ModelError


@dataclass(frozen=True)
class Follower:
    """Dependence of a follower on its leading joint.

    Attributes:
        joint: Name of the leading joint, which has a single coordinate.
        coefficients: Coefficients of the polynomial f, the constant first.
        span: Range of the leader's coordinate for which f holds, rad or m.
    """

    joint: str
    coefficients: tuple[float, ...]
    span: tuple[float, float] = (-np.pi, np.pi)

    def __post_init__(self) -> None:
        low, high = self.span
        if not self.coefficients or not np.isfinite([*self.coefficients, low, high]).all() or low >= high:
            raise ModelError(
                f"A follower of '{self.joint}' needs finite coefficients and a span from a smaller to a larger "
                f"coordinate, got {self.coefficients} and {self.span}."
            )

    def value(self, q: Any) -> Any:
        """f(q) for a number, a signal, or an array of any shape."""
        return horner(self.coefficients, q)

    def slope(self, q: Any) -> Any:
        """f'(q) for the same types."""
        return horner(tuple(Polynomial(self.coefficients).deriv().coef.tolist()), q)

    def bend(self, q: Any) -> Any:
        """f''(q) for the same types."""
        return horner(tuple(Polynomial(self.coefficients).deriv(2).coef.tolist()), q)

    def states(self, q: Any, *rates: Any) -> tuple[Any, ...]:
        """The follower's coordinate, and its velocity and acceleration if the leader's are given."""
        slope = self.slope(q) if rates else None
        out = [self.value(q), *(slope * rate for rate in rates)]
        if len(rates) > 1:
            out[2] = out[2] + self.bend(q) * (rates[0] * rates[0])
        return tuple(out)


def horner(coefficients: tuple[float, ...], q: Any) -> Any:
    """Value of a polynomial from its coefficients, the constant first."""
    out = q * 0 + coefficients[-1]
    for c in reversed(coefficients[:-1]):
        out = out * q + c
    return out

"""Joints that follow another joint's coordinate, as the shin slides on the thigh when the knee bends.

    q_f = f(q)        q̇_f = f'(q) q̇        q̈_f = f'(q) q̈ + f''(q) q̇²        τ += f'(q) τ_f

f is a polynomial, so that numbers, arrays, signals of a tape and symbols all go through it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from ident.errors import ModelError


@dataclass(frozen=True)
class Follower:
    """How a joint follows another one.

    Attributes:
        joint: Name of the joint that leads, one with a single coordinate.
        coefficients: Those of the polynomial f, the constant first.
        span: Coordinates of the leader for which f holds, rad or m.
    """

    joint: str
    coefficients: tuple[float, ...]
    span: tuple[float, float] = (-np.pi, np.pi)

    def __post_init__(self) -> None:
        low, high = self.span
        if not self.coefficients or not np.isfinite([*self.coefficients, low, high]).all() or low >= high:
            raise ModelError(
                f"What follows '{self.joint}' needs finite coefficients and a span from a smaller to a larger "
                f"coordinate, got {self.coefficients} and {self.span}."
            )

    def value(self, q: Any) -> Any:
        """f(q) for a number, a signal, or an array of any shape."""
        return _horner(self.coefficients, q)

    def slope(self, q: Any) -> Any:
        """f'(q), likewise."""
        return _horner(tuple(Polynomial(self.coefficients).deriv().coef.tolist()), q)

    def bend(self, q: Any) -> Any:
        """f''(q), likewise."""
        return _horner(tuple(Polynomial(self.coefficients).deriv(2).coef.tolist()), q)

    def states(self, q: Any, *rates: Any) -> tuple[Any, ...]:
        """The follower's coordinate, and as far as the leader's are given its velocity and acceleration."""
        slope = self.slope(q) if rates else None
        out = [self.value(q), *(slope * rate for rate in rates)]
        if len(rates) > 1:
            out[2] = out[2] + self.bend(q) * (rates[0] * rates[0])
        return tuple(out)


def _horner(coefficients: tuple[float, ...], q: Any) -> Any:
    """A polynomial, from its coefficients, the constant first."""
    out = q * 0 + coefficients[-1]
    for c in reversed(coefficients[:-1]):
        out = out * q + c
    return out

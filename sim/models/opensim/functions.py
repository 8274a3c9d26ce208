"""Functions of coordinates in OpenSim's files, and polynomials that approximate them.

A tabulated function is evaluated as in OpenSim, and approximated by the polynomial of lowest degree that is within
`CLOSE` of it over the coordinate's range: a follower needs two derivatives, also on a tape.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from ident.errors import ModelError
from sim.models.opensim.elements import label, number, numbers

CLOSE = 2e-5
"""Error of a polynomial, in m or rad, below which it may replace a tabulated function."""

DEGREE = 9
"""Largest degree of a polynomial that approximates a tabulated function."""

NODES, CHECKED = 200, 1001
"""Number of points to which a polynomial is fitted, and at which its error is evaluated."""

Evaluated = Callable[..., np.ndarray]


@dataclass(frozen=True)
class Curve:
    """A function of one coordinate.

    Attributes:
        evaluated: Callable that returns its values at an array of coordinates.
        exact: The equal polynomial, None for a tabulated function.
        span: Range of coordinates of its table, None without a table.
    """

    evaluated: Evaluated
    exact: Polynomial | None = None
    span: tuple[float, float] | None = None

    @classmethod
    def polynomial(cls, coefficients: Sequence[float]) -> "Curve":
        """The function of a polynomial, with the constant first."""
        exact = Polynomial(coefficients).trim()
        return cls(exact, exact)

    def scaled(self, factor: float) -> "Curve":
        """The function times a factor."""
        return self.of_value(Curve.polynomial([0, factor]))

    def of_value(self, outer: "Curve") -> "Curve":
        """The composition `outer(self(x))`."""
        exact = outer.exact(self.exact) if self.exact is not None and outer.exact is not None else None
        spans = [span for span in (self.span, self._before(outer.span)) if span]
        span = (max(low for low, _ in spans), min(high for _, high in spans)) if spans else None
        return Curve(lambda x: outer.evaluated(self.evaluated(x)), exact, span)

    def _before(self, span: tuple[float, float] | None) -> tuple[float, float] | None:
        """Range of coordinates in which the values of a linear function are in a span; None for other functions."""
        if span is None or self.exact is None or self.exact.degree() != 1:
            return None
        constant, slope = self.exact.coef.tolist()
        low, high = sorted((end - constant) / slope for end in span)
        return low, high

    def fitted(self, low: float, high: float) -> tuple[Polynomial, float]:
        """The approximating polynomial over a range, and its largest error there."""
        if self.exact is not None:
            return self.exact, 0.0
        at = (low + high) / 2 + (high - low) / 2 * np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
        x = np.linspace(low, high, CHECKED)
        values, there = self.evaluated(x), self.evaluated(at)
        best: tuple[Polynomial, float] | None = None
        for degree in range(DEGREE + 1):
            fit = Chebyshev.fit(at, there, degree, domain=[low, high]).convert(kind=Polynomial)
            error = float(abs(fit(x) - values).max())
            best = (fit, error) if best is None or error < best[1] else best
            if error < CLOSE:
                break
        assert best is not None
        return best


IDENTITY = Curve.polynomial([0, 1])
"""The identity function."""


def function_of(element: ET.Element) -> ET.Element | None:
    """Element of the function in an element, None without one."""
    inner = element.find("function")
    candidates = [child for child in (element if inner is None else inner) if child.tag in _READERS]
    if not candidates and inner is not None and len(inner):
        raise _unknown(element, next(iter(inner)).tag)
    return candidates[0] if candidates else None


def curve(element: ET.Element) -> Curve:
    """The function of an OpenSim element.

    Raises:
        ModelError: It is of an unsupported kind, or has no numbers.
    """
    if element.tag not in _READERS:
        raise _unknown(element, element.tag)
    return _READERS[element.tag](element)


def _unknown(element: ET.Element, kind: object) -> ModelError:
    return ModelError(f"{label(element)}: functions of coordinates are {', '.join(_READERS)}; got <{kind}>.")


def _multiplied(element: ET.Element) -> Curve:
    inner = function_of(element)
    if inner is None:
        raise ModelError(f"{label(element)} needs a function to multiply.")
    return curve(inner).scaled(number(element, "scale", "1"))


def _table(element: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    x, y = numbers(element, "x"), numbers(element, "y")
    if len(x) != len(y) or len(x) < 2 or not (np.diff(x) > 0).all():
        raise ModelError(
            f"{label(element)} needs two points or more with rising <x>, and as many <y>; got {len(x)} and {len(y)}."
        )
    return x, y


def _piecewise_linear(element: ET.Element) -> Curve:
    x, y = _table(element)
    slope, end = np.diff(y) / np.diff(x), len(x) - 2

    def evaluated(q: np.ndarray) -> np.ndarray:
        k = np.clip(np.searchsorted(x, q) - 1, 0, end)
        return y[k] + slope[k] * (q - x[k])

    return Curve(evaluated, None, (float(x[0]), float(x[-1])))


def _spline(element: ET.Element) -> Curve:
    """SIMM's cubic spline, with third derivatives at its ends from cubics through the outermost four points.

    Forsythe, Malcolm and Moler, *Computer Methods for Mathematical Computations*, 1977. It is extrapolated linearly.
    """
    x, y = _table(element)
    if len(x) == 2:
        return _piecewise_linear(element)
    # Imported here because few models have splines, and it also imports scipy's optimisers.
    from scipy.interpolate import make_interp_spline

    ends = [6 * _divided(x[part], y[part]) if len(x) > 3 else 0.0 for part in (slice(0, 4), slice(-4, None))]
    spline = make_interp_spline(x, y, 3, bc_type=([(3, ends[0])], [(3, ends[1])]))
    slopes = spline(x[[0, -1]], 1)

    def evaluated(q: np.ndarray) -> np.ndarray:
        inside = np.clip(q, x[0], x[-1])
        beyond = q - inside
        return spline(inside) + beyond * np.where(beyond < 0, *slopes)

    return Curve(evaluated, None, (float(x[0]), float(x[-1])))


def _divided(x: np.ndarray, y: np.ndarray) -> float:
    """Divided difference of all points; for four points a sixth of the third derivative of their cubic."""
    while len(y) > 1:
        y = np.diff(y) / (x[len(x) - len(y) + 1 :] - x[: len(y) - 1])
    return float(y[0])


_READERS: dict[str, Callable[[ET.Element], Curve]] = {
    "Constant": lambda element: Curve.polynomial([number(element, "value", "0")]),
    "LinearFunction": lambda element: Curve.polynomial(numbers(element, "coefficients", 2, "1 0")[::-1].tolist()),
    "PolynomialFunction": lambda element: Curve.polynomial(numbers(element, "coefficients")[::-1].tolist()),
    "MultiplierFunction": _multiplied,
    "SimmSpline": _spline,
    "NaturalCubicSpline": _spline,
    "PiecewiseLinearFunction": _piecewise_linear,
}
"""Readers of functions, by tag; SIMM's spline has another tag in files of OpenSim 2 and 3."""

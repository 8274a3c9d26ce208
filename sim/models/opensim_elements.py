"""OpenSim files as XML: elements, numbers, frames, and functions of coordinates with polynomials close to them.

A tabulated function is evaluated as in OpenSim, and approximated by the polynomial of lowest degree that is within
`CLOSE` of it over the coordinate's range: a follower needs two derivatives, also on a tape.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from scipy.spatial.transform import Rotation

from ident.errors import ModelError
from ident.files.table import FAR
from ident.geometry import se3


def model_element(path: Path, root: ET.Element) -> ET.Element:
    """The `<Model>` of an OpenSim file with a root element.

    Raises:
        ModelError: The file is no OpenSim model, or older than version 3.
    """
    model = root.find("Model")
    if root.tag != "OpenSimDocument" or model is None:
        raise ModelError(f"{path}: an OpenSim file is an <OpenSimDocument> with a <Model>, this one a <{root.tag}>.")
    version = root.get("Version", "")
    oldest = 30000
    if not version.isdecimal() or int(version) < oldest:
        raise ModelError(
            f"{path}: files of OpenSim 3 and later are read (Version {oldest} or more), this one is '{version}'; let "
            "OpenSim open and save it."
        )
    return model


def objects(parent: ET.Element | None, kind: str) -> list[ET.Element]:
    """Elements of a set such as `BodySet`, in `<objects>` or, in some sets of OpenSim 4, directly."""
    group = None if parent is None else parent.find(kind)
    if group is None:
        return []
    inner = group.find("objects")
    return [child for child in (group if inner is None else inner) if isinstance(child.tag, str)]


def label(element: ET.Element) -> str:
    """Label of an element in messages: `<PinJoint name="knee">`."""
    return f'<{element.tag} name="{element.get("name", "")}">'


def text(element: ET.Element, tag: str, default: str = "") -> str:
    """Text of a child, without surrounding blanks."""
    return (element.findtext(tag) or "").strip() or default


def numbers(element: ET.Element, tag: str, size: int | None = None, default: str | None = None) -> np.ndarray:
    """Numbers in a child of an element.

    Args:
        element: The element.
        tag: Tag of the child.
        size: Required count, None for any.
        default: Default if the file leaves them out.

    Raises:
        ModelError: They are missing, not finite, or of another count.
    """
    stated = text(element, tag) or default
    try:
        values = np.array((stated or "").split(), float)
    except ValueError:
        values = np.array([np.nan])
    if stated is None or not (abs(values) < FAR).all() or (size is not None and len(values) != size):
        expected = "finite numbers" if size is None else "a finite number" if size == 1 else f"{size} finite numbers"
        raise ModelError(f"{label(element)} needs {expected} in <{tag}>, got '{(stated or '')[:60]}'.")
    return values


def number(element: ET.Element, tag: str, default: str | None = None) -> float:
    """The number in a child of an element; errors as for `numbers`."""
    return float(numbers(element, tag, 1, default)[0])


def flag(element: ET.Element, tag: str, default: bool) -> bool:
    """True if a child has the text `true`.

    Raises:
        ModelError: It has neither that nor `false`.
    """
    value = text(element, tag, str(default)).lower()
    if value not in ("true", "false"):
        raise ModelError(f"{label(element)} needs true or false in <{tag}>, got '{value[:60]}'.")
    return value == "true"


def named(element: ET.Element) -> str:
    """Name of an element.

    Raises:
        ModelError: It has none.
    """
    name = element.get("name", "").strip()
    if not name:
        raise ModelError(f"Every <{element.tag}> of an OpenSim model needs a name; one has none.")
    return name


def with_owner(element: ET.Element, owner: str = "") -> Iterator[tuple[str, ET.Element]]:
    """All descendants of an element, each with the name of its nearest named ancestor."""
    for child in element:
        if isinstance(child.tag, str):
            yield owner, child
            yield from with_owner(child, child.get("name") or owner)


GROUND = "ground"


@dataclass(frozen=True)
class PlacedFrame:
    """A frame on a body.

    Attributes:
        body: Name of the body, `GROUND` for the ground.
        pose: Pose of the frame in the body's (4, 4).
    """

    body: str
    pose: np.ndarray


class Frames:
    """Frames of a model by name, with their poses."""

    def __init__(self, model: ET.Element) -> None:
        self.bodies = {named(element): element for element in objects(model, "BodySet") if element.tag == "Body"}
        self.bodies.pop(GROUND, None)
        self._offsets = {
            (owner, named(element)): element
            for owner, element in with_owner(model)
            if element.tag == "PhysicalOffsetFrame"
        }

    def joint_ends(self, joint: ET.Element, carrier: str = "") -> tuple[PlacedFrame, PlacedFrame]:
        """The frames F on the parent and M on the child that a joint connects.

        Args:
            joint: The joint.
            carrier: Name of the joint's child body, in files of OpenSim 3, where joints are inside bodies.

        Raises:
            ModelError: A frame is not in the model.
        """
        if carrier:
            parent, at = self.place(text(joint, "parent_body"), joint), offset(joint, "location", "orientation")
            there = offset(joint, "location_in_parent", "orientation_in_parent")
            return PlacedFrame(parent.body, there), PlacedFrame(carrier, at)
        return self.place(socket(joint, "parent_frame"), joint), self.place(socket(joint, "child_frame"), joint)

    def place(self, reference: str, user: ET.Element, below: tuple[str, ...] = ()) -> PlacedFrame:
        """Body and pose of a frame that an element refers to by a name or path, as `/bodyset/pelvis` or `hip_offset`.

        Raises:
            ModelError: There is no such frame, there are several, or frames depend on each other in a circle.
        """
        *owners, name = reference.split("/")
        if name == GROUND or name in self.bodies:
            return PlacedFrame(name, np.eye(4))
        owner = owners[-1] if owners and owners[-1] not in ("", "..", ".") else user.get("name", "")
        alike = [key for key in self._offsets if key[1] == name]
        key = (owner, name) if (owner, name) in alike else alike[0] if len(alike) == 1 else None
        if key is None or reference in below:
            raise ModelError(
                f"{label(user)} needs a frame of the model; '{reference}' is {'several' if len(alike) > 1 else 'none'}."
            )
        element = self._offsets[key]
        parent = self.place(socket(element, "parent"), element, (*below, reference))
        return PlacedFrame(parent.body, parent.pose @ offset(element, "translation", "orientation"))


def markers(model: ET.Element, frames: Frames) -> dict[str, PlacedFrame]:
    """Markers of a model by their names."""
    out = {}
    for element in objects(model, "MarkerSet"):
        reference = text(element, "body") or socket(element, "parent_frame")
        place = frames.place(reference, element)
        shift = se3.pose(np.eye(3), numbers(element, "location", 3, "0 0 0"))
        out[named(element)] = PlacedFrame(place.body, place.pose @ shift)
    return out


def socket(element: ET.Element, name: str) -> str:
    """Name or path in a socket of an element; earlier files of OpenSim 4 have another tag for it."""
    return text(element, f"socket_{name}") or text(element, f"socket_{name}_connectee_name")


def offset(element: ET.Element, position: str, angles: str) -> np.ndarray:
    """A pose from a position and body-fixed x, y, z angles."""
    turns = Rotation.from_euler("XYZ", numbers(element, angles, 3, "0 0 0"))
    return se3.pose(turns.as_matrix(), numbers(element, position, 3, "0 0 0"))


CLOSE = 2e-5
"""Error of a polynomial, in m or rad, below which it may replace a tabulated function."""

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
        """The approximating polynomial over a range, of degree nine at most, and its largest error there."""
        if self.exact is not None:
            return self.exact, 0.0
        # Errors are evaluated at five times as many points as polynomials are fitted to.
        nodes = 200
        at = (low + high) / 2 + (high - low) / 2 * np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
        x = np.linspace(low, high, 5 * nodes + 1)
        values, there = self.evaluated(x), self.evaluated(at)
        best: tuple[Polynomial, float] | None = None
        for degree in range(10):
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

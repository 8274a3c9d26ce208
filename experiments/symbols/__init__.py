"""Mechanisms in symbols: `ident.model.dim` and `ident.parameters.structure`, run on symbols instead of numbers."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import sympy
from scipy.spatial.transform import Rotation

from experiments.data.paper import drawing, tree_of_table_1
from ident.mechanism.body import ball_twist
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model import dim
from ident.parameters.base_parameters import BaseParameters, find_base_parameters
from ident.tolerances import ROUNDING

FEW = 6
"""Largest number of lengths for which coefficients are exact with arbitrary directions."""


class Symbol(sympy.Symbol):  # type: ignore[misc]
    """A real symbol that numpy's sine and cosine take."""

    def __new__(cls, name: str) -> "Symbol":
        """Returns a symbol of that name."""
        return super().__new__(cls, name, real=True)

    def sin(self) -> sympy.Expr:
        """Sine, called by numpy."""
        return sympy.sin(self)

    def cos(self) -> sympy.Expr:
        """Cosine, called by numpy."""
        return sympy.cos(self)


@dataclass(frozen=True, eq=False)
class SymbolicModel:
    """A mechanism's base-wrench DIM in closed form.

    Attributes:
        mechanism: The mechanism, its lengths and gravity symbols, its directions exact numbers (dtype object).
        lengths: Numerical value of each length, m.
        motion: Symbols of one sample.
        Y: The regressor of Eq. 14 (6, 10 b).
        regrouping: Regrouping with exact coefficients, which are rational functions of the lengths.
        reason: Reason for decimal coefficients at the lengths' values; empty if they are exact.
    """

    mechanism: Mechanism
    lengths: dict[Symbol, float]
    motion: Motion
    Y: np.ndarray
    regrouping: BaseParameters
    reason: str = ""

    @property
    def exact(self) -> bool:
        """True if the regrouping has exact coefficients."""
        return not self.reason

    def base_expressions(self) -> dict[str, sympy.Expr]:
        """Each base parameter by name, in symbols of φ and of the lengths."""
        base, phi = self.regrouping, [sympy.Symbol(name) for name in self.regrouping.parameters]
        return {
            base.parameters[k]: phi[k] + sum(c * phi[d] for c, d in zip(row, base.dependent, strict=True))
            for k, row in zip(base.kept, base.beta, strict=True)
        }


def derive(tree: Tree, lengths: dict[Symbol, float]) -> SymbolicModel:
    """The DIM of a mechanism whose poses and twists are symbols and exact numbers.

    Gravity acts along -Z of the base frame where parameters are regrouped.

    Args:
        tree: The mechanism, from `exact_tree`, `table_1` or `table_2`.
        lengths: Its symbols with their values, m.
    """
    coordinates, freedoms = sum(body.coordinates for body in tree.bodies), len(tree.freedoms)
    motion = Motion(_symbols("q", coordinates), _symbols("dq", freedoms), _symbols("ddq", freedoms))
    gravity = np.array([Symbol(f"g_{axis}") for axis in "xyz"])
    # Products of long fractions grow; decimals with spare digits do not.
    short = _each(lambda x: decimals(x, 20))
    bodies = [replace(body, home=short(body.home), twist=short(body.twist)) for body in tree.bodies]
    mechanism, Y = Mechanism(tree, gravity), dim.base_wrench_regressor(Mechanism(Tree(tuple(bodies)), gravity), motion)
    rounded = find_base_parameters(with_values(tree, lengths))
    base, reason = rounded, ""
    if len(lengths) > FEW and not _is_aligned(tree):
        reason = f"there are {len(lengths)} lengths and directions that are not along frame axes"
    elif (exact := exact_base_parameters(tree, list(lengths))).rank == rounded.rank:
        base = exact
    else:
        reason = "directions of this model coincide only to rounding"
    return SymbolicModel(mechanism, lengths, motion, Y, base, reason)


def decimals(x: sympy.Expr, digits: int) -> sympy.Expr:
    """An expression with long fractions and decimals rounded to some digits; whole ones become integers."""

    def rounded(number: sympy.Number) -> sympy.Number:
        value = number.evalf(digits)
        whole = sympy.Integer(int(value))
        return whole if abs(whole) < 10**digits and (value - whole).is_zero else value

    return sympy.sympify(x).replace(lambda part: part.is_Float or (part.is_Rational and part.q > 1000), rounded)


def exact_base_parameters(tree: Tree, lengths: list[Symbol]) -> BaseParameters:
    """Regrouping without rounding: the structure over the field of rational functions of the lengths.

    Args:
        tree: A mechanism of symbols and exact numbers.
        lengths: All its symbols.

    Returns:
        The regrouping; `beta` holds expressions.
    """
    field = sympy.QQ.frac_field(*lengths) if lengths else sympy.QQ
    in_field = _each(lambda x: field.from_sympy(sympy.sympify(x)))
    bodies = [replace(body, home=in_field(body.home), twist=in_field(body.twist)) for body in tree.bodies]
    base = find_base_parameters(Tree(tuple(bodies)), gravity=in_field(np.array([0, 0, -1])))
    return replace(base, beta=_each(lambda x: field.to_sympy(field.convert(x)))(base.beta))


def table_1() -> tuple[Tree, dict[Symbol, float]]:
    """The double pendulum of Table I, with T and l_1 as symbols; their values are the scene's."""
    lengths = _lengths_of_the_tables()
    *base, length = lengths
    return _without_rounding(tree_of_table_1(np.array(base), length)), lengths


def table_2() -> tuple[Tree, dict[Symbol, float]]:
    """The double pendulum of Table II: home poses in the world, and twists about X."""
    lengths = _lengths_of_the_tables()
    T_x, T_y, T_z, length = lengths
    home = np.tile(np.eye(4, dtype=int).astype(object), (3, 1, 1))
    home[:, :3, 3] = [[T_x, T_y, T_z], [T_x, T_y, T_z], [T_x, T_y, T_z + length]]
    turn = np.array([0, 0, 0, 1, 0, 0])
    tree = Tree.from_home_poses(["Base", "Link 1", "Link 2"], home, np.stack([0 * turn, turn, turn]))
    return _without_rounding(tree), lengths


def _lengths_of_the_tables() -> dict[Symbol, float]:
    scene = drawing()
    values = (*scene.base, scene.tree.bodies[2].home[2, 3])
    return {Symbol(name): float(value) for name, value in zip(("T_x", "T_y", "T_z", "l_1"), values, strict=True)}


def with_values(tree: Tree, lengths: dict[Symbol, float]) -> Tree:
    """A symbolic mechanism with numbers for its symbols."""

    def values(x: np.ndarray) -> np.ndarray:
        return _each(lambda entry: float(sympy.sympify(entry).subs(lengths)))(x).astype(float)

    return Tree(tuple(replace(body, home=values(body.home), twist=values(body.twist)) for body in tree.bodies))


def exact_tree(tree: Tree) -> tuple[Tree, dict[Symbol, float]]:
    """A numeric mechanism with symbols for its lengths and exact numbers for its directions.

    Offsets of body i from its parent become `l{i}x`, `l{i}y`, `l{i}z`, offsets of its joint's axis from its frame
    `c{i}x`, …; zeros stay zeros. Directions along frame axes are whole numbers, others fractions within 1e-16 of the
    given ones that are exactly of unit length.

    Returns:
        The tree, and the value of each symbol.
    """
    lengths: dict[Symbol, float] = {}

    def offset(kind: str, vector: np.ndarray) -> np.ndarray:
        out = []
        for axis, value in zip("xyz", vector, strict=True):
            if abs(value) < ROUNDING:
                out.append(sympy.Integer(0))
                continue
            symbol = Symbol(f"{kind}{axis}")
            while symbol in lengths:
                symbol = Symbol(f"{symbol.name}_")
            lengths[symbol] = float(value)
            out.append(symbol)
        return np.array(out, dtype=object)

    bodies = []
    for i, body in enumerate(tree.bodies):
        number = 1 + sum(k < i for k in tree.inertial)
        home = np.array(sympy.eye(4))
        home[:3, :3] = _exact_rotation(body.home[:3, :3])
        home[:3, 3] = offset(f"l{number}", body.home[:3, 3])
        v, w = body.twist[:3], body.twist[3:]
        if body.is_ball:
            twist = ball_twist(offset(f"c{number}", np.array([v[2, 1], v[0, 2], v[1, 0]])))
        elif w.any():
            axis, pitch = _exact_direction(w), _exact_number(v @ w)
            twist = np.concatenate([np.cross(offset(f"c{number}", np.cross(w, v)), axis) + pitch * axis, axis])
        else:
            twist = np.concatenate([_exact_direction(v), np.zeros(3, dtype=int)])
        bodies.append(replace(body, home=home, twist=twist))
    return Tree(tuple(bodies)), lengths


def _exact_number(x: float) -> sympy.Rational:
    whole = round(float(x))
    return sympy.Integer(whole) if abs(x - whole) < ROUNDING else sympy.Rational(Fraction(float(x)))


def _fraction(x: float) -> sympy.Rational:
    """The fraction of at most nine digits below the bar that is next to a number, right to 1e-16 for usual ones."""
    return sympy.Rational(Fraction(float(x)).limit_denominator(10**9) if abs(x) > ROUNDING else 0)


def _exact_rotation(R: np.ndarray) -> np.ndarray:
    """A rotation matrix of whole numbers, or from a quaternion of fractions."""
    if np.abs(R - np.round(R)).max() < ROUNDING:
        return _each(_exact_number)(R)
    x, y, z, w = map(_fraction, Rotation.from_matrix(R).as_quat())
    quaternion = sympy.Quaternion(w, x, y, z)
    return np.array(quaternion.to_rotation_matrix())


def _exact_direction(u: np.ndarray) -> np.ndarray:
    """A unit vector of whole numbers, or of fractions by stereographic projection along an axis; zeros stay zeros."""
    if np.abs(u - np.round(u)).max() < ROUNDING:
        return _each(_exact_number)(u)
    pole = int(np.argmin(np.where(np.abs(u) > ROUNDING, np.abs(u), np.inf)))
    a, b = (_fraction(u[k] / (1 + u[pole])) for k in range(3) if k != pole)
    square = a**2 + b**2
    out = np.array([2 * a, 2 * b], dtype=object) / (1 + square)
    return np.insert(out, pole, (1 - square) / (1 + square))


def _is_aligned(tree: Tree) -> bool:
    """True if all axes are along axes of the frames, and these along one another."""
    directions = [np.concatenate([body.home[:3, :3].ravel(), body.motions[3:].ravel()]) for body in tree.bodies]
    return all(sympy.sympify(x).is_Integer for x in np.concatenate(directions))


def _symbols(name: str, count: int) -> np.ndarray:
    return np.array([Symbol(f"{name}{k}") for k in range(1, count + 1)], dtype=object)


def _each(function: Callable) -> Callable[[np.ndarray], np.ndarray]:
    """A function of arrays from a function of one entry."""
    return np.vectorize(function, otypes=[object])


def _without_rounding(tree: Tree) -> Tree:
    """A symbolic tree whose decimals, such as the cosine of a right angle, are replaced by exact numbers."""
    exact = _each(lambda x: sympy.expand(x).replace(lambda part: part.is_Float, _exact_number))
    return Tree(tuple(replace(body, home=exact(body.home), twist=exact(body.twist)) for body in tree.bodies))

"""Base parameters, the identifiable combinations of φ: rank, selection of independent columns, regrouping (Eq. 4)."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from ident.annotations import WORDS, typed
from ident.arguments import check_type, described
from ident.display.brief import Brief, listed
from ident.errors import InputError
from ident.geometry.inertia import parameter_names
from ident.geometry.se3 import Ad, exp
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.parameters import independent_columns
from ident.parameters.independent_columns import UnitColumns, unit_columns
from ident.parameters.structure import Sensors, sampled_structure, scaled_structure
from ident.tolerances import ROUNDING

STANDARD_GRAVITY = np.array([0.0, 0.0, -9.81])
"""Acceleration of gravity along -Z of the base frame, m/s²."""


@typed()
@dataclass(frozen=True, eq=False, repr=False)
class BaseParameters(Brief):
    """A regrouping `ψ = φ[kept] + beta φ[dependent]` with `Y φ = Y[:, kept] ψ`.

    Attributes:
        parameters: Names of all P entries of φ.
        kept: Indices of the r columns kept.
        dependent: Indices of the other P - r columns.
        beta: Coefficients of the dependent columns, `Y[:, dependent] = Y[:, kept] beta` (r, P - r).
        gap: Smallest singular value of the unit-norm columns that counts, and the largest taken for zero.
        passed_over: Names of columns that are independent of those before them, but so nearly dependent that rounding
            errors would be large; columns further right are kept instead. If this is empty and no names are pinned, the
            kept columns are the first independent ones, left to right.
    """

    parameters: tuple[str, ...]
    kept: tuple[int, ...]
    dependent: tuple[int, ...]
    beta: np.ndarray
    gap: tuple[float, float]
    passed_over: tuple[str, ...] = ()

    @property
    def rank(self) -> int:
        """Number of base parameters r."""
        return len(self.kept)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters, those of the kept columns."""
        return tuple(self.parameters[k] for k in self.kept)

    @property
    def unseen(self) -> tuple[str, ...]:
        """Names of the parameters with no effect on the wrench."""
        return tuple(
            self.parameters[d] for d, column in zip(self.dependent, self.beta.T, strict=True) if not column.any()
        )

    @property
    def remark(self) -> str:
        """A sentence on the columns passed over, empty if there are none."""
        later = "Later parameters are base parameters instead of these, which nearly depend on earlier ones"
        return f"{later}: {', '.join(self.passed_over)}." if self.passed_over else ""

    @property
    def _in_short(self) -> dict[str, object]:
        return {
            "rank": f"{self.rank} of {len(self.parameters)} parameters",
            "base parameters": listed(self.expressions(4), 6),
            "without effect": listed(self.unseen),
            "singular values": f"{self.gap[0]:.2g} counts, {self.gap[1]:.2g} is taken for zero",
        }

    @typed()
    def reduce(self, Y: np.ndarray) -> np.ndarray:
        """The kept columns of a regressor (…, P) -> (…, r)."""
        return self._of_all("Y", Y)[..., list(self.kept)]

    def _of_all(self, name: str, x: np.ndarray) -> np.ndarray:
        """An array of a name, checked to have an entry for each parameter in its last dimension (…, P)."""
        if np.shape(x)[-1:] != (len(self.parameters),):
            raise InputError(f"{name} needs {len(self.parameters)} columns, one for each parameter; got {np.shape(x)}.")
        return x

    @typed()
    def regroup(self, phi: np.ndarray) -> np.ndarray:
        """Base parameters ψ of a stacked φ (…, P) -> (…, r)."""
        phi = self._of_all("phi", np.asarray(phi))
        return phi[..., list(self.kept)] + phi[..., list(self.dependent)] @ self.beta.T

    def expressions(self, digits: int = 6) -> tuple[str, ...]:
        """Base parameters as readable sums, `m2rz2 + 0.425 m3`, without coefficients that are rounding errors.

        Args:
            digits: Significant digits of the coefficients.
        """
        others = [self.parameters[d] for d in self.dependent]
        return tuple(
            "".join([name, *(_term(c, other, digits) for c, other in zip(row, others, strict=True) if c != 0)])
            for name, row in zip(self.names, map(_without_rounding, self.beta), strict=True)
        )


@typed("source", "parameters", "kept", "gravity")
def find_base_parameters(
    source: Tree | Mechanism | np.ndarray,
    parameters: Sequence[str] | None = None,
    *,
    kept: Sequence[str] | None = None,
    gravity: np.ndarray = STANDARD_GRAVITY,
    sensors: Sensors | None = None,
) -> BaseParameters:
    """Base parameters of a mechanism, from its structure, or of a regressor, from its numbers (Eq. 4).

    The rank is that of the unit-norm columns, by singular values. The first independent columns, left to right, are
    kept, which is the rule of the paper's tables, unless a coefficient between unit-norm columns would exceed
    `COEFFICIENTS`: then a later column is kept instead of a nearly dependent one.

    Args:
        source: A mechanism, which needs no data and gives coefficients to rounding; or a regressor at well-spread
            states (…, P), with at least as many rows as its rank.
        parameters: Names of the P columns; by default `ident.geometry.inertia.parameter_names`.
        kept: Names to use as base parameters instead of the first independent ones, so that two models can be
            compared on the same set.
        gravity: For a tree alone: acceleration of gravity in the base frame, m/s² (3,).
        sensors: For a mechanism: the measurements, by default the base wrench of a base at rest.

    Returns:
        The regrouping. The error of its coefficients is rounding times the condition number of the kept columns: 1e-15
        if axes are at right angles, more in general positions, where the first independent columns are nearly
        dependent. Negligible coefficients are set to zero. Those of a tree of exact numbers (dtype object) are exact.

    Raises:
        InputError: The regressor is not finite or all zero, names do not fit its columns, a pinned name is unknown or
            the pinned set no basis, or the kept columns do not reproduce the others.
    """
    for where, given in (("parameters", parameters), ("kept", kept)):
        own = given.tolist() if isinstance(given, np.ndarray) else given
        if not isinstance(own, Collection | None) or not all(isinstance(name, str) for name in own or ()):
            raise InputError(f"{where} needs a list of names of parameters, got {described(given)}.")
    if isinstance(source, np.ndarray):
        return _of_columns(unit_columns(source), 1.0, _names(parameters, source.shape[-1]), kept)
    mechanism = Mechanism(source, gravity) if isinstance(source, Tree) else source
    check_type("source", mechanism, Mechanism, WORDS["Mechanism"])
    return _of_structure(mechanism, sensors, _names(parameters, 10 * len(mechanism.bodies)), kept)


def _of_structure(
    mechanism: Mechanism, sensors: Sensors | None, names: tuple[str, ...], kept: Sequence[str] | None
) -> BaseParameters:
    """Regrouping of a mechanism, exact if its numbers are."""
    if mechanism.tree.followers or mechanism.tree.closure:
        return _of_columns(unit_columns(sampled_structure(mechanism, sensors)), 1.0, names, kept)
    structure, units = scaled_structure(mechanism, sensors)
    if structure.is_exact:
        if kept is not None:
            raise InputError("Base parameters can be pinned for numbers, not for exact numbers or symbols.")
        reduced, chosen = independent_columns.reduced_rows(structure.matrix)
        others = np.setdiff1d(np.arange(len(names)), chosen).tolist()
        return BaseParameters(names, tuple(chosen), tuple(others), reduced[:, others], (np.inf, 0.0))
    rows = structure.matrix
    if not rows.any():
        raise InputError("These sensors see no parameter of this mechanism: nothing that has a mass moves.")
    return _of_columns(unit_columns(rows), units, names, kept)


def _of_columns(
    columns: UnitColumns, units: np.ndarray | float, names: tuple[str, ...], kept: Sequence[str] | None
) -> BaseParameters:
    """Regrouping of a regressor's columns, whose parameters are in the given units (P,)."""
    unit, norms, s = columns
    rank = independent_columns.numerical_rank(s)
    gap = float(s[rank - 1]) if rank else 0.0, float(s[rank]) if rank < len(s) else 0.0
    chosen, passed = independent_columns.first_independent(unit, rank, gap[1])
    if kept is not None:
        chosen, passed = independent_columns.basis(kept, names, unit, chosen), []
    others = np.setdiff1d(np.arange(len(names)), chosen).tolist()
    made = independent_columns.coefficients(unit[:, chosen], unit[:, others])
    missed = (abs(unit[:, others] - unit[:, chosen] @ made) * norms[others]).max(initial=0) / norms.max()
    if missed > ROUNDING + 10 * gap[1]:
        raise InputError(
            f"The {rank} columns {names[chosen[0]]} … {names[chosen[-1]]} are so nearly dependent that they make up "
            f"the others only to {missed:.0e} of the largest column, which is no regrouping."
        )
    sizes = norms * units
    beta = made * sizes[others] / sizes[chosen][:, None]
    return BaseParameters(names, tuple(chosen), tuple(others), beta, gap, tuple(names[k] for k in passed))


def _names(parameters: Sequence[str] | None, columns: int) -> tuple[str, ...]:
    """Names of a number of columns, the given ones or those of bodies' parameters."""
    names = tuple(parameter_names(columns // 10) if parameters is None else parameters)
    if columns != len(names):
        raise InputError(f"A regressor of {columns} columns needs as many names, got {len(names)}.")
    return names


def structural_base_parameters(
    mechanism: Mechanism, *, sensors: Sensors | None = None, kept: tuple[str, ...] | None = None
) -> BaseParameters:
    """`find_base_parameters` of a mechanism, cached by tree, gravity, sensors and pinned names."""
    return _structural(mechanism.tree, tuple(mechanism.gravity.tolist()), sensors, kept)


@lru_cache(maxsize=64)
def _structural(
    tree: Tree, gravity: tuple[float, ...], sensors: Sensors | None, kept: tuple[str, ...] | None
) -> BaseParameters:
    regrouping = find_base_parameters(tree, gravity=np.array(gravity), sensors=sensors, kept=kept)
    regrouping.beta.flags.writeable = False
    return regrouping


def separating_sensors(mechanism: Mechanism, sensors: Sensors | None = None) -> dict[str, tuple[str, ...]]:
    """Parameters that would become base parameters of their own with additional measurements.

    Args:
        mechanism: The mechanism.
        sensors: The present measurements, by default the base wrench of a base at rest.

    Returns:
        Names of the gained parameters by change: `with the base wrench`, `with joint torques`, `on a moving base`,
        `with joint axes that are not parallel`.
    """
    now, tree = sensors or Sensors(), mechanism.tree
    skewed = list(tree.bodies)
    for k, i in enumerate(tree.moving):
        if not skewed[i].is_ball:
            turn = exp(np.array([0.0, 0, 0, *np.roll([0.6, 0.64, 0.48], k)]), 0.3 + 0.1 * k)
            skewed[i] = replace(skewed[i], twist=Ad(turn) @ skewed[i].twist)
    others = {
        "with the base wrench": (mechanism, replace(now, base_wrench=True, channels=None)),
        "with joint torques": (mechanism, replace(now, joint_torques=True)),
        "on a moving base": (mechanism, replace(now, moving_base=True)),
    }
    if tree.closure is None:
        others["with joint axes that are not parallel"] = replace(mechanism, tree=Tree(tuple(skewed))), now
    names = structural_base_parameters(mechanism, sensors=now).names
    enlarged = {what: structural_base_parameters(m, sensors=s).names for what, (m, s) in others.items()}
    return {what: tuple(name for name in more if name not in names) for what, more in enlarged.items()}


def _without_rounding(row: np.ndarray) -> np.ndarray:
    """Coefficients of a base parameter, zero below `ROUNDING` times the largest (at least 1); exact ones unchanged."""
    if row.dtype == object:
        return row
    return np.where(abs(row) < ROUNDING * abs(row).max(initial=1.0), 0, row)


def _term(coefficient: float, name: str, digits: int) -> str:
    if not isinstance(coefficient, float):
        return f" + ({coefficient}) {name}"
    size = f"{abs(coefficient):.{digits}g}"
    return (" - " if coefficient < 0 else " + ") + (name if size == "1" else f"{size} {name}")

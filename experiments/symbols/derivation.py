"""Derivation of a mechanism's symbolic model from its name or model file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.symbols import codegen, symbolic
from ident.errors import InputError, ModelError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import STANDARD_GRAVITY, separating_sensors
from sim.models.mechanism import mechanism

TABLES = ("table_1", "table_2")


@dataclass(frozen=True, eq=False)
class Derivation:
    """A mechanism's symbolic model.

    Attributes:
        name: Name of the mechanism, for files and titles.
        model: The model.
        gained: Parameters that more sensors would make identifiable separately, by sensors.
    """

    name: str
    model: symbolic.SymbolicModel
    gained: Mapping[str, Sequence[str]]


def derivation(given: str, base: str | None, ignore: Sequence[str]) -> Derivation:
    """Symbolic model of a mechanism.

    Args:
        given: Model file, or one of `TABLES`.
        base: Body whose frame is {0}, by default the world.
        ignore: Equality constraints and tendons to leave out.

    Raises:
        InputError: The model cannot be read, or a table is given options.
    """
    name = codegen.plain(Path(given).stem)
    if given not in TABLES:
        tree, lengths = symbolic.exact_tree(_tree(given, base, ignore))
    elif base is None and not ignore:
        tree, lengths = getattr(symbolic, given)()
    else:
        raise InputError(f"The options --base and --ignore need an MJCF or URDF file, got '{given}'.")
    gained = separating_sensors(Mechanism(symbolic.with_values(tree, lengths), STANDARD_GRAVITY))
    return Derivation(name if name.strip(". ") else "model", symbolic.derive(tree, lengths), gained)


def _tree(path: str, base: str | None, ignore: Sequence[str]) -> Tree:
    """The mechanism of a model file, which must have mass."""
    arm = mechanism(path, base, ignore=ignore)
    if arm.prior is None:
        raise ModelError(f"A mechanism needs mass; {', '.join(arm.bodies)} have none.")
    return arm.tree

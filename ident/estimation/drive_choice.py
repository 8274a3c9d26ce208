"""Drives that are fitted by default, and those that links take up."""

from collections.abc import Sequence

from ident.mechanism.mechanism import Mechanism
from ident.model.axes import Axes
from ident.model.stated import stated_values
from ident.tolerances import DRIVE, USUAL_DRIVE


def drives_of(axes: Axes, kinds: Sequence[str], torques: Sequence[int]) -> tuple[str, ...]:
    """Names of the columns of some kinds of drives that act on the freedoms whose torques are measured.

    Args:
        axes: Axes on which drives act.
        kinds: The kinds, out of `DRIVE`.
        torques: Indices of those freedoms.
    """
    each = (f"{DRIVE[kind]}({name})" for kind in kinds for k in torques for name in axes.acting(kind, k))
    return tuple(dict.fromkeys(each))


def usual_drives(mechanism: Mechanism, torques: Sequence[int], axes: Axes | None = None) -> tuple[str, ...]:
    """Names of the columns that are fitted by default: rotor inertia and friction, and springs that the model has.

    Args:
        mechanism: The mechanism.
        torques: Indices of the freedoms whose torques are measured.
        axes: Axes on which drives act, by default the freedoms alone.
    """
    axes = Axes.of(mechanism.tree) if axes is None else axes
    freedoms = [mechanism.tree.freedoms[k] for k in torques]
    hinges = [name for name in freedoms if name in mechanism.tree.joints and name in mechanism.drives]
    springs = [name for name in hinges if mechanism.drives[name].stiffness]
    return (*drives_of(axes, USUAL_DRIVE, torques), *(f"{DRIVE['spring']}({name})" for name in springs))


def absorbed_note(mechanism: Mechanism, lost: Sequence[str], mixed: Sequence[str] = ()) -> str:
    """Note on drives whose columns depend on those of the links, and of the mixed drives of other motors."""
    beside = f" and from {', '.join(mixed)}" if mixed else ""
    note = f"{', '.join(lost)} cannot be told from the links' inertias{beside}, which take them up"
    if not (stated := [name for name, value in zip(lost, stated_values(mechanism, lost), strict=True) if value]):
        return f"{note}."
    return f"{note}; bodies are computed with the model's {', '.join(stated)}."

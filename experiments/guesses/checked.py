"""Checks of beliefs on the log against the model: units, signs and axes of wrenches, and gains of torques."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from experiments.guesses.belief import DOUBTFUL, Belief, Entry, Group
from experiments.guesses.gains import set_gains
from experiments.guesses.log_contents import LogContents
from experiments.guesses.orientations import BASE
from experiments.guesses.sensors import set_turn, set_unit
from experiments.guesses.units import is_current
from experiments.guesses.words import words
from experiments.guesses.wrenches import is_doubtful
from experiments.guesses.written import toml_text
from ident.errors import InputError
from ident.estimation.equations import COMPONENTS
from ident.estimation.loads import predicted_channels
from ident.estimation.preparation import Prepared, prepared
from ident.files.column import CURRENT
from ident.judgement.checks import wrench_checks
from ident.judgement.gravity import recorded_gravity
from ident.mechanism.mechanism import Mechanism
from ident.recordings.log import read_log
from ident.recordings.wrench import GROUND

FAR_OFF = 0.3
"""Relative error of a wrench against the model's prediction above which a note says so."""


def check_wrenches_and_torques(
    belief: Belief, contents: LogContents, mechanism: Mechanism, limit: int, *, axes: bool
) -> None:
    """Reads the log by the belief, and sets units, signs, axes and gains of wrenches and torques by the model.

    Args:
        belief: The belief; units, signs and axes of wrenches and gains of torques are set.
        contents: The log.
        mechanism: The mechanism, with a prior.
        limit: Bytes that an archive may take in memory.
        axes: True if signs and axes of wrenches are checked.
    """
    # A sensor between bodies measures no contact.
    outer = {name: group for name, group in belief.groups.items() if not (group.is_inner or is_doubtful(group))}
    belief = replace(belief, groups=outer)
    if not (belief.groups or belief.of("torque")):
        return
    try:
        log = _tried(belief, contents, mechanism, limit)
        if belief.groups and np.isfinite(log.wrench).any():
            if _set_units(belief, contents, log):
                log = _tried(belief, contents, mechanism, limit)
            if axes:
                _set_axes(belief, log)
        set_gains(belief, contents, log)
    except InputError as error:
        belief.notes.append(f"Units, signs and gains could not be checked against the model: {error}")
        for quantity in belief.of("torque").values():
            if is_current(quantity):
                quantity.sure = DOUBTFUL
                quantity.why.append("a current needs a gain")


def mounted(belief: Belief, contents: LogContents, mechanism: Mechanism, limit: int) -> Mechanism:
    """The mechanism on a base in the orientation that the log shows, if that explains far more than the model's.

    It comes before any signs, which gravity in another direction would turn.
    """
    if mechanism.base_rpy_deg is not None or BASE in belief.poses:
        return mechanism
    try:
        check = recorded_gravity(_tried(belief, contents, mechanism, limit))
    except InputError:
        return mechanism
    if check is None or not check.suspicious:
        return mechanism
    why = f"gravity: the model leaves {100 * check.misfit:.0f} % unexplained then, as it is {100 * check.stated:.0f} %"
    belief.poses[BASE] = Group(BASE, {"rpy_deg": Entry(list(check.rpy_deg), why)})
    return mechanism.mounted(check.rpy_deg)


def _tried(belief: Belief, contents: LogContents, mechanism: Mechanism, limit: int) -> Prepared:
    """The log, read by the belief."""
    for quantity in belief.of("torque").values():
        if is_current(quantity):
            quantity.unit = words(quantity.column).unit if words(quantity.column).unit in CURRENT else "A"
    with TemporaryDirectory() as folder:
        columns = Path(folder, "columns.toml")
        columns.write_text(toml_text(contents, belief, mechanism.tree.joints), encoding="utf-8")
        recording = read_log(contents.path, mechanism, columns, gaps=True, limit=limit)
    return prepared(mechanism, recording, cutoff="auto", name=str(contents.path))


def _set_units(belief: Belief, contents: LogContents, log: Prepared) -> bool:
    """Sets unknown units of forces and moments by their size, and returns True if one is not the SI unit."""
    predicted = predicted_channels(log.mechanism, log.samples.motion, log.frame)
    there = np.stack([predicted[c] for c in COMPONENTS], axis=1)
    changed = False
    for kind, part in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        measured = log.wrench[:, part]
        measured, size = measured[:, np.isfinite(measured).all(axis=0)], float(np.sqrt((there[:, part] ** 2).mean()))
        if measured.size and size:
            ratio = float(np.sqrt((measured**2).sum(axis=1).mean() / 3)) / size
            changed |= set_unit(belief, contents, list(belief.groups.values()), kind, ratio)
    return changed


def _set_axes(belief: Belief, log: Prepared) -> None:
    """Sets signs and right-angled turns of wrenches with which they are far closer to the predictions."""
    checks, base = wrench_checks(log)
    if base is not None and base.suspicious:
        belief.notes.append(
            f"The ground's wrench fits far better in the frame of '{base.body}' (--base {base.body}): an error of "
            f"{100 * base.error_there:.0f} % rather than {100 * base.error:.0f} % of what the model predicts."
        )
        return
    for name, check in checks.items():
        entries = belief.groups[name].entries if name in belief.groups else {}
        if check.mirrored and entries:
            _mirror(entries, check.mirrored)
            continue
        if not entries or not check.suspicious:
            if entries and check.error > FAR_OFF:
                belief.notes.append(
                    f"The wrench '{name}' is off by {100 * check.error:.0f} % of what the model predicts, and no other "
                    "sign or right-angled turn is far better; see where its sensor is, and what else acts."
                )
            elif first := entries.get("force") or entries.get("torque"):
                first.why += f"; sign and axes as the model has them ({100 * check.error:.0f} % off)"
            continue
        frame = "base" if name == GROUND else "body"
        why = f"{100 * check.error_turned:.0f} % of the prediction is off then, as it stands {100 * check.error:.0f} %"
        set_turn(belief.groups[name], check.rotation, frame, why, opposite=check.sign < 0)


def _mirror(entries: dict[str, Entry], components: Sequence[str]) -> None:
    """Gives columns of components that have the opposite sign alone a gain of -1."""
    for key, part in (("force", COMPONENTS[:3]), ("torque", COMPONENTS[3:]), ("free_moment", COMPONENTS[3:])):
        if key in entries and set(components) & set(part):
            names = zip(entries[key].value, part, strict=True)
            mirrored = [{"column": name, "gain": -1.0} if own in components and name else name for name, own in names]
            why = f"{', '.join(c for c in part if c in components)} mirrored, as the model predicts the opposite sign"
            entries[key] = Entry(mirrored, f"{entries[key].why}; {why}")

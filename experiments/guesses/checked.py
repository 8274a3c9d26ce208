"""Checks of beliefs on the log against the model: units, signs and axes of wrenches, and gains of torques."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.guesses.belief import DOUBTFUL, Belief, Entry
from experiments.guesses.gains import set_gains
from experiments.guesses.joints import is_current
from experiments.guesses.log_contents import LogContents
from experiments.guesses.words import words
from experiments.guesses.written import toml_text
from ident.errors import InputError
from ident.estimation.equations import COMPONENTS
from ident.estimation.loads import predicted_channels
from ident.estimation.preparation import Prepared, prepared
from ident.files.column import CURRENT
from ident.judgement.checks import wrench_checks
from ident.mechanism.mechanism import Mechanism
from ident.recordings.log import read_log
from ident.recordings.wrench import GROUND

FAR_OFF = 0.3
"""Relative error of a wrench against the model's prediction above which a note says so."""

HALF_WAY = np.sqrt(1000)
"""Largest ratio of sizes within one unit: the geometric mean of 1 and the next unit's factor of 1000."""


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
    for key, kind, part, choices in (
        ("unit", "force", slice(0, 3), {"N": 1.0, "kN": 1e-3}),
        ("torque_unit", "torque", slice(3, 6), {"N m": 1.0, "N mm": 1e3, "kN m": 1e-3}),
    ):
        measured = log.wrench[:, part]
        measured, size = measured[:, np.isfinite(measured).all(axis=0)], float(np.sqrt((there[:, part] ** 2).mean()))
        if not measured.size or size == 0:
            continue
        ratio = float(np.sqrt((measured**2).sum(axis=1).mean() / 3)) / size
        unit = min(choices, key=lambda u: abs(np.log(max(ratio, 1e-12) / choices[u])))
        if abs(np.log(max(ratio, 1e-12) / choices[unit])) > np.log(HALF_WAY):
            belief.notes.append(
                f"The {kind}s have {ratio:.2g} times the size in {next(iter(choices))} that the model predicts, "
                "which no other unit explains."
            )
            continue
        for group in belief.groups.values():
            columns = [name for k in (kind, "free_moment") if k in group.entries for name in group.entries[k].value]
            if key in group.entries or not any(columns) or any(name in contents.units for name in columns):
                continue
            why = f"in {unit} it has {ratio / choices[unit]:.2g} times the size that the model predicts"
            group.entries[key] = Entry(unit, why)
            changed = changed or choices[unit] != 1
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
        error = (
            f"{100 * check.error_turned:.0f} % of the prediction is off then, as it stands {100 * check.error:.0f} %"
        )
        if not entries or not check.suspicious:
            if entries and check.error > FAR_OFF:
                belief.notes.append(
                    f"The wrench '{name}' is off by {100 * check.error:.0f} % of what the model predicts, and no other "
                    "sign or right-angled turn is far better; see where its sensor is, and what else acts."
                )
            elif first := entries.get("force") or entries.get("torque"):
                first.why += f"; sign and axes as the model has them ({100 * check.error:.0f} % off)"
            continue
        if check.sign < 0:
            entries["applied_to_link"] = Entry(False, f"the opposite sign: {error}")
        if not np.array_equal(check.rotation, np.eye(3)):
            # A frame that is not turned states no angles; others are multiples of 90°.
            angles = Rotation.from_matrix(check.rotation).as_euler("xyz", degrees=True).round(9) + 0.0
            entries["rpy_deg"] = Entry(angles.tolist(), f"its axes in those of the {_frame(name)}: {error}")
            if "frame" in entries:
                entries["frame"] = Entry("plate", "axes other than the world's")
                entries["position"] = Entry([0, 0, 0], "the world's origin")


def _frame(name: str) -> str:
    return "base" if name == GROUND else "body"

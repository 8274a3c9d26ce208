"""Beliefs held against the model: units of angles and wrenches, signs, turned axes, and gains of motors."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.guesses.belief import DOUBTFUL, LIKELY, Belief, Entry, Quantity
from experiments.guesses.joints import is_current, position
from experiments.guesses.predicted import curves, prediction, unexplained
from experiments.guesses.seen import Seen
from experiments.guesses.words import unit_of, words
from experiments.guesses.written import toml_text
from ident.errors import InputError
from ident.estimation.equations import COMPONENTS
from ident.estimation.loads import SLIP
from ident.estimation.preparation import Prepared, predicted_channels, prepared
from ident.judgement.checks import wrench_checks
from ident.judgement.torque_checks import ALIKE, SCALE
from ident.mechanism.mechanism import Mechanism
from ident.recordings.column import CURRENT
from ident.recordings.log import read_log
from ident.recordings.wrench import GROUND

BETTER, FAR_BETTER = 0.7, 0.5
"""What another unit, and another sign, has to leave unexplained at most, over what there is without."""

FAR_OFF = 0.3
"""Error of a wrench, over what the model predicts, that is worth a word."""

HALF_WAY = np.sqrt(1000)
"""Factor up to which sizes of wrenches are in the same unit: half way to the next."""


EXPLAINED = 0.02
"""What may be left unexplained without a doubt about signs."""


class Left(NamedTuple):
    """Shares of variances that the model leaves unexplained.

    Attributes:
        somehow: Whatever the axes, signs and units of wrenches are.
        straight: With wrenches in the axes that they are said to be in.
    """

    somehow: float
    straight: float


def check_positions(
    belief: Belief, seen: Seen, mechanism: Mechanism, kinds: Mapping[str, str], small: Sequence[str]
) -> bool:
    """Holds units and signs of joints against wrenches and torques, whatever the units and axes of those are.

    Args:
        belief: What is believed.
        seen: The log.
        mechanism: The mechanism.
        kinds: Whether each joint is a `hinge` or a `slide`.
        small: Joints whose angles may be radians or degrees.

    Returns:
        Whether no sign is open, which turned axes of wrenches cannot be told from.
    """
    joints = [joint for joint in kinds if position(belief, seen, kinds, joint) is not None]
    if len(joints) < len(kinds) or mechanism.prior is None:
        return True
    found = belief.of("position")
    low = curves(seen, [found[joint].column for joint in joints])
    states = {}
    for joint in joints:
        x, raw = position(belief, seen, kinds, joint), seen.columns[found[joint].column]
        assert x is not None
        states[joint] = low.states[found[joint].column] * (np.abs(x).max() / np.abs(raw).max())

    def left(factors: Mapping[str, float]) -> Left | None:
        return _left(belief, low.levels, mechanism, {j: x * factors.get(j, 1.0) for j, x in states.items()})

    here = left({})
    if here is None:
        return True
    if small:
        there = left(dict.fromkeys(small, np.pi / 180))
        if there is not None and there.somehow < BETTER * here.somehow:
            for joint in small:
                found[joint].unit = "deg"
                states[joint] = states[joint] * np.pi / 180
                shares = f"{_percent(there.somehow)} then, in rad {_percent(here.somehow)}"
                found[joint].why.append(f"deg since the model explains {shares}")
            here = there
    return _turn(belief, joints, left, here)


def _turn(
    belief: Belief, joints: Sequence[str], left: Callable[[Mapping[str, float]], Left | None], here: Left
) -> bool:
    """Turns joints around whose opposite sign explains far more, one after the other; where two do, neither is told.

    Args:
        belief: What is believed.
        joints: The joints.
        left: What is left unexplained with factors on some positions.
        here: The same with none.

    Returns:
        Whether no sign is open.
    """
    found = belief.of("position")
    turned: dict[str, float] = {}
    while here.somehow > EXPLAINED:
        ways = {joint: way for joint in joints if (way := left({**turned, joint: -turned.get(joint, 1.0)})) is not None}
        good = [joint for joint in ways if ways[joint].somehow < FAR_BETTER * here.somehow]
        # The mirror image of a motion goes with a plate that is turned by 180°; a plate as it is, is likelier.
        good.sort(key=lambda joint: (ways[joint].straight, ways[joint].somehow))
        if not good:
            return True
        if len(good) > 1 and ways[good[0]].straight > FAR_BETTER * ways[good[1]].straight:
            belief.open.append(
                f"One of {', '.join(good)} has the opposite sign, which of them depends on how the wrench's axes are "
                "turned: gain = -1 in its position."
            )
            return False
        joint, before = good[0], here
        here, turned[joint] = ways[joint], -turned.get(joint, 1.0)
        found[joint].gain = turned[joint]
        found[joint].why.append(
            f"turned, since the model explains {_percent(here.somehow)} then, else {_percent(before.somehow)}"
        )
    return True


def _percent(left: float) -> str:
    return f"{100 * (1 - left):.0f} %"


def _left(
    belief: Belief, levels: Mapping[str, np.ndarray], mechanism: Mechanism, states: Mapping[str, np.ndarray]
) -> Left | None:
    """What the model leaves unexplained of wrenches and torques, on average; None where there are none."""
    predicted = prediction(mechanism, list(states.values()))
    wrench = [predicted[c] for c in COMPONENTS]
    shares = []
    for key, basis, part in (("force", wrench[:3], wrench[:3]), ("torque", wrench, wrench[3:])):
        groups = [group for group in belief.groups.values() if key in group.entries]
        listed = [[levels.get(name, 0 * wrench[0]) for name in group.entries[key].value] for group in groups]
        total = np.sum(listed, axis=0).T if listed else np.empty((0, 0))
        if total.size and np.ptp(total, axis=0).any():
            shares.append((unexplained(total, basis), _beside_own(total, part)))
    for joint, found in belief.of("torque").items():
        if found.column in levels:
            dq = states[joint][1]
            rows = np.stack([np.ones_like(dq), dq, np.tanh(dq / SLIP)], axis=1)
            own = levels[found.column] - rows @ np.linalg.lstsq(rows, levels[found.column], rcond=1e-8)[0]
            share = unexplained(own[:, None], [predicted[joint], dq, rows[:, 2]])
            shares.append((share, share))
    return Left(*np.mean(shares, axis=0).tolist()) if shares else None


def _beside_own(measured: np.ndarray, predicted: Sequence[np.ndarray]) -> float:
    """Share of the variance of components (M, 3) that remains beside their own predictions, with one positive gain."""
    x, y = np.stack(predicted, axis=1), measured - measured.mean(axis=0)
    x = x - x.mean(axis=0)
    gain = max(float((x * y).sum()), 0.0) / max(float((x * x).sum()), 1e-300)
    return float(((y - gain * x) ** 2).sum() / (y**2).sum())


def check_wrenches_and_torques(belief: Belief, seen: Seen, mechanism: Mechanism, limit: int, *, axes: bool) -> None:
    """Reads the log by what is believed, and sets what the model tells of wrenches and torques.

    Args:
        belief: What is believed; units, signs and axes of wrenches and gains of torques are set.
        seen: The log.
        mechanism: The mechanism, with a prior.
        limit: Bytes that an archive may take in memory.
        axes: Whether signs and axes of wrenches are looked at.
    """
    try:
        log = _tried(belief, seen, mechanism, limit)
        if belief.groups and np.isfinite(log.wrench).any():
            if _set_units(belief, seen, log):
                log = _tried(belief, seen, mechanism, limit)
            if axes:
                _set_axes(belief, log)
        _set_gains(belief, seen, log)
    except InputError as error:
        belief.notes.append(f"Units, signs and gains could not be held against the model: {error}")
        for found in belief.of("torque").values():
            if is_current(found):
                found.sure = DOUBTFUL
                found.why.append("a current needs a gain")


def _tried(belief: Belief, seen: Seen, mechanism: Mechanism, limit: int) -> Prepared:
    """The log as it reads by what is believed."""
    for found in belief.of("torque").values():
        if is_current(found):
            found.unit = words(found.column).unit if words(found.column).unit in CURRENT else "A"
    with TemporaryDirectory() as folder:
        columns = Path(folder, "columns.toml")
        columns.write_text(toml_text(seen, belief, mechanism.tree.joints), encoding="utf-8")
        recording = read_log(seen.path, mechanism, columns, gaps=True, limit=limit)
    return prepared(mechanism, recording, cutoff="auto", name=str(seen.path))


def _set_units(belief: Belief, seen: Seen, log: Prepared) -> bool:
    """Sets units of forces and moments that nothing else told, by their size; whether one is another than the SI's."""
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
        beyond = abs(np.log(max(ratio, 1e-12) / choices[unit])) > np.log(HALF_WAY)
        for group in belief.groups.values():
            columns = [name for k in (kind, "free_moment") if k in group.entries for name in group.entries[k].value]
            if key in group.entries or not any(columns) or any(name in seen.units for name in columns):
                continue
            why = f"in {unit} it has {ratio / choices[unit]:.2g} times the size that the model predicts"
            group.entries[key] = Entry(unit, why + (", so doubt it" if beyond else ""), LIKELY)
            changed = changed or choices[unit] != 1
    return changed


def _set_axes(belief: Belief, log: Prepared) -> None:
    """Sets signs and right-angled turns of wrenches with which they look far more like what the model predicts."""
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
            # Others than multiples of 90° are not asked of a frame that is not turned.
            angles = Rotation.from_matrix(check.rotation).as_euler("xyz", degrees=True).round(9) + 0.0
            entries["rpy_deg"] = Entry(angles.tolist(), f"its axes in those of the {_frame(name)}: {error}")
            if "frame" in entries:
                entries["frame"] = Entry("plate", "axes other than the world's")
                entries["position"] = Entry([0, 0, 0], "the world's origin")


def _frame(name: str) -> str:
    return "base" if name == GROUND else "body"


def _set_gains(belief: Belief, seen: Seen, log: Prepared) -> None:
    """Sets gains, units and signs of joint torques by regression on those that the model predicts."""
    felt, found = log.equations.torques, belief.of("torque")
    if not felt:
        return
    predicted = predicted_channels(log.mechanism, log.samples.motion, log.frame, torques=True)
    whole = slice(log.edge, len(log.samples) - log.edge)
    for column, k in enumerate(felt, start=len(log.equations.channels) - len(felt)):
        joint, motion = log.mechanism.tree.freedoms[k], log.samples.motion
        if joint not in found:
            continue
        dq, ddq = motion.dq[whole, k], motion.ddq[whole, k]
        gain, deviation, alike = _gain(log.samples.measured[whole, column], predicted[joint][whole], dq, ddq)
        _set_gain(found[joint], gain, deviation, alike, joint_has_unit=found[joint].column in seen.units)


def _set_gain(found: Quantity, gain: float, deviation: float, alike: float, *, joint_has_unit: bool) -> None:
    """Sets what makes a column the model's torque, where they are alike."""
    explained = f"beside friction and rotor the model explains {100 * alike:.0f} % of it"
    said = unit_of("hinge torque", words(found.column).unit)
    if is_current(found):
        found.why.append(explained)
        if alike > ALIKE:
            found.gain = float(f"{gain:.4g}")
            found.why.append(
                f"{gain:.4g} ± {deviation:.1g} N m/A by the model's torque, so that masses found are "
                "no better than it: put the data sheet's here"
            )
        else:
            found.sure = DOUBTFUL
        return
    found.unit = "" if joint_has_unit else said or "N m"
    scale = {"N mm": 1e-3, "kN m": 1e3}.get(found.unit, 1.0)
    # The log was read as N m, unless the unit was there already.
    ratio = gain / scale
    found.why.append(explained)
    if alike <= ALIKE:
        found.why.append("sign and gain are not to be told")
    elif 1 / SCALE < abs(ratio) < SCALE:
        found.gain = float(np.sign(ratio))
        found.why.append(f"the model's torque is {ratio:.3g} ± {deviation / scale:.1g} times as large")
    elif not said and not joint_has_unit and 1 / SCALE < abs(ratio) * 1e3 < SCALE:
        found.unit, found.gain = "N mm", float(np.sign(ratio))
        found.why.append("N mm by its size")
    else:
        found.gain = float(f"{ratio:.4g}")
        found.why.append(f"a gain (a gear?) of {ratio:.4g} ± {deviation / scale:.1g} by the model's torque")


def _gain(measured: np.ndarray, predicted: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> tuple[float, float, float]:
    """What a column is to be multiplied by to be the predicted torque, its deviation, and the share explained.

    `predicted = gain · measured + offset + friction + rotor`, least squares (N,). Residuals that are correlated from
    sample to sample by ρ count as `(1 - ρ) / (1 + ρ)` of their number.
    """
    rows = np.stack([np.ones_like(dq), dq, np.tanh(dq / SLIP), ddq], axis=1)
    rows = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    x, y = (v - rows @ np.linalg.lstsq(rows, v, rcond=1e-10)[0] for v in (measured, predicted))
    power, other = max(float(x @ x), 1e-300), max(float(y @ y), 1e-300)
    gain = float(x @ y) / power
    residual = y - gain * x
    own = max(float(residual @ residual), 1e-300)
    rho = float(np.clip(residual[1:] @ residual[:-1] / own, 0, 0.999))
    number = max((len(x) - rows.shape[1] - 1) * (1 - rho) / (1 + rho), 1.0)
    return gain, float(np.sqrt(own / number / power)), gain**2 * power / other

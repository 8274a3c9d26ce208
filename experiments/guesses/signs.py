"""Units and signs of joints, by the share of wrenches and torques that the model explains with them."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from experiments.guesses.belief import DOUBTFUL, LIKELY, Belief
from experiments.guesses.joints import factor, position
from experiments.guesses.log_contents import LogContents
from experiments.guesses.predicted import beside_friction, curves, explained, prediction, unexplained
from ident.estimation.equations import COMPONENTS
from ident.mechanism.mechanism import Mechanism

BETTER, FAR_BETTER = 0.7, 0.5
"""Largest ratios of unexplained shares, with over without, to accept another unit and another sign."""

EXPLAINED = 0.02
"""Unexplained share below which signs are not doubted."""


TURNS_OF_A_JOINT = 60.0
"""Largest angle of a joint that is plausible in radians: about ten turns."""

ENOUGH, LITTLE = 0.5, 0.1
"""Shares of wrenches and torques that the model has to explain with columns assigned only by their place, and with
others. Torques of arms are explained to less than half with columns of other joints, to eight tenths or more with the
right ones, even if masses are wrong by a factor of two. For columns with names the model may be worse."""


class Left(NamedTuple):
    """Shares of variances that the model leaves unexplained.

    Attributes:
        somehow: With free axes, signs and units of wrenches.
        straight: With wrenches in their stated axes.
    """

    somehow: float
    straight: float


def check_positions(
    belief: Belief, contents: LogContents, mechanism: Mechanism, kinds: Mapping[str, str], by_size: Sequence[str]
) -> bool:
    """Checks units and signs of joints against wrenches and torques, independent of the units and axes of these.

    Likely columns that explain next to nothing become doubtful.

    Args:
        belief: The belief.
        contents: The log.
        mechanism: The mechanism.
        kinds: `hinge` or `slide` for each joint.
        by_size: Joints whose unit was chosen by size alone.

    Returns:
        True if no sign is open; an open one is indistinguishable from turned axes of a wrench.
    """
    joints = [joint for joint in kinds if position(belief, contents, kinds, joint) is not None]
    if not joints or belief.undecided or mechanism.prior is None:
        return True
    positions = belief.of("position")
    low = curves(contents, [positions[joint].column for joint in joints])
    # Joints that are not in the log, or constant, rest.
    states = {joint: np.zeros((3, low.size)) for joint in kinds}
    for x in positions.values():
        if x.joint in states and x.column in contents.constant:
            states[x.joint][0] = contents.constant[x.column] * factor(contents, x, kinds)
    for x in (positions[joint] for joint in joints):
        states[x.joint] = low.states[x.column] * x.gain * factor(contents, x, kinds)

    def left(factors: Mapping[str, float]) -> Left | None:
        return _left(belief, low.levels, mechanism, {j: x * factors.get(j, 1.0) for j, x in states.items()})

    here = left({})
    if here is None:
        return True
    if by_size:
        here = _other_unit(belief, contents, states, by_size, left, here)
    no_sign_is_open, here = _turn(belief, joints, left, here)
    if no_sign_is_open:
        _doubt(belief, here.somehow)
    return no_sign_is_open


def _other_unit(
    belief: Belief,
    contents: LogContents,
    states: dict[str, np.ndarray],
    by_size: Sequence[str],
    left: Callable[[Mapping[str, float]], Left | None],
    here: Left,
) -> Left:
    """Exchanges radians and degrees if the model explains far more then; returns the shares left unexplained."""
    positions = belief.of("position")
    # A program has one unit for all angles.
    unit = positions[by_size[0]].unit
    other, scale = ("deg", np.pi / 180) if unit == "rad" else ("rad", 180 / np.pi)
    largest = max(float(np.abs(contents.columns[positions[joint].column]).max()) for joint in by_size)
    there = left(dict.fromkeys(by_size, scale)) if other == "deg" or largest < TURNS_OF_A_JOINT else None
    if there is None or there.somehow > BETTER * here.somehow:
        return here
    for joint in by_size:
        positions[joint].unit = other
        states[joint] = states[joint] * scale
        shares = f"{explained(there.somehow)} then, in {unit} {explained(here.somehow)}"
        positions[joint].why.append(f"{other} since the model explains {shares}")
    return there


def _doubt(belief: Belief, left: float) -> None:
    """Makes likely positions doubtful if the model explains next to nothing, and adds a note if it explains little."""
    share = f"the model explains {explained(left)} of the wrenches and torques"
    likely = [x for x in belief.of("position").values() if x.sure == LIKELY]
    if 1 - left >= ENOUGH:
        return
    if not likely or not (belief.by_place or 1 - left < LITTLE):
        belief.notes.append(f"With the columns that are named like positions {share}: see names, units and the model.")
        return
    listed = ", ".join(f"'{x.joint}' in {x.column}" for x in likely)
    belief.open.append(f"The positions may be {listed}, but {share} then, so that they stay remarks.")
    belief.undecided |= {x.joint for x in likely}
    for x in belief.quantities.values():
        if x.joint in belief.undecided and x.sure == LIKELY:
            x.sure = DOUBTFUL


def _turn(
    belief: Belief, joints: Sequence[str], left: Callable[[Mapping[str, float]], Left | None], here: Left
) -> tuple[bool, Left]:
    """Inverts joints whose opposite sign explains far more, one by one; if two do so equally, the sign stays open.

    Args:
        belief: The belief.
        joints: The joints.
        left: Function that returns the unexplained shares with factors on some positions.
        here: The unexplained shares without factors.

    Returns:
        True if no sign is open, and the unexplained shares.
    """
    positions = belief.of("position")
    turned: dict[str, float] = {}
    while here.somehow > EXPLAINED:
        ways = {joint: way for joint in joints if (way := left({**turned, joint: -turned.get(joint, 1.0)})) is not None}
        good = [joint for joint in ways if ways[joint].somehow < FAR_BETTER * here.somehow]
        # The mirror image of a motion fits a plate that is turned by 180°; a plate that is not turned is likelier.
        good.sort(key=lambda joint: (ways[joint].straight, ways[joint].somehow))
        if not good:
            return True, here
        if len(good) > 1 and ways[good[0]].straight > FAR_BETTER * ways[good[1]].straight:
            belief.open.append(
                f"One of {', '.join(sorted(good))} has the opposite sign, which of them depends on how the "
                "wrench's axes are turned: gain = -1 in its position."
            )
            return False, here
        joint, before = good[0], here
        here, turned[joint] = ways[joint], -turned.get(joint, 1.0)
        positions[joint].gain = turned[joint]
        positions[joint].why.append(
            f"turned, since the model explains {explained(here.somehow)} then, else {explained(before.somehow)}"
        )
    return True, here


def _left(
    belief: Belief, levels: Mapping[str, np.ndarray], mechanism: Mechanism, states: Mapping[str, np.ndarray]
) -> Left | None:
    """Unexplained shares of wrenches and torques, on average; None without any."""
    predicted = prediction(mechanism, list(states.values()))
    wrench = [predicted[c] for c in COMPONENTS]
    shares = []
    for key, basis, part in (("force", wrench[:3], wrench[:3]), ("torque", wrench, wrench[3:])):
        groups = [group for group in belief.groups.values() if key in group.entries]
        listed = [[levels.get(name, 0 * wrench[0]) for name in group.entries[key].value] for group in groups]
        total = np.sum(listed, axis=0).T if listed else np.empty((0, 0))
        if total.size and np.ptp(total, axis=0).any():
            shares.append((unexplained(total, basis), _beside_own(total, part)))
    for joint, quantity in belief.of("torque").items():
        if quantity.column in levels:
            share = beside_friction(states[joint], predicted[joint], levels[quantity.column])
            shares.append((share, share))
    return Left(*np.mean(shares, axis=0).tolist()) if shares else None


def _beside_own(measured: np.ndarray, predicted: Sequence[np.ndarray]) -> float:
    """Unexplained share of the variance of components (M, 3) by their own predictions, with one positive gain."""
    x, y = np.stack(predicted, axis=1), measured - measured.mean(axis=0)
    x = x - x.mean(axis=0)
    gain = max(float((x * y).sum()), 0.0) / max(float((x * x).sum()), 1e-300)
    return float(((y - gain * x) ** 2).sum() / (y**2).sum())

"""Units and signs of joints, by how much of wrenches and torques the model explains with them."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from experiments.guesses.belief import DOUBTFUL, LIKELY, Belief
from experiments.guesses.joints import factor, position
from experiments.guesses.predicted import beside_friction, curves, prediction, unexplained
from experiments.guesses.seen import Seen
from ident.estimation.equations import COMPONENTS
from ident.mechanism.mechanism import Mechanism

BETTER, FAR_BETTER = 0.7, 0.5
"""What another unit, and another sign, has to leave unexplained at most, over what there is without."""

EXPLAINED = 0.02
"""What may be left unexplained without a doubt about signs."""


TURNS_OF_A_JOINT = 60.0
"""Angles beyond it are no radians of a joint, which would be ten turns."""

ENOUGH, LITTLE = 0.5, 0.1
"""Shares of wrenches and torques that the model has to explain with columns that are believed by their place alone, and
with others. Torques of arms are explained to less than half with columns of other joints, to eight tenths or more with
the right ones, even if masses are wrong by a factor of two. What has a name may have a worse model."""


class Left(NamedTuple):
    """Shares of variances that the model leaves unexplained.

    Attributes:
        somehow: Whatever the axes, signs and units of wrenches are.
        straight: With wrenches in the axes that they are said to be in.
    """

    somehow: float
    straight: float


def check_positions(
    belief: Belief, seen: Seen, mechanism: Mechanism, kinds: Mapping[str, str], by_size: Sequence[str]
) -> bool:
    """Holds units and signs of joints against wrenches and torques, whatever the units and axes of those are.

    What is only likely and explains next to nothing is doubted.

    Args:
        belief: What is believed.
        seen: The log.
        mechanism: The mechanism.
        kinds: Whether each joint is a `hinge` or a `slide`.
        by_size: Joints whose size alone tells radians from degrees.

    Returns:
        Whether no sign is open, which turned axes of wrenches cannot be told from.
    """
    joints = [joint for joint in kinds if position(belief, seen, kinds, joint) is not None]
    if not joints or belief.undecided or mechanism.prior is None:
        return True
    found = belief.of("position")
    low = curves(seen, [found[joint].column for joint in joints])
    # What is not in the log, or never changes, rests.
    states = {joint: np.zeros((3, low.size)) for joint in kinds}
    for joint in kinds:
        if joint in found and found[joint].column in seen.constant:
            states[joint][0] = seen.constant[found[joint].column] * factor(seen, found[joint], kinds)
    for joint in joints:
        states[joint] = low.states[found[joint].column] * found[joint].gain * factor(seen, found[joint], kinds)

    def left(factors: Mapping[str, float]) -> Left | None:
        return _left(belief, low.levels, mechanism, {j: x * factors.get(j, 1.0) for j, x in states.items()})

    here = left({})
    if here is None:
        return True
    if by_size:
        here = _other_unit(belief, seen, states, by_size, left, here)
    no_sign_is_open, here = _turn(belief, joints, left, here)
    if no_sign_is_open:
        _doubt(belief, 1 - here.somehow)
    return no_sign_is_open


def _other_unit(
    belief: Belief,
    seen: Seen,
    states: dict[str, np.ndarray],
    by_size: Sequence[str],
    left: Callable[[Mapping[str, float]], Left | None],
    here: Left,
) -> Left:
    """Takes degrees for radians, or the reverse, where the model explains far more then; what is left."""
    found = belief.of("position")
    # A program has one unit for all angles.
    unit, other, scale = ("rad", "deg", np.pi / 180) if found[by_size[0]].unit == "rad" else ("deg", "rad", 180 / np.pi)
    largest = max(float(np.abs(seen.columns[found[joint].column]).max()) for joint in by_size)
    there = left(dict.fromkeys(by_size, scale)) if other == "deg" or largest < TURNS_OF_A_JOINT else None
    if there is None or there.somehow > BETTER * here.somehow:
        return here
    for joint in by_size:
        found[joint].unit = other
        states[joint] = states[joint] * scale
        shares = f"{_percent(there.somehow)} then, in {unit} {_percent(here.somehow)}"
        found[joint].why.append(f"{other} since the model explains {shares}")
    return there


def _doubt(belief: Belief, explained: float) -> None:
    """Doubts what is only likely where the model explains next to nothing, and says so where it explains little."""
    told = f"the model explains {100 * explained:.0f} % of the wrenches and torques"
    likely = [x for x in belief.of("position").values() if x.sure == LIKELY]
    if explained >= ENOUGH:
        return
    if not likely or not (belief.by_place or explained < LITTLE):
        belief.notes.append(f"With the columns that are named like positions {told}: see names, units and the model.")
        return
    listed = ", ".join(f"'{x.joint}' in {x.column}" for x in likely)
    belief.open.append(f"The positions may be {listed}, but {told} then, so that they stay remarks.")
    belief.undecided |= {x.joint for x in likely}
    for x in belief.quantities.values():
        if x.joint in belief.undecided and x.sure == LIKELY:
            x.sure = DOUBTFUL


def _turn(
    belief: Belief, joints: Sequence[str], left: Callable[[Mapping[str, float]], Left | None], here: Left
) -> tuple[bool, Left]:
    """Turns joints around whose opposite sign explains far more, one after the other; where two do, neither is told.

    Args:
        belief: What is believed.
        joints: The joints.
        left: What is left unexplained with factors on some positions.
        here: The same with none.

    Returns:
        Whether no sign is open, and what is left.
    """
    found = belief.of("position")
    turned: dict[str, float] = {}
    while here.somehow > EXPLAINED:
        ways = {joint: way for joint in joints if (way := left({**turned, joint: -turned.get(joint, 1.0)})) is not None}
        good = [joint for joint in ways if ways[joint].somehow < FAR_BETTER * here.somehow]
        # The mirror image of a motion goes with a plate that is turned by 180°; a plate as it is, is likelier.
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
        found[joint].gain = turned[joint]
        found[joint].why.append(
            f"turned, since the model explains {_percent(here.somehow)} then, else {_percent(before.somehow)}"
        )
    return True, here


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
            share = beside_friction(states[joint], predicted[joint], levels[found.column])
            shares.append((share, share))
    return Left(*np.mean(shares, axis=0).tolist()) if shares else None


def _beside_own(measured: np.ndarray, predicted: Sequence[np.ndarray]) -> float:
    """Share of the variance of components (M, 3) that remains beside their own predictions, with one positive gain."""
    x, y = np.stack(predicted, axis=1), measured - measured.mean(axis=0)
    x = x - x.mean(axis=0)
    gain = max(float((x * y).sum()), 0.0) / max(float((x * x).sum()), 1e-300)
    return float(((y - gain * x) ** 2).sum() / (y**2).sum())

"""Units and signs of joints, by the share of wrenches and torques that the model explains with them."""

from collections.abc import Mapping

import numpy as np

from experiments.guesses.belief import DOUBTFUL, LIKELY, Belief
from experiments.guesses.chosen import ENOUGH, LITTLE
from experiments.guesses.explained import Left, Model, explained

BETTER, FAR_BETTER = 0.7, 0.5
"""Largest ratios of unexplained shares, with over without, to accept another unit and another sign."""

EXPLAINED = 0.02
"""Unexplained share below which signs are not doubted."""

CLEARLY = 0.01
"""Difference of unexplained shares below which two units are a tie, whatever their ratio."""


def check_positions(model: Model, by_size: list[str]) -> bool:
    """Checks units and signs of joints against wrenches and torques, independent of the units and axes of these.

    Likely columns that explain next to nothing become doubtful.

    Args:
        model: The model beside the log, with the believed positions.
        by_size: Joints whose unit was chosen by size alone; cleared if the model shows it.

    Returns:
        True if no sign is open; an open one is indistinguishable from turned axes of a wrench.
    """
    here = model.left(model.states_of({}))
    if here is None:
        return True
    if by_size:
        here = _other_unit(model, by_size, here)
    no_sign_is_open, here = _turn(model, here)
    if no_sign_is_open:
        _doubt(model.belief, here.somehow)
    return no_sign_is_open


def _left(model: Model, factors: Mapping[str, float]) -> Left | None:
    """Unexplained shares with factors on some positions; None without any wrench and torque."""
    return model.left({joint: x * factors.get(joint, 1.0) for joint, x in model.states_of({}).items()})


def _other_unit(model: Model, by_size: list[str], here: Left) -> Left:
    """Exchanges radians and degrees if the model explains far more then; returns the shares left unexplained."""
    positions = model.belief.of("position")
    # A program has one unit for all angles.
    unit = positions[by_size[0]].unit
    other, scale = ("deg", np.pi / 180) if unit == "rad" else ("rad", 180 / np.pi)
    there = _left(model, dict.fromkeys(by_size, scale))
    if there is None or there.somehow > min(BETTER * here.somehow, here.somehow - CLEARLY):
        if there is not None and here.somehow < min(BETTER * there.somehow, there.somehow - CLEARLY, 1 - ENOUGH):
            by_size.clear()
        return here
    for joint in by_size:
        positions[joint].unit = other
        shares = f"{explained(there.somehow)} then, in {unit} {explained(here.somehow)}"
        positions[joint].why.append(f"{other} since the model explains {shares}")
    by_size.clear()
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


def _turn(model: Model, here: Left) -> tuple[bool, Left]:
    """Inverts joints whose opposite sign explains far more, one by one; if two do so equally, the sign stays open.

    Returns:
        True if no sign is open, and the unexplained shares.
    """
    positions = {j: x for j, x in model.belief.of("position").items() if x.column in model.states}
    while here.somehow > EXPLAINED:
        ways = {joint: way for joint in positions if (way := _left(model, {joint: -1.0})) is not None}
        good = [joint for joint in ways if ways[joint].somehow < FAR_BETTER * here.somehow]
        # The mirror image of a motion fits a plate that is turned by 180°; a plate that is not turned is likelier.
        good.sort(key=lambda joint: (ways[joint].straight, ways[joint].somehow))
        if not good:
            return True, here
        if len(good) > 1 and ways[good[0]].straight > FAR_BETTER * ways[good[1]].straight:
            model.belief.open.append(
                f"One of {', '.join(sorted(good))} has the opposite sign, which of them depends on how the "
                "wrench's axes are turned: gain = -1 in its position."
            )
            return False, here
        joint, before = good[0], here
        here = ways[joint]
        positions[joint].gain *= -1
        positions[joint].why.append(
            f"turned, since the model explains {explained(here.somehow)} then, else {explained(before.somehow)}"
        )
    return True, here

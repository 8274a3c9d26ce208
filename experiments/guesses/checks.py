"""Checks of beliefs by the log and the model: units and signs of joints, the base's orientation, gains of torques."""

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from experiments.guesses.belief import (
    BASE,
    DOUBTFUL,
    LIKELY,
    SURE,
    Belief,
    ColumnGroup,
    Quantity,
    TableEntry,
    toml_text,
)
from experiments.guesses.log_contents import ROUND, is_one
from experiments.guesses.model import CLEAR, ENOUGH, LITTLE, ComparedModel, Left, beside, explained
from experiments.guesses.words import suits
from experiments.guesses.wrenches import set_axes, set_units_of_wrenches
from ident.errors import InputError
from ident.estimation.equations import SLIP, predicted_channels
from ident.estimation.preparation import Prepared, prepared
from ident.files.table import CURRENT, UNITS
from ident.judgement.model_fit import recorded_gravity
from ident.judgement.residuals import correlated_samples
from ident.judgement.torque_checks import SCALE
from ident.recordings.log import read_log
from ident.tolerances import AGREES, FAR_BETTER
from sim.models.notes import LONGEST

TIE = 0.01
"""Difference of unexplained shares below which two units are a tie, whatever their ratio."""

KNOWN = 0.02
"""Unexplained share below which signs are not doubted."""


def set_units(belief: Belief) -> None:
    """Sets units of positions by the file, their names, their velocities' units, and their size."""
    log, kinds, open_ones = belief.log, belief.kinds, list[Quantity]()
    for x in belief.quantities.values():
        if x.kind != "position" or not x.column:
            continue
        if x.column in log.units:
            x.why.append("the file knows its unit")
        elif not suits(f"{kinds[x.joint]} position", x.column):
            x.sure = DOUBTFUL
            belief.ask(
                f"The position of '{x.joint}', a {kinds[x.joint]}, may be in {x.column}, whose name states "
                f"{x.about.unit}: map it by unit, gain and constant, so that gain * column + constant is the position.",
                [x.joint],
            )
        elif stated := belief.stated(x):
            x.unit = stated
            x.why.append(f"{x.unit} by its name")
        elif by_rate := _unit_by_rate(belief, x):
            x.unit = by_rate
            x.why.append(f"{x.unit} by its velocity, whose name has a unit")
        elif x.column in log.columns:
            open_ones.append(x)
    for kind, limit, larger, usual in (("hinge", ROUND, "deg", "rad"), ("slide", LONGEST, "mm", "m")):
        those = [x for x in open_ones if kinds[x.joint] == kind]
        others = {x.unit for joint, x in belief.of("position").items() if kinds[joint] == kind} - {""}
        sizes = {x.joint: log.largest(x.column) for x in those}
        # A program has one unit for all angles.
        unit = others.pop() if len(others) == 1 else larger if max(sizes.values(), default=0) > limit else usual
        for x in those:
            alike = sizes[x.joint] > limit or unit == usual
            x.unit, x.sure = unit, x.sure if alike or x.sure == DOUBTFUL else LIKELY
            x.why.append(f"{unit} since it goes to {sizes[x.joint]:.3g}" + f", and others are in {unit}" * (not alike))
    belief.by_size = {x.joint for x in open_ones if kinds[x.joint] == "hinge"}


def _unit_by_rate(belief: Belief, position: Quantity) -> str:
    """Unit of a position in which the derivative is the velocity in the unit that its name states; "" if unknown."""
    rate, log = belief.of("velocity").get(position.joint), belief.log
    if not rate or not belief.stated(rate) or not {rate.column, position.column} <= log.columns.keys():
        return ""
    kind = belief.kinds[position.joint]
    ratio = log.rate_factor(log.columns[position.column], rate.column)
    ratio *= UNITS[f"{kind} velocity"][belief.stated(rate)]
    return next((own for own, scale in UNITS[f"{kind} position"].items() if is_one(ratio / scale)), "")


def doubt_units(belief: Belief) -> None:
    """Makes positions likely whose unit their size alone suggests, and remarks of those that may be percentages."""
    percentages = list[str]()
    for joint, x in belief.of("position").items():
        if joint in belief.by_size and x.sure == SURE:
            x.sure = LIKELY
            x.why.append("which nothing else shows")
        # LeRobot writes percentages of calibrated ranges, or degrees, under the same names.
        is_open = x.column.endswith(".pos") and x.unit in ("deg", "mm") and x.sure != SURE
        if x.about.unit == "%" or (is_open and belief.log.largest(x.column) <= 100):
            percentages.append(joint)
            x.sure = DOUBTFUL
    if percentages:
        belief.ask(
            f"The positions of {', '.join(percentages)} may be percentages of calibrated ranges. Map degrees by "
            'unit = "deg", percentages by unit, gain and constant, so that gain * column + constant is the position.',
            percentages,
        )


def set_rates(belief: Belief) -> None:
    """Sets units and signs of velocities and accelerations as derivatives; drops columns that are no derivatives."""
    log, rates = belief.log, (("velocity", "position"), ("acceleration", "velocity"))
    for x, of in ((x, of) for kind, of in rates for x in belief.of(kind).values()):
        state, stated = belief.values(x.joint, of), belief.stated(x)
        if state is None or x.column not in log.columns:
            continue
        choices = {"": belief.factor(x)} if x.column in log.units else UNITS[f"{belief.kinds[x.joint]} {x.kind}"]
        ratio = log.rate_factor(state, x.column)
        fits = {unit: ratio * choice for unit, choice in choices.items() if is_one(ratio * choice)}
        x.sure = SURE
        if not fits:
            x.why = [f"it is {ratio:.3g} times the derivative" if ratio else "it is not the derivative"]
            belief.notes.append(
                f"Column '{x.column}' is named like the {x.kind} of '{x.joint}', but {x.why[0]} of what is taken for "
                f"its {of}; it is left out."
            )
            x.column = ""
            continue
        x.unit, x.gain = stated if stated in fits else next(iter(fits)), float(np.sign(ratio))
        x.why.append(f"{fits[x.unit]:.2f} times the derivative of the {of}" + f" in {x.unit}" * bool(x.unit))


def check_positions(model: ComparedModel) -> None:
    """Checks units and signs of joints against wrenches and torques, independent of the units and axes of these.

    Likely columns that explain next to nothing become doubtful. An open sign is indistinguishable from turned axes of a
    wrench.
    """
    _other_unit(model)
    left = _turn(model, model.left())
    if not model.belief.sign_undecided and 1 - left < ENOUGH:
        _doubt(model.belief, left)


def _other_unit(model: ComparedModel) -> None:
    """Exchanges radians and degrees if the model explains far more then, each with the signs that suit it best.

    With a joint of opposite sign, too small angles may explain more than right ones: so small they hardly matter.
    """
    joints = [x for joint, x in model.belief.of("position").items() if joint in model.belief.by_size]
    if not joints:
        return
    # A program has one unit for all angles.
    unit = joints[0].unit
    other, scale = ("deg", np.pi / 180) if unit == "rad" else ("rad", 180 / np.pi)
    here, there = _left_somehow(model, {}), _left_somehow(model, {x.joint: scale for x in joints})
    if there <= min(CLEAR * here, here - TIE):
        for x in joints:
            x.unit = other
            x.why.append(f"{other} since the model explains {explained(there)} then, in {unit} {explained(here)}")
        model.belief.by_size.clear()
    elif here < min(CLEAR * there, there - TIE, 1 - ENOUGH):
        model.belief.by_size.clear()


def _left_somehow(model: ComparedModel, factors: Mapping[str, float]) -> float:
    """Share left unexplained with factors on positions and the signs that leave least: one more, or all, at a time."""
    here, left = dict(factors), model.left(factors).somehow
    joints = [joint for joint, x in model.belief.of("position").items() if x.column in model.states]
    while joints and left > KNOWN:
        turned = {joint: -here.get(joint, 1.0) for joint in joints}
        ways = [here | turned, *(here | {joint: sign} for joint, sign in turned.items())]
        shares = [model.left(way).somehow for way in ways]
        if min(shares) >= left:
            break
        here, left = ways[int(np.argmin(shares))], min(shares)
    return left


def _doubt(belief: Belief, left: float) -> None:
    """Makes likely positions doubtful if the model explains next to nothing, and adds a note if it explains little."""
    share = f"the model explains {explained(left)} of the wrenches and torques"
    likely = [x for x in belief.of("position").values() if x.sure == LIKELY]
    if not likely or not (belief.by_place or 1 - left < LITTLE):
        belief.notes.append(f"With the columns that are named like positions {share}: see names, units and the model.")
        return
    listed = ", ".join(f"'{x.joint}' in {x.column}" for x in likely)
    joints = {x.joint for x in likely}
    belief.ask(f"The positions may be {listed}, but {share} then, so that they stay remarks.", joints)
    for x in belief.quantities.values():
        if x.joint in belief.undecided and x.sure == LIKELY:
            x.sure = DOUBTFUL


def _turn(model: ComparedModel, here: Left) -> float:
    """Inverts joints whose opposite sign explains far more, one by one, and returns the unexplained share.

    If two do so equally, the sign stays open. Signs are not doubted where all but `KNOWN` is explained.
    """
    positions = {j: x for j, x in model.belief.of("position").items() if x.column in model.states}
    while here.somehow > KNOWN:
        ways = {joint: model.left({joint: -1.0}) for joint in positions}
        good = [joint for joint in ways if ways[joint].somehow < FAR_BETTER * here.somehow]
        if not good:
            break
        # The mirror image of a motion fits a plate that is turned by 180°; a plate that is not turned is likelier.
        joint, *rest = sorted(good, key=lambda joint: (ways[joint].straight, ways[joint].somehow))
        turned = any(not group.is_inner for group in model.belief.groups.values())
        if rest and ways[joint].straight > (FAR_BETTER if turned else CLEAR) * ways[rest[0]].straight:
            which = "which of them depends on how the wrench's axes are turned" if turned else "which of them is open"
            model.belief.ask(
                f"One of {', '.join(sorted(good))} has the opposite sign, {which}: gain = -1 in its position."
            )
            model.belief.sign_undecided = True
            break
        before, here = here, ways[joint]
        positions[joint].gain *= -1
        shares = f"{explained(here.somehow)} then, else {explained(before.somehow)}"
        positions[joint].why.append(f"turned, since the model explains {shares}")
    return here.somehow


def set_orientation(belief: Belief, limit: int) -> None:
    """Puts the mechanism on a base in the orientation that the log shows, if that explains far more than the model's.

    It comes before any signs, which gravity in another direction would turn.
    """
    if belief.mechanism.base_rpy_deg is not None or BASE in belief.poses:
        return
    try:
        check = recorded_gravity(_read(belief, limit))
    except InputError:
        return
    if check is not None and check.suspicious:
        shares = f"{100 * check.misfit:.0f} % unexplained then, as it is {100 * check.stated:.0f} %"
        orientation = TableEntry(list(check.rpy_deg), f"gravity: the model leaves {shares}")
        belief.poses[BASE] = ColumnGroup(BASE, {"rpy_deg": orientation})
        belief.mechanism = belief.mechanism.mounted(check.rpy_deg)


def check_wrenches_and_torques(belief: Belief, limit: int) -> None:
    """Reads the log by the belief, and sets units, signs, axes and gains of wrenches and torques by the model."""
    if not (belief.outer or belief.of("torque")):
        return
    try:
        log = _read(belief, limit)
        if belief.outer and np.isfinite(log.wrench).any():
            if set_units_of_wrenches(belief, log):
                log = _read(belief, limit)
            if belief.can_predict and not belief.sign_undecided:
                set_axes(belief, log)
        _set_gains(belief, log)
    except InputError as error:
        belief.notes.append(f"Units, signs and gains could not be checked against the model: {error}")
        for quantity in belief.of("torque").values():
            if quantity.is_current:
                quantity.sure = DOUBTFUL
                quantity.why.append("a current needs a gain")


def _read(belief: Belief, limit: int) -> Prepared:
    """The log, read by the belief; sensors between bodies measure no contact."""
    for quantity in belief.of("torque").values():
        if quantity.is_current:
            quantity.unit = quantity.about.unit if quantity.about.unit in CURRENT else "A"
    mapping = tomllib.loads(toml_text(replace(belief, groups=belief.outer)))
    recording = read_log(belief.log.path, belief.mechanism, mapping, gaps=True, limit=limit)
    return prepared(belief.mechanism, recording, cutoff="auto", name=str(belief.log.path))


class Gain(NamedTuple):
    """Factor from a column to the torque that the model predicts.

    Attributes:
        gain: The factor.
        deviation: Its standard deviation, over its size.
        alike: Share of the predicted torque's variance that it explains.
    """

    gain: float
    deviation: float
    alike: float


def _set_gains(belief: Belief, log: Prepared) -> None:
    """Sets gains, units and signs of joint torques by regression on the model's torques."""
    measured, torques, gains = log.equations.torques, belief.of("torque"), dict[str, Gain]()
    if not measured:
        return
    predicted = predicted_channels(log.mechanism, log.samples.motion, log.frame, torques=True)
    whole, motion = slice(log.edge, len(log.samples) - log.edge), log.samples.motion
    for column, k in enumerate(measured, start=len(log.equations.channels) - len(measured)):
        joint = log.mechanism.tree.freedoms[k]
        if joint in torques:
            # The mass on a slide moves like a rotor: only a hinge's rotor can be told from links.
            rates = motion.dq[whole, k], motion.ddq[whole, k] * (belief.kinds[joint] == "hinge")
            gains[joint] = _gain(log.samples.measured[whole, column], predicted[joint][whole], *rates)
            share = f"beside friction and rotor the model explains {100 * gains[joint].alike:.0f} % of it"
            torques[joint].why.append(share)
    _set_units_of_torques(belief, gains)


def _set_units_of_torques(belief: Belief, gains: Mapping[str, Gain]) -> None:
    """Sets units and signs of torques, and gains of currents and of torques without a unit, none of the model's size.

    The log was read in N m, unless the unit was known. A program writes all torques in one unit: if some have the
    model's size, one that has not is due to another body.
    """
    log, torques, ratios, stated = belief.log, belief.of("torque"), dict[str, float](), dict[str, str]()
    for joint, gain in gains.items():
        x, units = torques[joint], UNITS[f"{belief.kinds[joint]} torque"]
        stated[joint] = x.unit if x.is_current else belief.stated(x) or log.units.get(x.column, "")
        x.unit = "" if x.column in log.units and not x.is_current else stated[joint] or next(iter(units))
        if gain.alike > AGREES:
            ratios[joint] = gain.gain / units.get(x.unit, 1.0)
        else:
            x.why.append("sign and gain cannot be determined")
            x.sure = DOUBTFUL if x.is_current else x.sure
    free = [abs(ratio) for joint, ratio in ratios.items() if not stated[joint]]
    in_newton = any(map(_is_near, free))
    in_millimetres = bool(free) and not in_newton and all(_is_near(1e3 * ratio) for ratio in free)
    for joint in gains.keys() - ratios.keys() if in_millimetres else ():
        if not stated[joint] and belief.kinds[joint] == "hinge":
            torques[joint].unit = "N mm"
            torques[joint].why.append("N mm since others are")
    for joint, ratio in ratios.items():
        x, times = torques[joint], f"± {gains[joint].deviation * abs(ratio):.1g}"
        x.gain = float(np.sign(ratio))
        larger = f"the model's torque is {abs(ratio):.3g} {times} times as large"
        if x.is_current:
            data_sheet = "so that identified masses are no more accurate than it: better put the data sheet's here"
            x.gain, reason = float(f"{ratio:.4g}"), f"{ratio:.4g} {times} N m/A by the model's torque, {data_sheet}"
        elif not stated[joint] and in_millimetres and belief.kinds[joint] == "hinge":
            x.unit, reason = "N mm", "N mm by its size"
        elif _is_near(abs(ratio)):
            reason = larger
        elif stated[joint] or in_newton or len(free) < 2:
            other = "others are in N m" if in_newton else "one torque proves nothing"
            other = f"its unit is {x.unit or 'the SI one'}" if stated[joint] else other
            reason = f"{larger}, but no gain is put for it since {other}: look at the model's bodies and at gears"
        else:
            x.gain, reason = float(f"{ratio:.4g}"), f"a gain (a gear?) of {ratio:.4g} {times} by the model's torque"
        x.why.append(reason)


def _is_near(ratio: float) -> bool:
    """True where a ratio of torques is consistent with one unit."""
    return 1 / SCALE < ratio < SCALE


def _gain(measured: np.ndarray, predicted: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> Gain:
    """Factor from a column to the predicted torque, its standard deviation, and the share of variance explained.

    `predicted = gain · measured + offset + friction + rotor`, least squares (N,). With autocorrelation ρ of the
    residuals, `(1 - ρ) / (1 + ρ)` of the samples count.
    """
    rows = [np.ones_like(dq), dq, np.tanh(dq / SLIP), ddq]
    x, y = beside(rows, np.stack([measured, predicted], axis=1)).T
    power, other = max(float(x @ x), 1e-300), max(float(y @ y), 1e-300)
    gain = float(x @ y) / power
    left = y - gain * x
    number = max((len(x) - len(rows) - 1) / float(correlated_samples(left, 0.999)), 1.0)
    deviation = np.sqrt(max(float(left @ left), 1e-300) / number / power) / max(abs(gain), 1e-300)
    return Gain(gain, float(deviation), gain**2 * power / other)

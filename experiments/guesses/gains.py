"""Gains, units and signs of joint torques and motor currents, by regression on the model's torques."""

from typing import NamedTuple

import numpy as np

from experiments.guesses.belief import DOUBTFUL, Belief, Quantity
from experiments.guesses.log_contents import LogContents
from experiments.guesses.units import is_current
from experiments.guesses.words import unit_of, words
from ident.estimation.loads import SLIP, predicted_channels
from ident.estimation.preparation import Prepared
from ident.files.column import UNITS
from ident.judgement.torque_checks import ALIKE, SCALE
from ident.recordings.columns.mapping import joint_kinds


class Gain(NamedTuple):
    """Factor from a column to the torque that the model predicts.

    Attributes:
        gain: The factor.
        deviation: Standard deviation of the factor.
        alike: Share of the predicted torque's variance that it explains.
    """

    gain: float
    deviation: float
    alike: float


def set_gains(belief: Belief, contents: LogContents, log: Prepared) -> None:
    """Sets gains, units and signs of joint torques by regression on the model's torques."""
    measured, torques = log.equations.torques, belief.of("torque")
    if not measured:
        return
    predicted = predicted_channels(log.mechanism, log.samples.motion, log.frame, torques=True)
    whole = slice(log.edge, len(log.samples) - log.edge)
    motion, gains, kinds = log.samples.motion, dict[str, Gain](), joint_kinds(log.mechanism.tree)
    for column, k in enumerate(measured, start=len(log.equations.channels) - len(measured)):
        joint = log.mechanism.tree.freedoms[k]
        if joint in torques:
            # The mass on a slide moves like a rotor: only a hinge's rotor can be told from links.
            rates = motion.dq[whole, k], motion.ddq[whole, k] * (kinds[joint] == "hinge")
            gains[joint] = _gain(log.samples.measured[whole, column], predicted[joint][whole], *rates)
    for joint in [joint for joint in gains if is_current(torques[joint])]:
        _set_motor_constant(torques[joint], gains.pop(joint))
    _set_units({joint: torques[joint] for joint in gains}, gains, contents, kinds)


def _set_motor_constant(torque: Quantity, by_model: Gain) -> None:
    """Sets the factor from current to torque, if the current explains the torque."""
    torque.why.append(_explained(by_model))
    if by_model.alike > ALIKE:
        torque.gain = float(f"{by_model.gain:.4g}")
        torque.why.append(
            f"{by_model.gain:.4g} ± {by_model.deviation:.1g} N m/A by the model's torque, so that identified "
            "masses are no more accurate than it: better put the data sheet's here"
        )
    else:
        torque.sure = DOUBTFUL


def _set_units(
    torques: dict[str, Quantity], gains: dict[str, Gain], contents: LogContents, kinds: dict[str, str]
) -> None:
    """Sets units and signs of torques, and gains where the unit is unknown and no torque has the model's size.

    The log was read in N m, unless the unit was known. A program writes all torques in one unit: if some have the
    model's size, one that has not is due to another body.
    """
    units = {joint: UNITS[f"{kinds[joint]} torque"] for joint in torques}
    own = {joint: unit_of(f"{kinds[joint]} torque", words(x.column).unit) for joint, x in torques.items()}
    stated = {joint: own[joint] or contents.units.get(x.column, "") for joint, x in torques.items()}
    for joint, x in torques.items():
        x.unit = "" if x.column in contents.units else stated[joint] or next(iter(units[joint]))
        x.why.append(_explained(gains[joint]))
        if gains[joint].alike <= ALIKE:
            x.why.append("sign and gain cannot be determined")
    alike = [joint for joint in torques if gains[joint].alike > ALIKE]
    scale = {joint: units[joint].get(torques[joint].unit, 1.0) for joint in alike}
    ratios = {joint: gains[joint].gain / scale[joint] for joint in alike}
    free = [abs(ratios[joint]) for joint in alike if not stated[joint]]
    in_newton = any(_near(ratio) for ratio in free)
    in_millimetres = bool(free) and not in_newton and all(_near(1e3 * ratio) for ratio in free)
    for joint, ratio in ratios.items():
        x, deviation = torques[joint], gains[joint].deviation / scale[joint]
        x.gain = float(np.sign(ratio))
        if not stated[joint] and in_millimetres and kinds[joint] == "hinge":
            x.unit = "N mm"
            x.why.append("N mm by its size")
        elif _near(abs(ratio)):
            x.why.append(f"the model's torque is {abs(ratio):.3g} ± {deviation:.1g} times as large")
        elif stated[joint] or in_newton or len(free) < 2:
            reason = f"its unit is {x.unit or 'the SI one'}" if stated[joint] else ""
            other = reason or ("others are in N m" if in_newton else "one torque proves nothing")
            x.why.append(
                f"the model's torque is {abs(ratio):.3g} ± {deviation:.1g} times as large, but no gain is put for it "
                f"since {other}: look at the model's bodies and at gears"
            )
        else:
            x.gain = float(f"{ratio:.4g}")
            x.why.append(f"a gain (a gear?) of {ratio:.4g} ± {deviation:.1g} by the model's torque")


def _near(ratio: float) -> bool:
    """True where a ratio of torques is consistent with one unit."""
    return 1 / SCALE < ratio < SCALE


def _explained(by_model: Gain) -> str:
    return f"beside friction and rotor the model explains {100 * by_model.alike:.0f} % of it"


def _gain(measured: np.ndarray, predicted: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> Gain:
    """Factor from a column to the predicted torque, its standard deviation, and the share of variance explained.

    `predicted = gain · measured + offset + friction + rotor`, least squares (N,). With autocorrelation ρ of the
    residuals, `(1 - ρ) / (1 + ρ)` of the samples count.
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
    return Gain(gain, float(np.sqrt(own / number / power)), gain**2 * power / other)

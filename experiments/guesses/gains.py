"""Gains, units and signs of joint torques and motor currents, by regression on the torques that the model predicts."""

import numpy as np

from experiments.guesses.belief import DOUBTFUL, Belief, Quantity
from experiments.guesses.joints import is_current
from experiments.guesses.seen import Seen
from experiments.guesses.words import unit_of, words
from ident.estimation.loads import SLIP
from ident.estimation.preparation import Prepared, predicted_channels
from ident.judgement.torque_checks import ALIKE, SCALE


def set_gains(belief: Belief, seen: Seen, log: Prepared) -> None:
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

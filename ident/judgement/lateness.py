"""Delay of wrenches or torques behind the joint angles, beyond those that an estimator searches for."""

from dataclasses import dataclass

import numpy as np

from ident.estimation.preparation import Prepared
from ident.judgement.model_fit import EXPLAINED, FAR_BETTER, SAMPLES, ModelFit

FARTHEST, STEP = 1.0, 0.02
"""Longest delay that is tried, s, unless that is more than a tenth of the recording; and the spacing of delays, s."""

SURE = 4.0
"""Standard deviations from zero from which a delay is one."""


@dataclass(frozen=True)
class DelayCheck:
    """Delay with which a model explains channels best.

    Attributes:
        of: `wrench` or `torques`.
        delay: The delay, s; negative if the angles are late.
        std: Its standard deviation, s.
        stated: Misfit without it, as of `ModelFit.misfit`.
        misfit: Misfit with it.
        other: Misfit without it, but with other signs of channels.
    """

    of: str
    delay: float
    std: float
    stated: float
    misfit: float
    other: float

    @property
    def suspicious(self) -> bool:
        """True if the delay explains far more than none, and more than other signs do."""
        sure = abs(self.delay) > SURE * self.std
        return bool(sure and self.misfit < min(FAR_BETTER * self.stated, EXPLAINED, self.other))


def delay_check(prepared: Prepared) -> DelayCheck | None:
    """The delay of a wrench or torques that explains most; None where the base moves or commands are fitted."""
    kept = prepared.taken(slice(prepared.edge, len(prepared.samples) - prepared.edge))
    if not prepared.recording.is_held(prepared.mechanism.tree) or prepared.recording.servos or len(kept) < 2:
        return None
    samples, time = prepared.samples[kept], prepared.recording.time[kept]
    reach = min(FARTHEST, 0.1 * (time[-1] - time[0]))
    inside = np.flatnonzero((time >= time[0] + reach) & (time <= time[-1] - reach))
    some = inside[np.linspace(0, len(inside) - 1, min(SAMPLES, len(inside))).astype(int)]
    delays = np.arange(-reach, reach + STEP / 2, STEP)
    few = dict(zip(prepared.equations.channels, samples.measured[some].T, strict=True))
    fit = ModelFit.of(prepared.mechanism, samples.motion[some], few, prepared.frame)
    if fit is None or len(delays) < 3:
        return None
    shifted = np.array([[np.interp(time[some] + d, time, x) for x in samples.measured.T] for d in delays])
    shifted, number = shifted.swapaxes(1, 2), len(fit.wrench)
    checks = []
    for of, part in (("wrench", slice(0, number)), ("torques", slice(number, None))):
        variants = np.repeat(samples.measured[None, some], len(delays), axis=0)
        variants[:, :, part] = shifted[:, :, part]
        if variants[:, :, part].size:
            misfits = fit.misfits(fit.down, np.array([fit.scaled(each) for each in variants]))
            checks.append(
                DelayCheck(of, *_least(delays, misfits), fit.misfit(fit.down), misfits.min(), fit.otherwise())
            )
    return min(checks, key=lambda check: check.misfit)


def _least(delays: np.ndarray, misfits: np.ndarray) -> tuple[float, float]:
    """Delay at the least misfit, and its standard deviation, infinite at the end of those tried."""
    k, squares = int(misfits.argmin()), misfits**2
    if k in (0, len(delays) - 1):
        return float(delays[k]), np.inf
    before, here, after = squares[k - 1 : k + 2].tolist()
    curvature = max((before - 2 * here + after) / STEP**2, 1e-300)
    shift = (before - after) / (2 * STEP * curvature)
    return float(delays[k] + shift), float(np.sqrt(2 * here / (SAMPLES * curvature)))

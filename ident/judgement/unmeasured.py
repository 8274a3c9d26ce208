"""Spans of a recording in which an unmeasured contact carries a part of the weight.

A foot beside the force plate, a chair or a hand on a table only pushes, so that the measured support falls short of the
weight and of the force that the motion requires, and never exceeds it. Errors of the model, delays and noise have both
signs, since accelerations average to zero over a motion.

At the ends of a recording the low-pass takes accelerations to zero. Splines leave them free there, so that support
counts as missing only as far as both motions require it.
"""

from dataclasses import replace

import numpy as np

from ident.estimation.preparation import LeftOut, Prepared
from ident.estimation.recorded_motion import recorded_motion
from ident.geometry.se3 import applied, coAd
from ident.judgement.checks import NEAR, NotCheckedError, check_contact, predicted_wrench, upward
from ident.recordings.smoothing import running_median, runs
from ident.recordings.times import Sampled
from ident.recordings.wrench import GROUND
from ident.trajectory.angles_alone import smoothed

SHARPER = 0.5
"""Time constant of the splines over that of the low-pass, `1 / (2 π f)`. Of 144 simulated recordings without contacts
that end in motion, something was detected in 17 by the low-pass alone, in 2 with equal constants and in none with half;
with a quarter, noise begins to hide contacts at the ends."""

AT_AN_END = 0.5
"""Shortest span at an end of a recording, in periods of the cut-off: accelerations there follow from angles on one side
only. In 8 of 648 simulated recordings without contacts something would be detected, at an end and for at most 0.26
periods; a foot beside the plates, in four recordings of a person who walks, is detected for 1.0 to 1.5."""


def without_unmeasured(prepared: Prepared) -> Prepared:
    """Recording without the samples in which an unmeasured contact carries weight."""
    return replace(prepared, left_out=unmeasured_contacts(prepared))


def unmeasured_contacts(prepared: Prepared) -> tuple[LeftOut, ...]:
    """Spans with unmeasured contacts, detected by missing support; none where no weight is measured, or of poses."""
    if prepared.recording.still:
        return ()
    try:
        up, known = upward(prepared)
    except NotCheckedError:
        return ()
    predicted = predicted_wrench(prepared)
    every = (predicted, predicted_wrench(_by_splines(prepared)), prepared.wrench)
    needed, by_splines, carried = ((wrench[:, :3] * up)[:, known].sum(axis=1) for wrench in every)
    weight = prepared.mechanism.mass * float(np.linalg.norm(prepared.mechanism.gravity))
    whole = prepared.whole
    heavier = _heavier(needed[whole], carried[whole], weight)
    if heavier is None:
        return ()
    # Samples of the shortest span, and of the margin that is left out beside each.
    reach = max(1, round(0.03 * prepared.recording.rate))
    # Where a sensor's range ends support is missing as well.
    usual, missing = (
        running_median(np.where(whole, heavier * support - carried, 0), reach)
        for support in (needed, np.minimum(needed, by_splines))
    )
    # A smaller part of the weight may be an error of the model.
    limit, contacts = _limit(usual, 0.06 * heavier * weight), []
    at_an_end = AT_AN_END * prepared.recording.rate / (prepared.cutoff or np.inf)
    # Contacts are loaded gradually.
    for first, last in runs(missing > limit / 3).tolist():
        largest = float(missing[first:last].max())
        shortest = max(reach, at_an_end) if first < reach or last > len(missing) - reach else reach
        if last - first >= shortest and largest > limit:
            times = prepared.recording.time[max(0, first - reach) : last + reach]
            residual = prepared.wrench[first:last] - heavier * predicted[first:last]
            body = _body(prepared, slice(first, last), residual, up[first:last])
            contacts.append(LeftOut(float(times[0]), float(times[-1]), largest / (heavier * weight), body))
    return tuple(contacts)


def _by_splines(prepared: Prepared) -> Prepared:
    """Recording with its motion smoothed by splines instead of a low-pass."""

    def smoother(x: np.ndarray, rate: float, cutoff: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if not x.size:
            return x, x, x
        time = np.arange(len(x)) / rate
        q, dq, ddq, _ = smoothed(Sampled(time, x), SHARPER / (2 * np.pi * cutoff)).evaluate(time)
        return q, dq, ddq

    if prepared.cutoff is None:
        return prepared
    motion = recorded_motion(prepared.mechanism, prepared.recording, prepared.cutoff, smoother)
    return replace(prepared, samples=replace(prepared.samples, motion=motion))


def _heavier(needed: np.ndarray, carried: np.ndarray, weight: float) -> float | None:
    """Ratio of the mechanism's mass to its model's by the samples that agree; None if too few do.

    Args:
        needed: Support that the model predicts, N (N,).
        carried: Support that is measured, N (N,).
        weight: The model's weight, N.
    """
    # Largest factor by which a mechanism is heavier or lighter than its model; part of the samples that must agree, and
    # their largest spread over that of those that agree best.
    most, agreeing, close = 1.6, 0.15, 2.0
    standing = needed > weight / 2
    ratio = np.sort(carried[standing] / needed[standing])
    ratio = ratio[(ratio > 1 / most) & (ratio < most)]
    together = int(np.ceil(agreeing * len(needed)))
    if len(ratio) <= together:
        return None
    # Of the short intervals that hold so many of them the highest: support is missing, and never too large.
    widths = ratio[together:] - ratio[:-together]
    first = int(np.flatnonzero(widths <= close * widths.min())[-1])
    middle, reach = ratio[first + together // 2], close * widths[first]
    return float(np.median(ratio[np.abs(ratio - middle) <= reach]))


def _limit(missing: np.ndarray, least: float) -> float:
    """Missing support from which there is a contact, N, at least a given one, from missing support and excess (N,).

    It is twice the excess, and six times the standard deviation of the rest.
    """
    neither = np.abs(missing) < least
    spread = float(missing[neither].std()) if neither.any() else 0.0
    return max(least, 6 * spread, 2 * float(-missing.min()))


def _body(prepared: Prepared, part: slice, residual: np.ndarray, up: np.ndarray) -> str | None:
    """Body that a contact is likely on; None if no force on or near one explains most of the missing moment.

    None as well where not all six components of the wrench are measured.
    """
    if not np.isfinite(residual).all():
        return None
    in_base, unloaded = applied(coAd(prepared.frame), residual), _unloaded(prepared, part)
    q, up_in_base = prepared.samples.motion.q[part], up @ prepared.frame[:3, :3].T
    contact = check_contact(prepared.mechanism.tree, q, in_base, unloaded, up_in_base)
    return contact.body if contact.explained > 0.8 or contact.distance < NEAR else None


def _unloaded(prepared: Prepared, part: slice) -> set[str]:
    """Bodies of measured contacts that are unloaded during most of a part: a foot on a plate is not beside it."""
    recording, loaded = prepared.recording, dict[str, float]()
    for name in recording.wrenches:
        if name != GROUND:
            body, share = str(recording.sensors[name].body), recording[f"{name}_force"][part].any(axis=1).mean()
            loaded[body] = loaded.get(body, 0.0) + float(share)
    return {body for body, share in loaded.items() if share < 1 / 2}

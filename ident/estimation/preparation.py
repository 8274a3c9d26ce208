"""Preparation of a user's model and recording for a fit: one set of samples, channels and columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from ident.arguments import checked_names
from ident.errors import InputError, LogError
from ident.estimation import repairs
from ident.estimation.equations import COMPONENTS, Equations
from ident.estimation.measurement import base_motion, joint_states
from ident.estimation.repairs import Clipped, Stuck
from ident.estimation.samples import Samples
from ident.estimation.separable import separable
from ident.estimation.stated_drives import stated_drive_torques
from ident.files.table import BASE
from ident.geometry.quaternion import continuous_quaternions, without_jumps
from ident.geometry.se3 import coAd, inverse
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.model.regressor import CHUNK, base_wrench_regressor, drive_names, joint_torque_regressor
from ident.model.stated import stated_values
from ident.parameters.base_parameters import BaseParameters, structural_base_parameters
from ident.parameters.structure import Sensors
from ident.recordings.gaps import covered
from ident.recordings.recording import Recording
from ident.recordings.smoothing import PADDING, chosen_cutoff, low_pass, settling, smoothed
from ident.recordings.suggestion import suggested_mapping
from ident.recordings.wrench import GROUND
from ident.tolerances import DRIVE, USUAL_DRIVE

USUAL = 0.1
"""Default cut-off over the sampling rate, for the first estimate of motions for which none can be chosen."""


class LeftOut(NamedTuple):
    """Span of a recording whose samples are not used.

    Attributes:
        start: Time of the first sample, s.
        end: Time of the last sample, s.
        carries: The most that an unmeasured contact carries, of the weight.
        body: Body that the contact may be on, None for none.
    """

    start: float
    end: float
    carries: float
    body: str | None = None


@dataclass(frozen=True, eq=False)
class Prepared:
    """Recording ready for a fit.

    Attributes:
        mechanism: The mechanism.
        recording: The recording after repairs.
        equations: Equations to fit, without offsets.
        samples: Motion and measured channels, low-passed if there is a cut-off.
        sensors: Measured quantities.
        frame: Pose of the frame in which the wrench is expressed, the ground sensor's (4, 4).
        wrench: Total wrench in that frame, NaN in channels that are not measured (N, 6).
        cutoff: Cut-off of the low-pass, Hz; None if the recording's own derivatives are used.
        notes: Notes on what was detected and done.
        stuck: Channels left out because they are constant although the model predicts a change.
        left_out: Spans whose samples are not used.
        clipped: Channels clipped by a sensor's range; their clipped samples are not used.
        steps: Resolution of recorded channels by name, where it can be detected; coordinates as `JOINT_position`.
        rests: Positions of the hinges and slides at rest throughout, by joint.
    """

    mechanism: Mechanism
    recording: Recording
    equations: Equations
    samples: Samples
    sensors: Sensors
    frame: np.ndarray
    wrench: np.ndarray
    cutoff: float | None
    notes: tuple[str, ...]
    stuck: tuple[Stuck, ...]
    left_out: tuple[LeftOut, ...] = ()
    clipped: tuple[Clipped, ...] = ()
    steps: Mapping[str, float] = field(default_factory=dict)
    rests: Mapping[str, float] = field(default_factory=dict)

    def usable(self, time: np.ndarray) -> np.ndarray:
        """Mask of the times at which samples are not left out (N,)."""
        return np.all(
            [(time < each.start) | (time > each.end) for each in self.left_out] or [np.isfinite(time)], axis=0
        )

    def taken(self, part: slice | np.ndarray) -> np.ndarray:
        """Indices of the samples of a part that are neither left out, nor clipped in any channel, nor in a gap.

        In a gap channels are only interpolated linearly.
        """
        kept = self.usable(self.recording.time) & self.covered & self.whole
        return np.arange(len(self.samples))[part][kept[part]]

    @property
    def whole(self) -> np.ndarray:
        """Mask of the samples that are clipped in no used channel (N,)."""
        clipped = [each.samples for each in self.clipped if each.kept]
        return ~np.any(clipped or [np.zeros(len(self.samples), bool)], axis=0)

    @cached_property
    def covered(self) -> np.ndarray:
        """Mask of the samples that lie neither in a gap of a used channel nor within the filter's reach of one (N,)."""
        names = [f"{joint}_{kind}" for joint in self.mechanism.joints for kind in ("position", "torque")]
        names += [f"{name}_{kind}" for name in self.recording.wrenches for kind in ("force", "torque")]
        inside = covered(self.recording, (*names, BASE))
        return minimum_filter1d(inside, 2 * self.edge + 1, mode="constant", cval=1) if self.edge else inside

    @property
    def edge(self) -> int:
        """Number of samples left out at either end, where the filter settles."""
        return 0 if self.cutoff is None else settling(self.recording.rate, self.cutoff)


def prepared(
    mechanism: Mechanism,
    recording: Recording,
    *,
    cutoff: str | float | None = None,
    drive: Sequence[str] | None = (),
    leave_out: Sequence[str] = (),
    name: str = "The recording",
    filters: bool = True,
) -> Prepared:
    """Prepares a recording for a fit.

    Args:
        mechanism: The mechanism, with a prior.
        recording: The recording.
        cutoff: Cut-off of the low-pass in Hz, `auto`, or None for the recording's own velocities and accelerations.
        drive: Columns of friction, rotor inertia and springs for joint torques; None for `usual_drives`.
        leave_out: Channels that are not fitted, though they may be measured: components of the total wrench in the
            ground sensor's axes, without a ground in those of the base, or joint torques by the joints' names.
        name: Name of the recording in messages.
        filters: True if the estimator fits low-passed samples. The trajectory estimate does not: it uses a default
            cut-off for its first estimate of a motion for which none can be chosen.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
    """
    tree, rate = mechanism.tree, recording.rate
    asked = () if drive is None else drive_names(tree, drive)
    leave_out = checked_names("leave_out", leave_out, (*COMPONENTS, *tree.freedoms))
    recording = repairs.without_channels(recording, tree, leave_out)
    steps = repairs.steps(recording, tree)
    recording, clipped = repairs.without_clipped(recording, mechanism)
    recording, notes = repairs.without_spikes(recording, mechanism.joints)
    constant = repairs.constants(recording, tree)
    recording = repairs.without_channels(recording, tree, constant)
    notes += [f"Left out, as asked for: {', '.join(leave_out)}."] * bool(leave_out)
    rests = repairs.rests(recording, tree)
    notes += [repairs.rest_note(*each) for each in rests.items()]
    cutoff = _cutoff(recording, mechanism.joints, cutoff, filters)
    motion = _motion(mechanism, recording, cutoff)
    frame, wrench = _wrench(tree, recording, motion, cutoff, notes)
    constant |= _constant_together(recording, wrench)
    wrench = np.where(np.isin(COMPONENTS, (*constant, *leave_out)), np.nan, wrench)
    torques = recording.torques_at(tree, motion)
    torques = torques if torques is None or cutoff is None else low_pass(torques, rate, cutoff)
    channels = _channels(mechanism, frame, wrench, torques)
    if asked and not channels.torques:
        notes.append(f"The log has no joint torques for the drive columns {', '.join(drive or ())}.")
    if not channels.names and leave_out and (recording.wrenches or torques is not None):
        raise LogError(f"{name} has nothing to fit: all that it measures is left out, {', '.join(leave_out)}.")
    if not channels.names and constant:
        raise LogError(f"Every measured channel of {name} is constant ({', '.join(constant)}); nothing is to fit.")
    if not channels.names:
        raise LogError(
            f"{name} has neither a wrench nor a joint torque to fit. {suggested_mapping(recording.unused, tree.joints)}"
        )
    stuck = repairs.stuck(constant, predicted_channels(mechanism, motion, frame, torques=torques is not None), notes)
    rows = channels.wrench
    sensors = Sensors(rows is not None, bool(channels.torques), motion.base is not None, rows)
    parameters = structural_base_parameters(mechanism, sensors=sensors)
    notes += _hidden(mechanism, sensors, parameters, channels.names)
    notes += [parameters.remark] if parameters.remark else []
    drives = usual_drives(mechanism, channels.torques) if drive is None else asked if channels.torques else ()
    servos = servo_gains(recording, tree, channels.torques)
    equations = Equations(mechanism, parameters, rows, channels.torques, channels.names, drives, servos=servos)
    samples = Samples(motion, channels.measured)
    fitted = separable(equations, samples) if drives else equations
    if lost := [name for name in drives if name not in fitted.drives]:
        notes.append(_absorbed(mechanism, lost))
    all_notes = (*recording.notes, *notes)
    return Prepared(
        mechanism,
        recording,
        fitted,
        samples,
        sensors,
        frame,
        wrench,
        cutoff,
        all_notes,
        stuck,
        clipped=clipped,
        steps=steps,
        rests=rests,
    )


def usual_drives(mechanism: Mechanism, torques: Sequence[int]) -> tuple[str, ...]:
    """Names of the columns that are fitted by default: rotor inertia and friction, and springs that the model has.

    Args:
        mechanism: The mechanism.
        torques: Indices of the freedoms whose torques are measured.
    """
    freedoms = [mechanism.tree.freedoms[k] for k in torques]
    springs = [name for name in freedoms if name in mechanism.drives and mechanism.drives[name].stiffness]
    usual = [f"{DRIVE[kind]}({name})" for kind in USUAL_DRIVE for name in freedoms]
    return (*usual, *(f"{DRIVE['spring']}({name})" for name in springs))


def _absorbed(mechanism: Mechanism, lost: Sequence[str]) -> str:
    """Note on drives whose columns depend on those of the links."""
    note = f"{', '.join(lost)} cannot be told from the links' inertias, which take them up"
    if not (stated := [name for name, value in zip(lost, stated_values(mechanism, lost), strict=True) if value]):
        return f"{note}."
    return f"{note}; bodies are computed with the model's {', '.join(stated)}."


def servo_gains(recording: Recording, tree: Tree, torques: Sequence[int]) -> np.ndarray | None:
    """`Equations.servos` of a recording, for the torques of some freedoms."""
    if not recording.servos:
        return None
    servos = [recording.servos.get(tree.freedoms[k]) for k in torques]
    return np.array([(each.kp, each.kv, each.kp_std) if each else (0.0, 0.0, 0.0) for each in servos]).T


@dataclass(frozen=True, eq=False)
class _Channels:
    """Measured components of a wrench, and measured joint torques.

    Attributes:
        names: Names of the channels.
        measured: Measured channels (N, C).
        wrench: Rows that map Γ in the base frame to the channels of the wrench (k, 6), None without any.
        torques: Indices of the joint torques among the velocities.
    """

    names: tuple[str, ...]
    measured: np.ndarray
    wrench: np.ndarray | None
    torques: tuple[int, ...]


def _channels(mechanism: Mechanism, frame: np.ndarray, wrench: np.ndarray, torques: np.ndarray | None) -> _Channels:
    known = np.flatnonzero(np.isfinite(wrench).all(axis=0))
    torques = np.full((len(wrench), 0), np.nan) if torques is None else torques
    felt = np.flatnonzero(np.isfinite(torques).all(axis=0))
    names = [COMPONENTS[k] for k in known] + [mechanism.tree.freedoms[k] for k in felt]
    rows = coAd(inverse(frame))[known] if len(known) else None
    return _Channels(tuple(names), np.hstack([wrench[:, known], torques[:, felt]]), rows, tuple(felt.tolist()))


def predicted_channels(
    mechanism: Mechanism, motion: Motion, frame: np.ndarray, *, torques: bool = False
) -> dict[str, np.ndarray]:
    """Components of the total wrench in a frame, and joint torques if requested, as the model predicts them (N,) each.

    It predicts with its prior and with the drives that it states.
    """
    in_frame = coAd(inverse(frame))
    wrenches, felt = [], []
    for first in range(0, len(motion), CHUNK):
        part = motion[first : first + CHUNK]
        given: dict[str, Any] = {"gravity": mechanism.gravity, "base": part.base}
        Y = base_wrench_regressor(mechanism.tree, *part.states, **given)
        wrenches.append(Y @ mechanism.known @ in_frame.T)
        if torques:
            links = joint_torque_regressor(mechanism.tree, *part.states, **given) @ mechanism.known
            felt.append(links + stated_drive_torques(mechanism, part) if mechanism.drives else links)
    predicted = dict(zip(COMPONENTS, np.concatenate(wrenches).T, strict=True))
    return predicted | (dict(zip(mechanism.tree.freedoms, np.concatenate(felt).T, strict=True)) if torques else {})


def base_motion_from_poses(T: np.ndarray, rate: float, cutoff: float | None) -> BaseMotion:
    """Motion of a base from its poses alone, low-passed and differentiated.

    Args:
        T: Poses in an inertial frame (N, 4, 4).
        rate: Samples per second.
        cutoff: Cut-off of the low-pass, Hz; None for `chosen_cutoff` of the positions and quaternions.
    """
    x = np.hstack([T[:, :3, 3], continuous_quaternions(T[:, :3, :3])])
    return base_motion(np.stack(smoothed(x, rate, cutoff or chosen_cutoff(x, rate))))


def _hidden(mechanism: Mechanism, sensors: Sensors, parameters: BaseParameters, channels: Sequence[str]) -> list[str]:
    """Note on the base parameters that cannot be identified without the missing components of the wrench."""
    if not sensors.base_wrench:
        return []
    whole = replace(sensors, channels=None)
    every = structural_base_parameters(mechanism, sensors=whole).rank
    if every == parameters.rank:
        return []
    return [
        f"{every - parameters.rank} of {every} base parameters cannot be seen in {', '.join(channels)}, whatever the "
        "motion; they take the other components of the wrench."
    ]


def _has_rates(recording: Recording, joints: Sequence[str]) -> bool:
    """True if there are velocities and accelerations, which a recording has for all joints or none."""
    return any(
        f"{joint}_velocity" in recording.measured and f"{joint}_acceleration" in recording.measured for joint in joints
    )


def _cutoff(recording: Recording, joints: Sequence[str], cutoff: str | float | None, filters: bool) -> float | None:
    if cutoff is None and _has_rates(recording, joints):
        return None
    if cutoff is None or cutoff == "auto":
        if not joints:
            raise InputError("Nothing moves on this base: name another one (--base), or a cut-off in Hz (--cutoff).")
        try:
            return chosen_cutoff(coordinates(recording, joints), recording.rate)
        except InputError:
            if filters:
                raise
            if (samples := len(recording.time)) <= PADDING:
                message = f"An identification needs more than {PADDING} samples, got {samples}."
                raise InputError(message) from None
            return USUAL * recording.rate
    try:
        value = float(cutoff)
    except ValueError:
        value = np.nan
    if not 0 < value < recording.rate / 2:
        raise InputError(
            f"A cut-off is 'auto' or from 0 to {recording.rate / 2:g} Hz, half the sampling rate, got '{cutoff}'."
        )
    return value


def _motion(mechanism: Mechanism, recording: Recording, cutoff: float | None) -> Motion:
    """Motion of the joints, and of a base on a carrier or tracked."""
    base = None if recording.base is None else base_motion_from_poses(recording.base, recording.rate, cutoff)
    if mechanism.carrier is not None:
        base = mechanism.carrier.motion(*_states(recording, mechanism.carrier.tree, cutoff))
    return Motion(*_states(recording, mechanism.tree, cutoff), base)


def _states(recording: Recording, tree: Tree, cutoff: float | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if cutoff is None:
        return recording.joint_states(tree.joints)
    return joint_states(tree, np.stack(smoothed(coordinates(recording, tree.joints), recording.rate, cutoff)))


def coordinates(recording: Recording, joints: Sequence[str]) -> np.ndarray:
    """Joint coordinates, quaternions without jumps of sign (N, n_q)."""
    columns = [recording[f"{joint}_position"] for joint in joints]
    continuous = [without_jumps(x) if x.ndim == 2 else x[:, None] for x in columns]
    return np.hstack([np.empty((len(recording.time), 0)), *continuous])


def _wrench(
    tree: Tree, recording: Recording, motion: Motion, cutoff: float | None, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the ground sensor's frame and total wrench in it (Eq. 17), of contacts alone if the base is not held."""
    wrenches = recording.wrenches
    if not wrenches and recording.base is None:
        return np.eye(4), np.full((len(motion), 6), np.nan)
    if GROUND not in wrenches and recording.is_held(tree):
        raise LogError(
            "Where something holds the base the wrench 'ground' has to be measured besides the contacts'; where "
            "nothing does, because joints carry the mechanism freely, say so: held = false under [base]."
        )
    if GROUND not in wrenches and recording.base is None:
        notes.append(f"Nothing holds the base: {', '.join(wrenches)} make up the total wrench alone (Eq. 3).")
    total = recording.total_wrench(tree, motion=motion)
    return total.frame, total.values if cutoff is None else low_pass(total.values, recording.rate, cutoff)


def _constant_together(recording: Recording, wrench: np.ndarray) -> dict[str, float]:
    """Constant components of a total wrench (N, 6) of contacts alone, with their values.

    If all are zero, none are returned: the mechanism is in free flight, which is informative.
    """
    if GROUND in recording.wrenches or not wrench.any():
        return {}
    return {name: float(x[0]) + 0.0 for name, x in zip(COMPONENTS, wrench.T, strict=True) if np.ptp(x) == 0}


class Filtered(NamedTuple):
    """Motion and channels of a recording for least squares.

    Attributes:
        motion: Joint states, and the motion of the base.
        measured: Measured channels, filtered like the states (N, C).
        raw: Unfiltered channels (N, C).
    """

    motion: Motion
    measured: np.ndarray
    raw: np.ndarray


def filtered(prepared: Prepared, cutoff: float | None) -> Filtered:
    """States and channels of a recording low-passed at a cut-off, Hz; prepared states and raw channels for None."""
    mechanism, recording = prepared.mechanism, prepared.recording
    tree, rate = mechanism.tree, recording.rate
    motion = prepared.samples.motion if cutoff is None else _motion(mechanism, recording, cutoff)
    _, wrench = _wrench(tree, recording, motion, None, [])
    torques = recording.torques_at(tree, motion)
    known, felt = np.isfinite(prepared.wrench).all(axis=0), list(prepared.equations.torques)
    raw = np.hstack([wrench[:, known], np.empty((len(wrench), 0)) if torques is None else torques[:, felt]])
    return Filtered(motion, raw if cutoff is None else low_pass(raw, rate, cutoff), raw)

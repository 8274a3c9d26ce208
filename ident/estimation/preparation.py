"""Preparation of a user's model and recording for a fit: one set of samples, channels and columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ident.arguments import checked_names
from ident.errors import LogError
from ident.estimation import repairs
from ident.estimation.drive_choice import absorbed_note, drives_of, scale_deviations, servo_gains, usual_drives
from ident.estimation.equations import COMPONENTS, Equations
from ident.estimation.model_channels import predicted_channels
from ident.estimation.recorded_motion import motion_cutoff, recorded_motion
from ident.estimation.repairs import Clipped, Stuck
from ident.estimation.samples import Samples
from ident.estimation.separable import separable
from ident.files.table import BASE
from ident.geometry.se3 import coAd, inverse
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.axes import Axes
from ident.model.regressor import drive_kinds
from ident.parameters.base_parameters import BaseParameters, structural_base_parameters
from ident.parameters.structure import Sensors
from ident.recordings.gaps import covered
from ident.recordings.recording import Recording
from ident.recordings.runs import runs
from ident.recordings.smoothing import low_pass, settling
from ident.recordings.suggestion import suggested_mapping
from ident.recordings.wrench import GROUND


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
        drives: Names of the drives' columns before those that depend on others were left out.
        searches_stribeck: True if the data may add Stribeck friction to them.
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
    drives: tuple[str, ...] = ()
    searches_stribeck: bool = False

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
        return inside if self.edge == 0 else ~_widened(~inside, self.edge)

    @property
    def edge(self) -> int:
        """Number of samples left out at either end, where the filter settles."""
        return 0 if self.cutoff is None else settling(self.recording.rate, self.cutoff)


def _widened(samples: np.ndarray, reach: int) -> np.ndarray:
    """Mask of the samples with a true one at most `reach` samples away (N,)."""
    out = np.zeros(len(samples), bool)
    for first, end in runs(samples):
        out[max(0, first - reach) : end + reach] = True
    return out


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
        drive: Columns of friction, rotor inertia and springs for joint torques; None for `usual_drives`,
            to which the trajectory estimate may add Stribeck friction.
        leave_out: Channels that are not fitted, though they may be measured: components of the total wrench in the
            ground sensor's axes, without a ground in those of the base, or joint torques by the joints' names.
        name: Name of the recording in messages.
        filters: True if the estimator fits low-passed samples. The trajectory estimate does not: it uses a default
            cut-off for its first estimate of a motion for which none can be chosen.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
    """
    tree, rate = mechanism.tree, recording.rate
    mechanism = _with_known_bodies(mechanism, recording)
    asked = () if drive is None else drive_kinds(drive)
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
    cutoff = motion_cutoff(recording, mechanism.joints, cutoff, filters)
    motion = recorded_motion(mechanism, recording, cutoff)
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
    axes = Axes.of(tree, recording.couplings)
    chosen = drives_of(axes, asked, range(len(tree.freedoms))) if channels.torques else ()
    drives = usual_drives(mechanism, channels.torques, axes) if drive is None else chosen
    equations = Equations(
        *(mechanism, parameters, rows, channels.torques, channels.names, drives),
        servos=servo_gains(recording, tree, channels.torques),
        scales=scale_deviations(recording, tree, channels.torques),
        couplings=recording.couplings,
    )
    samples = Samples(motion, channels.measured)
    fitted = separable(equations, samples) if drives else equations
    if lost := [name for name in drives if name not in fitted.drives]:
        notes.append(absorbed_note(mechanism, lost, fitted.mixed))
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
        drives=drives,
        searches_stribeck=drive is None,
    )


def _with_known_bodies(mechanism: Mechanism, recording: Recording) -> Mechanism:
    """Mechanism with the standard deviations that a recording states of single bodies."""
    if not recording.known_bodies:
        return mechanism
    before = mechanism.prior_known
    stated = {name: {**before.get(name, {}), **own} for name, own in recording.known_bodies.items()}
    return replace(mechanism, prior_known={**before, **stated})


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
    motion = prepared.samples.motion if cutoff is None else recorded_motion(mechanism, recording, cutoff)
    _, wrench = _wrench(tree, recording, motion, None, [])
    torques = recording.torques_at(tree, motion)
    known, felt = np.isfinite(prepared.wrench).all(axis=0), list(prepared.equations.torques)
    raw = np.hstack([wrench[:, known], np.empty((len(wrench), 0)) if torques is None else torques[:, felt]])
    return Filtered(motion, raw if cutoff is None else low_pass(raw, rate, cutoff), raw)

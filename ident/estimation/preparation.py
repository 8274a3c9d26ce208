"""Preparation of a user's model and recording for a fit: one set of samples, channels and columns."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from ident.arguments import checked_names, rpy_text
from ident.errors import LogError
from ident.estimation import repairs
from ident.estimation.accumulator import separable
from ident.estimation.equations import (
    COMPONENTS,
    Equations,
    absorbed_note,
    drives_of,
    passive_drives,
    predicted_channels,
    usual_drives,
)
from ident.estimation.recorded_motion import check_tracked, motion_cutoff, recorded_motion
from ident.estimation.repairs import Clipped, Stuck
from ident.estimation.samples import Samples
from ident.files.table import BASE
from ident.geometry.se3 import coAd, inverse, roll_pitch_yaw
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.axes import Axes, column_place
from ident.model.regressor import drive_kinds
from ident.parameters.base_parameters import structural_base_parameters
from ident.parameters.structure import Sensors
from ident.recordings.channels import unmapped
from ident.recordings.followers import moving
from ident.recordings.recording import Recording
from ident.recordings.smoothing import low_pass, runs, settling
from ident.recordings.wrench import GROUND

Chosen = TypeVar("Chosen", bound=slice | np.ndarray, covariant=True)
"""A span of samples, or their indices."""


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
        drives: Names of the drives' columns before those that depend on others were left out.
        searches_stribeck: True if the data may add Stribeck friction to them.
        resting: Joints that rest, which excite no friction.
        guessed: True if the model's bodies are a guess that shows neither unmeasured contacts nor gross errors.
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
    drives: tuple[str, ...] = ()
    searches_stribeck: bool = False
    resting: tuple[str, ...] = ()
    guessed: bool = False

    def usable(self, time: np.ndarray) -> np.ndarray:
        """Mask of the times at which samples are not left out (N,)."""
        outside = [(time < each.start) | (time > each.end) for each in self.left_out]
        return np.all([np.isfinite(time), *outside], axis=0)

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
        out = self.recording.covered((*names, BASE))
        for first, end in runs(~out):
            out[max(0, first - self.edge) : end + self.edge] = False
        return out

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
        mechanism: The mechanism; without a prior, its bodies have no mass by the model.
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
    mechanism, recording, notes = moving(mechanism, recording)
    tree = mechanism.tree
    if mechanism.prior is None:
        mechanism = replace(mechanism, prior=np.zeros(10 * len(mechanism.bodies)))
    mechanism, (recording,) = at_rest(mechanism, [recording])
    mechanism = _with_known_bodies(mounted(mechanism, recording), recording)
    asked = () if drive is None else drive_kinds(drive)
    leave_out = checked_names("leave_out", leave_out, (*COMPONENTS, *tree.freedoms))
    recording, steps, clipped, constant, of_repairs = repairs.mended(recording, mechanism, leave_out)
    resting = repairs.rests(recording, tree)
    check_tracked(mechanism, recording, resting)
    notes += [*of_repairs, *_orientation(mechanism, recording), *(repairs.rest_note(*each) for each in resting.items())]
    cutoff = motion_cutoff(recording, mechanism.joints, cutoff, filters)
    motion = recorded_motion(mechanism, recording, cutoff)
    frame, wrench = _wrench(tree, recording, motion, cutoff, notes)
    constant = constant | _constant_together(recording, wrench)
    wrench = np.where(np.isin(COMPONENTS, (*constant, *leave_out)), np.nan, wrench)
    torques = recording.torques_at(tree, motion, cutoff)
    every = dict(zip(COMPONENTS, wrench.T, strict=True))
    every |= {} if torques is None else dict(zip(tree.freedoms, torques.T, strict=True))
    measured = {name: x for name, x in every.items() if np.isfinite(x).all()}
    felt = [k for k, freedom in enumerate(tree.freedoms) if freedom in measured]
    if asked and not felt:
        notes.append(f"The log has no joint torques for the drive columns {', '.join(drive or ())}.")
    if not measured:
        out = leave_out if recording.wrenches or torques is not None else ()
        raise LogError(f"{name} {_nothing_to_fit(recording, out, tuple(constant), notes)}")
    stuck = repairs.stuck(constant, predicted_channels(mechanism, motion, frame, torques=torques is not None), notes)
    axes = Axes.of(tree, recording.couplings)
    chosen = drives_of(axes, asked, range(len(tree.freedoms))) if felt else ()
    chosen += passive_drives(mechanism, axes, asked, felt)
    drives = usual_drives(mechanism, felt, axes) if drive is None else chosen
    samples = Samples(motion, np.column_stack(list(measured.values())))
    equations, sensors = equations_of(mechanism, recording, frame, samples, tuple(measured), drives)
    notes += [*_hidden(equations, sensors), *_not_separate(equations, drives, resting)]
    return Prepared(
        *(mechanism, recording, equations, samples, sensors, frame, wrench, cutoff),
        notes=(*recording.notes, *notes),
        stuck=stuck,
        clipped=clipped,
        steps=steps,
        drives=drives,
        searches_stribeck=drive is None,
        resting=tuple(resting),
    )


def _orientation(mechanism: Mechanism, recording: Recording) -> list[str]:
    """Note on the orientation of the base, or of the axes of its poses, if one is stated."""
    if mechanism.base_rpy_deg is None:
        return []
    down = ", ".join(f"{x:.3g}" for x in mechanism.gravity)
    of, are = ("base's", "") if recording.base is None else ("poses' axes have", " are")
    return [f"The {of} roll, pitch and yaw{are} {rpy_text(mechanism.base_rpy_deg)}°: gravity ({down}) m/s²."]


def _nothing_to_fit(
    recording: Recording, leave_out: Sequence[str], constant: Sequence[str], notes: Sequence[str]
) -> str:
    """Reason why no channel of a recording can be fitted."""
    if leave_out:
        return f"has nothing to fit: all that it measures is left out, {', '.join(leave_out)}."
    if constant:
        return f"is constant in every channel ({', '.join(constant)}); check sensors and columns."
    known = " ".join([*recording.notes, *notes, unmapped(recording.unused)])
    return f"has neither a wrench nor a joint torque to fit. {known}"


def _not_separate(equations: Equations, drives: Sequence[str], resting: Collection[str]) -> list[str]:
    """Notes on parameters that show only together with others, and on drives that were left out."""
    lost = [name for name in drives if name not in equations.drives]
    still = [name for name in lost if column_place(name)[1] in resting]
    absorbed = [name for name in lost if name not in still]
    return [
        *([equations.parameters.remark] if equations.parameters.remark else []),
        *([f"{', '.join(still)} do not show in a joint that rests."] if still else []),
        *([absorbed_note(equations.mechanism, absorbed, equations.mixed)] if absorbed else []),
    ]


def mounted(mechanism: Mechanism, recording: Recording) -> Mechanism:
    """Mechanism with the orientation of its base, or of the axes of a moving base's poses, that a recording states.

    Raises:
        InputError: Another orientation was stated before.
    """
    return mechanism if recording.base_rpy_deg is None else mechanism.mounted(recording.base_rpy_deg)


def at_rest(mechanism: Mechanism, recordings: Sequence[Recording]) -> tuple[Mechanism, list[Recording]]:
    """Mechanism and recordings with a base at rest, if the recorded poses of the base have one constant rotation.

    Gravity is then in the axes of the base frame, and fewer parameters show than on a base that moves. What rests in
    the world beside the mechanism needs the poses.
    """
    bases = [each.base for each in recordings if each.base is not None]
    in_world = any(sensor.frame == "world" for each in recordings for sensor in each.sensors.values())
    moving = any(np.ptp(T, axis=0).any() or (T[0] != bases[0][0])[:3, :3].any() for T in bases)
    if in_world or moving or not 0 < len(bases) == len(recordings):
        return mechanism, list(recordings)
    out = []
    for each in recordings:
        held = bool(not each.wrenches or GROUND in each.wrenches) if each.held is None else each.held
        streams = {name: stream for name, stream in each.streams.items() if name != BASE}
        notes = (*each.notes, "The base rests: its recorded pose is constant.")
        out.append(replace(each, base=None, held=held, streams=streams, notes=notes))
    return mechanism.mounted(roll_pitch_yaw(bases[0][0, :3, :3])), out


def _with_known_bodies(mechanism: Mechanism, recording: Recording) -> Mechanism:
    """Mechanism with the standard deviations that a recording states of single bodies."""
    if not recording.known_bodies:
        return mechanism
    before = mechanism.prior_known
    stated = {name: {**before.get(name, {}), **own} for name, own in recording.known_bodies.items()}
    return replace(mechanism, prior_known={**before, **stated})


def equations_of(
    mechanism: Mechanism,
    recording: Recording,
    frame: np.ndarray,
    samples: Samples,
    channels: tuple[str, ...],
    drives: tuple[str, ...],
) -> tuple[Equations, Sensors]:
    """Equations of channels without the drives that the motion does not separate, and the measured quantities.

    Args:
        mechanism: The mechanism.
        recording: The recording.
        frame: Pose of the frame in which components of the wrench are expressed (4, 4).
        samples: Motion and these channels.
        channels: Names of components of the wrench, and then of freedoms with a torque.
        drives: Names of the drives' columns, left out without torques.
    """
    freedoms = mechanism.tree.freedoms
    known = [COMPONENTS.index(name) for name in channels if name in COMPONENTS]
    torques = tuple(freedoms.index(name) for name in channels[len(known) :])
    rows = coAd(inverse(frame))[known] if known else None
    servos = [recording.servos.get(freedoms[k]) for k in torques] if recording.servos else []
    gains = np.array([(each.kp, each.kv) if each else (0.0, 0.0) for each in servos]).T
    sensors = Sensors(bool(known), bool(torques), samples.motion.base is not None, rows, recording.still)
    parameters = structural_base_parameters(mechanism, sensors=sensors)
    equations = Equations(
        *(mechanism, parameters, rows, torques, channels, drives if torques else ()),
        servos=gains if servos else None,
        scales=tuple(float(recording.scales.get(freedoms[k], 0.0)) for k in torques),
        couplings=recording.couplings,
    )
    return separable(equations, samples) if equations.drives else equations, sensors


def _hidden(equations: Equations, sensors: Sensors) -> list[str]:
    """Note on the base parameters that cannot be identified without the missing components of the wrench."""
    whole, rank = replace(sensors, channels=None), equations.parameters.rank
    every = structural_base_parameters(equations.mechanism, sensors=whole).rank if sensors.base_wrench else rank
    if every == rank:
        return []
    return [
        f"{every - rank} of {every} base parameters cannot be seen in {', '.join(equations.channels)}, whatever the "
        "motion; they take the other components of the wrench."
    ]


def _wrench(
    tree: Tree, recording: Recording, motion: Motion, cutoff: float | None, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the ground sensor's frame and total wrench in it (Eq. 17), of contacts alone if the base is not held."""
    wrenches = recording.wrenches
    if not wrenches and (recording.base is None or recording.held):
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


class Part(NamedTuple, Generic[Chosen]):
    """Part of a recording.

    Attributes:
        log: The recording.
        samples: The samples of it, of which those left out, clipped or in a gap are not used.
    """

    log: Prepared
    samples: Chosen

    @property
    def indices(self) -> np.ndarray:
        """Indices of the used samples."""
        return self.log.taken(self.samples)

    @property
    def used(self) -> Samples:
        """The used samples."""
        return self.log.samples[self.indices]

    @property
    def times(self) -> np.ndarray:
        """Times of the used samples, s."""
        return self.log.recording.time[self.indices]

    def of(self, log: Prepared) -> "Part[Chosen]":
        """The same samples of another version of the recording."""
        return Part(log, self.samples)


def length(parts: Sequence[Part[slice]]) -> int:
    """Number of samples of parts that are spans."""
    return sum(part.samples.stop - part.samples.start for part in parts)


def filtered(prepared: Prepared, cutoff: float | None) -> tuple[Samples, np.ndarray]:
    """Samples low-passed at a cut-off, Hz, and their unfiltered channels (N, C); with prepared states for None."""
    mechanism, recording = prepared.mechanism, prepared.recording
    motion = prepared.samples.motion if cutoff is None else recorded_motion(mechanism, recording, cutoff)

    def channels(cutoff: float | None) -> np.ndarray:
        wrench = _wrench(mechanism.tree, recording, motion, cutoff, [])[1][:, np.isfinite(prepared.wrench).all(axis=0)]
        torques = recording.torques_at(mechanism.tree, motion, cutoff)
        return wrench if torques is None else np.hstack([wrench, torques[:, list(prepared.equations.torques)]])

    raw = channels(None)
    return Samples(motion, raw if cutoff is None else channels(cutoff)), raw

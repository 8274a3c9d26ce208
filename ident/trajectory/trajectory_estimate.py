"""Trajectory estimate of parameters, set-up, trajectories and noise from recordings."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import cache

import numpy as np

from ident.arguments import checked_names
from ident.estimation.accumulator import accumulate
from ident.estimation.equations import Equations
from ident.estimation.measurement import Measurement
from ident.estimation.noise import channel_scales
from ident.estimation.preparation import Part, Prepared, length
from ident.estimation.recorded_motion import aligned
from ident.estimation.setup_parameters import SetupParameter, name_in_log, setup_parameters
from ident.mechanism.mechanism import Mechanism
from ident.parameters.prior import drive_precision, known_covariance
from ident.recordings.wrench import GROUND
from ident.setup import FRICTION, OFFSET, OWN
from ident.tolerances import DRIVE, SINGULAR
from ident.trajectory import moves
from ident.trajectory.cut_pieces import WIDEST, WIDEST_BESIDE_TORQUES, knot_distance
from ident.trajectory.fit.fitted import Prior, inverse_of_precision
from ident.trajectory.fit.iteration import Report
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.reversals import low_velocity_columns
from ident.trajectory.stages import Stages

FINEST = 0.005
"""Smallest knot spacing, s: no drive's torque is known to change faster."""

OF_RECORDINGS = FRICTION, OFFSET
"""Kinds of columns that recordings may have for themselves: friction changes with temperature and load, offsets with
every start of an amplifier."""

RUBS = tuple(f"{DRIVE[kind]}(" for kind in ("viscous", "coulomb", "stribeck"))
"""Beginnings of the names of columns of friction."""

FAR_OFF = 3.0
"""Ratio of the recording's bodies to the model's from which these are not of its size; masses that models guess are
wrong by less than a factor of two."""

ENOUGH = 4_000
"""Number of samples by which knots, friction, noise model, prior and set-up are decided. Of a double pendulum's 10,000,
5,000 decide alike but for the friction of a joint near reversals, and it is predicted alike to 2 %; 3,300 decided on
correlated noise, which predicts it by 11 and 17 % worse."""


def trajectory_estimate(
    recordings: Sequence[Part[slice]],
    equations: Equations,
    *,
    setup: Mapping[str, float] | None = None,
    known: Mapping[str, float] | None = None,
    fallback: Mapping[str, float] | None = None,
    own: Sequence[str] = (),
    search: bool = True,
    stribeck: bool = False,
    physical: bool = False,
    knots: float | None = None,
    executor: Executor | None = None,
    report: Report | None = None,
) -> TrajectoryEstimate:
    """Estimates trajectories, parameters, set-up and noise of recordings that share their parameters.

    Args:
        recordings: Parts of recordings to fit.
        equations: Channels and columns.
        setup: Standard deviations of the set-up, as for `setup_parameters`.
        known: Standard deviations of the model's φ, as for `known_deviations`; None for no prior.
        fallback: Those to use if the data alone turn out far less precise while knots are chosen; None for never.
        own: Kinds of parameters that each recording has separately, out of `OWN`.
        search: True to search for set-up errors.
        stribeck: True to fit Stribeck friction of the joints for which recordings ask for it.
        physical: True to require physical bodies.
        knots: Knot spacing of the trajectory, s; by default chosen by the motion.
        executor: Executor for the pieces; by default they are computed here.
        report: Called with every round and its step in standard deviations.
    """
    own = checked_names("own", own, OWN)
    logs, sized = [part.log for part in recordings], with_bodies_to_size(equations, recordings[0])

    @cache
    def measurement_of(columns: Equations, mechanism: Mechanism) -> Measurement:
        # Its programs are recorded once for stages with a prior and without.
        return _measurement(logs[0], replace(columns, mechanism=mechanism), setup)

    def stages_of(known: Mapping[str, float] | None, columns: Equations, own: Sequence[str] = own) -> Stages:
        # A prior is that of the bodies as they are.
        measurement = measurement_of(columns, columns.mechanism if known is not None else sized)
        names, setup_at, of_recording = _shared(measurement, len(recordings), own)
        prior = _prior(measurement, setup_at, len(names), known)
        return Stages(
            measurement, recordings, names, setup_at, of_recording, prior, known is not None, search, executor, report
        )

    stages = stages_of(known, equations)
    share = max(1, length(recordings) // ENOUGH)
    widest = WIDEST if stages.measurement.components else WIDEST_BESIDE_TORQUES
    steps = [knots or knot_distance(log.recording, log.mechanism.joints, widest) for log in logs]
    finest = [knots or max(moves.KNOTS_PER_SAMPLE / log.recording.rate, FINEST) for log in logs]
    estimate = moves.explored(stages, steps, share, finest)
    if fallback is not None:
        with_prior = stages_of(fallback, equations)
        estimate = moves.preferred(with_prior, stages.carried(estimate))
        known, stages = (fallback, with_prior) if estimate.known else (known, stages)
    estimate = moves.settled(stages, estimate)
    if moves.disagree(estimate, own_columns(estimate.measurement, OF_RECORDINGS)):
        apart = stages_of(known, equations, (*own, *OF_RECORDINGS))
        tried = moves.better(
            estimate,
            "own friction and offsets",
            lambda: moves.settled(apart, moves.explored(apart, steps, share, finest)),
        )
        if len(tried.fit.names) > len(estimate.fit.names):
            own, stages = (*own, *OF_RECORDINGS), apart
        estimate = tried
    if more := low_velocity_columns(equations, estimate.reversals) if stribeck else ():
        wider = stages_of(known, equations.with_stribeck(more), own)
        estimate = moves.with_setup_errors(wider, wider.carried(estimate))
        kept = [name for name in more if estimate.fit.unbound.free[wider.names.index(name)]]
        stages = stages_of(known, equations.with_stribeck(kept) if kept else equations, own)
        estimate = stages.carried(estimate)
    else:
        estimate = moves.with_setup_errors(stages, estimate)
    if share > 1:
        estimate = moves.with_setup_errors(stages, moves.whole(stages, estimate))
    estimate = moves.converged(stages, estimate)
    return moves.with_physical_bodies(stages, estimate) if physical else estimate


def with_bodies_to_size(equations: Equations, recording: Part[slice]) -> Mechanism:
    """Mechanism whose bodies have the size that a recording gives them, if the model's are far from that.

    Set-up errors also act through parameters that the channels do not contain. These are the model's; of a model in
    wrong units they would make standard deviations of any size.

    Args:
        equations: Channels and columns.
        recording: A recording, by whose least squares the sizes are compared.
    """
    mechanism, rank, samples = equations.mechanism, equations.parameters.rank, recording.used
    samples = samples[:: max(1, len(samples) // ENOUGH)]
    weights = 1 / channel_scales([samples.measured], equations.channels)
    root = accumulate(equations, samples, factors=np.broadcast_to(weights, samples.measured.shape)).root
    size = np.maximum(np.linalg.norm(root[:, :-1], axis=0), 1e-300)
    psi = (np.linalg.lstsq(root[:, :-1] / size, root[:, -1], rcond=SINGULAR)[0] / size)[:rank]
    model, data = (root[:, :rank] @ each for each in (equations.from_model[:rank], psi))
    ratio = float(model @ data) / max(float(model @ model), 1e-300)
    if mechanism.prior is None or 1 / FAR_OFF < ratio < FAR_OFF:
        return mechanism
    return replace(mechanism, prior=ratio * mechanism.prior)


def _measurement(prepared: Prepared, equations: Equations, setup: Mapping[str, float] | None) -> Measurement:
    recording = prepared.recording
    # The source of a mechanism is not needed in other processes, and cannot be pickled.
    equations = replace(equations, mechanism=replace(equations.mechanism, source=None))
    contacts = {name: recording.sensors[name] for name in recording.wrenches if name != GROUND}
    plates = dict.fromkeys(sensor.plate or name for name, sensor in contacts.items())
    held, moving = GROUND in recording.wrenches, recording.base is not None
    measured = np.isfinite(prepared.wrench).all(axis=0)
    return Measurement(
        equations,
        setup_parameters(equations, tuple(plates), setup, held=held, moving=moving, trackers=recording.trackers),
        moving,
        prepared.frame if held else None,
        tuple(np.flatnonzero(measured).tolist()),
        contacts,
        aligned(equations.mechanism, recording, prepared.samples.motion) if recording.trackers else {},
    )


def _shared(
    measurement: Measurement, recordings: int, own: Sequence[str]
) -> tuple[list[str], dict[int, SetupParameter], list[np.ndarray]]:
    """Names of all parameters, those of the set-up by index, and the indices of each recording's."""
    names, setup, every = list(measurement.names), dict(measurement.setup_at), [np.arange(len(measurement.names))]
    mine = [*own_columns(measurement, own), *(k for k, each in measurement.setup_at.items() if each.kind in own)]
    for number in range(2, recordings + 1):
        chosen = np.arange(len(measurement.names))
        chosen[mine] = len(names) + np.arange(len(mine))
        setup |= {int(chosen[k]): replace(setup[k], log=number) for k in mine if k in setup}
        names += [name_in_log(measurement.names[k], number) for k in mine]
        every.append(chosen)
    return names, setup, every


def own_columns(measurement: Measurement, own: Sequence[str]) -> np.ndarray:
    """Indices of the columns of some kinds out of `OF_RECORDINGS` (k,)."""
    equations, rank = measurement.equations, measurement.equations.parameters.rank
    kinds = [FRICTION if name.startswith(RUBS) else "" for name in equations.drives] + [OFFSET] * len(equations.offsets)
    return rank + np.flatnonzero(np.isin(kinds, own))


def _prior(
    measurement: Measurement, setup: Mapping[int, SetupParameter], number: int, known: Mapping[str, float] | None
) -> Prior:
    """Gaussian prior of all `number` parameters; `setup` has those of the set-up by index."""
    precision = np.diag([1 / setup[k].std ** 2 if k in setup else 0.0 for k in range(number)])
    mean = np.zeros(number)
    if known is not None:
        equations = measurement.equations
        count, rank = equations.parameters.rank + len(equations.drives), equations.parameters.rank
        mean[:count] = equations.from_model
        beforehand = known_covariance(equations.mechanism, equations.parameters, known, equations.absorbed)
        # A plain inverse may be asymmetric by more than the smallest eigenvalue.
        precision[:rank, :rank] = inverse_of_precision(beforehand)
        drives = range(rank, count)
        precision[drives, drives] = drive_precision(equations.mechanism, equations.drives, equations.scaled)
    return Prior(mean, precision)

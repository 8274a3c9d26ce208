"""Moves of the trajectory estimate: what each frees, and by what it is kept.

1. Knots are made denser as long as the channels' noise, taken as white, decreases: jumps need denser knots, but model
   errors do not decrease with them.
2. The model's bodies are a prior if left-out pieces are then predicted better, clearly.
3. Torques near reversals get an additional variance (`ident.trajectory.reversals`).
4. Noise is correlated over time if left-out pieces are then predicted better.
5. Friction and offsets are each recording's own where recordings disagree, and left-out pieces are predicted better.
6. Set-up errors and further friction are freed one by one (`ident.trajectory.setup_search`).
7. The estimate converges (`SETTLED`): fits before it end once what they decide would not change any more (`NEAR`).

Moves 2, 4 and 5 share one test, `better`. All but knots, of which each recording keeps its own, are kept or undone by
`ident.trajectory.left_out.after`. Standard deviations follow from noise that is estimated independently of the weights
(`ident.trajectory.fit.sandwich`).
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
from scipy import linalg, special

from ident.errors import ExcitationError
from ident.estimation.preparation import length
from ident.estimation.setup_parameters import SetupParameter
from ident.parameters.consistency import consistent_parameters
from ident.tolerances import ROUNDING, SIGNIFICANT
from ident.trajectory.fit import iteration
from ident.trajectory.fit.fitted import TINIEST, TrajectoryFit, inverse_of_precision
from ident.trajectory.fit.iteration import SETTLED
from ident.trajectory.fit.piece import residual
from ident.trajectory.fit.repeats import repeating
from ident.trajectory.fit.sandwich import by_samples, with_scatter
from ident.trajectory.left_out import CLEARLY, Move, after, clearly_less, prediction_errors
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.reversals import speeds
from ident.trajectory.setup_search import SearchSpace, searched
from ident.trajectory.stages import EXPLORED, Stages
from ident.trajectory.start import likely_delay, smoothed

SMALLER = 0.985
"""Geometric mean of the channels' noise, over that with half as many knots, below which denser ones are used."""

MUCH = 0.7
"""The same ratio below which knots are made four times as dense at once, as for a joint with friction."""

TRIES = 2
"""Number of knot spacings tried without a decrease of the noise, where residuals are correlated over less than the knot
spacing: a single halving may be too little to follow a touch."""

WORTH_A_PRIOR = 0.1
"""Decrease of the mean log error of left-out pieces with which exploring fits take a prior. It stands in for errors of
the set-up, too, which are found later: somebody who bows gains .06 and is predicted worse with it in the end, a UR10
gains .06 and is predicted alike; of three people who lift, whose bodies the data hardly tell, two gain .15 and .26.
"""

MAJORITY, FAR_LESS = 0.5, 30.0
"""Share of the channels that must be predicted for pieces to decide on a prior; and standard deviations from the data,
over those of the prior, above which it is used otherwise: noise, or a contact left out, can pass for excitation."""

WEIGHED = 20
"""Rounds after which white and correlated noise are compared, before the fit with the better one goes on."""

HOPELESS, STEADY, FAR_WORSE = 5, 2.0, 0.7
"""Rounds after which correlated noise that does not predict clearly better is given up, step of θ, in standard
deviations, below which it then is, and increase of the mean log error from which it is anyway: of seven recordings six
were decided by then. A person who bows gains in the end, from an increase of .22 while θ moves by five; an arm that
rubs ends at 1.00, from 1.03 while θ moves by 24."""

OVERRATED = 2.0
"""Variance of the recordings' gradient over that of the working model from which the prior is weighted up."""

KNOTS_PER_SAMPLE = 2.0
"""Least number of samples per knot."""

ROUGHER = 1e3
"""Factor by which smoothness that was estimated while set-up errors were in the residuals begins lower than it ended.
The height of a person's pelvis was held smooth at 10^5.0 then, and stayed there (from a thirtieth of it, too), where
10^1.6 explains the vertical force: 52 instead of 92 % of the 95 % intervals held with all of the set-up known.
"""

UNFOLLOWED = 0.125
"""Apparent time shift, over the knot spacing, due to jumps that knots cannot follow: motions with trapezoidal
velocities at 100 Hz, otherwise exact, gave spurious clock errors with shifts of a twentieth."""

CORRELATED = 0.15
"""Autocorrelation of a residual at lag one above which denser knots, or correlated noise, are tried."""

TURNS = 8
"""Largest number of alternations."""

RESTS = 0.05
"""Step of ψ, in standard deviations, below which it has converged."""


def explored(stages: Stages, steps: Sequence[float], share: int, finest: Sequence[float]) -> TrajectoryEstimate:
    """Exploring fit with white noise and the densest knots that still decrease the noise of a recording notably.

    Args:
        steps: Initial knot spacing of each recording, s.
        share: Step k: every k-th piece of each recording is used; half of it where these do not determine θ.
        finest: Smallest knot spacing of each, s.
    """
    try:
        best = last = stages.begun(steps, share)
    except ExcitationError:
        if share == 1:
            raise
        return explored(stages, steps, share // 2, finest)
    near, far = correlated(best)
    patience = np.where((near & ~far).any(axis=1), TRIES, 1)
    tries, parts = np.where(near.any(axis=1), patience, 0), np.full(len(patience), 2)
    chosen, noise = np.array(steps), _log_noise(best)
    try:
        while (tried := (tries > 0) & (np.array(last.steps) > finest)).any() and last.fit.status != "interrupted":
            # Rounded down to the smallest one if nearly as small.
            pairs = zip(last.steps / parts, finest, strict=True)
            denser = [least if own < np.sqrt(2) * least else own for own, least in pairs]
            last = stages.denser(last, np.where(tried, denser, chosen).tolist(), share)
            ratio = np.exp((_log_noise(last) - noise).mean(axis=1))
            kept, parts = tried & (ratio < SMALLER), np.where(ratio < MUCH, 4, 2)
            chosen, noise = np.where(kept, last.steps, chosen), np.where(kept[:, None], _log_noise(last), noise)
            tries = np.where(kept, patience, tries - tried)
            best = last if (chosen == last.steps).all() else best
        if (chosen != best.steps).any() and last.fit.status != "interrupted":
            return stages.denser(last, chosen.tolist(), share)
    except (ExcitationError, np.linalg.LinAlgError):
        pass
    return last if last.fit.status == "interrupted" else best


def preferred(stages: Stages, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
    """Exploring estimate of stages without a prior, or one with this prior if it predicts left-out pieces better.

    Where pieces repeat each other, it has to predict them as well. Without pieces to leave out the prior is taken
    wherever it is more precise than the data, and where neither predicts most channels, if it is far more precise.
    """
    fit = estimate.fit
    used = min(sum(len(piece.time) for piece in fit.pieces) / length(stages.recordings), 1.0)
    part = np.ix_(~stages.is_setup, ~stages.is_setup)
    most = np.linalg.eigvals(used * fit.covariance[part] @ stages.prior.precision[part]).real.max()
    if most < 1:
        return estimate

    @cache
    def with_prior() -> TrajectoryEstimate:
        return stages.refitted(stages.carried(estimate), rounds=EXPLORED)

    if len(fit.pieces) < 2:
        return with_prior()
    # Pieces that repeat motions and what is left of them predict each other's errors as well.
    repeated = sum(len(each.starts) for each in repeating(stages.measurement, fit)) == len(estimate.counts)
    worth = -WORTH_A_PRIOR if repeated else WORTH_A_PRIOR
    chosen = better(estimate, "prior", lambda: stages.carried(estimate), worth - CLEARLY)
    chosen = better(estimate, "prior", with_prior, worth) if chosen.known else chosen
    neither = np.mean((chosen.errors.get("prior", np.zeros((2, 1))) < 1).any(axis=0)) < MAJORITY
    return with_prior() if neither and most > FAR_LESS**2 and not chosen.known else chosen


def settled(stages: Stages, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
    """Estimate near convergence with friction near reversals, and noise white or correlated over time."""
    if estimate.fit.status == "interrupted":
        return estimate
    estimate = stages.opened(estimate)
    # In the unconverged fit a drive may have been set to zero wrongly.
    white = stages.refitted(estimate.with_fit(estimate.fit.unbound), rounds=WEIGHED)
    # Residuals correlated over less than the knot spacing are jumps that knots cannot follow.
    if correlated(white)[1].any():
        white = _coloured(stages, white)
    if white.fit.status != "stopped":
        return white
    return stages.refitted(white, rounds=iteration.ROUNDS - WEIGHED)


def _coloured(stages: Stages, white: TrajectoryEstimate) -> TrajectoryEstimate:
    """Estimate with white noise, or with correlated noise if that predicts clearly better."""

    def tried() -> TrajectoryEstimate:
        soon = stages.refitted(replace(white, coloured=True), rounds=HOPELESS)
        if soon.fit.status != "stopped":
            return soon
        margin = CLEARLY if soon.fit.trace[-1] < STEADY else -FAR_WORSE
        hopeful = better(white, "", lambda: soon, margin).coloured
        return stages.refitted(soon, rounds=WEIGHED - HOPELESS) if hopeful else soon

    return better(white, "correlated noise", tried)


def whole(stages: Stages, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
    """Estimate near convergence from all pieces, with knots, noise and set-up of one from fewer pieces.

    Noise that is correlated there has to predict all pieces better as well: white noise is the more robust choice.
    The covariance of its gradient is that of the fewer pieces, by numbers of samples: enough for score tests.
    """
    pieces = stages.cut(estimate.steps, 1)
    alone = smoothed(pieces, estimate.fit.noises, executor=stages.executor)
    if estimate.reversals is not None:
        theta = [estimate.fit.theta[stages.of_recording[piece.log]] for piece in pieces]
        rates = [speeds(stages.measurement, *x) for x in zip(pieces, alone.coefficients, theta, strict=True)]
        pieces = estimate.reversals.opened(pieces, rates)
    begun = replace(estimate.fit, pieces=pieces, coefficients=alone.coefficients)
    begun = replace(begun, theta=np.where(begun.free | ~stages.is_setup, begun.theta, stages.prior.mean))
    begun = replace(begun, noises=[replace(own, channels_rho=0 * own.channels_rho) for own in begun.noises])
    out = stages.refitted(replace(estimate.with_fit(begun.unbound), coloured=False))
    out = _coloured(stages, out) if estimate.coloured else out
    if out.fit.status == "interrupted":
        return out
    return out.with_fit(replace(out.fit, status="near", scatters=by_samples(estimate.fit, pieces)))


def with_setup_errors(stages: Stages, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
    """Estimate with set-up errors, if these are searched for, and with sandwich covariance."""
    estimate = _with_weighted_prior(stages, estimate if estimate.fit.scatters else stages.scattered(estimate))
    if estimate.search.incredible or estimate.fit.status == "interrupted" or len(estimate.fit.pieces) < 2:
        return estimate

    def scattered(begin: TrajectoryFit) -> TrajectoryFit:
        return with_scatter(estimate.measurement, stages.fitted(estimate, begin, shares=False), every=False)

    far = [at for at, each in stages.setup.items() if each.row.far and stages.search]
    delays = {at: partial(likely_delay, estimate.measurement, at) for at in far}
    space = SearchSpace(
        setup=stages.is_setup & ~stages.is_estimated & stages.search,
        drives=stages.is_drive & ~estimate.fit.unbound.free,
        least=_unfollowed(stages, estimate),
        gross=stages.gross,
        groups=_groups(stages.setup, len(stages.names)),
    )
    return replace(estimate, search=searched(estimate.search, scattered, space, delays))


def _unfollowed(stages: Stages, estimate: TrajectoryEstimate) -> np.ndarray:
    """Apparent delays and clock errors due to jumps, zero unless knots are as dense as samples allow (p,)."""
    pieces, out = estimate.fit.pieces, np.zeros(len(stages.names))
    half = np.array(max(float(piece.when[-1] - piece.origin) for piece in pieces) / 2)
    between = [float(np.median(np.diff(piece.when))) for piece in pieces]
    pairs = zip((estimate.steps[piece.log] for piece in pieces), between, strict=True)
    step = max((own for own, each in pairs if own <= KNOTS_PER_SAMPLE * each * (1 + ROUNDING)), default=0.0)
    for at, each in stages.setup.items():
        if each.row.shift is not None:
            out[at] = UNFOLLOWED * step / abs(each.row.shift(half))
    return out


def _with_weighted_prior(stages: Stages, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
    """Estimate with a prior weighted up where recordings carry less information than the fit assumes.

    Weights that take autocorrelated residuals as white overrate the recordings, several times on real robots, so
    that they override a more precise prior. The magnitude of the likelihood is adjusted to the covariance of its
    gradient, as for composite likelihoods (Ribatet, Cooley and Davison, Statistica Sinica 22, 2012,
    doi:10.5705/ss.2009.248).
    """
    fit = estimate.fit
    if not stages.known or fit.scatters is None or fit.prior.weight > 1:
        return estimate
    rank = stages.measurement.equations.parameters.rank
    curvature, scatter = (np.diag(each - fit.prior.precision)[:rank] for each in (fit.precision, fit.scatter))
    weight = float(np.median(scatter[curvature > 0] / curvature[curvature > 0])) if (curvature > 0).any() else 1.0
    if weight < OVERRATED:
        return estimate
    weighted = replace(fit.unbound, prior=fit.prior.weighted(weight))
    return stages.scattered(stages.refitted(estimate.with_fit(weighted)))


def converged(stages: Stages, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
    """Converged estimate.

    Friction near reversals and smoothness are estimated anew where set-up errors have been found since: residuals
    contained them.
    The gradient's covariance is computed again: short as the step is, directions that recordings leave
    undetermined, such as the common scale of bodies and torques, turn with θ.
    """
    fit = estimate.fit
    if fit.status != "near":
        return estimate
    if estimate.search.deviations:
        estimate = stages.opened(estimate)
        rougher = [replace(own, jerk=own.jerk / ROUGHER) for own in fit.noises]
        estimate = estimate.with_fit(replace(estimate.fit, noises=rougher))
    out = stages.refitted(estimate, settled=SETTLED, shares=False)
    again = replace(out.fit, scatters=fit.scatters, trace=(*fit.trace, *out.fit.trace))
    return stages.scattered(out.with_fit(again))


def _log_noise(estimate: TrajectoryEstimate) -> np.ndarray:
    """Logarithms of the noise by which knots are chosen, of every recording (L, s).

    It is that of the channels but poses. Commands have none: what knots do not follow is then in the angles'.
    """
    equations = estimate.measurement.equations
    angles, own = slice(0 if equations.servos is None else None), len(equations.channels)
    return np.log([np.r_[each.channels[:own], each.states[angles]] for each in estimate.fit.noises])


def _groups(setup: Mapping[int, SetupParameter], number: int) -> dict[str, np.ndarray]:
    """Directions in θ along which several set-up parameters change together, by description (p,) each."""
    groups = defaultdict[str, np.ndarray](lambda: np.zeros(number))
    for at, each in setup.items():
        for name, share in each.together.items():
            groups[each.row.together.format(name)][at] = share
    return {text: direction for text, direction in sorted(groups.items()) if np.count_nonzero(direction) > 1}


def better(
    usual: TrajectoryEstimate, name: str, other: Callable[[], TrajectoryEstimate], margin: float = CLEARLY
) -> TrajectoryEstimate:
    """The usual estimate, or another one that predicts left-out pieces clearly better.

    Args:
        usual: The usual estimate, with the shares of its pieces.
        name: Name of the alternative.
        other: Function that returns the other one, which may not be determined.
        margin: Decrease of the mean log error from which it is better.
    """
    errors = dict(usual.errors)

    def kept(tried: TrajectoryEstimate) -> bool:
        least = np.minimum(usual.fit.channel_noise, tried.fit.channel_noise)
        errors[name] = np.array([prediction_errors(each.measurement, each.fit, least) for each in (usual, tried)])
        return clearly_less(errors[name][0], errors[name][1], margin)

    return replace(after(usual, Move(other, kept)), errors=errors) if len(usual.fit.pieces) > 1 else usual


def disagree(estimate: TrajectoryEstimate, mine: np.ndarray) -> bool:
    """True if some parameters, by their indices, would differ significantly between the recordings (score test).

    With H_l and g_l the precision and right side of recording l, H their sum with the prior's, and K the parameters,

        gᵀ S⁻¹ g ~ χ²,    S_lm = (δ_lm H_l - H_l H⁻¹ H_m)_KK

    where g are the (g_l)_K of all recordings but the first.
    """
    fit, free = estimate.fit, estimate.fit.free
    mine = mine[free[mine]]
    if len(estimate.counts) < 2 or not len(mine):
        return False
    parts = [fit.shares[estimate.pieces_of(k)] for k in range(1, len(estimate.counts))]
    every = [(np.sum([H for H, _ in part], axis=0), np.sum([g for _, g in part], axis=0)) for part in parts]
    across = np.hstack([H[np.ix_(free, mine)] for H, _ in every])
    alone = linalg.block_diag(*(H[np.ix_(mine, mine)] for H, _ in every))
    score = np.concatenate([g[mine] for _, g in every])
    S = alone - across.T @ inverse_of_precision(fit.precision[np.ix_(free, free)]) @ across
    size = np.sqrt(np.maximum(np.diag(S), 1e-300))
    values, axes = np.linalg.eigh(S / np.outer(size, size))
    seen = values > 1e-9 * values[-1]
    z = (axes.T @ (score / size))[seen] / np.sqrt(values[seen])
    return bool((z**2).sum() > special.chdtri(seen.sum(), SIGNIFICANT))


def correlated(estimate: TrajectoryEstimate) -> np.ndarray:
    """Masks of the channels whose residual is correlated over one sample, and over the knot spacing (2, L, C).

    By recording, without samples with slack.
    """
    fit = estimate.fit
    products = np.zeros((2, len(fit.noises), len(fit.channel_noise)))
    squares = np.full(products.shape[1:], TINIEST)
    for point in fit.points:
        piece, left = point.piece, residual(estimate.measurement, point)
        clear = np.isfinite(left)
        if piece.slack is not None:
            clear &= piece.slack < point.noise.channels
        left = np.where(clear, left, 0.0)
        squares[piece.log] += (left**2).sum(axis=0)
        for k, lag in enumerate((1, max(1, round(piece.spline.step / float(np.median(np.diff(piece.when))))))):
            products[k, piece.log] += (left[lag:] * left[:-lag]).sum(axis=0)
    return np.asarray(products > CORRELATED * squares)


def with_physical_bodies(stages: Stages, estimate: TrajectoryEstimate) -> TrajectoryEstimate:
    """Estimate with ψ of physical bodies, as close to the model's as the recordings allow.

    Near a fit the cost is quadratic in ψ with everything else eliminated: its minimum is ψ* with covariance C. The ψ of
    the physical bodies closest to it (`ident.parameters.consistency`) is then fixed, while the trajectory, the set-up
    and the noise are fitted again; that changes ψ*, and the two steps alternate until ψ converges. Covariances are
    those without the condition, which adds little information where noise alone violates it.
    """
    fit, equations = estimate.fit, stages.measurement.equations
    mechanism, parameters, rank = equations.mechanism, equations.parameters, equations.parameters.rank
    absorbed, is_psi = equations.from_drives[:rank], np.arange(len(fit.theta)) < rank
    held = fit
    for _ in range(TURNS if fit.status != "interrupted" else 0):
        inverse = inverse_of_precision(held.precision[np.ix_(fit.free, fit.free)])
        wanted = held.theta[fit.free] + inverse @ held.gradient[fit.free]
        bodies = consistent_parameters(
            wanted[:rank] - absorbed, inverse[:rank, :rank], parameters, mechanism.known, bodies=mechanism.bodies
        )
        psi = bodies.psi + absorbed
        step = np.abs(psi - held.theta[:rank]) / np.sqrt(np.diag(inverse)[:rank])
        begin = replace(held, theta=np.r_[psi, held.theta[rank:]], free=fit.free & ~is_psi)
        held = stages.fitted(estimate, begin, settled=SETTLED)
        if step.max() < RESTS or held.status == "interrupted":
            break
    if held is not fit:
        held = replace(held, free=fit.free & (held.free | is_psi), trace=(*fit.trace, *held.trace))
    return stages.scattered(estimate.with_fit(held))

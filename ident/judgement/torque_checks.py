"""Checks of joint torques against the model's prediction: sign and size, friction, loads, and absent bodies.

Offsets, friction and rotor inertia, which the model lacks, are regressed out of measured and predicted torques alike.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ident.estimation.accumulator import accumulate
from ident.estimation.equations import SLIP, Equations, drives_of, stated_drive_torques
from ident.estimation.noise import least_noise
from ident.estimation.preparation import Prepared
from ident.estimation.samples import Samples
from ident.judgement.residuals import coefficients, correlated_samples
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.axes import Axes, column_place
from ident.model.regressor import joint_torque_regressor
from ident.parameters.prior import known_roots
from ident.regression.ordinary import Fit
from ident.tolerances import AGREES, FAR_BETTER, SINGULAR

FRICTION, SLOW = ("viscous", "coulomb"), "stribeck"
"""Drive columns with which friction is detected; and the one that is added at low velocity if these are fitted."""

SCALE = 3.0
"""Factor between measured and predicted torque from which a unit or a gear ratio is missing."""


class TorqueLoad(NamedTuple):
    """Load on a body of the model that explains the torques best.

    Attributes:
        body: The body's name.
        mass: Mass of the load over that of all bodies of the model.
        against_factors: Squared residual with it over that with a factor on each torque instead.
    """

    body: str
    mass: float
    against_factors: float

    @property
    def better(self) -> bool:
        """True if it explains the torques far better than factors do, and is no heavier than the model."""
        return abs(self.mass) < 1 and self.against_factors < FAR_BETTER

    @property
    def possible(self) -> bool:
        """True if factors do not explain the torques far better than it does."""
        return self.against_factors < 1 / FAR_BETTER


class TorqueCheck(NamedTuple):
    """Comparison of the torque of one joint with the model's prediction.

    Attributes:
        joint: The joint.
        gain: Measured over predicted torque, by least squares.
        flipped: True if the opposite sign fits far better.
        scaled: True if a factor of unit or gear explains the torque, and the usual uncertainty of bodies does not.
    """

    joint: str
    gain: float
    flipped: bool
    scaled: bool


class AbsentBody(NamedTuple):
    """Body of the model that was not carried, as its absence explains most of the torques' residual.

    Attributes:
        body: Its name; all bodies that it carries are left out with it.
        explained: Share of the squared residual that vanishes without it.
    """

    body: str
    explained: float


class TorqueChecks(NamedTuple):
    """Results of all checks of joint torques.

    Attributes:
        joints: Check of each torque.
        absent: The mounted body that was not carried, None for none.
        load: The load that explains most, where a torque is much more than the model's.
    """

    joints: tuple[TorqueCheck, ...]
    absent: AbsentBody | None
    load: TorqueLoad | None = None

    @property
    def gains(self) -> dict[str, float]:
        """Factors between measured and predicted torques that no load explains, by joint."""
        loaded = self.load is not None and self.load.better
        return {each.joint: each.gain for each in self.joints if each.scaled and not each.flipped and not loaded}

    @property
    def grossly_wrong(self) -> bool:
        """True if a torque's sign or unit is wrong."""
        return bool(self.gains) or any(check.flipped for check in self.joints)


def inner_samples(prepared: Prepared) -> Samples:
    """Samples of a recording, evenly spread, at most about 4000, without its ends."""
    number = len(prepared.samples)
    return prepared.samples[slice(prepared.edge, number - prepared.edge, max(1, number // 4000))]


def torque_checks(prepared: Prepared) -> TorqueChecks | None:
    """Checks of measured torques against the prediction of the model's φ; None without torques."""
    felt = list(prepared.equations.torques)
    if not felt:
        return None
    mechanism, samples = prepared.mechanism, inner_samples(prepared)
    motion, drives = samples.motion, drive_rows(prepared.equations.axes, samples.motion, felt)
    Y = joint_torque_regressor(mechanism.tree, *motion.states, gravity=mechanism.gravity, base=motion.base)[:, felt]
    by_body = Y.reshape(*Y.shape[:2], -1, 10)
    measured = without_drives(drives, samples.measured[:, -len(felt) :])
    of_bodies = without_drives(drives, np.einsum("ntbp,bp->ntb", by_body, mechanism.known.reshape(-1, 10)))
    uncertain = without_drives(drives, np.einsum("ntbp,brp->ntbr", by_body, known_roots(mechanism)).reshape(Y.shape))
    # Of the drives that the model states, springs are left.
    stated = without_drives(drives, stated_drive_torques(mechanism, motion)[:, felt]) if mechanism.drives else 0
    predicted, size = of_bodies.sum(axis=2) + stated, np.linalg.norm(uncertain, axis=(0, 2))
    each = zip(felt, measured.T, predicted.T, size, strict=True)
    checks = tuple(_check(mechanism.tree.freedoms[k], *compared) for k, *compared in each)
    load = None
    if any(check.scaled and check.gain > SCALE for check in checks):
        columns = (without_drives(drives, by_body[:, :, b]) for b in range(by_body.shape[2]))
        load = min(_loads(mechanism, measured, predicted, columns, size), key=lambda own: own.against_factors)
    return TorqueChecks(checks, _absent(mechanism, measured - predicted, of_bodies), load)


def _check(joint: str, measured: np.ndarray, predicted: np.ndarray, uncertain: float) -> TorqueCheck:
    """Check of the torque of one joint (N,) against its prediction (N,), given the norm of the latter's uncertainty."""
    size, whole = max(float(predicted @ predicted), 1e-300), max(float(measured @ measured), 1e-300)
    error, opposite = (float(np.linalg.norm(measured - sign * predicted)) for sign in (1, -1))
    gain, share = float(measured @ predicted) / size, float(measured @ predicted) / whole
    alike = gain * share
    # Smaller distances may be due to other bodies: the torque of a real wrist whose centre of mass is 55 mm from its
    # joint, 5 mm in its model, is 11.6 times the model's.
    far = FAR_BETTER * error > max(uncertain, 1e-300)
    scaled = alike > AGREES and far and not 1 / SCALE < abs(gain) < SCALE
    return TorqueCheck(joint, gain, opposite < FAR_BETTER * error, scaled)


def _loads(
    mechanism: Mechanism,
    measured: np.ndarray,
    predicted: np.ndarray,
    columns: Iterator[np.ndarray],
    uncertain: np.ndarray,
) -> Iterator[TorqueLoad]:
    """Yields the load on each body that leaves least, each torque weighted by its prediction's uncertainty.

    Args:
        mechanism: The mechanism.
        measured: Torques (N, n).
        predicted: Predicted torques (N, n).
        columns: Torques of unit parameters φ of each body (N, n, 10).
        uncertain: Norm of each prediction's uncertainty (n,).
    """
    weight = 1 / np.maximum(uncertain, 1e-300)
    gains = (measured * predicted).sum(axis=0) / np.maximum((predicted**2).sum(axis=0), 1e-300)
    by_factors = max(float((((measured - gains * predicted) * weight) ** 2).sum()), 1e-300)
    left = ((measured - predicted) * weight).ravel()
    for i, each in zip(mechanism.tree.inertial, columns, strict=True):
        rows = (each * weight[:, None]).reshape(-1, 10)
        phi = coefficients(rows, left, 1e-8)
        residual = float(((left - rows @ phi) ** 2).sum())
        yield TorqueLoad(mechanism.tree.names[i], float(phi[0]) / max(mechanism.mass, 1e-300), residual / by_factors)


def _absent(mechanism: Mechanism, residual: np.ndarray, of_bodies: np.ndarray) -> AbsentBody | None:
    """The mounted body without which the residual (N, n) is smallest, from the torques of all bodies (N, n, b).

    None if its absence does not explain half of it, and far more than a common factor on all bodies.
    """
    tree, before, predicted = mechanism.tree, max(float((residual**2).sum()), 1e-300), of_bodies.sum(axis=2)
    by_factor = float((residual * predicted).sum() ** 2 / max(float((predicted**2).sum()), 1e-300)) / before
    left = dict[str, float]()
    for i in _mounted(mechanism):
        carried = [tree.inertial.index(k) for k in tree.carried(i) if k in tree.inertial]
        left[tree.names[i]] = float(((residual + of_bodies[:, :, carried].sum(axis=2)) ** 2).sum()) / before
    body = min(left, key=left.__getitem__, default="")
    if not body or left[body] >= min(0.5, FAR_BETTER * (1 - by_factor)):
        return None
    return AbsentBody(body, 1 - left[body])


def _mounted(mechanism: Mechanism) -> Iterator[int]:
    """Yields bodies with mass that are fixed to a moving one, such as tools, and may have been absent."""
    tree = mechanism.tree
    for i, mass in zip(tree.inertial, mechanism.known[::10], strict=True):
        if i in tree.moved and not tree.bodies[i].moves and mass > 0:
            yield i


def drive_rows(axes: Axes, motion: Motion, felt: list[int]) -> list[np.ndarray]:
    """Columns of offset, friction and rotor inertia of each torque (N, m), of unit norm."""
    ddq, out = axes.moved(motion.ddq), []
    for k in felt:
        rotors = [ddq[:, a] for a in map(axes.names.index, axes.acting(FRICTION[0], k))]
        rows = np.stack([*friction_columns(axes, motion, k), *rotors], axis=1)
        out.append(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300))
    return out


def friction_columns(axes: Axes, motion: Motion, freedom: int) -> list[np.ndarray]:
    """Columns of offset and friction of a freedom's torque, each (N,)."""
    dq, columns = axes.moved(motion.dq), [np.ones(len(motion))]
    for a in map(axes.names.index, axes.acting(FRICTION[0], freedom)):
        columns += [dq[:, a], np.tanh(dq[:, a] / (SLIP * axes.gears[a]))]
    return columns


def without_drives(drives: Sequence[np.ndarray], torques: np.ndarray) -> np.ndarray:
    """Torques (N, k, ...) less their regression on the columns of `drive_rows`."""
    out = torques.reshape(*torques.shape[:2], -1).copy()
    for column, rows in enumerate(drives):
        out[:, column] -= rows @ np.linalg.lstsq(rows, out[:, column], rcond=1e-10)[0]
    return out.reshape(torques.shape)


def lacking_drives(equations: Equations, joint: str) -> tuple[str, ...]:
    """Columns of friction that a joint lacks, its motors' where these are coupled.

    Those at low velocity are among them only if there are the others.
    """
    axes = equations.axes
    drives = drives_of(axes, (*FRICTION, SLOW), [axes.freedoms.index(joint)])
    lacking = tuple(name for name in drives if name not in equations.drives)
    return tuple(name for name in lacking if column_place(name)[0] in FRICTION) or lacking


def friction_shares(fit: Fit, samples: Samples) -> dict[str, float]:
    """Share of each torque's least-squares residual that friction of its joint would explain, beyond chance.

    Args:
        fit: The fit; its offsets and drives are fitted here as well.
        samples: The samples that were fitted.

    Returns:
        Shares by the torques' channels, zero where friction is fitted already.
    """
    equations, felt = fit.equations, len(fit.equations.torques)
    freedoms = equations.mechanism.tree.freedoms
    names = dict.fromkeys(name for joint in freedoms for name in lacking_drives(equations, joint))
    with_friction = equations.with_drives((*equations.drives, *names))
    residual, left = (_least_residual(fit, each, samples)[:, -felt:] for each in (equations, with_friction))
    squares = np.maximum((residual**2).sum(axis=0), 1e-300)
    chance = len(FRICTION) * correlated_samples(left, 0.99) / len(left)
    shares = np.maximum(0.0, 1 - (left**2).sum(axis=0) / squares - chance)
    return dict(zip(equations.channels[-felt:], shares.tolist(), strict=True))


def _least_residual(fit: Fit, equations: Equations, samples: Samples) -> np.ndarray:
    """Residual of least squares, each channel weighted by its residual of the fit (N, C)."""
    scale = np.maximum(fit.residual(samples).std(axis=0), least_noise([samples.measured], equations.channels))
    root = accumulate(equations, samples, factors=np.broadcast_to(1 / scale, samples.measured.shape)).root
    values = coefficients(root[:, :-1], root[:, -1], SINGULAR)
    return replace(fit, equations=equations, values=values).residual(samples)

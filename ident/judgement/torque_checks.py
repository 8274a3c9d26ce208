"""Checks of joint torques against the model's own: sign and size, friction, and bodies that are not there.

Offsets, friction and rotor inertia that the model does not know are taken out of measured and predicted torques alike.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.estimation.accumulator import accumulate
from ident.estimation.equations import Equations
from ident.estimation.loads import SLIP
from ident.estimation.preparation import Prepared
from ident.estimation.samples import Samples
from ident.mechanism.body import BASE
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.regressor import joint_torque_regressor
from ident.parameters.prior import known_roots
from ident.regression.ordinary import Fit
from ident.tolerances import DRIVE, SINGULAR

FRICTION, SLOW = ("viscous", "coulomb"), "stribeck"
"""Drive columns that friction is looked for with; and, where it has these, with what it is more at low velocity."""

ENOUGH = 4000
"""Samples that are looked at, evenly spread."""

FLIPPED = 0.5
"""Part of an error that has to remain at most where another reading of the torques is to be believed."""

SCALE, ALIKE = 3.0, 0.8
"""Factor between measured and predicted torque from which a unit or a gear is missing, where they are alike: where that
share of the variance of one is explained by the other."""

FAR = 2.0
"""Distance of a torque from the model's, over the largest one that likely bodies explain, from which it is of another
unit. One that is nearer may as well be of another body: the torque of a real wrist whose centre of mass is 55 mm from
its joint, 5 mm in its model, is 11.6 times the model's."""

MISSING = 0.5
"""Share of the residual that has to vanish if a body is not carried."""


@dataclass(frozen=True, eq=False)
class TorqueCheck:
    """The torque of one joint against the model's own prediction.

    Attributes:
        joint: The joint.
        gain: Measured over predicted torque, by least squares.
        error: Relative error, over the prediction's size.
        error_flipped: The same with the opposite sign.
        alike: Share of the measured variance that the prediction explains at that gain.
        far: Difference of the two over what it is from bodies as uncertain as a model's usually are, both RMS.
    """

    joint: str
    gain: float
    error: float
    error_flipped: float
    alike: float
    far: float

    @property
    def flipped(self) -> bool:
        """True if the opposite sign fits far better."""
        return self.error_flipped < FLIPPED * self.error

    @property
    def scaled(self) -> bool:
        """True if it is the predicted one in another unit, and no other bodies explain it."""
        return self.alike > ALIKE and self.far > FAR and not 1 / SCALE < abs(self.gain) < SCALE


@dataclass(frozen=True)
class AbsentBody:
    """A body that the torques look as if the mechanism had not carried.

    Attributes:
        body: Its name; it, and all on it.
        explained: Share of the squared residual that vanishes without it.
        explained_by_factor: The same with one factor on all that the model predicts.
    """

    body: str
    explained: float
    explained_by_factor: float

    @property
    def suspicious(self) -> bool:
        """True if that is most of the residual, and far more than links too heavy or too light would explain."""
        return self.explained > MISSING and 1 - self.explained < FLIPPED * (1 - self.explained_by_factor)


@dataclass(frozen=True, eq=False)
class TorqueChecks:
    """Results of all checks of joint torques.

    Attributes:
        joints: Check of each torque.
        absent: The mounted body whose absence explains most, None where nothing is mounted.
    """

    joints: tuple[TorqueCheck, ...]
    absent: AbsentBody | None

    @property
    def grossly_wrong(self) -> bool:
        """True if a torque is not the one that was stated."""
        return any(check.flipped or check.scaled for check in self.joints)


def torque_checks(prepared: Prepared) -> TorqueChecks | None:
    """Compares measured torques with what the model's φ predicts; None where there are none."""
    felt = list(prepared.equations.torques)
    if not felt:
        return None
    mechanism, edge, number = prepared.mechanism, prepared.edge, len(prepared.samples)
    samples = prepared.samples[slice(edge, number - edge, max(1, number // ENOUGH))]
    motion, first = samples.motion, len(prepared.equations.channels) - len(felt)
    Y = joint_torque_regressor(mechanism.tree, *motion.states, gravity=mechanism.gravity, base=motion.base)[:, felt]
    by_body = Y.reshape(*Y.shape[:2], -1, 10)
    measured = _without_drives(samples.measured[:, first:], motion, felt)
    of_bodies = _without_drives(np.einsum("ntbp,bp->ntb", by_body, mechanism.known.reshape(-1, 10)), motion, felt)
    uncertain = _without_drives(
        np.einsum("ntbp,brp->ntbr", by_body, known_roots(mechanism)).reshape(*Y.shape), motion, felt
    )
    predicted, size = of_bodies.sum(axis=2), np.linalg.norm(uncertain, axis=(0, 2))
    each = zip(felt, measured.T, predicted.T, size, strict=True)
    checks = [_check(mechanism.tree.freedoms[k], *compared) for k, *compared in each]
    return TorqueChecks(tuple(checks), _absent(mechanism, measured - predicted, of_bodies))


def _check(joint: str, measured: np.ndarray, predicted: np.ndarray, uncertain: float) -> TorqueCheck:
    """The torque of one joint (N,) against the prediction (N,), of which so much is uncertain (its norm)."""
    size, whole = max(float(predicted @ predicted), 1e-300), max(float(measured @ measured), 1e-300)
    across = float(measured @ predicted)
    error, flipped = (float(np.linalg.norm(measured - sign * predicted)) for sign in (1, -1))
    errors = error / np.sqrt(size), flipped / np.sqrt(size)
    return TorqueCheck(joint, across / size, *errors, across**2 / (size * whole), error / max(uncertain, 1e-300))


def _absent(mechanism: Mechanism, residual: np.ndarray, of_bodies: np.ndarray) -> AbsentBody | None:
    """The mounted body without which least is left of a residual (N, n); torques of all bodies (N, n, b)."""
    tree, before, predicted = mechanism.tree, max(float((residual**2).sum()), 1e-300), of_bodies.sum(axis=2)
    by_factor = float((residual * predicted).sum() ** 2 / max(float((predicted**2).sum()), 1e-300)) / before
    candidates = []
    for i in _mounted(mechanism):
        carried = [tree.inertial.index(k) for k in tree.carried(i) if k in tree.inertial]
        torque = of_bodies[:, :, carried].sum(axis=2)
        candidates.append(AbsentBody(tree.names[i], 1 - float(((residual + torque) ** 2).sum()) / before, by_factor))
    return max(candidates, key=lambda each: each.explained, default=None)


def _mounted(mechanism: Mechanism) -> Iterator[int]:
    """Bodies with a mass that are screwed to one that joints move, and so might not have been there."""
    tree, moved = mechanism.tree, list[bool]()
    for i, body in enumerate(tree.bodies):
        carried = body.parent != BASE and moved[body.parent]
        moved.append(body.moves or carried)
        heavy = any(mechanism.known[10 * tree.inertial.index(k)] > 0 for k in tree.carried(i) if k in tree.inertial)
        if carried and not body.moves and heavy:
            yield i


def _without_drives(torques: np.ndarray, motion: Motion, felt: list[int]) -> np.ndarray:
    """Torques (N, k, ...) without what offsets, friction and rotors of their joints would explain of them."""
    out = torques.reshape(*torques.shape[:2], -1).copy()
    for column, k in enumerate(felt):
        dq = motion.dq[:, k]
        rows = np.stack([np.ones_like(dq), dq, np.tanh(dq / SLIP), motion.ddq[:, k]], axis=1)
        rows = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        out[:, column] -= rows @ np.linalg.lstsq(rows, out[:, column], rcond=1e-10)[0]
    return out.reshape(torques.shape)


def lacking_drive(drives: Sequence[str], joint: str) -> list[str]:
    """Kinds of friction of a joint that have no column, of which the last is asked for only when it has the others."""
    lacking = [kind for kind in (*FRICTION, SLOW) if f"{DRIVE[kind]}({joint})" not in drives]
    return [kind for kind in lacking if kind in FRICTION] or lacking


def friction_shares(fit: Fit, samples: Samples) -> dict[str, float]:
    """Share of what least squares leaves of each torque that friction of its joint would take away, beyond chance.

    Args:
        fit: What was fitted; offsets and drives that it has are fitted here as well.
        samples: The samples that were fitted.

    Returns:
        Shares by the torques' channels, zero where friction is fitted already.
    """
    equations, felt = fit.equations, len(fit.equations.torques)
    freedoms = equations.mechanism.tree.freedoms
    names = [f"{DRIVE[kind]}({joint})" for joint in freedoms for kind in lacking_drive(equations.drives, joint)]
    with_friction = replace(equations, drives=(*equations.drives, *names))
    residual, left = (_least_residual(fit, each, samples)[:, -felt:] for each in (equations, with_friction))
    squares = np.maximum((residual**2).sum(axis=0), 1e-300)
    # Of residuals that are alike for some samples there are fewer than samples.
    lag = np.clip((left[1:] * left[:-1]).sum(axis=0) / np.maximum((left**2).sum(axis=0), 1e-300), 0, 0.99)
    chance = len(FRICTION) * (1 + lag) / (1 - lag) / len(left)
    shares = np.maximum(0.0, 1 - (left**2).sum(axis=0) / squares - chance)
    return dict(zip(equations.channels[-felt:], shares.tolist(), strict=True))


def _least_residual(fit: Fit, equations: Equations, samples: Samples) -> np.ndarray:
    """Residual of least squares, each channel weighted by its residual of the fit (N, C)."""
    scale = np.maximum(fit.residual(samples).std(axis=0), 1e-300)
    root = accumulate(equations, samples, factors=np.broadcast_to(1 / scale, samples.measured.shape)).root
    size = np.maximum(np.linalg.norm(root[:, :-1], axis=0), 1e-300)
    values = np.linalg.lstsq(root[:, :-1] / size, root[:, -1], rcond=SINGULAR)[0] / size
    return replace(fit, equations=equations, values=values).residual(samples)

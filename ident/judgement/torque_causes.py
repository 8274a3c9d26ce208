"""Findings on torques that are not what moves the joints: something else does, a loop acts, or a model computed them.

Torques that move a joint contain its inertia H(q) q̈ and its weight G(q). By the inequality of Cauchy and Schwarz,
whatever bodies of mass M, at heights z, move with a coordinate q,

    H ≥ Σ m (∂z/∂q)² ≥ (Σ m ∂z/∂q)² / M = (G / g)² / M
"""

from collections.abc import Container, Iterator
from typing import NamedTuple

import numpy as np

from ident.estimation.samples import Samples
from ident.estimation.units import coefficient_unit
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.place import Place
from ident.judgement.torque_checks import FRICTION, SLOW
from ident.mechanism.motion import Motion
from ident.model.regressor import joint_torque_regressor
from ident.tolerances import DRIVE

ENOUGH = 200
"""Largest number of samples in which torques are taken apart, evenly spread."""

TIMES = 10.0
"""Mass that moves with a joint over that of the model's bodies beyond it, up to which it is likely."""

DEVIATIONS = 4.0
"""Standard deviations by which a joint's inertia must be below the least that its weight allows."""

WEIGHS = 0.2
"""Weight on a joint, over the largest in any direction of gravity, below which the model's largest stands in for it."""

INTERVAL = 1.96
"""Standard deviations of a 95 % interval."""

EXPLAINED, SMOOTHLY = 0.1, 0.01
"""Largest residual of computed torques over their signal, and largest friction in them over it."""


class Inertia(NamedTuple):
    """Inertia of a joint by the estimate, kg m², of a slide kg.

    Attributes:
        value: Its mean over the motion.
        least: The least that its weight allows.
        std: Standard deviation of the difference of both.
        unit: Its unit.
    """

    value: float
    least: float
    std: float
    unit: str


def cause_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on joints that something else moves, on loops that were left out, and on computed torques."""
    checks = evidence.checks.torques
    if checks is None or not evidence.logs:
        return
    less = {joint: own for joint, own in inertias(evidence).items() if own.value + DEVIATIONS * own.std < own.least}
    if less and not checks.grossly_wrong:
        values = {joint: own._asdict() for joint, own in less.items()}
        yield Finding.of("motion_not_by_torques", Place(joints=tuple(less)), joints=values)
    for loop, joints in evidence.mechanism.loops.items():
        if acting := tuple(joint for joint in joints if joint in evidence.channels):
            yield Finding.of("loop_left_out", Place(channels=acting), loop=loop, joints=acting)
    moving = {channel: evidence.ratios[channel] for channel in _torques(evidence) if channel not in evidence.idle}
    if moving and max(moving.values()) < EXPLAINED and max(_friction(evidence, moving)) < SMOOTHLY:
        place = Place(channels=tuple(moving))
        yield Finding.of("computed_torques", place, joints=tuple(moving), largest=max(moving.values()))


def inertias(evidence: Evidence) -> dict[str, Inertia]:
    """Inertia of each joint with a torque by the estimate, beside the least that its weight allows."""
    mechanism, fit, motion = evidence.mechanism, evidence.fit, evidence.logs[0].samples.motion
    tree, g = mechanism.tree, float(np.linalg.norm(mechanism.gravity))
    if motion.base is not None or not g or mechanism.prior is None:
        return {}
    q = motion.q[:: -(-len(motion) // ENOUGH)]
    rest = np.zeros((len(q), len(tree.freedoms)))
    C = fit.covariance if evidence.covariance_setup is None else evidence.covariance_setup
    still, out = _columns(evidence, Motion(q, rest, rest)), dict[str, Inertia]()
    levers = still / g
    levers[:, :, fit.parameters.rank :] = 0
    of_model = [joint_torque_regressor(tree, q, rest, rest, gravity=axis) @ mechanism.known for axis in np.eye(3)]
    for c, k in enumerate(fit.equations.torques):
        unit = rest.copy()
        unit[:, k] = 1
        row = _columns(evidence, Motion(q, rest, unit))[c] - still[c]
        value, lever, slope = float((row @ fit.values).mean()), levers[c] @ fit.values, levers[c]
        along = np.stack([each[:, k] for each in of_model], axis=-1)
        if np.linalg.norm(along @ mechanism.gravity) < WEIGHS * g * np.linalg.norm(along):
            lever, slope = np.linalg.norm(along, axis=-1), 0 * slope
        most = TIMES * max(_mass_moved(evidence, k), 1e-300)
        difference = (row - 2 * lever[:, None] * slope / most).mean(axis=0)
        std = float(np.sqrt(max(difference @ C @ difference, 0)))
        joint = tree.freedoms[k]
        unit_name = coefficient_unit(f"{DRIVE['rotor']}({joint})", tree)
        out[joint] = Inertia(value, float((lever**2).mean() / most), std, unit_name)
    return out


def _mass_moved(evidence: Evidence, freedom: int) -> float:
    """Mass of the model's bodies that move with a freedom; of all if joints follow others, kg."""
    tree, masses = evidence.mechanism.tree, evidence.mechanism.known[::10]
    body = [i for i, each in enumerate(tree.bodies) for _ in each.freedom_names][freedom]
    moved = range(len(tree.bodies)) if tree.followers else tree.carried(body)
    return float(sum(masses[tree.inertial.index(i)] for i in moved if i in tree.inertial))


def _torques(evidence: Evidence) -> tuple[str, ...]:
    """Names of the channels that are torques."""
    return evidence.channels[len(evidence.channels) - len(evidence.fit.equations.torques) :]


def _columns(evidence: Evidence, motion: Motion) -> np.ndarray:
    """Columns of the torques for a motion (torques, N, m)."""
    samples = Samples(motion, np.zeros((len(motion), len(evidence.channels))))
    rows = np.concatenate([each[:-1].copy() for each in evidence.fit.equations.rows(samples)], axis=-1)
    return rows[:, len(evidence.channels) - len(evidence.fit.equations.torques) :].transpose(1, 2, 0)


def _friction(evidence: Evidence, channels: Container[str]) -> Iterator[float]:
    """Yields the largest likely friction in each torque over its signal, or what is left of it if it was not fitted."""
    fit, samples = evidence.fit, evidence.logs[0].samples
    samples = samples[:: -(-len(samples) // ENOUGH)]
    columns = _columns(evidence, samples.motion)
    at_most = {name: most for name, (most, _) in evidence.bounded.items()}
    kinds = {DRIVE[kind] for kind in (*FRICTION, SLOW)}
    most = [
        at_most.get(name, abs(value) + INTERVAL * std) if name.partition("(")[0] in kinds else 0.0
        for name, value, std in zip(fit.names, fit.values.tolist(), fit.std.tolist(), strict=True)
    ]
    signal = samples.measured[:, -len(columns) :].std(axis=0)
    rubs = np.sqrt((columns**2).mean(axis=1)) @ most / np.maximum(signal, 1e-300)
    for channel, share in zip(_torques(evidence), rubs.tolist(), strict=True):
        if channel in channels:
            yield max(share, np.sqrt(evidence.friction.get(channel, 0.0)) * evidence.ratios[channel])

"""Findings on torques that are not what moves the joints: something else does, a loop acts, or a model computed them.

Torques that move a joint contain the weight a G and the inertia b D of masses at the centres of the model's bodies:

    τ = a G(q) + b D(q, q̇, q̈) + friction + spring + offset

Bodies with a times the model's first moments and up to k times its masses have b ≥ a² / k; torques with another unit or
scale b ≥ a / k.
"""

from collections.abc import Container, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ident.geometry.inertia import parameters_from_com
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, Row, listed, percent
from ident.judgement.torque_checks import ENOUGH, FRICTION, SLOW, friction_columns
from ident.model.axes import column_place
from ident.model.regressor import joint_torque_regressor
from ident.tolerances import INTERVAL, LIKELY, SINGULAR

DEVIATIONS = 4.0
"""Standard deviations from which weight is in a torque, and by which its inertia must be below the least."""

EXPLAINED, SMOOTHLY = 0.1, 0.01
"""Largest residual of computed torques over their signal, and largest friction in them over it."""


class Parts(NamedTuple):
    """Weight a and inertia b in a torque, over those of the model's masses.

    Attributes:
        weight: a.
        weight_std: Its standard deviation.
        inertia: b.
        inertia_std: Its standard deviation.
    """

    weight: float
    weight_std: float
    inertia: float
    inertia_std: float

    @property
    def moves(self) -> bool:
        """False if the inertia is significantly below the least that goes with the weight, the model's without any.

        Inertia far below zero is no lack of it but another error of the model.
        """
        weight = abs(self.weight) if abs(self.weight) > DEVIATIONS * self.weight_std else 1.0
        least = weight * min(weight, 1.0) / LIKELY
        return not -least <= self.inertia + DEVIATIONS * self.inertia_std < least


def cause_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on loops that were left out, on joints that something else moves, and on computed torques."""
    for loop, joints in evidence.mechanism.loops.items():
        if acting := tuple(joint for joint in joints if joint in evidence.channels):
            yield Finding.of("loop_left_out", Place(channels=acting), loop=loop, joints=acting)
    checks = evidence.checks.torques
    if checks is None:
        return
    others = {joint: parts for joint, parts in torque_parts(evidence).items() if not parts.moves}
    if others and not checks.grossly_wrong:
        values = {joint: parts._asdict() for joint, parts in others.items()}
        yield Finding.of("motion_not_by_torques", Place(joints=tuple(others)), joints=values)
    moving = {channel: evidence.ratios[channel] for channel in _torques(evidence) if channel not in evidence.idle}
    if moving and max(moving.values()) < EXPLAINED and max(_friction(evidence, moving)) < SMOOTHLY:
        place = Place(channels=tuple(moving))
        yield Finding.of("computed_torques", place, joints=tuple(moving), largest=max(moving.values()))


def torque_parts(evidence: Evidence) -> dict[str, Parts]:
    """Weight and inertia in the torques of a resting base's joints, by joint."""
    mechanism, log = evidence.mechanism, evidence.prepared
    samples = log.samples[slice(log.edge, len(log.samples) - log.edge, max(1, len(log.samples) // ENOUGH))]
    motion, tree = samples.motion, mechanism.tree
    if motion.base is not None or mechanism.prior is None:
        return {}
    bodies = mechanism.known.reshape(-1, 10)
    masses = [parameters_from_com(phi[0], phi[1:4] / max(phi[0], 1e-300), np.zeros((3, 3))) for phi in bodies]
    at_rest = motion.q, 0 * motion.dq, 0 * motion.ddq
    torques, weight = (
        joint_torque_regressor(tree, *states, gravity=mechanism.gravity) @ np.concatenate(masses)
        for states in (motion.states, at_rest)
    )
    q, axes, out = tree.freedom_coordinates(motion.q), evidence.fit.equations.axes, dict[str, Parts]()
    for measured, k in zip(samples.measured.T[-len(_torques(evidence)) :], evidence.fit.equations.torques, strict=True):
        columns = [weight[:, k], torques[:, k] - weight[:, k], q[:, k], *friction_columns(axes, motion, k)]
        values, std = _regressed(np.stack(columns, axis=1), measured)
        out[tree.freedoms[k]] = Parts(values[0], std[0], values[1], std[1])
    return out


def _regressed(X: np.ndarray, y: np.ndarray) -> tuple[list[float], list[float]]:
    """Coefficients of columns (N, m) in a signal (N,), with deviations for residuals that are alike for some samples.

    Those of columns that are zero or dependent are large.
    """
    norms = np.linalg.norm(X, axis=0)
    norms = np.where(norms > 0, norms, 1)
    U, s, Vt = np.linalg.svd(X / norms, full_matrices=False)
    inverse = 1 / np.maximum(s, SINGULAR * s[0])
    values = Vt.T @ (np.where(s > SINGULAR * s[0], inverse, 0) * (U.T @ y))
    left = y - X / norms @ values
    lag = np.clip((left[1:] @ left[:-1]) / max(float(left @ left), 1e-300), 0, 0.999)
    variance = float(left @ left) / len(y) * (1 + lag) / (1 - lag)
    std = np.sqrt(variance * (Vt.T**2 @ inverse**2))
    return (values / norms).tolist(), (std / norms).tolist()


def _torques(evidence: Evidence) -> tuple[str, ...]:
    """Names of the channels that are torques."""
    return evidence.channels[len(evidence.channels) - len(evidence.fit.equations.torques) :]


def _friction(evidence: Evidence, channels: Container[str]) -> Iterator[float]:
    """Yields the largest likely friction in each torque over its signal, or what is left of it if it was not fitted."""
    fit, samples = evidence.fit, evidence.prepared.samples
    axes, torques = fit.equations.axes, list(fit.equations.torques)
    speed = np.sqrt((axes.moved(samples.motion.dq) ** 2).mean(axis=0))
    rubs = np.zeros(len(speed))
    for name, value, std in zip(fit.names, fit.values.tolist(), fit.std.tolist(), strict=True):
        if name in fit.equations.drives and (place := column_place(name))[0] in (*FRICTION, SLOW):
            most, axis = evidence.bounded.get(name, (abs(value) + INTERVAL * std,))[0], axes.names.index(place[1])
            rubs[axis] += most * (speed[axis] if place[0] == FRICTION[0] else 1)
    signal = np.maximum(samples.measured.T[-len(torques) :].std(axis=1), 1e-300)
    shares = np.abs(axes.matrix[:, torques]).T @ rubs / signal
    for channel, share in zip(_torques(evidence), shares.tolist(), strict=True):
        if channel in channels:
            yield max(share, np.sqrt(evidence.friction.get(channel, 0.0)) * evidence.ratios[channel])


def _moved(joints: Mapping[str, Mapping[str, Any]]) -> str:
    shares = (
        f"{joint} {percent(x['inertia'], 1)} ± {percent(x['inertia_std'], 1)} ({percent(x['weight'])})"
        for joint, x in joints.items()
    )
    return (
        "Motion that the torques do not explain. Share of the model's inertia in them, with that of its weight in "
        f"brackets: {listed(shares, 'joints')}. A hand or something else moves the joints, or the torques are commands "
        "that something overrides. Record motion by the motors alone."
    )


def _loop(loop: str, joints: Sequence[str]) -> str:
    names = " ".join(joints)
    return (
        f"The coupling '{loop}' acts on the torques of {listed(joints, 'joints')}, but the equations leave it out. "
        f"Take these torques away, --leave-out {names}; the wrench at the base is not affected."
    )


def _computed(joints: Sequence[str], largest: float) -> str:
    return (
        f"Torques are explained to {100 * largest:.1g} % without friction ({listed(joints, 'joints')}): they are "
        "computed, simulated, or measured behind the gears. Computed ones repeat the controller's model: record "
        "currents or measured torques."
    )


FINDINGS.update(
    motion_not_by_torques=Row(_moved, doubt=True),
    loop_left_out=Row(_loop, doubt=True),
    computed_torques=Row(_computed, doubt=False),
)

"""Direction of gravity that explains a recording best, for a mechanism whose base rests.

    r(d) = t - (Y_0 + g Σ d_k Y_k) φ_0        misfit(d)² = min over x of (|r - A(d) x|² + σ² |x|²) / samples

Y_0 is the regressor of the motion without gravity, Y_k that of gravity along axis k; A(d) holds the usual deviations of
the model's bodies, so that wrong masses are no wrong direction. Channels are in units of their size. Offsets, friction
and rotors of joint torques are regressed out.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg, optimize
from scipy.spatial.transform import Rotation

from ident.estimation.equations import COMPONENTS
from ident.estimation.loads import stated_drive_torques
from ident.estimation.preparation import Prepared
from ident.geometry.se3 import coAd, inverse
from ident.judgement.diagnosis import right_angled_rotations
from ident.judgement.torque_checks import drive_rows, without_drives
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion, joined
from ident.model.axes import Axes
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.prior import known_roots

SAMPLES = 40
"""Number of samples used, evenly spread: what the model lacks is alike for samples next to each other."""

UNMODELLED = 0.6
"""What neither bodies nor drives explain, over the size of a channel. Arms of six and seven joints, slow and fast, with
masses wrong by 20 to 40 % are left with 0.1 to 0.4 in the right direction, and with 0.55 to 1.1 in others."""

FAR_BETTER, EXPLAINED = 0.6, 0.45
"""Misfit of another direction over that of the stated one below which the latter is wrong, and the largest for that."""

AXIS, AWAY = np.cos(np.radians(8)), np.cos(np.radians(15))
"""Cosine of the angle from an axis up to which a fitted direction is taken as that axis; and of the one from the stated
direction up to which the set-up's tilt of gravity explains it."""

FIRST_TURNS = np.array([[0.0, 0.0], [0.4, 0.0], [0.0, 0.4]])
"""Directions from which a search begins, about the best of some: turns by less than half their distance, rad."""

TIE, BRAKING = 1.25, -0.02
"""Factor between misfits that are alike; and mean power of the torques over their size, below which they would drive
against friction, so that their signs are wrong: masses and springs return their energy."""


@dataclass(frozen=True, eq=False)
class GravityCheck:
    """Directions of gravity in the base frame, compared.

    Attributes:
        misfits: Misfit of gravity along each axis of the base frame, by `+x` to `-z`.
        stated: Misfit of the stated direction.
        direction: Direction that explains best, of all (3,); `misfit` is its misfit.
        other: Misfit of the stated direction with the signs or offsets of channels, or axes of the wrench, that explain
            best; what is alike counts for or against it as it is likelier.
        turned: Cosine of the angle between the stated direction and the best one.
        rpy_deg: Orientation of the base in the world with the best direction: roll, pitch and yaw, degrees.
        joint: Joint of which another zero would explain the same; None if there is none.
    """

    misfits: Mapping[str, float]
    stated: float
    direction: np.ndarray
    misfit: float
    other: float
    turned: float
    rpy_deg: tuple[float, ...]
    joint: str | None = None

    @property
    def suspicious(self) -> bool:
        """True if another direction explains far more than the stated one, and more than other signs do."""
        return self.possible and self.misfit < self.other

    @property
    def possible(self) -> bool:
        """True if another direction explains far more than the stated one, whatever other signs do."""
        return bool(self.turned < AWAY and self.misfit < min(FAR_BETTER * self.stated, EXPLAINED, TIE**2 * self.other))


def gravity_check(
    mechanism: Mechanism, motion: Motion, measured: Mapping[str, np.ndarray], frame: np.ndarray | None = None
) -> GravityCheck | None:
    """Comparison of directions of gravity.

    Args:
        mechanism: The mechanism, with a prior.
        motion: Its motion (N samples).
        measured: Components of the total wrench, `Fx` to `Mz`, and joint torques by the freedoms' names (N,) each.
        frame: Pose of the frame of these components in the base frame (4, 4).

    Returns:
        The comparison; None without gravity, for a base that moves or floats, or if nothing is measured.
    """
    if motion.base is not None or mechanism.carrier or mechanism.tree.floats or not mechanism.gravity.any():
        return None
    compared = _Compared.of(mechanism, motion, measured, np.eye(4) if frame is None else frame)
    if compared is None:
        return None
    down = mechanism.gravity / np.linalg.norm(mechanism.gravity)
    axes = {f"{sign}{'xyz'[k]}": e if sign == "+" else -e for sign in "+-" for k, e in enumerate(np.eye(3))}
    misfits = {name: compared.misfit(direction) for name, direction in axes.items()}
    best = compared.best(list(axes.values()))
    likelier = 1 / TIE if not compared.felt or _power(mechanism, motion, measured) < BRAKING else TIE
    return GravityCheck(
        misfits=misfits,
        stated=compared.misfit(down),
        direction=best,
        misfit=compared.misfit(best),
        other=likelier * compared.otherwise(down),
        turned=float(down @ best),
        rpy_deg=rpy_deg(mechanism, best),
        joint=None if compared.wrench else _joint_of(mechanism, best - down),
    )


def recorded_gravity(prepared: Prepared) -> GravityCheck | None:
    """Comparison of directions of gravity in a recording; None where nothing holds a base at rest."""
    if not prepared.recording.is_held(prepared.mechanism.tree):
        return None
    samples = prepared.samples[prepared.taken(slice(prepared.edge, len(prepared.samples) - prepared.edge))]
    measured = dict(zip(prepared.equations.channels, samples.measured.T, strict=True))
    return gravity_check(prepared.mechanism, samples.motion, measured, prepared.frame) if len(samples) else None


def rpy_deg(mechanism: Mechanism, direction: np.ndarray) -> tuple[float, ...]:
    """Roll, pitch and yaw of the base frame in the world that give gravity a direction in it, in whole degrees."""
    world = mechanism.in_world @ mechanism.gravity
    upright, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [world / np.linalg.norm(world)])
    x, y, z = -direction
    turned = Rotation.from_euler("xyz", [np.arctan2(y, z) if y or z else 0.0, -np.arcsin(np.clip(x, -1, 1)), 0.0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # At a pitch of 90°, yaw is zero.
        angles = np.rint((upright.inv() * turned).as_euler("xyz", degrees=True))
    return tuple(np.where(angles == -180, 180.0, angles + 0.0).tolist())


def _power(mechanism: Mechanism, motion: Motion, measured: Mapping[str, np.ndarray]) -> float:
    """Mean power of the measured torques, over their sizes times those of the velocities."""
    felt = [k for k, name in enumerate(mechanism.tree.freedoms) if name in measured]
    torques = np.stack([measured[mechanism.tree.freedoms[k]] for k in felt], axis=1)
    dq = motion.dq[:, felt] - motion.dq[:, felt].mean(axis=0)
    size = float((torques.std(axis=0) * dq.std(axis=0)).sum())
    return float((torques * dq).mean(axis=0).sum()) / max(size, 1e-300)


def _joint_of(mechanism: Mechanism, change: np.ndarray) -> str | None:
    """The hinge that alone carries all others, if gravity changes by as much as by another zero of it."""
    tree = mechanism.tree
    first = [i for i in tree.moving if not any(i in tree.carried(k) for k in tree.moving if k != i)]
    body = tree.bodies[first[0]]
    if len(first) > 1 or body.is_ball or not body.turns:
        return None
    return body.joint if abs(tree.screws[first[0]][3:, 0] @ change) < 0.02 else None


@dataclass(frozen=True, eq=False)
class _Compared:
    """Channels of a recording in units of their size, and the model's for each part of the acceleration.

    Attributes:
        measured: Measured channels (N, C).
        predicted: Of the motion, and of gravity along each axis (4, N, C).
        uncertain: Their deviations for usual deviations of the bodies (4, N, C, p).
        wrench: Names of the components of the wrench, the first channels.
        felt: Indices of the freedoms whose torques are the other ones.
    """

    measured: np.ndarray
    predicted: np.ndarray
    uncertain: np.ndarray
    wrench: tuple[str, ...]
    felt: list[int]

    @classmethod
    def of(
        cls, mechanism: Mechanism, motion: Motion, measured: Mapping[str, np.ndarray], frame: np.ndarray
    ) -> "_Compared | None":
        """The channels at `SAMPLES` samples; None if there are none."""
        tree, some = mechanism.tree, np.linspace(0, len(motion) - 1, min(SAMPLES, len(motion))).astype(int)
        wrench = tuple(name for name in COMPONENTS if name in measured)
        felt = [k for k, name in enumerate(tree.freedoms) if name in measured]
        if not wrench and not felt:
            return None
        motion = motion[some]
        on_base = _accelerated(motion, float(np.linalg.norm(mechanism.gravity)))
        given: dict[str, Any] = {"gravity": np.zeros(3), "base": on_base.base}
        raw = np.stack([measured[name][some] for name in (*wrench, *(tree.freedoms[k] for k in felt))], axis=1)
        t, Y, size = raw.copy(), np.zeros((len(on_base), raw.shape[1], 10 * len(tree.inertial))), np.ones(raw.shape[1])
        if number := len(wrench):
            rows = coAd(inverse(frame))[[COMPONENTS.index(name) for name in wrench]]
            Y[:, :number] = rows @ base_wrench_regressor(tree, *on_base.states, **given)
            kinds = np.array([name[0] for name in wrench])
            size[:number] = [np.sqrt((raw[:, :number][:, kinds == kind] ** 2).mean()) for kind in kinds]
        if felt:
            own = joint_torque_regressor(tree, *on_base.states, **given)[:, felt]
            drives = drive_rows(Axes.of(tree), motion, felt)
            t[:, number:] = without_drives(drives, raw[:, number:] - stated_drive_torques(mechanism, motion)[:, felt])
            Y[:, number:] = np.concatenate([without_drives(drives, part) for part in np.split(own, 4)])
            # What is left of a torque that is mostly friction is no signal.
            size[number:] = np.maximum(raw[:, number:].std(axis=0), 1e-300)
            size[number:] *= np.sqrt(((t[:, number:] / size[number:]) ** 2).mean())
        size = np.maximum(size, 1e-300)
        Y = (Y / size[:, None]).reshape(4, *t.shape, -1)
        each = Y.reshape(*Y.shape[:3], -1, 10)
        uncertain = np.einsum("kncbp,brp->kncbr", each, known_roots(mechanism)).reshape(Y.shape)
        return cls(t / size, Y @ mechanism.known, uncertain, wrench, felt)

    def _at(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Prediction for a direction (N C,), and its uncertainty (N C, p)."""
        each = np.append(1.0, direction)
        predicted = np.tensordot(each, self.predicted, 1).ravel()
        return predicted, np.tensordot(each, self.uncertain, 1).reshape(predicted.size, -1)

    def misfit(self, direction: np.ndarray) -> float:
        """Misfit of a direction (3,)."""
        return float(self._misfits(direction, self.measured[None])[0])

    def _misfits(self, direction: np.ndarray, variants: np.ndarray) -> np.ndarray:
        """Misfit of a direction with each variant of the measured channels (v, N, C)."""
        predicted, A = self._at(direction)
        left = variants.reshape(len(variants), -1) - predicted
        # Orthogonal, since a model in wrong units makes columns of any size.
        Q = np.linalg.qr(np.vstack([A, UNMODELLED * np.eye(A.shape[1])]))[0][: len(A)]
        squares = (left**2).sum(axis=1) - ((left @ Q) ** 2).sum(axis=1)
        return np.sqrt(np.maximum(squares, 0) / predicted.size)

    def best(self, starts: Sequence[np.ndarray]) -> np.ndarray:
        """Direction with the least misfit, searched from the best of some; an axis if it is near one."""
        corners = [np.array([x, y, z]) / np.sqrt(3) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
        first = min((*starts, *corners), key=self.misfit)
        across = linalg.null_space(first[None])
        turned = optimize.minimize(
            lambda a: self.misfit(_unit(first + across @ a)),
            np.zeros(2),
            method="Nelder-Mead",
            options={"initial_simplex": FIRST_TURNS, "xatol": 0.01, "fatol": 1e-3},
        )
        best = _unit(first + across @ turned.x)
        axis = np.round(best)
        return axis if np.abs(best).max() > AXIS else best

    def otherwise(self, direction: np.ndarray) -> float:
        """Least misfit of a direction with other signs of channels, or other offsets or axes of the wrench."""
        t, number = self.measured, len(self.wrench)
        predicted = self._at(direction)[0].reshape(t.shape)
        torques = t[:, number:] * np.where((t[:, number:] * predicted[:, number:]).sum(axis=0) < 0, -1, 1)
        turns = [np.diag(signs) for signs in (*(1 - 2 * np.eye(number)), np.ones(number), -np.ones(number))]
        if number == len(COMPONENTS):
            turns += [sign * linalg.block_diag(R, R) for R in right_angled_rotations() for sign in (1, -1)]
        wrenches = [t[:, :number] @ turn.T for turn in turns]
        wrenches.append(t[:, :number] - (t - predicted)[:, :number].mean(axis=0))
        return float(self._misfits(direction, np.stack([np.hstack([each, torques]) for each in wrenches])).min())


def _unit(x: np.ndarray) -> np.ndarray:
    return x / np.linalg.norm(x)


def _accelerated(motion: Motion, g: float) -> Motion:
    """The motion without gravity, and its postures at rest on a base accelerated against gravity along each axis."""
    rest, still = np.zeros((len(motion), 6)), np.zeros_like(motion.dq)
    T, parts = np.broadcast_to(np.eye(4), (len(motion), 4, 4)), []
    parts.append(Motion(motion.q, motion.dq, motion.ddq, BaseMotion(T, rest, rest)))
    for axis in np.eye(3):
        parts.append(Motion(motion.q, still, still, BaseMotion(T, rest, rest - np.append(g * axis, np.zeros(3)))))
    return joined(parts)

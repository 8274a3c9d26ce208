"""Equations to fit: measured channels, and the columns of base parameters, drives and constant offsets."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from ident.annotations import typed
from ident.errors import InputError
from ident.estimation.samples import Samples, whitened
from ident.geometry.se3 import coAd, inverse
from ident.mechanism.drives import NO_DRIVE
from ident.mechanism.mechanism import Mechanism, out_of_plane
from ident.mechanism.motion import Motion
from ident.model.axes import Axes, Couplings, column_place, stated_values
from ident.model.compiled import zeros
from ident.model.regressor import CHUNK, drive_signals, inverse_dynamics, program_inputs, regressor_program
from ident.model.tape import Program
from ident.parameters.base_parameters import BaseParameters, structural_base_parameters
from ident.parameters.structure import Sensors
from ident.tolerances import DRIVE, USUAL_DRIVE

COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
"""Names of a wrench's components."""

SLIP = 0.003
"""Default velocity over which Coulomb friction changes sign, rad/s or m/s."""


def channels_out_of_plane(mechanism: Mechanism, frame: np.ndarray | None = None) -> tuple[str, ...]:
    """Names of the components that planar motion cannot produce (see `out_of_plane`), by default at the base."""
    return tuple(COMPONENTS[k] for k in out_of_plane(mechanism, np.eye(4) if frame is None else frame))


@typed()
@dataclass(frozen=True, eq=False)
class Equations:
    """Linear equations `[Y_b | drives | offsets] x = measured` of C channels.

    Attributes:
        mechanism: The mechanism.
        parameters: Regrouping of its parameters, of which r are base parameters.
        wrench: Channels of the total wrench Γ in the base frame: rows w, each of which measures `w · Γ` (k, 6); None
            for its six components.
        torques: Indices, among the velocities, of the joint torques that are channels, after those of the wrench.
        channels: Names of the C channels.
        drives: Names of the columns of rotor inertia and friction, such as `Fv(elbow)`.
        offsets: Indices of the channels that have a constant offset.
        slips: Velocities over which Coulomb friction changes sign, rad/s or m/s, as `Fc tanh(q̇ / slip)`, of the m
            axes (m,); None for a jump.
        servos: Stiffness and damping of the servos of joints whose commands are the channels, zero for measured torques
            (2, torques); None for none.
        scales: Relative standard deviations of the scales of torques, zero for exact ones; empty if all are.
        absorbed: What a unit of each drive without a column of its own adds to the coefficients of base parameters and
            drives, on whose columns its own depends, by its name (r + d,).
        couplings: Motors that move several joints together, to which rotors and friction belong.
        mixed: Drives of these that take up drives without a column, and may thus be negative.
        beside: φ that acts beside the coefficients in a mechanism whose joints or gravity are not as in the model, for
            which the parameters were regrouped (10 b,); None for none.
    """

    mechanism: Mechanism
    parameters: BaseParameters
    wrench: np.ndarray | None = None
    torques: tuple[int, ...] = ()
    channels: tuple[str, ...] = COMPONENTS
    drives: tuple[str, ...] = ()
    offsets: tuple[int, ...] = ()
    slips: np.ndarray | None = None
    servos: np.ndarray | None = None
    scales: tuple[float, ...] = ()
    absorbed: Mapping[str, np.ndarray] = field(default_factory=dict)
    couplings: Couplings = field(default_factory=dict)
    mixed: tuple[str, ...] = ()
    beside: np.ndarray | None = None

    def __post_init__(self) -> None:
        expected, bodies = len(self.parameters.parameters), len(self.mechanism.tree.inertial)
        if expected != 10 * bodies:
            raise InputError(f"A regrouping of {expected} parameters does not fit {bodies} bodies.")

    @classmethod
    @typed()
    def of_wrench(
        cls, mechanism: Mechanism, parameters: BaseParameters | None = None, *, moving: bool = False
    ) -> "Equations":
        """Equations of the total wrench's six components, by default with the structural base parameters.

        Args:
            mechanism: The mechanism.
            parameters: Regrouping of its parameters.
            moving: True if its base moves.
        """
        if parameters is None:
            parameters = structural_base_parameters(mechanism, sensors=Sensors(moving_base=moving))
        return cls(mechanism, parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return (*self.parameters.names, *self.drives, *(f"offset({self.channels[k]})" for k in self.offsets))

    @cached_property
    def axes(self) -> Axes:
        """Axes on which drives act: the n freedoms, and coupled motors."""
        return Axes.of(self.mechanism.tree, self.couplings)

    @property
    def from_drives(self) -> np.ndarray:
        """Coefficients of base parameters and drives due to the drives that the model states (r + d,)."""
        own = np.r_[np.zeros(self.parameters.rank), stated_values(self.mechanism, self.drives)]
        stated = stated_values(self.mechanism, list(self.absorbed))
        return sum((x * each for x, each in zip(stated, self.absorbed.values(), strict=True)), start=own)

    @property
    def from_model(self) -> np.ndarray:
        """Coefficients of base parameters and drives by the model: its prior φ and its drives (r + d,)."""
        out = self.from_drives
        out[: self.parameters.rank] += self.parameters.regroup(self.mechanism.known)
        return out

    @property
    def sensed(self) -> list[int]:
        """Indices of the channels that sensors measure, which may have offsets; commands have none."""
        first = len(self.channels) - len(self.torques)
        commanded = [] if self.servos is None else (first + np.flatnonzero(self.servos[0])).tolist()
        return [k for k in range(len(self.channels)) if k not in commanded]

    @property
    def scaled(self) -> dict[str, float]:
        """Relative standard deviations of the scales of torques that are not exact, by channel."""
        channels = self.channels[len(self.channels) - len(self.torques) :]
        return {name: std for name, std in zip(channels, self.scales, strict=bool(self.scales)) if std}

    def with_drives(self, drives: Sequence[str]) -> "Equations":
        """Equations with the columns of some drives, of which none is absorbed by others."""
        return replace(self, drives=tuple(drives), absorbed={}, mixed=())

    def with_stribeck(self, names: Sequence[str]) -> "Equations":
        """Equations with more columns of Stribeck friction, of which models state none."""
        absorbed = {name: np.append(each, np.zeros(len(names))) for name, each in self.absorbed.items()}
        return replace(self, drives=(*self.drives, *names), absorbed=absorbed)

    def with_offsets(self, offsets: Sequence[int]) -> "Equations":
        """Equations with constant offsets of some channels."""
        return replace(self, offsets=tuple(offsets))

    def checked(self, samples: Samples, where: str = "The samples") -> Samples:
        """Samples, checked against the equations, as `Samples.checked`."""
        return samples.checked(self.mechanism.tree, len(self.channels), where)

    def order(self, samples: Samples) -> tuple[np.ndarray, tuple[int, ...]]:
        """Order of the columns `[Y_b | drives | offsets | measured]` in which channels with few columns come in last.

        Args:
            samples: Checked samples.

        Returns:
            Indices of the columns, base columns reordered and the others unchanged (columns + 1,); and the position of
            the first column in this order that is not zero in each channel (C,).
        """
        moving = samples.motion.base is not None
        if moving not in self._orders:
            nonzero, rank = self._nonzero(moving), self.parameters.rank
            # Last the columns of the channel with fewest, before them the remaining ones of the next channel.
            by_size = np.argsort(nonzero[:rank].sum(axis=0), kind="stable")
            smallest = nonzero[:rank, by_size].argmax(axis=1)
            order = np.append(np.argsort(-smallest, kind="stable"), np.arange(rank, len(nonzero)))
            self._orders[moving] = order, tuple(nonzero[order].argmax(axis=0).tolist())
        return self._orders[moving]

    @cached_property
    def _orders(self) -> dict[bool, tuple[np.ndarray, tuple[int, ...]]]:
        return {}

    def _nonzero(self, moving: bool) -> np.ndarray:
        """Mask of the columns and measurements that are not structurally zero (columns + 1, C)."""
        rank, (wrench, torques) = self.parameters.rank, self._parts()
        nonzero = np.ones((len(self.names) + 1, len(self.channels)), bool)
        if wrench:
            of_wrench = self.program(moving=moving, torques=False).written.reshape(rank, 6)
            nonzero[:rank, wrench] = of_wrench if self.wrench is None else of_wrench @ (self.wrench != 0).T
        if torques:
            own = self.program(moving=moving, torques=True).written.reshape(rank, -1)
            nonzero[:rank, torques] = own[:, list(self.torques)]
        nonzero[rank:-1, wrench] = False
        nonzero[rank + len(self.drives) + np.arange(len(self.offsets)), list(self.offsets)] = True
        return nonzero

    @property
    def straight(self) -> bool:
        """True if the channels are the six components of the wrench, as the program writes them."""
        return self.wrench is None and not self.torques

    def block(self, samples: int) -> np.ndarray:
        """Memory for columns and measurements of some samples (columns + 1, C, samples), offsets written."""
        out = zeros(len(self.names) + 1, len(self.channels), samples)
        for k, channel in enumerate(self.offsets, self.parameters.rank + len(self.drives)):
            out[k, channel] = 1
        return out

    def program(self, *, moving: bool, torques: bool, order: np.ndarray | None = None) -> Program:
        """Program that computes the base columns, by default in their own order."""
        kept = self.parameters.kept
        kept = kept if order is None else tuple(kept[k] for k in order[: self.parameters.rank].tolist())
        return regressor_program(self.mechanism, kept, moving=moving, torques=torques)

    def rows(
        self, samples: Samples, factors: np.ndarray | None = None, *, order: np.ndarray | None = None
    ) -> Iterator[np.ndarray]:
        """Yields columns and measurements of checked samples, chunk by chunk in the same memory.

        They are whitened where the samples have a covariance.

        Args:
            samples: The samples (N).
            factors: Weight by which each row is multiplied (N, C).
            order: Order of the columns from `order`, by default their own.

        Yields:
            Columns first, measurements last (columns + 1, C, chunk).
        """
        arm, rank = self.mechanism, self.parameters.rank
        moving, (wrench, torques) = samples.motion.base is not None, self._parts()
        kinds = [kind for kind, channels in ((False, wrench), (True, torques)) if channels]
        programs = {kind: self.program(moving=moving, torques=kind, order=order) for kind in kinds}
        size = min(CHUNK, len(samples))
        block = self.block(size)
        blocks = {kind: np.zeros((rank, len(arm.tree.freedoms) if kind else 6, size)) for kind in kinds}
        if self.straight:
            blocks[False] = block[:rank]
        for kind, program in programs.items():
            program.fill(blocks[kind].reshape(-1, size))
        for first in range(0, len(samples), size):
            part = samples[first : first + size]
            count, inputs = len(part), program_inputs(arm.tree, part.motion, arm.gravity)
            rows = block[:, :, :count]
            for kind, program in programs.items():
                program.run(inputs, blocks[kind].reshape(-1, size)[:, :count])
            if wrench and not self.straight:
                Y = blocks[False][:, :, :count]
                rows[:rank, wrench] = Y if self.wrench is None else self.wrench @ Y
            if torques:
                rows[:rank, torques] = blocks[True][:, list(self.torques), :count]
                rows[rank : rank + len(self.drives), torques] = self._drives(part)
            rows[-1] = part.measured.T
            if part.covariance is not None:
                rows = whitened(rows, part.covariance)
            yield rows if factors is None else rows * factors[first : first + size].T

    def residual(self, samples: Samples, values: np.ndarray) -> np.ndarray:
        """Measured less predicted channels of checked samples (…, N, C), not whitened, for coefficients (…, m)."""
        rows = self.rows(replace(samples, covariance=None))
        left = np.concatenate([x[-1] - np.tensordot(values, x[:-1], axes=1) for x in rows], axis=-1).swapaxes(-1, -2)
        return left if self.beside is None else left - self._beside(samples.motion, self.beside)

    def _beside(self, motion: Motion, phi: np.ndarray) -> np.ndarray:
        """Channels of some φ (10 b,) that are no coefficients (N, C)."""
        total, felt = inverse_dynamics(self.mechanism.tree, motion, phi, self.mechanism.gravity)
        wrench = (total if self.wrench is None else total @ self.wrench.T)[:, self._parts()[0]]
        return np.hstack([wrench, felt[:, list(self.torques)]])

    def _parts(self) -> tuple[range, range]:
        """Indices of the channels of the wrench and of the torques."""
        wrenches = len(self.channels) - len(self.torques)
        return range(wrenches), range(wrenches, len(self.channels))

    def _drives(self, samples: Samples) -> np.ndarray:
        """Columns of rotor inertia and friction (d, torques, chunk)."""
        tree, axes, torques = self.mechanism.tree, self.axes, list(self.torques)
        signals = drive_signals(tree, axes, samples.motion.states, self.slips, self.mechanism.springrefs)
        places = [(kind, axes.names.index(axis)) for kind, axis in map(column_place, self.drives)]
        columns, first = list[np.ndarray](), len(axes.names) - len(axes.dependent)
        # Axes of dependent joints act by the slopes of the loops.
        slopes = tree.slopes(samples.motion.q) if any(a >= first for _, a in places) else np.zeros(0)
        for kind, a in places:
            shares = axes.matrix[a, torques, None] if a < first else slopes[:, a - first, torques].T
            columns.append(shares * signals[kind][:, a])
        return np.reshape(columns, (len(places), len(torques), len(samples)))

    def drive_torques(
        self, states: tuple[np.ndarray, np.ndarray, np.ndarray], theta: np.ndarray, slips: np.ndarray
    ) -> np.ndarray:
        """Torques of rotor inertia, friction and springs of the n freedoms, zero without a column for them (n,).

        Args:
            states: Joint coordinates (n_q,), velocities and accelerations (n,), numbers or signals of a tape.
            theta: Parameters, those of the drives after ψ.
            slips: Velocities of the m axes over which Coulomb friction changes sign (m,).
        """
        axes, at = self.axes, dict(zip(self.drives, theta[self.parameters.rank :], strict=False))
        signals = drive_signals(self.mechanism.tree, axes, states, slips, self.mechanism.springrefs)
        each = [[at.get(f"{DRIVE[kind]}({name})", 0.0) for name in axes.names] * own for kind, own in signals.items()]
        return axes.felt(self.mechanism.tree, states[0], np.sum(each, axis=0))


def stated_drive_torques(mechanism: Mechanism, motion: Motion) -> np.ndarray:
    """Torques of rotors, friction and springs as the model states them, N m or N (N, n).

    Coulomb friction changes its sign as `tanh(q̇ / SLIP)`, so that noise of a resting joint's velocity is no friction.

    Args:
        mechanism: The mechanism, with its drives.
        motion: Motion of its joints, checked (N samples).
    """
    tree = mechanism.tree
    axes, names = Axes.of(tree), (*tree.freedoms, *tree.dependent)
    drives = [mechanism.drives.get(name, NO_DRIVE) for name in names]
    signals = drive_signals(tree, axes, motion.states, SLIP, mechanism.springrefs)
    values, at = {kind: np.array([each.value(kind) for each in drives], float) for kind in signals}, 0
    for body, own in zip(tree.bodies, tree.body_coordinates(motion.q), strict=True):
        part = slice(at, at := at + body.freedoms)
        if body.is_ball and values["spring"][part].any():
            reference = Rotation.from_rotvec(mechanism.springrefs[part])
            turned = reference.inv() * Rotation.from_quat(own, scalar_first=True)
            signals["spring"][:, part] = turned.as_rotvec()
    return axes.felt(tree, motion.q, np.sum([values[kind] * signal for kind, signal in signals.items()], axis=0))


def stated_drive_channels(equations: Equations, motion: Motion) -> np.ndarray:
    """Part of the drives, as the model states them, in the channels of equations: zero in a wrench (N, C)."""
    out = np.zeros((len(motion), len(equations.channels)))
    if equations.torques and equations.mechanism.drives:
        torques = stated_drive_torques(equations.mechanism, motion)
        out[:, -len(equations.torques) :] = torques[:, list(equations.torques)]
    return out


def predicted_channels(
    mechanism: Mechanism, motion: Motion, frame: np.ndarray, *, torques: bool = False
) -> dict[str, np.ndarray]:
    """Components of the total wrench in a frame, and joint torques if requested, as the model predicts them (N,) each.

    It predicts with its prior and with the drives that it states.
    """
    total, felt = inverse_dynamics(mechanism.tree, motion, mechanism.known, mechanism.gravity)
    predicted = dict(zip(COMPONENTS, coAd(inverse(frame)) @ total.T, strict=True))
    if torques and mechanism.drives:
        felt = felt + stated_drive_torques(mechanism, motion)
    return predicted | (dict(zip(mechanism.tree.freedoms, felt.T, strict=True)) if torques else {})


def drives_of(axes: Axes, kinds: Sequence[str], torques: Sequence[int]) -> tuple[str, ...]:
    """Names of the columns of some kinds of drives that act on the freedoms whose torques are measured.

    Args:
        axes: Axes on which drives act.
        kinds: The kinds, out of `DRIVE`.
        torques: Indices of those freedoms.
    """
    each = (f"{DRIVE[kind]}({name})" for kind in kinds for k in torques for name in axes.acting(kind, k))
    return tuple(dict.fromkeys(each))


def usual_drives(mechanism: Mechanism, torques: Sequence[int], axes: Axes | None = None) -> tuple[str, ...]:
    """Names of the columns that are fitted by default: rotor inertia and friction, and springs that the model has.

    Args:
        mechanism: The mechanism.
        torques: Indices of the freedoms whose torques are measured.
        axes: Axes on which drives act, by default the freedoms alone.
    """
    axes = Axes.of(mechanism.tree) if axes is None else axes
    freedoms = [mechanism.tree.freedoms[k] for k in torques]
    hinges = [name for name in freedoms if name in mechanism.tree.joints and name in mechanism.drives]
    springs = [name for name in hinges if mechanism.drives[name].stiffness]
    usual = (*drives_of(axes, USUAL_DRIVE, torques), *(f"{DRIVE['spring']}({name})" for name in springs))
    return (*usual, *passive_drives(mechanism, axes, (*USUAL_DRIVE, "spring"), torques))


def passive_drives(mechanism: Mechanism, axes: Axes, kinds: Sequence[str], torques: Sequence[int]) -> tuple[str, ...]:
    """Names of the columns of drives that the model states of dependent joints, arguments as above."""
    moved = [name for name in axes.dependent if torques and name in mechanism.drives]
    pairs = [(kind, name) for kind in kinds for name in moved if mechanism.drives[name].value(kind)]
    return tuple(f"{DRIVE[kind]}({name})" for kind, name in pairs)


def absorbed_note(mechanism: Mechanism, lost: Sequence[str], mixed: Sequence[str] = ()) -> str:
    """Note on drives whose columns depend on those of the links, and of the mixed drives of other motors."""
    beside = f" and from {', '.join(mixed)}" if mixed else ""
    note = f"{', '.join(lost)} cannot be told from the links' inertias{beside}, which take them up"
    if not (stated := [name for name, value in zip(lost, stated_values(mechanism, lost), strict=True) if value]):
        return f"{note}."
    return f"{note}; bodies are computed with the model's {', '.join(stated)}."

"""Measurement model: the channels of `Equations` as functions of states, parameters and set-up.

    wrench   (1 + gain) coAd(T_sensor)⁻¹ [Y(q, q̇, q̈) ψ - Σ contacts] + offset
    pose     F⁻¹ T(q) M, of a tracked body (`ident.estimation.recorded_motion`)
    zero     Y(q, q̇, q̈) ψ - Σ contacts + offset, where nothing holds the base: contacts alone (Eq. 3)
    torque   (1 + gain) [Y_τ(q, q̇, q̈) ψ - Σ contacts + drives] + offset

A contact is its sensor's reading, each component over 1 + gain, moved from the place of the sensor.

The parameters ψ are inserted first, so that inverse dynamics is differentiated, not its regressor. Measured contacts
are noisy: the effect of the set-up on them is computed from averages over neighbouring samples, whose noise is
independent of the residual; otherwise a gain, for example, would shrink to reduce the noise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ident.estimation.equations import COMPONENTS, SLIP
from ident.estimation.recorded_motion import WIDTH, Tracked, base_motion, joint_states, reading
from ident.estimation.setup_parameters import MARKERS, ChannelParameters
from ident.geometry.se3 import coAd, inverse, pose
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model import closed_form, compiled
from ident.model.regressor import CHUNK
from ident.model.tape import Program, Signal, Value, gradient, recording
from ident.recordings.wrench import GROUND, Sensor, pose_in_base
from ident.tolerances import DRIVE

CHUNK_COMPILED = 256
"""Samples that compiled code differentiates at once, so that its results are still in cache when they are reordered."""


@dataclass(frozen=True, eq=False)
class Measurement(ChannelParameters):
    """Channels as functions of a trajectory and of `ChannelParameters` θ.

    Attributes:
        frame: Pose of the ground sensor's frame in the base frame (4, 4); None where nothing holds the base: then the
            sum of all wrenches about the base frame's origin is zero.
        components: Components of the wrench that are channels.
        contacts: Sensors of the other wrenches by name.
        tracked: Tracked bodies by the names of their poses, which are channels after those of the equations.
    """

    frame: np.ndarray | None
    components: tuple[int, ...]
    contacts: dict[str, Sensor]
    tracked: Mapping[str, Tracked] = field(default_factory=dict)

    @property
    def in_world_axes(self) -> bool:
        """True if the wrench is expressed in the world's axes, those of its noise: a whole wrench without a ground.

        A partial wrench stays in the axes of the base, in which its components were left out.
        """
        return self.frame is None and len(self.components) == len(COMPONENTS)

    @property
    def width(self) -> int:
        """Number of channels C, those of tracked bodies included."""
        return len(self.equations.channels) + WIDTH * len(self.tracked)

    @cached_property
    def coordinates(self) -> int:
        """Number of coordinates of the base and of the joints."""
        return self.of_base + self.tree.size

    @cached_property
    def zeros(self) -> dict[int, int]:
        """Indices in θ of the coordinates' zeros, by coordinate."""
        kinds = [self.of_kind("zero", body.joint) if body.joint else {} for body in self.tree.bodies]
        return {int(at[0]): own[None] for at, own in zip(self._places, kinds, strict=True) if own}

    @cached_property
    def _places(self) -> list[np.ndarray]:
        """Indices of the coordinates of each body's joint."""
        return self.tree.body_coordinates(np.arange(self.of_base, self.coordinates))

    @property
    def smooth(self) -> bool:
        """True if channels are smooth functions of the states alone: there are no contacts, trackers or friction."""
        dry = tuple(f"{DRIVE[kind]}(" for kind in ("coulomb", "stribeck"))
        return not (self.contacts or self.tracked) and not any(name.startswith(dry) for name in self.equations.drives)

    @cached_property
    def turning(self) -> np.ndarray:
        """Masks of the coordinates that turn each body, those of the base among them (b, n)."""
        out = np.zeros((len(self.tree.bodies), self.coordinates), bool)
        out[:, : self.of_base] = True
        for i, (body, own) in enumerate(zip(self.tree.bodies, self._places, strict=True)):
            if body.parent >= 0:
                out[i] = out[body.parent]
            out[i, own] = body.is_ball or body.turns
            if body.depends and (closure := self.tree.closure):
                # At least as fast as one of those that determine it.
                for lead, others in zip(self.tree.bodies, self._places, strict=True):
                    out[i, others] |= lead.joint in closure.independent
        return out

    def values(self, states: np.ndarray, wrenches: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Predicted channels (C, N).

        Args:
            states: Coordinates, and their first and second derivatives (3, N, n).
            wrenches: Wrenches of the surroundings on the contacts: averages over neighbours, and the rest; and measured
                orientations of tracked bodies, in halves (N, 2, 6 k).
            theta: Parameters (p,).
        """
        program, *_ = self._recorder._programs
        every = np.arange(program.results)
        return self._run(program, (states, wrenches, theta), every, every, program.results)

    def of_contacts(self, states: np.ndarray, wrenches: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Contribution of the contacts to the channels (C, M), arguments as for `values`."""
        return self.values(states, wrenches, theta) - self.values(states, np.zeros_like(wrenches), theta)

    def derivatives(
        self, states: np.ndarray, wrenches: np.ndarray, theta: np.ndarray, columns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predicted channels (C, N), and their derivatives by the states (C, 3, n, N) and by entries of θ (C, k, N)."""
        n, channels, displaced = self.coordinates, self.width, self.is_displaced(theta)
        _, program, nonzero = self._recorder._programs
        # Those by `unseen` are after those by θ, if they count at all.
        by = np.r_[: 3 * n, 3 * n + columns, 3 * n + len(theta) : nonzero.shape[1] if displaced else 0]
        every, position = np.arange(channels), np.zeros(nonzero.shape, int)
        position[nonzero] = np.arange(channels, channels + nonzero.sum())
        wanted = position[:, by].ravel()
        place = np.flatnonzero(wanted)
        # Results that are identically zero are neither computed nor copied.
        wanted, place = np.append(every, wanted[place]), np.append(every, channels + place)
        out = self._run(program, (states, wrenches, theta), wanted, place, channels * (1 + len(by)))
        by_states, by_theta, by_unseen = np.split(
            out[channels:].reshape(channels, len(by), -1), [3 * n, 3 * n + len(columns)], axis=1
        )
        if displaced:
            of_bodies = columns < self.equations.parameters.rank
            by_theta[:, of_bodies] += self._unseen[1][:, columns[of_bodies]].T @ by_unseen
        return out[:channels], by_states.reshape(channels, 3, n, -1), by_theta

    def dependence(self, theta: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Masks of the coordinates (C, n) and of the entries of θ (C, k) on which the channels depend at all."""
        n, (*_, nonzero) = self.coordinates, self._recorder._programs
        of_theta = nonzero[:, 3 * n + columns]
        if self.is_displaced(theta):
            of_bodies = columns < self.equations.parameters.rank
            of_theta[:, of_bodies] = of_theta[:, of_bodies].any(axis=1, keepdims=True)
        return np.asarray(nonzero[:, : 3 * n].reshape(-1, 3, n).any(axis=1)), of_theta

    def _run(
        self, program: Program, inputs: Sequence[np.ndarray], wanted: np.ndarray, place: np.ndarray, number: int
    ) -> np.ndarray:
        """Some results of a program at places among zeros (k, N), those of one sample adjacent in memory.

        The inputs are states, wrenches and θ as for `values`.
        """
        states, wrenches, theta = inputs
        starts = self.tree.started(states[0, :, self.of_base :])[:, self.coordinates - self.of_base :]
        if self._on:
            starts = np.hstack([starts, self._on.started(states[0, :, : self.of_base])[:, self.of_base :]])
        rows = [*states.swapaxes(1, 2), starts.T, wrenches.reshape(len(wrenches), -1).T]
        constants = np.concatenate([theta, self.unseen(theta), self._slips])
        along = np.concatenate(rows, out=np.empty((sum(map(len, rows)), len(wrenches))))
        out = np.zeros((len(wrenches), number))
        size = min(CHUNK_COMPILED if compiled.available() else CHUNK, len(wrenches))
        some = np.zeros((program.results, size))
        program.fill(some)
        for first in range(0, len(out), size):
            part = slice(first, first + size)
            results = some[:, : len(out[part])]
            program.run(along[:, part], results, constants)
            out[part, slice(None) if len(place) == number else place] = results[wanted].T
        return out.T

    @cached_property
    def _slips(self) -> np.ndarray:
        """Velocities over which Coulomb friction changes sign, empty if no torque is a channel."""
        if not self.equations.torques:
            return np.zeros(0)
        return SLIP * self.equations.axes.gears if self.equations.slips is None else self.equations.slips

    def with_slips(self, slips: np.ndarray) -> "Measurement":
        """Measurement with other slips (m,) and the same programs, of which slips are inputs."""
        other = replace(self, equations=replace(self.equations, slips=slips))
        other.__dict__.update(_recorder=self._recorder, _unseen=self._unseen)
        return other

    @cached_property
    def _recorder(self) -> "Measurement":
        """Measurement, equal but for slips, that records the programs and has what does not depend on slips."""
        return self

    @cached_property
    def _programs(self) -> tuple[Program, Program, np.ndarray]:
        """Programs of the channels, and of the channels and then their gradients that are not identically zero.

        Last the mask of the latter: derivatives of each channel by states, by θ and by `unseen` (C, 3 n + p + d).
        """
        n, d, measured = self.coordinates, len(self.tree.dependent), len(self.contacts) + len(self.tracked)
        d += len(self._on.dependent) if self._on else 0
        ends = np.cumsum([3 * n, d, 12 * measured, len(self.names), len(self._unseen[0])])
        with recording(int(ends[-1]) + len(self._slips)) as tape:
            states, starts, wrenches, theta, unseen, slips = np.split(np.array(tape.inputs), ends)
            channels = self._channels(states.reshape(3, n), starts, wrenches.reshape(2, -1, 6), theta, unseen, slips)
            gradients = [gradient(channel, [*states, *theta, *unseen]) for channel in channels]
            nonzero = np.array([[isinstance(d, Signal) or d != 0 for d in row] for row in gradients], bool)
            nonzero = nonzero.reshape(len(channels), -1)
            kept = [gradients[c][k] for c, k in np.argwhere(nonzero)]
            return Program.of(tape, channels), Program.of(tape, channels + kept), nonzero

    def _channels(
        self,
        states: np.ndarray,
        starts: np.ndarray,
        wrenches: np.ndarray,
        theta: np.ndarray,
        unseen: np.ndarray,
        slips: np.ndarray,
    ) -> list[Value]:
        """Channels on a tape, from states (3, n), starts of dependent joints (d,), wrenches (2, k, 6), θ, φ and slips.

        Those of the mechanism's own loops are before those of its carrier's.
        """
        equations, tree = self.equations, self.corrected_tree(theta)
        motion = self.motion(states, starts[len(tree.dependent) :])
        motion = replace(motion, q=np.concatenate([motion.q, starts[: len(tree.dependent)]]))
        root, base = self._root(motion, theta)
        motions, gains = closed_form.body_motions(tree, root, *motion.states), self.gains(theta)
        drives = np.zeros(len(tree.freedoms))
        if equations.torques:
            drives = equations.drive_torques(motion.states, theta, slips)

        def read(felt: list[np.ndarray], drives: np.ndarray, at: np.ndarray) -> list[Value]:
            """Readings, without gains and offsets, of wrenches on the bodies (6,) and of drives' torques."""
            wrench = self._in_sensor(np.sum(felt, axis=0), base, at)
            torques = closed_form.joint_torques(tree, motions, motion.q, felt) if equations.torques else np.zeros(0)
            return [*wrench, *(torques[k] + drives[k] for k in equations.torques)]

        phi = self.with_dependent(unseen)
        phi[list(equations.parameters.kept)] += theta[: equations.parameters.rank]
        own = read(closed_form.body_wrenches(self.tree, motions, phi), drives, theta)
        out = [gain * value for value, gain in zip(own, gains, strict=True)]
        offsets = theta[equations.parameters.rank + len(equations.drives) :]
        for k, offset in zip(equations.offsets, offsets, strict=False):
            out[k] = out[k] + offset
        if equations.servos is not None:
            # Commands u take the place of torques: kp u = τ + kp q + kv q̇.
            lengths, first = self.encoders(motion.q, theta), len(self.components)
            for at, (k, kp, kv) in enumerate(zip(equations.torques, *equations.servos, strict=True), first):
                out[at] = out[at] + kp * lengths[k] + kv * motion.dq[k]
        if self.contacts:
            averages, rest = wrenches[:, : len(self.contacts)]
            touch = self._less_contacts(motions, base, averages, theta)
            noise = self._less_contacts(motions, base, rest, theta * 0)
            of_touch, of_noise = read(touch, 0 * drives, theta), read(noise, 0 * drives, theta * 0)
            out = [a + g * b + c for a, g, b, c in zip(out, gains, of_touch, of_noise, strict=True)]
        return out + self._poses(motions, base, wrenches[:, len(self.contacts) :], theta)

    def _poses(
        self, motions: list[closed_form.BodyMotion], base: np.ndarray, measured: np.ndarray, theta: np.ndarray
    ) -> list[Value]:
        """Channels of the tracked bodies, beside their measured orientations (2, k, 6)."""
        out = list[Value]()
        for k, (name, (body, frame, markers, of_frame)) in enumerate(self.tracked.items()):
            T = base @ pose(motions[body].R, motions[body].p) @ markers @ self.displacement(MARKERS.format(name), theta)
            T = inverse(frame @ self.displacement(of_frame, theta)) @ T
            out += reading(T, measured[:, k].ravel())
        return out

    def torque_gains(self, theta: np.ndarray) -> np.ndarray:
        """Gains of the torques, 1 for the components of a wrench (C,)."""
        gains = np.array(self.gains(theta), float)
        gains[: len(self.components)] = 1
        return gains

    @property
    def _on(self) -> Tree | None:
        """Tree of the carrier, None without one."""
        carrier = self.equations.mechanism.carrier
        return carrier.tree if carrier else None

    def motion(self, states: np.ndarray, starts: np.ndarray | None = None) -> Motion:
        """Motion of coordinates and their derivatives (3, N, n), on a tape from starts of the carrier's loops."""
        carrier, base = self.equations.mechanism.carrier, states[..., : self.of_base]
        moved = base_motion(base) if self.moving else None
        if carrier:
            q, *rates = joint_states(carrier.tree, base)
            moved = carrier.motion(q if starts is None else np.concatenate([q, starts]), *rates)
        return Motion(*joint_states(self.tree, states[..., self.of_base :]), moved)

    def _root(self, motion: Motion, theta: np.ndarray) -> tuple[closed_form.BodyMotion, np.ndarray]:
        """Motion of the base in a motion of one sample, and its pose in the world."""
        gravity, base = self.gravity(theta), motion.base
        if base is None:
            return closed_form.base_motion(np.zeros(3), np.zeros(3), -gravity), np.eye(4)
        v, w, dv, dw = base.V[:3], base.V[3:], base.dV[:3], base.dV[3:]
        return closed_form.base_motion(w, dw, dv + np.cross(w, v) - base.T[:3, :3].T @ gravity), base.T

    def _less_contacts(
        self, motions: list[closed_form.BodyMotion], base: np.ndarray, wrenches: np.ndarray, theta: np.ndarray
    ) -> list[np.ndarray]:
        """Negative wrenches of the contacts (k, 6) on the bodies (6,), in the base frame."""
        felt, world = [np.zeros(6)] * len(motions), base if self.moving else None
        for (name, sensor), wrench in zip(self.contacts.items(), wrenches, strict=True):
            i = self.tree.names.index(str(sensor.body))
            place = pose_in_base(sensor, pose(motions[i].R, motions[i].p), world)
            own = sensor.plate or name
            gains = self.gains(theta, [f"{own} {component}" for component in COMPONENTS])
            felt[i] = felt[i] - coAd(place @ self.displacement(own, theta)) @ (wrench / np.array(gains))
        return felt

    def _in_sensor(self, total: np.ndarray, base: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Measured components of a total wrench: in the ground sensor's frame, else in the world's or base's axes."""
        change = coAd(pose(base[:3, :3], np.zeros(3))) if self.in_world_axes else np.eye(6)
        if self.frame is not None:
            change = coAd(inverse(self.displacement(GROUND, theta))) @ coAd(inverse(self.frame))
        return (change @ total)[list(self.components)]

"""Shares of wrenches and torques that the model explains with some columns as positions of its joints."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from experiments.guesses.belief import Belief
from experiments.guesses.words import unit_of, words
from ident.errors import ModelError
from ident.estimation.equations import COMPONENTS, SLIP, predicted_channels
from ident.estimation.recorded_motion import joint_states
from ident.files.table import UNITS
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.recordings.smoothing import SETTLING, chosen_cutoff, low_pass, smoothed

ENOUGH, LITTLE = 0.5, 0.1
"""Shares of wrenches and torques that the model has to explain with columns assigned only by their place, and with
others. Torques of arms are explained to less than half with columns of other joints, to eight tenths or more with the
right ones, even if masses are wrong by a factor of two. For columns with names the model may be worse."""

ENOUGH_OF_WRENCHES = 0.95
"""Share of wrenches that the model has to explain with one order among several, whatever the wrenches' axes: with that
much freedom, a wrong order explains up to nine tenths."""

CLEAR = 0.7
"""Ratio of the best choice's unexplained share to the second's, above which the choice is open: of random orders of the
columns of 60 samples, .8 took a wrong one in 8 of 9 logs, .7 in 5."""

SAME = 0.999
"""Correlation above which columns, or the sizes of two forces, are two readings of the same."""

States = Mapping[str, np.ndarray]
"""Position and both derivatives by joint (3, M)."""


class Left(NamedTuple):
    """Shares of variances that the model leaves unexplained.

    Attributes:
        somehow: With free axes, signs and units of wrenches.
        straight: With wrenches in their stated axes.
    """

    somehow: float
    straight: float


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """The model of a belief beside its log: columns low-passed by one filter, at few samples.

    Attributes:
        belief: The belief so far, which may change.
        states: Values and both derivatives of columns that may be positions (3, M).
        levels: Values of all columns (M,).
    """

    belief: Belief
    states: Mapping[str, np.ndarray]
    levels: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, belief: Belief, candidates: Iterable[str] = ()) -> "ComparedModel":
        """The model beside a log, at 300 samples; the cut-off suits the known positions and the candidates.

        Raises:
            InputError: There are too few samples for a filter.
        """
        log, known = belief.log, [x.column for x in belief.of("position").values()]
        names = [name for name in dict.fromkeys([*known, *candidates]) if name in log.columns]
        x, rate = log.table(names), log.rate
        cutoff = chosen_cutoff(x, rate)
        edge = min(int(SETTLING * rate / cutoff), len(x) // 10)
        taken = np.unique(np.linspace(edge, len(x) - 1 - edge, 300).astype(int))
        states = np.stack(smoothed(x, rate, cutoff))[:, taken]
        levels = {name: low_pass(y, rate, cutoff)[taken] for name, y in log.columns.items()}
        return cls(belief, {name: states[:, :, k] for k, name in enumerate(names)}, levels)

    def states_of(self, positions: Mapping[str, str], scale: float = 1.0) -> dict[str, np.ndarray]:
        """Positions and both derivatives of all joints (3, M); those without columns depend on others, or are at rest.

        Args:
            positions: Columns taken as positions, by joint, beside those of the belief.
            scale: Factor to rad of angles whose unit is not known: a program has one unit for all angles.
        """
        size, known, out = len(next(iter(self.levels.values()))), self.belief.of("position"), dict[str, np.ndarray]()
        for joint, kind in self.belief.kinds.items():
            angle, x = scale if kind == "hinge" else 1.0, known.get(joint)
            out[joint] = np.zeros((3, size))
            if joint in positions:
                stated = unit_of(f"{kind} position", words(positions[joint]).unit)
                out[joint] = self.states[positions[joint]] * UNITS[f"{kind} position"].get(stated, angle)
            elif x and x.column in self.states:
                out[joint] = self.states[x.column] * x.gain * (self.belief.factor(x) if x.unit else angle)
            elif x and x.column in self.belief.log.constant:
                out[joint][0] = self.belief.log.constant[x.column] * self.belief.factor(x)
        tree = _closed(self.belief.mechanism, frozenset({*out} - {*positions, *known}), ()).tree
        own = np.stack(tree.dependent_states(*_joint_states(tree, out)))
        return out | {joint: own[..., k] for k, joint in enumerate(tree.dependent)}

    def predicted(self, states: States) -> dict[str, np.ndarray]:
        """Total wrench in the base frame and joint torques by channel (M,) each."""
        whole, driven = self.belief.mechanism, self.belief.of("torque")
        motion = Motion(*_joint_states(whole.tree, states))
        channels = predicted_channels(whole, motion, np.eye(4), torques=True)
        closed = _closed(whole, frozenset({*states} - {*self.belief.of("position")}), tuple(driven))
        if closed is not whole:
            motion = Motion(*_joint_states(closed.tree, states))
            channels |= predicted_channels(closed, motion, np.eye(4), torques=True)
        return channels

    def left(self, factors: Mapping[str, float] | None = None) -> Left:
        """Mean of the unexplained shares, with factors on some positions; zero without any wrench and torque."""
        states = {joint: x * (factors or {}).get(joint, 1.0) for joint, x in self.states_of({}).items()}
        shares = self.shares(states, self.predicted(states))
        return Left(*np.mean(shares or [Left(0.0, 0.0)], axis=0).tolist())

    def shares(self, states: States, predicted: Mapping[str, np.ndarray]) -> list[Left]:
        """Unexplained shares of the forces, the moments and each joint torque that the belief has."""
        wrench, out = [predicted[c] for c in COMPONENTS], list[Left]()
        groups = [group for group in self.belief.groups.values() if not group.is_inner]
        places = self.wrenches(states) if any(g.is_open or "body" in g.entries for g in groups) else {}
        for key, basis, part in (("force", wrench[:3], wrench[:3]), ("torque", wrench, wrench[3:])):
            total = sum((self.level(g.entries[key].value) for g in groups if key in g.entries), np.zeros((1, 3)))
            if np.ptp(total, axis=0).any():
                inside = [unexplained(total, list(x.T)[: len(basis)]) for x in places.values()]
                out.append(Left(min([unexplained(total, basis), *inside]), min([_beside_own(total, part), *inside])))
        for joint, quantity in self.belief.of("torque").items():
            if quantity.column in self.levels:
                out.append(Left(*2 * [float(self.of_torques(states, predicted, [quantity.column])[joint][0])]))
        return out

    def level(self, names: Sequence[str]) -> np.ndarray:
        """Columns of a vector, zeros for those that are missing or do not change (M, 3)."""
        zero = np.zeros(len(next(iter(self.levels.values()))))
        return np.stack([self.levels.get(name, zero) for name in names], axis=1)

    def likeness(self, names: Sequence[str], predicted: Mapping[str, np.ndarray]) -> tuple[np.ndarray, list[str]]:
        """Squared correlations of columns with the predicted channels that change, and these channels' names."""
        ranges = {name: float(np.ptp(x)) for name, x in predicted.items()}
        moving = {name: x for name, x in predicted.items() if ranges[name] > 1e-6 * max(ranges.values())}
        if not names or not moving:
            return np.zeros((len(names), len(moving))), list(moving)
        both = np.corrcoef(np.array([*(self.levels[name] for name in names), *moving.values()]))
        return np.nan_to_num(both[: len(names), len(names) :]) ** 2, list(moving)

    def wrenches(self, states: States) -> dict[str, np.ndarray]:
        """Wrench that each joint's child exchanges with its parent, in the child's frame, by the body's name (M, 6)."""
        out = {}
        for body, part in self._parts.items():
            carrier = part.carrier
            assert carrier is not None
            own = Motion(*_joint_states(part.tree, states), carrier.motion(*_joint_states(carrier.tree, states)))
            predicted = predicted_channels(part, own, np.eye(4))
            out[body] = np.stack([predicted[c] for c in COMPONENTS], axis=1)
        return out

    @cached_property
    def _parts(self) -> dict[str, Mechanism]:
        """Each moved body with all bodies on it; of unit mass if the model states none."""
        tree, out = self.belief.mechanism.tree, dict[str, Mechanism]()
        for i in (i for i in tree.inertial if self.mover(tree.names[i]) >= 0):
            try:
                part = self.belief.mechanism.beyond(tree.names[i])
            except ModelError:  # A loop goes through it.
                continue
            out[tree.names[i]] = part if part.known.any() else replace(part, prior=np.eye(len(part.known))[0])
        return out

    def mover(self, body: str) -> int:
        """Index of the body, of those that carry a body rigidly, on the last joint before it; -1 for the base."""
        tree, i = self.belief.mechanism.tree, self.belief.mechanism.tree.names.index(body)
        while i >= 0 and not tree.bodies[i].moves:
            i = tree.bodies[i].parent
        return i

    def of_torques(
        self, states: States, predicted: Mapping[str, np.ndarray], columns: Sequence[str]
    ) -> dict[str, np.ndarray]:
        """Share of each column's variance that a joint's predicted torque, friction and an offset leave, by joint."""
        out = {joint: np.empty(0) for joint in states}
        for joint, (_, dq, _) in states.items() if columns else ():
            both = np.stack([predicted[joint], *(self.levels[name] for name in columns)], axis=1)
            both = beside([np.ones_like(dq), dq, np.tanh(dq / SLIP)], both)
            x, y = both[:, 0], both[:, 1:]
            out[joint] = 1 - (x @ y) ** 2 / np.maximum((x @ x) * (y * y).sum(axis=0), 1e-300)
        return out


@lru_cache(maxsize=64)
def _closed(mechanism: Mechanism, lacking: frozenset[str], driven: tuple[str, ...]) -> Mechanism:
    """The mechanism with those joints dependent that loops determine."""
    return mechanism.closed(lacking, driven)


def _joint_states(tree: Tree, states: States) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates, velocities and accelerations of a tree's joints, each with one coordinate (M, n)."""
    size = len(next(iter(states.values()))[0])
    own = np.stack([states[joint] for joint in tree.joints], axis=-1) if tree.joints else np.zeros((3, size, 0))
    return joint_states(tree, own)


def beside(rows: Sequence[np.ndarray], y: np.ndarray) -> np.ndarray:
    """Residuals of columns fitted with regressors (M,) by least squares (M,) or (M, k)."""
    x = np.stack(rows, axis=1)
    x = x / np.maximum(np.linalg.norm(x, axis=0), 1e-300)
    return np.asarray(y - x @ np.linalg.lstsq(x, y, rcond=1e-8)[0])


def unexplained(measured: np.ndarray, predicted: Sequence[np.ndarray]) -> float:
    """Unexplained share of the variance of columns (M, k) in a regression on others (M,), gains and offsets free."""
    whole = ((measured - measured.mean(axis=0)) ** 2).sum()
    left = (beside([np.ones(len(measured)), *predicted], measured) ** 2).sum()
    return float(left / whole) if whole > 0 else 1.0


def _beside_own(measured: np.ndarray, predicted: Sequence[np.ndarray]) -> float:
    """Unexplained share of the variance of components (M, 3) by their own predictions, with one positive gain."""
    x, y = (each - each.mean(axis=0) for each in (np.stack(predicted, axis=1), measured))
    gain = max(float((x * y).sum()), 0.0) / max(float((x * x).sum()), 1e-300)
    return float(((y - gain * x) ** 2).sum() / (y**2).sum())


def explained(left: float) -> str:
    """Explained share of a variance as text, from the unexplained one."""
    return f"{100 * (1 - left):.0f} %"

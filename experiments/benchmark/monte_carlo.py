"""Monte Carlo trials of the double pendulum against a loop over another library."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

import scenes
from experiments.benchmark.identification import check_agreement, solved
from experiments.benchmark.mechanisms import Subject, double_pendulum
from experiments.benchmark.peers import PINOCCHIO_NAME, Pinocchio
from experiments.benchmark.timing import Comparison, Effort, alternating, with_and_without
from experiments.data.defaults import SCENE
from ident.estimation.accumulator import accumulate
from ident.estimation.samples import Samples
from ident.mechanism.motion import Motion
from ident.parameters.base_parameters import STANDARD_GRAVITY
from ident.regression.ordinary import least_squares
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

ALL_COLUMNS, BASE_COLUMNS = "Monte Carlo, all columns", "Monte Carlo, base columns"

TASKS = {
    ALL_COLUMNS: "a trial that draws the noise on joint states and wrench anew and identifies with the regrouping "
    "given, against the same draws, the loop and np.linalg.lstsq on all columns",
    BASE_COLUMNS: "the same with np.linalg.lstsq on the base columns",
}
"""The timed tasks."""

BLOCKS = 10
"""Blocks that the trials are divided into, one for each repetition."""


@dataclass(frozen=True, eq=False)
class Trials:
    """Monte Carlo trials around one simulated recording.

    Attributes:
        mechanism: The double pendulum.
        true: Joint states and wrench without noise.
        noise: Standard deviations on the columns of q, dq, ddq and of the wrench.
    """

    mechanism: Subject
    true: Samples
    noise: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, samples: int) -> "Trials":
        """Trials around a recording of the scene with the paper's excitation."""
        recording = simulate(scenes.load(SCENE), DOUBLE_PENDULUM, samples=samples)
        mechanism, true = double_pendulum(), recording.noise_free
        joints = mechanism.tree.joints
        wrench = np.repeat([recording.noise[f"ground_{kind}"] for kind in ("force", "torque")], 3)
        samples_true = Samples(Motion(*true.joint_states(joints)), true.wrench("ground").values)
        return cls(mechanism, samples_true, (*recording.joint_noise(joints), wrench))

    def drawn(self, seed: int) -> Samples:
        """Samples of one trial."""
        # The fastest of numpy's generators.
        rng, true = np.random.Generator(np.random.SFC64(seed)), self.true
        channels = zip((*true.motion.states, true.measured), self.noise, strict=True)
        q, dq, ddq, wrench = (x + std * rng.normal(size=x.shape) for x, std in channels)
        return Samples(Motion(q, dq, ddq), wrench)

    def identified(self, seeds: Iterable[int]) -> np.ndarray:
        """Our ψ of each trial (trials, r)."""
        equations = self.mechanism.equations
        return np.array([least_squares(equations, self.drawn(seed), factor=self.factor).psi for seed in seeds])

    @cached_property
    def factor(self) -> np.ndarray:
        """Factor of the accumulated noise-free samples, in whose coordinates all trials are fitted."""
        return accumulate(self.mechanism.equations, self.true).factor

    def solved(self, peer: Pinocchio, columns: Sequence[int] | None, seeds: Iterable[int]) -> np.ndarray:
        """Least-squares solutions on some columns of Pinocchio's regressor, for each trial (trials, columns)."""
        solutions = []
        for seed in seeds:
            drawn = self.drawn(seed)
            states = peer.states(drawn.motion.states, None)
            solutions.append(solved(peer.regressor(*states), drawn.measured, columns))
        return np.array(solutions)


def comparisons(effort: Effort) -> list[Comparison]:
    """Seconds per trial, ours and theirs, after a check that both estimate the same base parameters."""
    trials, seeds = Trials.of(effort.samples), range(effort.trials // BLOCKS)
    mechanism, rows = trials.mechanism, []
    peer = Pinocchio(mechanism.tree, STANDARD_GRAVITY)
    kept = peer.columns(mechanism.parameters.kept)
    check_agreement("Monte Carlo", trials.identified([0]), trials.solved(peer, kept, [0]))
    for task, columns in ((ALL_COLUMNS, None), (BASE_COLUMNS, kept)):
        ways = partial(trials.identified, seeds), partial(trials.solved, peer, columns, seeds)
        times = alternating(with_and_without(*ways), 0, BLOCKS) / len(seeds)
        bodies = len(mechanism.tree.bodies)
        rows.append(Comparison.of(task, mechanism.name, bodies, effort.samples, PINOCCHIO_NAME, times))
    return rows

"""Which motion of a mechanism tells most about its base parameters: the problem, its criteria, and the best of many."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from tqdm import tqdm

from ident.errors import InputError, ModelError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.model.regressor import CHUNK, base_wrench_regressor, joint_torque_regressor
from ident.parameters.base_parameters import BaseParameters, find_base_parameters
from ident.parameters.structure import Sensors
from sim.models.couplings import check_torques
from sim.models.mujoco_model import base_motion, gravity_of, mechanism_bodies, rest_coordinates
from sim.models.names import joint_name
from sim.motion.collisions import Collisions
from sim.motion.excitation_design import Cost, Limits, design, random_start, scaled_into
from sim.motion.fourier import FourierTrajectory
from sim.simulation.sensors import ONE_DOF

INVISIBLE = 1e-14
"""Eigenvalues of the information below this fraction of the largest are rounding."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be excited.

    Attributes:
        mechanism: The mechanism of the joints that move, all others locked where they rest.
        rest: Where each hinge and slide rests, moved or not, rad or m.
        units: Their units, `rad` or `m`.
        sensors: One of `defaults.SENSORS`.
        noise: Standard deviations of the noise on forces in N, and on moments and torques in N m.
        parameters: Base parameters that motions of these joints can tell apart.
    """

    mechanism: Mechanism
    rest: Mapping[str, float]
    units: Mapping[str, str]
    sensors: str
    noise: tuple[float, float]
    parameters: BaseParameters

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that move."""
        return self.mechanism.tree.joints

    def regressor(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Base regressor Y_b of N samples (N, rows, r)."""
        function = base_wrench_regressor if self.sensors == "wrench" else joint_torque_regressor
        return self.parameters.reduce(function(self.mechanism.tree, q, dq, ddq, gravity=self.mechanism.gravity))

    def weights(self) -> np.ndarray:
        """One over the standard deviation of the noise on each row of a sample (rows,)."""
        force, moment = self.noise
        if self.sensors == "wrench":
            return 1 / np.repeat([force, moment], 3)
        return 1 / np.array([force if self.units[joint] == "m" else moment for joint in self.joints])


def problem(
    mechanism: Mechanism,
    names: Sequence[str] | None,
    *,
    sensors: str,
    noise: tuple[float, float],
    ignore: Sequence[str] = (),
) -> Problem:
    """What some joints of a mechanism can excite, on a base that stands still.

    Args:
        mechanism: The mechanism, from `sim.mechanism`.
        names: Joints to move; by default all hinge and slide joints.
        sensors: One of `defaults.SENSORS`.
        noise: Standard deviations of the noise, N and N m.
        ignore: Names of equality constraints and tendons to leave out.

    Raises:
        ModelError: A joint does not exist or cannot be moved so, or there is none.
    """
    model, base = mechanism.source.model, mechanism.source.base
    kinds = {joint_name(model, j): model.jnt_type[j] for j in range(model.njnt)}
    joints = [joint for joint in mechanism.tree.joints if kinds.get(joint) in ONE_DOF]
    moving = _chosen(joints, mechanism.tree, names)
    check_torques(model, mechanism_bodies(model, base), ignore, moving)
    rest = rest_coordinates(model, base)
    tree = mechanism.tree.fixed({name: q for name, q in rest.items() if name not in moving})
    gravity = mechanism.gravity
    if base is not None:
        still = base_motion(model, base, model.qpos0[None], *np.zeros((2, 1, model.nv)))
        gravity = still.T[0, :3, :3].T @ gravity_of(model)
    locked = replace(mechanism, tree=tree, gravity=gravity)
    return Problem(
        locked,
        {joint: float(rest[joint][0]) for joint in joints},
        {joint: "m" if kinds[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad" for joint in joints},
        sensors,
        noise,
        find_base_parameters(
            locked, sensors=Sensors(base_wrench=sensors == "wrench", joint_torques=sensors == "torque")
        ),
    )


def _chosen(joints: Sequence[str], tree: Tree, names: Sequence[str] | None) -> Sequence[str]:
    """Those of the hinges and slides of a tree that have some names, in the tree's order."""
    if not joints:
        raise ModelError("Excitation needs a hinge or slide joint; this mechanism has none.")
    for name in names or ():
        if name not in joints:
            what = "is neither hinge nor slide" if name in tree.joints else "does not exist"
            raise ModelError(f"Joint '{name}' {what}; the joints to choose from are {', '.join(joints)}.")
    return [joint for joint in joints if names is None or joint in names]


def information(problem: Problem, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Information `Σ Y_bᵀ W² Y_b` of P motions of G samples: arrays (P, G, n) give (P, r, r)."""
    out = np.empty((len(q), problem.parameters.rank, problem.parameters.rank))
    at_once = max(1, CHUNK // q.shape[1])
    for start in range(0, len(q), at_once):
        part = slice(start, start + at_once)
        Y = problem.regressor(*(x[part].reshape(-1, x.shape[2]) for x in (q, dq, ddq))) * weights[:, None]
        rows = Y.reshape(len(q[part]), -1, Y.shape[2])
        out[part] = np.swapaxes(rows, 1, 2) @ rows
    return out


def cost(problem: Problem, criterion: str) -> Cost:
    """What a criterion of `defaults.CRITERIA` makes small, as a logarithm."""
    weights = problem.weights() if criterion == "information" else np.ones_like(problem.weights())

    def logarithm(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        s = np.linalg.eigvalsh(information(problem, q, dq, ddq, weights))
        s = np.log(np.maximum(s, INVISIBLE * s[:, -1:]))
        return -np.mean(s, axis=1) / 2 if criterion == "information" else (s[:, -1] - s[:, 0]) / 2

    return logarithm


def quality(problem: Problem, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> dict[str, float]:
    """Every criterion's value for a sampled motion (N, n)."""
    Y = problem.regressor(q, dq, ddq)
    s = np.linalg.svd(Y.reshape(-1, Y.shape[2]), compute_uv=False)
    columns = Y.reshape(-1, Y.shape[2])
    norms = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    weighted = (Y * problem.weights()[:, None]).reshape(-1, Y.shape[2])
    return {
        "condition_number": _ratio(s),
        "condition_number_of_unit_columns": _ratio(np.linalg.svd(columns / norms, compute_uv=False)),
        "log_det_information": 2 * float(np.log(np.linalg.svd(weighted, compute_uv=False)).sum()),
        "smallest_singular_value": float(s[-1]),
    }


def _ratio(singular_values: np.ndarray) -> float:
    return float(singular_values[0] / max(singular_values[-1], np.finfo(float).tiny))


def best(
    problem: Problem,
    limits: Limits,
    criterion: str,
    starts: Sequence[FourierTrajectory],
    collisions: Collisions | None,
    iterations: int,
) -> FourierTrajectory:
    """The best of what is found from several starts; progress goes to stderr.

    Raises:
        InputError: Everything found collides, or cannot tell the base parameters apart.
    """
    if collisions is not None:
        check_starts(collisions, starts, limits)
    value = cost(problem, criterion)
    found: list[tuple[float, FourierTrajectory]] = []
    for start in tqdm(starts, desc="Starts", file=sys.stderr):
        trajectory = design(value, limits, start, collisions=collisions, iterations=iterations)
        if trajectory is not None:
            found.append((_value_of(value, trajectory), trajectory))
    if not found and collisions is not None:
        raise InputError(f"No motion without collisions was found: {_collision(collisions, starts, limits)}.")
    return min(found, key=lambda pair: pair[0])[1]


def _value_of(value: Callable[..., np.ndarray], trajectory: FourierTrajectory) -> float:
    time = np.linspace(0, trajectory.duration, 401)
    return float(value(*(x[None] for x in trajectory.states(time)))[0])


def _collision(collisions: Collisions, starts: Sequence[FourierTrajectory], limits: Limits) -> str:
    """Who touches whom along the start that touches least."""
    time = np.linspace(0, starts[0].duration, 401)
    pairs = min((collisions.touching(scaled_into(s, limits).states(time)[0]) for s in starts), key=len)
    return _closer(collisions, list(pairs))


def check_starts(collisions: Collisions, starts: Sequence[FourierTrajectory], limits: Limits) -> None:
    """Refuses bodies that touch wherever the joints go, before the search looks for a way around.

    Raises:
        InputError: Some pair touches at every posture of every start.
    """
    time = np.linspace(0, starts[0].duration, 101)
    always: set[tuple[str, str]] | None = None
    for start in starts:
        for posture in scaled_into(start, limits).states(time)[0]:
            pairs = set(collisions.touching(posture[None]))
            always = pairs if always is None else always & pairs
            if not always:
                return
    raise InputError(f"No motion is without collisions: in every posture {_closer(collisions, sorted(always or ()))}.")


def _closer(collisions: Collisions, pairs: Sequence[tuple[str, str]]) -> str:
    named = ", ".join(f"'{a}' and '{b}'" for a, b in pairs[:3]) or "bodies"
    return (
        f"{named} come closer than {collisions.clearance:g} m; to accept that, lower --clearance, exclude the pair in "
        "the model, or choose --collisions ignore"
    )


def start_motions(
    limits: Limits, rest: np.ndarray, duration: float, harmonics: int, count: int, seed: int
) -> list[FourierTrajectory]:
    """Random motions, the first one about where the joints rest (n,)."""
    rng = np.random.default_rng(seed)
    return [random_start(limits, duration, harmonics, rng, rest if k == 0 else None) for k in range(count)]

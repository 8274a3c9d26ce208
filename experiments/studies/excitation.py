"""Design of exciting motions: the problem, and the best motion from several starts."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from tqdm import tqdm

from experiments.data.paper import NOISE
from experiments.studies.driven_excitation import determined, drive_signals, drives_pulled_back
from ident.errors import InputError, ModelError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.pullback import pulled_back
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.base_parameters import BaseParameters, find_base_parameters
from ident.parameters.structure import Sensors
from sim.models.couplings import check_torques
from sim.models.mechanism import mujoco_origin
from sim.models.mujoco_model import base_motion, gravity_of, mechanism_bodies, rest_coordinates
from sim.models.names import joint_name
from sim.motion.collisions import Collisions
from sim.motion.excitation_design import Cost, Limits, States, design, nearby_start, random_start, scaled_into
from sim.motion.fourier import FourierTrajectory
from sim.simulation.sensors import ONE_DOF, torque_noise, wrench_whitening


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """A mechanism to excite, and the measurements to design for.

    Attributes:
        mechanism: The mechanism of the joints that move; all others are locked at rest.
        whole: The mechanism of all joints.
        rest: Rest position of each hinge and slide, moved or not, rad or m.
        still: Coordinates of joints that are not part of the mechanism, where they are not as the model draws them.
        units: Their units, `rad` or `m`.
        sensors: One of `defaults.SENSORS`.
        whitening: W that makes the noise on the rows of a sample white and of unit size, 1/N and 1/(N m) (rows, rows).
        parameters: Base parameters identifiable by motions of these joints.
        drives: Names of the drives' columns to determine as well.
    """

    mechanism: Mechanism
    whole: Mechanism
    rest: Mapping[str, float]
    still: Mapping[str, Sequence[float]]
    units: Mapping[str, str]
    sensors: str
    whitening: np.ndarray
    parameters: BaseParameters
    drives: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the r base parameters and d drives."""
        return (*self.parameters.names, *self.drives)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that move."""
        return self.mechanism.tree.joints

    def regressor(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Base regressor Y_b of N samples, with the columns of the drives (N, rows, r + d)."""
        function = base_wrench_regressor if self.sensors == "wrench" else joint_torque_regressor
        tree, gravity = self.mechanism.tree, self.mechanism.gravity
        Y = function(tree, q, dq, ddq, gravity=gravity, columns=self.parameters.kept)
        if not self.drives:
            return Y
        return np.concatenate([Y, drive_signals(self.mechanism, self.drives, Motion(q, dq, ddq))], axis=2)

    def pulled_back(self, motion: Motion, adjoints: np.ndarray) -> States:
        """Derivatives by a motion, from derivatives by its base regressor (N, rows, r + d)."""
        rank, torques = self.parameters.rank, self.sensors == "torque"
        by_links = pulled_back(self.mechanism, motion, self.parameters.kept, adjoints[..., :rank], torques=torques)
        if not self.drives:
            return by_links
        by_drives = drives_pulled_back(self.mechanism, self.drives, motion, adjoints[..., rank:])
        q, dq, ddq = (a + b for a, b in zip(by_links, by_drives, strict=True))
        return q, dq, ddq


def problem(
    mechanism: Mechanism,
    names: Sequence[str] | None,
    *,
    sensors: str,
    noise: tuple[float, float] | None = None,
    ignore: Sequence[str] = (),
    fix: Mapping[str, Sequence[float]] | None = None,
    drive: Sequence[str] | None = (),
) -> DesignProblem:
    """Problem of exciting some joints of a mechanism on a fixed base.

    Args:
        mechanism: The mechanism, from `sim.mechanism`.
        names: Joints to move; by default all hinge and slide joints.
        sensors: One of `defaults.SENSORS`.
        noise: Standard deviations of the noise on forces in N, and on moments and torques in N m; by default those
            that the model's sensors state, and `NOISE` for channels without.
        ignore: Names of equality constraints and tendons to leave out.
        fix: Coordinates of the joints that the mechanism was read without.
        drive: Drives to determine as well, as for `ident.identify`; they need torques.

    Raises:
        ModelError: A joint does not exist, or is neither hinge nor slide; or the mechanism has none.
        InputError: Drives are to be determined from a wrench.
    """
    if sensors == "wrench" and drive != ():
        raise InputError("The wrench at the base contains no drives: --drive needs --sensors torque.")
    origin = mujoco_origin(mechanism)
    model, base = origin.model, origin.base
    kinds = {joint_name(model, j): model.jnt_type[j] for j in range(model.njnt)}
    joints = [joint for joint in mechanism.tree.joints if kinds.get(joint) in ONE_DOF]
    moving = _chosen(joints, mechanism.tree, names)
    check_torques(model, mechanism_bodies(model, base), ignore, moving)
    depending = _dependent(mechanism, names)
    moving = [joint for joint in moving if joint not in depending]
    rest = rest_coordinates(model, base)
    resting = {name: rest[name] for name in mechanism.tree.joints if name not in (*moving, *depending)}
    locked = mechanism.fixed(resting).closed(depending, moving)
    gravity = mechanism.gravity
    if base is not None and mechanism.base_rpy_deg is None:
        still = base_motion(model, base, model.qpos0[None], *np.zeros((2, 1, model.nv)))
        gravity = still.T[0, :3, :3].T @ gravity_of(model)
    locked = replace(locked, gravity=gravity)
    units = {joint: "m" if kinds[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad" for joint in joints}
    wrench = sensors == "wrench"
    parameters = find_base_parameters(locked, sensors=Sensors(base_wrench=wrench, joint_torques=not wrench))
    return DesignProblem(
        locked,
        mechanism,
        {joint: float(rest[joint][0]) for joint in joints},
        {joint: q for joint, q in (fix or {}).items() if len(q)},
        units,
        sensors,
        _whitening(model, base, {} if wrench else {joint: units[joint] for joint in moving}, noise),
        parameters,
        () if wrench else determined(locked, parameters, drive),
    )


def _dependent(mechanism: Mechanism, names: Sequence[str] | None) -> tuple[str, ...]:
    """Joints that loops move: those that no actuator drives, or without actuators those that are not named.

    Raises:
        ModelError: One is named.
    """
    loops = mechanism.in_loops
    driven = {joint for joint in loops if joint in mechanism.drives and mechanism.drives[joint].actuators}
    depending = mechanism.constraints.dependent(mechanism.tree, (), driven or names or ())
    if wrong := [joint for joint in names or () if joint in depending]:
        leads = [joint for joint in loops if joint not in depending]
        raise ModelError(
            f"Joint '{wrong[0]}' cannot be excited: loops make it depend on {', '.join(leads) or 'no joint'}. "
            f"Name {' '.join(leads) or 'others'} with --joints."
        )
    return depending


def _whitening(
    model: mujoco.MjModel, base: str | None, torques: Mapping[str, str], noise: tuple[float, float] | None
) -> np.ndarray:
    """Whitening of the noise on the torques of joints, given with their units, or on the base wrench without any."""
    force, moment = noise or NOISE
    if not torques:
        return np.diag(1 / np.repeat(noise, 3)) if noise else wrench_whitening(model, base, force, moment)
    stated = {} if noise else torque_noise(model)
    levels = {joint: force if unit == "m" else moment for joint, unit in torques.items()} | stated
    return np.diag([1 / levels[joint] for joint in torques])


def _chosen(joints: Sequence[str], tree: Tree, names: Sequence[str] | None) -> Sequence[str]:
    """Hinges and slides with the given names, in the tree's order."""
    if not joints:
        raise ModelError("Excitation needs a hinge or slide joint; this mechanism has none.")
    for name in names or ():
        if name not in joints:
            what = "is neither hinge nor slide" if name in tree.joints else "does not exist"
            raise ModelError(f"Joint '{name}' {what}; the joints to choose from are {', '.join(joints)}.")
    return [joint for joint in joints if names is None or joint in names]


def best(
    value: Cost,
    limits: Limits,
    starts: Sequence[FourierTrajectory],
    collisions: Collisions | None,
    iterations: int,
    seed: int,
) -> FourierTrajectory:
    """The best motion from several starts, and then from half as many near the best; prints progress to stderr.

    Collisions are only avoided for a motion that is better with them than the best one without so far. While no motion
    is found, the first start counts as the best.

    Args:
        value: Cost to minimize.
        limits: Joint limits.
        starts: Motions to start from.
        collisions: Bodies that must not touch; None for no checks.
        iterations: Largest number of iterations from each start.
        seed: Seed of the starts near the best.

    Raises:
        InputError: All motions collide.
    """
    if collisions is not None:
        check_starts(collisions, starts, limits)
    rng, near = np.random.default_rng([seed, 1]), len(starts) // 2
    lowest, chosen = np.inf, None
    for k in tqdm(range(len(starts) + near), desc="Starts", file=sys.stderr):
        start = starts[k] if k < len(starts) else nearby_start(chosen or starts[0], limits, rng)
        trajectory = design(value, limits, start, collisions=collisions, iterations=iterations, below=lowest)
        if trajectory is not None and (cost := _value_of(value, trajectory)) < lowest:
            lowest, chosen = cost, trajectory
    if chosen is None:
        assert collisions is not None
        raise InputError(f"No motion without collisions was found: {_collision(collisions, starts, limits)}.")
    return chosen


def _value_of(value: Cost, trajectory: FourierTrajectory) -> float:
    return value(*trajectory.states(np.linspace(0, trajectory.duration, 401)))[0]


def _collision(collisions: Collisions, starts: Sequence[FourierTrajectory], limits: Limits) -> str:
    """Names of the bodies that touch along the start with the fewest contacts."""
    time = np.linspace(0, starts[0].duration, 401)
    pairs = min((collisions.touching(scaled_into(s, limits).states(time)[0]) for s in starts), key=len)
    return _closer(collisions, list(pairs))


def check_starts(collisions: Collisions, starts: Sequence[FourierTrajectory], limits: Limits) -> None:
    """Checks before the search that no bodies touch in all postures.

    Raises:
        InputError: A pair touches in every posture of every start.
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
    """Random motions, the first one about the rest position (n,)."""
    rng = np.random.default_rng(seed)
    return [random_start(limits, duration, harmonics, rng, rest if k == 0 else None) for k in range(count)]

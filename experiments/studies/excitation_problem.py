"""The problem that an exciting motion is designed for: joints that move, measurements, drives, and criteria.

M = Σ Y_bᵀ C⁻¹ Y_b     information of a motion, C the covariance of the noise on a sample
σ = √diag M⁻¹          standard deviations of ψ by least squares, weighted by C
P = B S Bᵀ             prior covariance of ψ, S that of φ, and ψ = B φ the regrouping

Noise is white, and joint states are exact.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from experiments.data.paper import ACCELERATION, NOISE, VELOCITY
from ident.errors import InputError, ModelError
from ident.estimation.accumulator import separable
from ident.estimation.equations import Equations, usual_drives
from ident.estimation.samples import Samples
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model import regressor
from ident.model.axes import Axes, column_place, stated_values
from ident.model.regressor import base_wrench_regressor, drive_names, joint_torque_regressor, pulled_back
from ident.parameters.base_parameters import BaseParameters, find_base_parameters
from ident.parameters.prior import known_rows
from ident.parameters.structure import Sensors
from ident.tolerances import STRIBECK
from sim.models.couplings import check_torques
from sim.models.model_mechanism import mujoco_origin
from sim.models.mujoco_model import base_motion, gravity_of, mechanism_bodies, rest_coordinates
from sim.models.notes import joint_name
from sim.motion.excitation_design import Cost, States
from sim.simulation.readings import ONE_DOF, torque_noise, wrench_whitening

SLIP = 0.03
"""Velocity over which Coulomb friction changes its sign in a design, rad/s or m/s: a motion slower than that says
little of it on a real joint, and its derivatives exist."""


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
        ModelError: A joint does not exist, is neither hinge nor slide, or depends on others; or the mechanism has none.
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
    # Loops move the joints that no actuator drives, or without actuators those that are not named.
    driven = {*mechanism.in_loops} & {*mechanism.driven}
    depending = mechanism.constraints.dependent(mechanism.tree, (), driven or names or ())
    if wrong := [joint for joint in names or () if joint in depending]:
        leads = [joint for joint in mechanism.in_loops if joint not in depending]
        on = f"depend on {', '.join(leads)}. Name {' '.join(leads)} with --joints" if leads else "rest. Name others"
        raise ModelError(f"Joint '{wrong[0]}' cannot be excited: loops make it {on}, or leave some out with --ignore.")
    moving = [joint for joint in moving if joint not in depending]
    rest = rest_coordinates(model, base)
    resting = {name: rest[name] for name in mechanism.tree.joints if name not in (*moving, *depending)}
    locked = mechanism.fixed(resting).closed(depending, moving)
    if held := [joint for joint in moving if joint not in locked.tree.joints]:
        raise ModelError(
            f"Joint '{held[0]}' cannot be excited: loops hold it while {', '.join(resting)} rests. Name other joints "
            "with --joints, or leave constraints out with --ignore."
        )
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


def determined(mechanism: Mechanism, parameters: BaseParameters, drive: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the drives' columns that some motion separates from the base parameters.

    Args:
        mechanism: The mechanism of the joints that move.
        parameters: Its base parameters by torques.
        drive: Kinds of drives; None for `usual_drives`.
    """
    felt = tuple(range(len(mechanism.tree.freedoms)))
    names = usual_drives(mechanism, felt) if drive is None else drive_names(mechanism.tree, drive)
    channels = mechanism.tree.freedoms
    # Motions are not designed for drives of joints that loops move.
    names = tuple(name for name in names if column_place(name)[1] in channels)
    if not names:
        return ()
    equations = Equations(mechanism, parameters, torques=felt, channels=channels, drives=names)
    motion = random_motion(mechanism)
    return separable(equations, Samples(motion, np.zeros((len(motion), len(channels))))).drives


def drive_signals(mechanism: Mechanism, drives: Sequence[str], motion: Motion) -> np.ndarray:
    """Columns of drives (N, n, d)."""
    signals = regressor.drive_signals(
        mechanism.tree, Axes.of(mechanism.tree), motion.states, SLIP, mechanism.springrefs
    )
    out = np.zeros((*motion.dq.shape, len(drives)))
    for column, (kind, k) in enumerate(_places(mechanism, drives)):
        out[:, k, column] = signals[kind][:, k]
    return out


def drives_pulled_back(
    mechanism: Mechanism, drives: Sequence[str], motion: Motion, adjoints: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives by a motion, from derivatives by the columns of drives (N, n, d)."""
    q, dq, ddq = (np.zeros_like(x) for x in motion.states)
    sign, relative = np.tanh(motion.dq / SLIP), motion.dq / STRIBECK
    steep, low, one = (1 - sign**2) / SLIP, 1 / (1 + relative**2), np.ones_like(dq)
    slopes = {
        "rotor": (ddq, one),
        "viscous": (dq, one),
        "coulomb": (dq, steep),
        "stribeck": (dq, steep * low - sign * 2 * relative / STRIBECK * low**2),
        "spring": (q, one),
    }
    for column, (kind, k) in enumerate(_places(mechanism, drives)):
        by, slope = slopes[kind]
        by[:, k] += adjoints[:, k, column] * slope[:, k]
    return q, dq, ddq


def drive_deviations(mechanism: Mechanism, drives: Sequence[str]) -> np.ndarray:
    """Prior standard deviations of drives: those of the model's values, else a tenth of the links' torques (d,)."""
    motion = random_motion(mechanism)
    torques = joint_torque_regressor(mechanism.tree, *motion.states, gravity=mechanism.gravity) @ mechanism.known
    size, per = 0.1 * np.sqrt((torques**2).mean(axis=0)), {"rotor": ACCELERATION, "viscous": VELOCITY}
    usual = np.array([size[k] / per.get(kind, 1.0) for kind, k in _places(mechanism, drives)])
    stated = stated_values(mechanism, drives)
    return np.where(stated > 0, stated, usual)


def _places(mechanism: Mechanism, drives: Sequence[str]) -> list[tuple[str, int]]:
    """Kind, and index of the freedom, of each column."""
    freedoms = mechanism.tree.freedoms
    return [(kind, freedoms.index(freedom)) for kind, freedom in map(column_place, drives)]


def random_motion(mechanism: Mechanism) -> Motion:
    """200 random states at which columns are compared, with loops closed."""
    number = 200
    rng, tree = np.random.default_rng(0), mechanism.tree
    q, dq, ddq = rng.uniform(-1, 1, size=(3, number, len(tree.freedoms)))
    closed = tree.closure.drawn(rng, number) if tree.closure else {}
    for joint, x in closed.items():
        q[:, [tree.joints.index(joint)]] = x
    return Motion(q, dq, ddq)


def known_root(problem: DesignProblem) -> np.ndarray:
    """Root L of the prior covariance of ψ and drives, `P = Lᵀ L`; norms of its columns are standard deviations.

    Raises:
        ModelError: No body has a mass.
    """
    if problem.mechanism.prior is None:
        raise ModelError(
            "Deviations relative to what the model knows need a mass, and no body has one; choose --criterion "
            "determinant or condition."
        )
    root = np.linalg.qr(known_rows(problem.mechanism, problem.parameters))[1]
    if not problem.drives:
        return root
    return block_diag(root, np.diag(drive_deviations(problem.mechanism, problem.drives)))


def predicted_deviations(problem: DesignProblem, motion: Motion) -> np.ndarray:
    """Standard deviations σ of ψ and drives from a motion, by weighted least squares without a prior.

    Args:
        problem: The problem.
        motion: A sampled motion.

    Returns:
        σ in SI units (r + d,).
    """
    rows = (problem.whitening @ problem.regressor(*motion.states)).reshape(-1, len(problem.names))
    _, s, Vt = np.linalg.svd(rows, full_matrices=False)
    return np.linalg.norm(Vt.T / np.maximum(s, np.finfo(float).eps * s[0]), axis=1)


def quality(problem: DesignProblem, motion: Motion) -> dict[str, float]:
    """All criteria of a sampled motion by name; without masses, those relative to the prior are missing."""
    Y = problem.regressor(*motion.states)
    columns, weighted = (x.reshape(-1, Y.shape[2]) for x in (Y, problem.whitening @ Y))
    norms = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    s = np.linalg.svd(columns, compute_uv=False)
    relative = {}
    if problem.mechanism.prior is not None:
        logarithm, _ = _relative_deviation(weighted.T @ weighted, known_root(problem))
        relative = {"geometric_mean_of_relative_deviations": float(np.exp(logarithm))}
    return {
        "condition_number": _ratio(s),
        "condition_number_of_unit_columns": _ratio(np.linalg.svd(columns / norms, compute_uv=False)),
        **relative,
        "log_det_information": 2 * float(np.log(np.linalg.svd(weighted, compute_uv=False)).sum()),
        "smallest_singular_value": float(s[-1]),
    }


def cost(problem: DesignProblem, criterion: str, samples: int) -> Cost:
    """Cost of a criterion of `defaults.CRITERIA`, as a logarithm, with its derivatives with respect to a motion.

    Args:
        problem: The problem.
        criterion: `deviations`: the geometric mean of the standard deviations of ψ relative to the prior ones. The
            prior counts as one more measurement (Chaloner and Verdinelli, Bayesian experimental design, Stat. Sci.
            1995, doi:10.1214/ss/1177009939), so that bodies too small to be identified do not dominate the design.
            The mean of squares instead, the trace of A-optimality, is dominated by the worst-determined parameter:
            within the paper's limits it gets an eighth smaller, and the geometric mean an eighth larger.
            `determinant`: det M to the power of -1/2r, D-optimality. `condition`: the condition number of Y_b.
        samples: Number of samples N of the motion's recording.

    Raises:
        ModelError: No body has a mass, so that there is no prior.
    """
    W = problem.whitening if criterion != "condition" else np.eye(len(problem.whitening))
    L = known_root(problem) if criterion == "deviations" else None

    def logarithm(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> tuple[float, States]:
        # Columns first, as in the regressor's memory.
        Y = W @ problem.regressor(q, dq, ddq).T
        columns, each = Y.reshape(len(Y), -1), samples / len(q)
        M = each * columns @ columns.T
        value, by_M = _eigenvalues(M, criterion) if L is None else _relative_deviation(M, L)
        # M is quadratic in Y: δf = Σ by_M · δM = 2 Σ (W Y by_M) · W δY.
        adjoints = W.T @ (2 * each * by_M @ columns).reshape(Y.shape)
        return value, problem.pulled_back(Motion(q, dq, ddq), adjoints.T)

    return logarithm


def _eigenvalues(M: np.ndarray, criterion: str) -> tuple[float, np.ndarray]:
    """Logarithm of det M to the power of -1/2r, or of the root of its condition number, and the derivative by M."""
    s, V = np.linalg.eigh(M)
    weights = np.full(len(s), -1 / len(s)) / 2
    if criterion == "condition":
        weights = np.zeros(len(s))
        weights[[0, -1]] = weights[[0, -1]] + [-0.5, 0.5]
    rounding = 1e-14 * s[-1]
    visible = s > rounding
    by_s = weights * visible / np.where(visible, s, 1)
    # The others count as a fraction of the largest.
    by_s[-1] += weights[~visible].sum() / s[-1]
    return float(weights @ np.log(np.where(visible, s, rounding))), (V * by_s) @ V.T


def _relative_deviation(M: np.ndarray, L: np.ndarray) -> tuple[float, np.ndarray]:
    """Logarithm of the geometric mean of √(diag (M + P⁻¹)⁻¹ / diag P), and its derivative by the information M (r, r).

    P = Lᵀ L may be singular: (M + P⁻¹)⁻¹ = Lᵀ A⁻¹ L with A = 1 + L M Lᵀ, and a variance v = lᵀ A⁻¹ l with l a column of
    L changes by -lᵀ A⁻¹ L δM Lᵀ A⁻¹ l.
    """
    known = np.linalg.norm(L, axis=0)
    columns = L[:, known > 0] / known[known > 0]
    solved = cho_solve(cho_factor(np.eye(len(L)) + L @ M @ L.T), columns)
    variances = np.sum(columns * solved, axis=0)
    left = L.T @ solved
    return float(np.log(variances).mean()) / 2, -(left / variances) @ left.T / (2 * len(variances))


def _ratio(singular_values: np.ndarray) -> float:
    return float(singular_values[0] / max(singular_values[-1], np.finfo(float).tiny))

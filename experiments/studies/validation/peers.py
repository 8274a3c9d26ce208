"""Other software on the same logs, each as its documentation says and unattended (extra `peers`).

Plain least squares are for all recordings; FIGAROH and mujoco.sysid get angles and torques of the fitted part, and a
URDF; nimblephysics angles and plates of a person, and OpenSim's model. All are judged by motions from which the
trajectory estimate predicts, each channel by the best one of them, or by the software's own prediction if that is
better.
"""

import json
import re
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from experiments.studies.user_files import part_of
from ident.errors import InputError
from ident.estimate import Estimate
from ident.estimation.equations import Equations
from ident.estimation.preparation import Prepared, prepared
from ident.estimators.predictions import Candidate
from ident.files.limits import library
from ident.geometry.inertia import PINOCCHIO
from ident.identification import identified
from ident.mechanism.mechanism import Mechanism
from sim.models.model_mechanism import mechanism

PLAIN = "plain least squares"
"""Name of the ordinary least squares."""

UNLIMITED = '<limit lower="-1e3" upper="1e3" effort="1e6" velocity="1e6"/>'
"""Limits of a joint that has none."""

SHARE = 0.1
"""Cut-off of FIGAROH's low-pass over the sampling rate, as in its UR10 example; that of the first velocities of
simulations too."""

Values = Mapping[str, float]
"""Estimates of base parameters, drives and offsets, by the names of the estimate's columns."""


@dataclass(frozen=True)
class TorqueLog:
    """Angles and torques (N, n) at a rate in Hz."""

    rate: float
    q: np.ndarray
    torque: np.ndarray

    @classmethod
    def of(cls, log: Prepared, part: slice) -> "TorqueLog":
        """Part of a recording."""
        joints = log.mechanism.tree.joints
        q, torque = (log.recording.of_joints(joints, kind)[part] for kind in ("position", "torque"))
        return cls(log.recording.rate, q, torque)


@dataclass(frozen=True)
class Given:
    """Input for another software.

    Attributes:
        path: URDF file without shapes.
        equations: Equations whose parameters are compared.
        logs: The fitted logs.
        judged: What is predicted.
    """

    path: Path
    equations: Equations
    logs: Sequence[TorqueLog]
    judged: TorqueLog

    @property
    def arm(self) -> Mechanism:
        """The mechanism."""
        return self.equations.mechanism

    def values(self, phi: np.ndarray, drives: Values) -> Values:
        """Values of standard parameters (b, 10) and of drives and offsets by name."""
        out = np.array([drives.get(name, 0.0) for name in self.equations.names])
        out[: self.equations.parameters.rank] = self.equations.parameters.regroup(phi.ravel())
        for name, each in self.equations.absorbed.items():
            out[: len(each)] += drives.get(name, 0.0) * each
        return dict(zip(self.equations.names, out.tolist(), strict=True))


Answer = tuple[Values, Sequence[float]]
"""Values, and held-out residuals over signal by joint as the software itself states them, empty if it does not."""


def compared(
    model: Path, estimate: Estimate, judges: Sequence[Prepared], logs: Sequence[Sequence[Path]] = ()
) -> dict[str, Any]:
    """Held-out residuals over signal and CPU time, s, or why there are none, of each other software by name.

    Args:
        model: File of the model.
        estimate: The estimate.
        judges: Logs to judge by.
        logs: Files of each fitted log, of persons angles and plates.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        out = {PLAIN: _measured(estimate, lambda: (_plain(estimate), ())), **_of_arms(model, estimate, judges)}
        if model.suffix == ".osim":
            out["nimblephysics"] = _measured(estimate, partial(nimble, model, logs, estimate))
        return out


def _of_arms(model: Path, estimate: Estimate, judges: Sequence[Prepared]) -> dict[str, Any]:
    """The same of what takes a URDF file and the torques of all its joints."""
    arm, (first, *_) = estimate.prepared.mechanism, estimate.logs
    if model.suffix != ".urdf" or estimate.channels != arm.tree.joints or first.log.recording.servos:
        return {}
    equations = estimate.fit.equations.with_offsets(estimate.fit.equations.sensed)
    logs = [TorqueLog.of(part.log, part.samples) for part in estimate.logs]
    judged = (
        TorqueLog.of(judges[0], slice(None)) if judges else TorqueLog.of(first.log, slice(first.samples.stop, None))
    )
    shapes = r"<(visual|collision|transmission|gazebo)\b(?:[^>]*/>|.*?</\1>)"
    text, out = re.sub(shapes, "", model.read_text(encoding="utf-8"), flags=re.DOTALL), dict[str, Any]()
    # Pinocchio has two coordinates for a joint without limits.
    text = re.sub(r"(<joint\b[^>]*)continuous([^>]*>)", rf"\1revolute\2{UNLIMITED}", text)
    for name, peer in PEERS.items():
        with TemporaryDirectory() as scratch, redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            path = Path(scratch) / "model.urdf"
            path.write_text(text, encoding="utf-8")
            out[name] = _measured(estimate, partial(peer, Given(path, equations, logs, judged)))
    return out


def _measured(estimate: Estimate, peer: Callable[[], Answer]) -> dict[str, Any] | str:
    """Held-out residuals over signal and CPU time of a peer, or the sentence why there are none."""
    start = time.process_time()
    try:
        values, own = peer()
    except InputError as error:
        return str(error)
    seconds, held = time.process_time() - start, estimate.held_out
    equations = estimate.fit.equations.with_offsets(estimate.fit.equations.sensed)
    candidate = Candidate(equations, np.array([[values.get(name, 0.0) for name in equations.names]]))
    ratios = [held.ratio_of(candidate.residuals(each)[0]) for each in held.versions]
    ratios += [np.array(own)] if len(own) else []
    return {"ratios": np.min(ratios, axis=0).tolist(), "seconds": seconds}


def _plain(estimate: Estimate) -> Values:
    """Ordinary least squares of the fitted parts, with the cut-off that is chosen for each recording."""
    logs = [
        prepared(part.log.mechanism, part_of(part.log.recording, part.samples), cutoff="auto", drive=None)
        for part in estimate.logs
    ]
    fit = identified(logs, estimator="ordinary", holdout=0.0).fit
    return dict(zip(fit.names, fit.values.tolist(), strict=True))


def figaroh(task: Given) -> Answer:
    """FIGAROH: filtered angles, differences, and least squares of base parameters, from the longest log."""
    with library("peers", "It"):
        base = import_module("figaroh.identification.base_identification").BaseIdentification
        load_robot = import_module("figaroh.tools.load_robot").load_robot

    arm, joints, count = task.arm, task.arm.tree.joints, len(task.arm.tree.joints)
    log = max(task.logs, key=lambda log: len(log.q))
    none = [0.0] * count
    mechanics: dict[str, Any] = {"reduction_ratios": [1.0] * count, "actuator_inertias": none, "joint_offsets": none}
    mechanics["friction_coefficients"] = {"viscous": none, "static": none}
    components = dict.fromkeys(("friction", "joint_offset", "actuator_inertia"), True)
    identification = {
        "problem": {"use_joint_torques": True, "model_components": components},
        "coupling": {"has_coupled_wrist": False},
        "signal_processing": {"sampling_frequency": log.rate, "cutoff_frequency": SHARE * log.rate},
        "data": {"validation_data_file": "judged"},
    }
    properties = {"joints": {"active_joints": list(joints)}, "mechanics": mechanics}
    content = {"robot": {"name": "robot", "properties": properties}, "tasks": {"identification": identification}}
    config = task.path.with_name("config.yaml")
    # JSON is YAML.
    config.write_text(json.dumps(content), encoding="utf-8")

    class Identification(base):  # type: ignore[misc, valid-type]
        def load_trajectory_data(self, data_source: str | None = None) -> dict[str, Any]:
            of = task.judged if data_source else log
            raw = {"timestamps": np.arange(len(of.q)) / of.rate, "positions": of.q, "torques": of.torque}
            return raw | {"velocities": None, "accelerations": None}

    robot = load_robot(str(task.path))
    made = Identification(robot, str(config))
    at = [robot.model.joints[robot.model.getJointId(joint)].idx_q for joint in joints]
    made.identif_config |= {"act_idxq": at, "act_idxv": at}
    made.initialize()
    made.solve(plotting=False)
    active = list(made.active_parameters)
    value = {active[k]: float(x) for k, x in zip(made._base_indices, made.phi_base, strict=True)}
    names = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    phi = np.zeros((len(arm.bodies), 10))
    for body in (body for body in arm.tree.bodies if body.joint):
        phi[arm.bodies.index(body.name), PINOCCHIO] = [value.get(f"{name}_{body.joint}", 0.0) for name in names]
    kinds = {"fv": "Fv", "fs": "Fc", "Ia": "Ia", "off": "offset"}
    drives = {f"{own}({joint})": value.get(f"{kind}_{joint}", 0.0) for kind, own in kinds.items() for joint in joints}
    stated = made.result["validation_metrics"]["per_joint"]
    return task.values(phi, drives), [stated[joint]["nrmse"] for joint in joints]


def nimble(model: Path, logs: Sequence[Sequence[Path]], estimate: Estimate) -> Answer:
    """nimblephysics: bodies and angles of a person on plates, in the steps of AddBiomechanics, without markers."""
    try:
        if int(np.__version__.split(".")[0]) > 1:
            raise ImportError
        made = import_module("nimblephysics").biomechanics
    except ImportError:
        raise InputError(
            "It ends with a segmentation fault beside numpy 2, so it needs an environment of its own: "
            'pip install -e ".[nimble]", without constraints.txt, brings it and numpy 1.26.'
        ) from None

    skeleton = made.OpenSimParser.parseOsim(str(model), "", True).skeleton
    skeleton.setGravity([0.0, -9.81, 0.0])
    sensors = estimate.prepared.recording.sensors.values()
    feet = [skeleton.getBodyNode(body) for body in dict.fromkeys(sensor.body for sensor in sensors)]
    poses, plates, rates = [], [], []
    for part, (angles, forces) in zip(estimate.logs, logs, strict=True):
        motion, times = made.OpenSimParser.loadMot(skeleton, str(angles)), part.log.recording.time[part.samples]
        # A microsecond is for times that are rounded.
        at = slice(*np.searchsorted(motion.timestamps, times[[0, -1]] + [-1e-6, 1e-6]))
        poses.append(motion.poses[:, at])
        plates.append(made.OpenSimParser.loadGRF(str(forces), list(motion.timestamps[at])))
        rates.append(round(1 / float(np.median(np.diff(motion.timestamps)))))
    no_markers: list[list[dict[str, np.ndarray]]] = [[{}] * each.shape[1] for each in poses]
    fitter = made.DynamicsFitter(skeleton, feet, [])
    fitter.setSilenceOutput(True)
    fit = made.DynamicsFitter.createInitialization(skeleton, {}, [], feet, plates, poses, rates, no_markers)
    fitter.estimateFootGroundContactsWithHeightHeuristic(fit)
    fitter.addJointBoundSlack(skeleton, 0.1)
    fitter.smoothAccelerations(fit)
    fitter.timeSyncAndInitializePipeline(fit)
    # As AddBiomechanics has them.
    fitter.setIterationLimit(200)
    fitter.setLBFGSHistoryLength(20)
    problem = made.DynamicsFitProblemConfig(skeleton).setDefaults(True).setIncludePoses(True)
    fitter.runIPOPTOptimization(fit, problem.setIncludeMasses(True).setIncludeCOMs(True).setIncludeInertias(True))
    fitter.applyInitToSkeleton(skeleton, fit)
    with TemporaryDirectory() as scratch:
        path = Path(scratch) / model.name
        made.OpenSimParser.replaceOsimInertia(str(model), skeleton, str(path))
        equations = replace(estimate.fit.equations, mechanism=mechanism(path))
    return dict(zip(equations.names, equations.from_model.tolist(), strict=True)), ()


def sysid(task: Given) -> Answer:
    """mujoco.sysid: bodies and drives with which simulations under the recorded torques follow the angles."""
    import mujoco

    with library("peers", "It"):
        import_module("absl")
    sysid = import_module("mujoco.sysid")

    joints, log = task.arm.tree.joints, task.logs[0]
    spec = _simulated(mujoco.MjSpec.from_file(str(task.path)), joints, log.rate)
    model, parameters = spec.compile(), sysid.ParameterDict()
    for name in (model.body(k).name for k in range(1, model.nbody) if model.body_weldid[k] and model.body_mass[k]):

        def bodily(spec: Any, parameter: Any, name: str = name) -> None:
            sysid.apply_body_inertia(spec, name, parameter)
            # MuJoCo 4.0 refuses the undefined axes that this leaves.
            spec.body(name).iquat = [1, 0, 0, 0]

        parameters.add(sysid.body_inertia_param(spec, model, name, sysid.InertiaType.Pseudo, modifier=bodily))
    size = np.concatenate([log.torque for log in task.logs]).std(axis=0)
    kinds = {"frictionloss": "Fc", "damping": "Fv", "armature": "Ia"}
    names = {f"{joint}_{kind}": f"{own}({joint})" for joint in joints for kind, own in kinds.items()}
    for name, most in zip(names, np.repeat(size, len(kinds)).tolist(), strict=True):

        def driven(spec: Any, parameter: Any, name: str = name) -> None:
            joint, kind = name.rsplit("_", 1)
            own, value = spec.joint(joint), float(parameter.value[0])
            # MuJoCo 4 has damping of three powers of the rate.
            setattr(own, kind, [value, 0, 0] if np.size(getattr(own, kind)) == 3 else value)

        parameters.add(sysid.Parameter(name, 0.1 * most, 0.0, 10 * most, modifier=driven))
    parts = [part for log in task.logs for part in _windows(log)]
    times = [np.arange(len(part.q)) / part.rate for part, _ in parts]
    sequences = sysid.ModelSequences(
        "robot",
        spec,
        [str(k) for k in range(len(parts))],
        [sysid.create_initial_state(model, part.q[0], rates, np.zeros(0)) for part, rates in parts],
        [sysid.TimeSeries(t, part.torque) for t, (part, _) in zip(times, parts, strict=True)],
        [sysid.TimeSeries.from_names(t, part.q, model) for t, (part, _) in zip(times, parts, strict=True)],
    )
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    # Each iteration takes a simulation of every piece for every parameter.
    optimal, _ = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False, max_iters=20)
    sysid.apply_param_modifiers_spec(optimal, spec)
    task.path.with_suffix(".xml").write_text(spec.to_xml(), encoding="utf-8")
    made = mechanism(spec)
    own = dict(zip(made.bodies, made.known.reshape(-1, 10), strict=True))
    phi = np.array([own.get(name, np.zeros(10)) for name in task.arm.bodies])
    return task.values(phi, {own: float(optimal[name].value[0]) for name, own in names.items()}), ()


def _simulated(spec: Any, joints: Sequence[str], rate: float) -> Any:
    """Specification with a motor and an encoder at every joint, without contacts, at a whole fraction of the rate.

    Steps are at most MuJoCo's default of 2 ms.
    """
    import mujoco

    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.timestep = 1 / rate / np.ceil(1 / rate / 0.002)
    for joint in joints:
        spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        kinds = {"type": mujoco.mjtSensor.mjSENS_JOINTPOS, "objtype": mujoco.mjtObj.mjOBJ_JOINT}
        spec.add_sensor(name=f"{joint}_pos", objname=joint, **kinds)
    # A specification from a URDF has no inertias that can be changed.
    spec.compile()
    return mujoco.MjSpec.from_string(spec.to_xml())


def _windows(log: TorqueLog) -> list[tuple[TorqueLog, np.ndarray]]:
    """Pieces of a log, and their first velocities (n,).

    In half a second errors of joints without a restoring force do not add up.
    """
    smooth = sosfiltfilt(butter(4, 2 * SHARE, output="sos"), log.q, axis=0)
    rates, size = np.gradient(smooth, 1 / log.rate, axis=0), round(0.5 * log.rate)
    starts = range(0, len(log.q) - size, size)
    return [(replace(log, q=log.q[k : k + size], torque=log.torque[k : k + size]), rates[k]) for k in starts]


PEERS: dict[str, Callable[[Given], Answer]] = {"FIGAROH": figaroh, "mujoco.sysid": sysid}
"""All of them by name."""

"""Wrong arguments, each refused in one sentence."""

import argparse
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mechanisms import GRAVITY, double_pendulum, random_states
from recorded_faults import PENDULUM, faulty, shortened

import ident
import scenes
from experiments.cli import options
from ident.estimation.sources import in_order
from ident.geometry import se3
from ident.mechanism.body import BASE, Body, ball_twist
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.recovered_axes import estimate_screw, recover_axes
from ident.mechanism.tree import Tree
from ident.model.adjoint import pulled_back
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.prior import body_covariance, known_covariances
from ident.recordings.recording import Recording
from ident.recordings.wrench import total_wrench
from ident.trajectory.algebra.banded import WINDOW, Banded
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.motion.excitation_design import basis
from sim.simulation.simulate import simulate, simulate_many

TREE = double_pendulum()
STATES = random_states(np.random.default_rng(0), TREE, 3)
ONE = BaseMotion(np.eye(4)[None], np.zeros((1, 6)), np.zeros((1, 6)))
SAMPLES = np.arange(3.0)
POINT = Body("a", BASE, np.eye(4), np.zeros(6))
HINGE = Body("a", BASE, np.eye(4), np.eye(6)[3], "elbow")
SLIDE = Tree((Body("slide", BASE, np.eye(4), np.eye(6)[0], "rail"),))
BALL = Tree((Body("arm", BASE, np.eye(4), ball_twist(np.zeros(3)), "shoulder"),))
STILL = Mechanism(TREE, np.zeros(3))
ONE_JOINT = replace(DOUBLE_PENDULUM, offset=[0.0], amplitude=[[1.0]], frequency=[[1.0]], phase=[[0.0]])


def pendulum():
    return scenes.load("double_pendulum")


def of_another_body():
    spec = pendulum()
    sensor = spec.sensor("joint1_acceleration")
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_BODY, "link1"
    return spec


def pieces(path):
    path.write_text("time\n0\n")
    return next(Recording.chunks(path, 0))


def ahead():
    with ThreadPoolExecutor(1) as executor:
        list(in_order(executor, str, [1], ahead=0))


def indefinite():
    matrix = Banded(WINDOW, 1, WINDOW)
    matrix.add(0, -np.ones((1, WINDOW, 1, WINDOW, 1)), np.arange(1))
    matrix.factored()


def regressor(tree, *states, **given):
    return base_wrench_regressor(tree, *states, gravity=GRAVITY, **given)


WRONG = {
    "at least one body": lambda _: Tree(()),
    r"parent index from -1 to 0, got 1": lambda _: Tree((POINT, replace(POINT, name="b", parent=1))),
    r"Parents come before their children, got \(1, -1\)": lambda _: Tree.from_home_poses(
        "ab", np.stack([np.eye(4)] * 2), np.zeros((2, 6)), [1, -1]
    ),
    "for every body; 'a' occurs twice": lambda _: Tree((POINT, POINT)),
    "for every joint; 'elbow' occurs twice": lambda _: Tree((HINGE, replace(HINGE, name="b"))),
    "ball joint 'elbow' has a rotation 'elbow.x', and another joint": lambda _: Tree(
        (Body("a", BASE, np.eye(4), ball_twist(np.zeros(3)), "elbow"), replace(HINGE, name="b", joint="elbow.x"))
    ),
    "at least 10 finite poses, got 3": lambda _: estimate_screw(se3.exp(np.eye(6)[3], SAMPLES), np.eye(3)[0]),
    "'rail' slides": lambda _: recover_axes(SLIDE, np.tile(np.eye(4), (20, 1, 1, 1))),
    "'shoulder' needs quaternions; that of sample 1 is zero": lambda _: regressor(
        BALL, np.array([[1.0, 0, 0, 0], [0, 0, 0, 0]]), *np.zeros((2, 2, 3))
    ),
    "3 joint states need as many samples of the base's motion": lambda _: regressor(TREE, *STATES, base=ONE),
    "has columns 0 to 29, not 60": lambda _: regressor(TREE, *STATES, columns=[3, 60]),
    r"adjoints of shape \(3, 6, 2\) are needed": lambda _: pulled_back(STILL, Motion(*STATES), [0, 1], np.ones(3)),
    "finite numbers that are not all zero": lambda _: find_base_parameters(np.zeros((5, 6, 30))),
    "30 columns needs as many names, got 2": lambda _: find_base_parameters(regressor(TREE, *STATES), ["a", "b"]),
    "total wrench needs finite joint states": lambda _: total_wrench(TREE, np.full((4, 2), np.nan), None, []),
    r"4 joint states need poses of a moving base, got shape \(3, 4, 4\)": lambda _: total_wrench(
        TREE, np.zeros((4, 2)), None, [], base=np.tile(np.eye(4), (3, 1, 1))
    ),
    "no true values": lambda _: Recording(SAMPLES, {"a": SAMPLES}).noise_free,
    "The stream 'a' needs 1 components, got 3": lambda _: Recording(
        SAMPLES, {"a": SAMPLES}, streams={"a": (SAMPLES, np.ones((3, 3)))}
    ),
    "needs at least one sample, got 0": lambda path: pieces(path / "r.csv"),
    "submitted ahead, got 0": lambda _: ahead(),
    "not positive definite": lambda _: indefinite(),
    "'tail', which is none of": lambda _: replace(STILL, prior_known={"tail": {"mass": 0.1}}),
    "'triple'; the scenes are double_pendulum": lambda _: scenes.load("triple"),
    "'humanoid' has neither tilt nor contact to choose": lambda _: scenes.load("humanoid", tilt_deg=5),
    "at least 2 harmonics, got 1": lambda _: basis(1.0, 1, np.zeros(1)),
    "at least one thread, got 0": lambda _: simulate_many(pendulum(), DOUBLE_PENDULUM, seeds=[1], threads=0),
    "1 joints needs as many position servos": lambda _: simulate(pendulum(), ONE_JOINT, samples=1),
    "must report one number of a hinge": lambda _: simulate(of_another_body(), DOUBLE_PENDULUM, samples=1),
    "where it stands, got knee high": lambda _: options.fixed([["knee", "high"]]),
    "--drive takes auto alone": lambda _: options.drives(["auto", "viscous"]),
    "needs a whole number of at least 1, got 'x'": lambda _: options.whole_number(1)("x"),
    "estimate filters nothing": lambda _: ident.identify(STILL, {"time": SAMPLES}, estimator="joint", cutoff=5.0),
}


@pytest.mark.parametrize(("message", "call"), WRONG.items(), ids=WRONG.keys())
def test_a_wrong_argument_is_one_sentence(tmp_path, message, call):
    with pytest.raises((ValueError, argparse.ArgumentTypeError, np.linalg.LinAlgError), match=message) as error:
        call(tmp_path)
    assert "\n" not in str(error.value)


RECORDING = shortened(faulty(0), 120)
DEVIATION, NAMED = "needs a standard deviation, zero or false, got", "needs standard deviations by name"
OF_RECORDING = "needs a Recording, the path of a log, .* or a list; got"
BODY = PENDULUM.bodies[0]
WRONG_DEVIATIONS = [
    *(({"mass": x}, f"mass {DEVIATION} ") for x in ("a lot", -0.1, np.nan, np.inf, None, True, [0.1])),
    ({"weight": 0.1}, "has no entry 'weight'; valid are mass, center, inertia"),
    *((x, f"{NAMED}, out of mass, center, inertia; got") for x in ("mass", 3, ["mass"])),
]
OF_DRIVES, OF_OWN = "^drive needs a list out of rotor, .*; got", "^own needs a list out of offset, .*, delay, lag; got"
WRONG_ARGUMENTS = [
    *(({"known": known}, f"^known.?{message}") for known, message in WRONG_DEVIATIONS),
    ({"setup": {"late": 0.1}}, "^setup has no entry 'late'; valid are delay, lag, clock, origin"),
    *(({"setup": {"delay": x}}, f"^setup.delay {DEVIATION} ") for x in (np.nan, -1, np.inf, "long", None)),
    *(({"setup": x}, f"^setup {NAMED}") for x in ("delay", 0)),
    *(({"holdout": x}, "^holdout needs a fraction") for x in (-0.1, 1, 1.5, np.nan, "0.4", None, True)),
    *(
        ({"drive": x}, f"{OF_DRIVES} {named}")
        for x, named in ((["coulomb", "stiction"], "stiction"), ("coulomb", "coulomb"), (1, "1"))
    ),
    *(({"own": x}, f"{OF_OWN} {x}") for x in ("delay", None)),
    ({"held_out": None}, f"^held_out {OF_RECORDING} None"),
    ({"held_out": ["run.csv"]}, r"^run\.csv: there is no such file"),
    ({"recording": 3}, f"^recording {OF_RECORDING} 3"),
    ({"recording": replace(RECORDING, setup={"delay": -1})}, f"setup.delay {DEVIATION}"),
    ({"recording": replace(RECORDING, known={"mass": np.nan})}, f"known.mass {DEVIATION}"),
]


@pytest.mark.parametrize(("given", "message"), WRONG_ARGUMENTS)
def test_arguments_are_refused_in_one_sentence(given, message):
    with pytest.raises(ident.InputError, match=message):
        ident.identify(PENDULUM, **{"recording": RECORDING, **given})


@pytest.mark.parametrize(("known", "message"), WRONG_DEVIATIONS)
def test_how_well_bodies_are_known_is_checked(known, message):
    with pytest.raises(ident.ModelError, match=f"^prior_known of '{BODY}'.?{message}"):
        replace(PENDULUM, prior_known={BODY: known})
    for of_mechanism in (body_covariance, known_covariances):
        what = PENDULUM if of_mechanism is known_covariances else PENDULUM.known[:10]
        with pytest.raises(ident.InputError, match=f"^known.?{message}"):
            of_mechanism(what, known)


@pytest.mark.parametrize("known", ["mass", 3, None])
def test_bodies_are_known_by_their_names(known):
    with pytest.raises(ident.ModelError, match="prior_known needs standard deviations by the bodies' names"):
        replace(PENDULUM, prior_known=known)

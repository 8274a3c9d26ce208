"""Wrong arguments and mistaken calls of every front door, each refused in one sentence."""

import argparse
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import driven_arm
import mujoco
import numpy as np
import pytest
from commands import sentence_of
from mechanisms import GRAVITY, double_pendulum, random_states, random_tree
from recorded_faults import PENDULUM, faulty, shortened

import ident
import multicontact as mc
import scenes
from experiments.cli import options
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.estimation.sources import in_order
from ident.geometry import se3
from ident.geometry.inertia import com_from_parameters
from ident.mechanism.body import BASE, Body, ball_twist
from ident.mechanism.dh import Frame, tree_from_mdh
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.recovered_axes import estimate_screw, recover_axes
from ident.mechanism.tree import Tree
from ident.model.adjoint import pulled_back
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.person_prior import Person
from ident.parameters.prior import body_covariance, known_covariances
from ident.parameters.structure import Sensors
from ident.recordings.recording import Recording
from ident.recordings.smoothing import chosen_cutoff, differences, low_pass
from ident.recordings.wrench import Wrench, total_wrench
from ident.regression.ordinary import least_squares
from ident.trajectory.algebra.banded import WINDOW, Banded
from sim.models.mujoco_model import parameters_from_model
from sim.motion.excitation import DOUBLE_PENDULUM, Trapezoids
from sim.motion.excitation_design import FourierTrajectory, basis
from sim.simulation.contacts import fall
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
ACROSS, SHAPES = double_pendulum((0, 1, 0), (0, 1, 0)), ((5, 2), (4, 2), (5, 2))
GHOST = '<body name="ghost"><site/></body><body name="rock"><geom size="1"/></body>'
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


def body(**change):
    return Body(**{"name": "arm", "parent": BASE, "home": np.eye(4), "twist": np.zeros(6), **change})


def moving(**change):
    rests = {"T": np.tile(np.eye(4), (3, 1, 1)), "V": np.zeros((3, 6)), "dV": np.zeros((3, 6))}
    return BaseMotion(**rests | change)


def followers(first, second):
    """A table of two joints that follow others, with a fixed frame between them."""
    last = Frame("2", "fixed", "prismatic", follows=second)
    return tree_from_mdh([Frame("1", None, "revolute", follows=first), Frame("fixed", "1", "fixed"), last])


def excited(**change):
    return replace(DOUBLE_PENDULUM, **change)


def series(duration=1.0, center=(0.0,), coefficients=((1.0, 2.0),)):
    return FourierTrajectory(duration, center, coefficients)


def in_contact(**contact):
    """Total wrench of three bodies with a contact on one of them."""
    touch = Wrench(**{"values": np.zeros((4, 6)), "body": "b1", **contact})
    return total_wrench(CHAIN, np.zeros((4, len(CHAIN.moving))), Wrench(np.zeros((4, 6)), time=np.arange(4.0)), [touch])


def on_ground(**ground):
    touch = Wrench(**{"values": np.zeros((4, 6)), **ground})
    return total_wrench(CHAIN, np.zeros((4, len(CHAIN.moving))), touch, [])


def streams(*channels, **options):
    return Recording.from_streams(dict(channels), **options)


def compiled(bodies):
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")


def not_finite():
    model = compiled('<body name="a"><geom size="1"/></body>')
    model.body_inertia[1, 2] = np.nan
    return parameters_from_model(model)


def tilted(tilt, azimuth=0):
    return scenes.load("double_pendulum", tilt_deg=tilt, azimuth_deg=azimuth)


def falling(seconds, rate=100):
    return fall(scenes.load("humanoid").compile(), "pelvis", seconds=seconds, rate=rate)


def weighed(covariance):
    wrench = np.zeros((3, 6))
    return least_squares(Equations.of_wrench(STILL), Samples(Motion(*STATES), wrench, covariance))


CLOCK = np.arange(40) / 100
CHAIN = random_tree(np.random.default_rng(0), 3)
WELDED = random_tree(np.random.default_rng(0), 3, kinds=("welded",))
RANDOM = np.random.default_rng(0).normal(size=(500, 1))
WAVE = np.sin(2 * np.pi * 30 * np.arange(1200) / 100)
SQUARE, ROWS = np.eye(6), r"rows \(k, 6\)"
REFUSED = [
    # Bodies, trees and motions of a base.
    ("'arm'.*rigid home pose", lambda: body(home=np.diag([2.0, 1, 1, 1]))),
    ("'arm'.*rigid home pose", lambda: body(home=np.full((4, 4), np.nan))),
    ("'arm'.*4×4", lambda: body(home=np.eye(3))),
    ("'arm'.*joint twist", lambda: body(twist=np.array([0, 0, 0, 0, 0, 2.0]))),
    ("'arm'.*joint twist", lambda: body(twist=np.zeros(5))),
    ("'arm'.*joint twist", lambda: body(twist=np.full(6, np.nan))),
    (r"coordinates \(N, 7\).* got \(3, 6\), \(3, 6\) and", lambda: BaseMotion.from_free_joint(*np.ones((3, 3, 6)))),
    (r"T \(N, 4, 4\), V \(N, 6\) and dV \(N, 6\), got V \(2, 6\)", lambda: moving(V=np.zeros((2, 6)))),
    ("finite", lambda: moving(dV=np.full((3, 6), np.nan))),
    ("rigid poses", lambda: moving(T=np.zeros((3, 4, 4)))),
    (r"Row 1 \(frame '1'\) .*out of revolute, prismatic, fixed, got", lambda: tree_from_mdh([Frame("1", None, "x")])),
    ("Row 2 gives frame '1' a second time", lambda: tree_from_mdh(2 * [Frame("1", None, "fixed")])),
    (r"Row 1 .*parent from a row before it \(none but", lambda: tree_from_mdh([Frame("1", "2", "fixed")])),
    (r"before it \(1\), got '9'", lambda: tree_from_mdh([Frame("1", None, "fixed"), Frame("2", "9", "fixed")])),
    (r"Row 1 .* has follows without a joint", lambda: tree_from_mdh([Frame("1", None, "fixed", follows={"1": 1.0})])),
    (r"Row 1 .* constant without follows", lambda: tree_from_mdh([Frame("1", None, "revolute", constant=0.3)])),
    (r"Frame '1' needs to follow joints out of 2, got '1'\.", lambda: followers({"1": 1.0}, {})),
    (r"Frame '1' needs to follow joints out of 2, got 'fixed'\.", lambda: followers({"fixed": 1.0}, {})),
    (r"The frames 1, 2 follow each other; one of them needs a", lambda: followers({"2": 1.0}, {"1": 1.0})),
    ("Joint 'link1'", lambda: recover_axes(TREE, TREE.poses(np.zeros((20, 2))))),
    (
        "'link1': The axis is perpendicular",
        lambda: recover_axes(TREE, ACROSS.poses(np.outer(np.arange(40) / 20, [1, 2]))),
    ),
    # Parameters and wrenches.
    ("zero mass", lambda: com_from_parameters(np.zeros(10))),
    ("A mechanism needs mass; ghost have none", lambda: parameters_from_model(compiled(GHOST), "ghost")),
    ("Body 'a' needs a finite mass, centre of mass and inertia", not_finite),
    ("one of winter, deleva, dumas, got 'vitruvius'", lambda: Person("vitruvius", 70, 1.7, "male")),
    ("one of female, male, got 'm'", lambda: Person("dumas", 70, 1.7, "m")),
    ("a height in m, got 70 and 175", lambda: Person("dumas", 70, 175, "male")),
    ("got 70 and nan", lambda: Person("dumas", 70, np.nan, "male")),
    ("see no parameter of this mechanism", lambda: find_base_parameters(WELDED, sensors=Sensors(False, True))),
    ("massless bodies has no parameters", lambda: find_base_parameters(Tree((replace(POINT, massless=True),)))),
    ("base wrench, joint torques, or both", lambda: Sensors(False, False)),
    *(
        (ROWS, partial(Sensors, channels=x))
        for x in (np.eye(5), np.zeros((1, 6)), SQUARE * np.nan, SQUARE[:0], SQUARE[0])
    ),
    (ROWS, lambda: Sensors(False, True, channels=SQUARE)),
    (r"shapes \(N, 2\), .* got \(5, 2\), \(4, 2\) and \(5, 2\)", lambda: regressor(TREE, *map(np.zeros, SHAPES))),
    *(
        (r"covariance.* (positive definite|symmetric|shape)", partial(weighed, x))
        for x in (np.zeros((6, 6)), np.triu(np.ones((6, 6))), np.eye(5))
    ),
    ("on 'hand', but the mechanism's bodies are b0, b1, b2", lambda: in_contact(body="hand")),
    ("on 'None', but the mechanism's bodies are b0, b1, b2", lambda: in_contact(body=None)),
    (r"'b1' needs the pose of its sensor's frame.*got none", lambda: in_contact(pose=None)),
    (r"frame, \(4, 4\) or \(4, 4, 4\), got \(3, 3\)", lambda: in_contact(pose=np.eye(3))),
    ("'b1' needs the pose of its sensor's frame", lambda: in_contact(pose=2 * np.eye(4))),
    ("'b1' needs the pose of its sensor's frame", lambda: in_contact(pose=np.eye(4) * np.nan)),
    ("'b1' needs 4 samples like the joint states, got 3", lambda: in_contact(values=np.zeros((3, 6)))),
    (
        r"'b1' needs wrenches \(N, 6\), each .* throughout, got shape \(4, 5\)",
        lambda: in_contact(values=np.zeros((4, 5))),
    ),
    ("'b1' needs wrenches .* finite or NaN throughout", lambda: in_contact(values=np.where(np.eye(4, 6), np.inf, 0))),
    ("'b1' needs wrenches .* finite or NaN throughout", lambda: in_contact(values=np.where(np.eye(4, 6), np.nan, 0))),
    ("'b1' needs all six components; only the ground's", lambda: in_contact(values=np.full((4, 6), np.nan))),
    (r"'b1' needs a symmetric covariance \(6, 6\), got shape \(3, 3\)", lambda: in_contact(covariance=np.eye(3))),
    ("'b1' needs a symmetric covariance", lambda: in_contact(covariance=np.triu(np.ones((6, 6))))),
    ("sample times; they differ by up to 0.5 s, most at sample 2", lambda: in_contact(time=np.array([0, 1, 2.5, 3]))),
    ("'b1' needs the other wrenches' sample times", lambda: in_contact(time=np.full(4, np.nan))),
    (r"'b1' needs 4 sample times, got shape \(9,\)", lambda: in_contact(time=np.arange(9.0))),
    ("'b1' needs a frame out of body, world, for the ground 'body', got 'lab'", lambda: in_contact(frame="lab")),
    (r"4 joint states need ground wrenches \(4, 6\), got \(3, 6\)", lambda: on_ground(values=np.zeros((3, 6)))),
    (r"ground wrench needs 4 sample times, got shape \(3,\)", lambda: on_ground(time=np.arange(3.0))),
    ("ground wrench needs a frame out of body, world, for the ground 'body'", lambda: on_ground(frame="world")),
    (r"ground wrench needs a symmetric covariance \(6, 6\), got", lambda: on_ground(covariance=np.eye(3))),
    # Recordings and signals.
    (
        r"times \(N,\) and values \(N,\) or \(N, d\), got \(40,\) and \(39,\)",
        lambda: streams(("a", (CLOCK, CLOCK[1:]))),
    ),
    ("stream 'a' needs times", lambda: streams(("a", (CLOCK[:0], CLOCK[:0])))),
    ("stream 'a' needs a pair of times and values", lambda: streams(("a", CLOCK))),
    ("stream 'a' needs a pair of times and values", lambda: streams(("a", (CLOCK, ["x"] * 40)))),
    ("times of the stream 'a' must increase; sample 1 does not", lambda: streams(("a", (CLOCK[::-1], CLOCK)))),
    (
        "times of the stream 'a' need finite numbers",
        lambda: streams(("a", (np.where(CLOCK > 0.2, np.nan, CLOCK), CLOCK))),
    ),
    (
        "stream 'a' needs numbers, NaN for a missing",
        lambda: streams(("a", (CLOCK, np.where(CLOCK > 0.2, np.inf, CLOCK)))),
    ),
    (r"rigid poses \(N, 16\), .* got shape \(40, 3\)", lambda: streams(("base:pose", (CLOCK, np.ones((40, 3)))))),
    ("needs rigid poses", lambda: streams(("base:pose", (CLOCK, np.ones((40, 16)))))),
    ("Streams without joint positions need a rate", lambda: streams(("a", (CLOCK, CLOCK)))),
    (r"need a positive rate in Hz .*, got -1\.0", lambda: streams(("a", (CLOCK, CLOCK)), rate=-1.0)),
    ("Streams need samples", lambda: streams(("a", (CLOCK, CLOCK * np.nan)), rate=10.0)),
    (
        "that all of them cover; 'b' begins at 1 s",
        lambda: streams(("a_position", (CLOCK, CLOCK)), ("b", (CLOCK + 1, CLOCK))),
    ),
    ("must increase; sample 2 does not", lambda: Recording([0.0, 1, 1], {})),
    ("'time' needs finite numbers; sample 1 is nan", lambda: Recording([0.0, np.nan], {})),
    ("'time' needs N > 0 samples", lambda: Recording([[0.0, 1]], {})),
    (r"'a' needs 2 samples along its first axis, got shape \(3,\)", lambda: Recording([0.0, 1], {"a": [1.0, 2, 3]})),
    ("'a' needs finite numbers; sample 1 is inf", lambda: Recording([0.0, 1], {"a": [[1.0, 2], [3, np.inf]]})),
    ("'a' needs finite numbers; sample 0 is nan", lambda: Recording([0.0, 1], {"a": [[1.0, np.nan], [3, 4]]})),
    ("times need finite numbers", lambda: Recording([np.nan, np.nan], {})),
    ("at least 50 samples, got 40", lambda: chosen_cutoff(np.zeros((40, 2)), 100.0)),
    ("a column that moves below 10 Hz", lambda: chosen_cutoff(np.ones((100, 2)), 100.0)),
    ("a column that moves below 10 Hz", lambda: chosen_cutoff(WAVE, 100.0)),
    ("not noise alone; state a cut-off", lambda: chosen_cutoff(RANDOM, 100.0)),
    ("from 0.001 Hz to below half the rate, 50 Hz, got 50 Hz", lambda: low_pass(WAVE, 100.0, 50.0)),
    ("from 0.001 Hz to below half the rate, 50 Hz, got 1e-09 Hz", lambda: low_pass(WAVE, 100.0, 1e-9)),
    ("got 0 Hz", lambda: low_pass(WAVE, 100.0, 0.0)),
    ("got nan Hz", lambda: low_pass(WAVE, 100.0, np.nan)),
    ("more than 9 samples, got 9", lambda: low_pass(WAVE[:9], 100.0, 3.0)),
    ("at least 5 samples, got 4", lambda: differences(WAVE[:4], 100.0)),
    # Scenes, excitations and simulations.
    *(("from 0° to below 90°", partial(tilted, *x)) for x in ((-1,), (90,), (np.nan,), (5, np.inf))),
    ("at least one sample, got 0 s at 100 Hz", lambda: falling(0)),
    ("at least one sample, got inf s at 100 Hz", lambda: falling(np.inf)),
    (r"timestep of 0.001 s must divide 0.0033\d* s", lambda: falling(1, 300)),
    (r"timestep of 0.001 s must divide 0.0005 s", lambda: falling(1, 2000)),
    ("needs 1 to 1000000 samples, got 0", lambda: simulated(samples=0)),
    ("from 0 to 1000, got -1", lambda: simulated(noise_scale=-1)),
    ("from 0 to 1000, got nan", lambda: simulated(noise_scale=np.nan)),
    (r"shapes \(1,\), \(2, 2\)", lambda: excited(offset=[0.0])),
    (r"and \(2, 1\)", lambda: excited(phase=[[0.0], [0.0]])),
    ("positive frequencies", lambda: excited(frequency=[[0.0, 1], [1, 1]])),
    ("zero or more, got -1.0", lambda: excited(noise=-1.0)),
    ("zero or more", lambda: excited(noise=np.nan)),
    (r"got shapes \(1, 2\), \(1, 1\) and \(1, 3\)", lambda: Trapezoids([[0, 1]], [[1]], [[0, 1, 2]])),
    ("goals", lambda: Trapezoids([[0, 1]], [[1, 1]], [[0, 1]])),
    ("finite numbers", lambda: Trapezoids([[0, 1]], [[1, np.nan]], [[0, 1, 2]])),
    ("to end before the next one", lambda: Trapezoids([[0, 1]], [[1.5, 1]], [[0, 1, 2]])),
    ("take some time", lambda: Trapezoids([[0, 1]], [[0, 1]], [[0, 1, 2]])),
    (r"shapes \(1,\) and \(1, 3\)", lambda: series(coefficients=[[1.0, 2, 3]])),
    (r"shapes \(1,\) and \(2, 0\)", lambda: series(coefficients=[[], []])),
    (r"shapes \(2,\) and \(1, 2\)", lambda: series(center=[0.0, 1])),
    ("finite numbers", lambda: series(center=[np.nan])),
    ("positive duration, got 0.0 s", lambda: series(0.0)),
    ("positive duration", lambda: series(np.inf)),
]


@pytest.mark.parametrize(("message", "call"), REFUSED, ids=[message for message, _ in REFUSED])
def test_bad_input_is_one_sentence(message, call):
    with pytest.raises(mc.InputError, match=message) as error:
        call()
    assert "\n" not in str(error.value).partition("got [[")[0]


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
OF_DRIVES = "^drive needs a list out of rotor, .*; got"
OF_OWN = "^own needs a list out of offset, .*, delay, lag, tracker_delay; got"
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


T, Q = np.arange(100) / 100, np.zeros((5, 3))
ARM, LOG, SPEC = driven_arm.mechanism(), driven_arm.log(4.0, 50.0), mc.scenes.load("double_pendulum")
ARM_TREE, ARM_GRAVITY, REGROUPED = ARM.tree, ARM.gravity, mc.find_base_parameters(ARM)
UNIT = np.eye(4)


def recording(channels=None, **fields):
    return mc.Recording(fields.pop("time", T), {"a": np.ones(100)} if channels is None else channels, **fields)


def identified(given=LOG, **options):
    return mc.identify(ARM, given, **{"estimator": "weighted", "cutoff": 8.0, **options})


def part_of_log(start, stop):
    return mc.Recording(LOG.time[start:stop], {name: x[start:stop] for name, x in LOG.measured.items()})


def consistent(**options):
    own = driven_arm.quick()
    given = {"psi": own.psi_of_links, "covariance": own.covariance, "base": own.base, "prior": ARM.known, **options}
    return mc.consistent_parameters(**given)


def simulated(**options):
    return mc.simulate(SPEC, DOUBLE_PENDULUM, **{"samples": 5, **options})


def of_arm(tree=ARM_TREE, q=Q, dq=Q, ddq=Q, gravity=ARM_GRAVITY, of=mc.base_wrench_regressor):
    return of(tree, q, dq, ddq, gravity=gravity)


NUMBERS = "needs an array of real numbers"
MECHANISM = 'needs a Mechanism, such as mc.mechanism("arm.xml"); got'
FIX = "fix needs joints"


def fixed(fix):
    return mc.mechanism(SPEC, base="base", fix=fix)


CALLS = {
    # Recordings.
    "channels in a list": (lambda: recording([np.ones(100)]), "measured needs a mapping of arrays"),
    "true values in a list": (lambda: recording(true=[1]), "true needs a mapping"),
    "a base that is short": (lambda: recording(base=[[1]]), "A moving base needs poses"),
    "noise of texts": (lambda: recording(noise={"a": "x"}), "The noise of channel 'a' needs a standard deviation"),
    "a text for held": (lambda: recording(held="no"), "held needs True or False or None; got 'no'"),
    "streams that are none": (lambda: recording(streams={"a": 3}), "The stream 'a' needs a pair"),
    "recording of no streams": (lambda: mc.Recording.from_streams(3), "streams needs a mapping of pairs"),
    "no sensors to add": (lambda: LOG.with_sensors(3), "sensors needs"),
    "a channel by number": (lambda: LOG[3], "The recording has no channel '3'"),
    "a wrench by number": (lambda: LOG.wrench(3), "name needs a text"),
    "a folder for a recording": (lambda: LOG.save("."), "A recording is saved as .npz or .csv"),
    "a recording from a folder": (lambda: mc.Recording.load("."), "the folder needs metadata.yaml"),
    # Sensors and wrenches.
    "a text for a sign": (lambda: mc.Sensor(applied_to_link="no"), "applied_to_link needs True or False; got 'no'"),
    "a sensor's small pose": (lambda: mc.Sensor(pose=np.eye(3)), "needs a rigid pose"),
    "a wrench of texts": (lambda: mc.Wrench("x"), f"values {NUMBERS}"),
    "no ground": (lambda: mc.total_wrench(ARM_TREE, Q, 3, []), "ground needs a Wrench or None"),
    "a contact on nobody": (
        lambda: mc.total_wrench(ARM_TREE, Q, None, [mc.Wrench(np.ones((5, 6)), body="nope")]),
        "A contact is on 'nope', but the mechanism's bodies are",
    ),
    # Mechanisms.
    "ignore in a text": (lambda: mc.mechanism(SPEC, ignore="x"), "ignore needs a list of texts; got 'x'"),
    "ignore in a mapping": (lambda: mc.mechanism(SPEC, ignore={"a": 3}), "ignore needs a list of texts; got"),
    "joints to fix in an array": (lambda: mc.mechanism(SPEC, fix=np.zeros(3)), FIX),
    "base by number": (lambda: mc.mechanism(SPEC, base=3), "base needs a text or None; got 3"),
    "a mechanism for its tree": (
        lambda: mc.Mechanism(ARM, ARM_GRAVITY),
        "tree needs a Tree; got an object of type Mech",
    ),
    "gravity downwards": (lambda: mc.Mechanism(ARM_TREE, "down"), "Gravity needs three finite numbers"),
    "a prior of NaN": (
        lambda: mc.Mechanism(ARM_TREE, ARM_GRAVITY, 0 * ARM.known + np.nan),
        "A prior φ needs finite numbers",
    ),
    "sites that are none": (
        lambda: mc.Mechanism(ARM_TREE, ARM_GRAVITY, sites={"a": 3}),
        "sites needs a mapping of tuples",
    ),
    "drives that are none": (lambda: mc.Mechanism(ARM_TREE, ARM_GRAVITY, drives=3), "drives needs a Drive"),
    "joints to fix": (lambda: ARM.fixed(3), "coordinates needs a mapping"),
    "a body by number": (lambda: ARM.beyond(3), "body needs a text"),
    "a site by number": (lambda: ARM.site(3), "name needs a text"),
    "no tree": (lambda: mc.Tree(None), "bodies needs a list of Body objects; got None"),
    "a body's name": (lambda: mc.Body(3, -1, UNIT, np.zeros(6)), "name needs a text"),
    "a body's parent": (lambda: mc.Tree((mc.Body("a", "b", UNIT, np.zeros(6)),)), "needs a parent index"),
    "no frames": (lambda: mc.tree_from_mdh([3]), "frames needs a list of Frame objects"),
    "no tree to recover axes of": (lambda: mc.recover_axes(3, np.eye(4)), "tree needs a Tree"),
    "no base's motion": (lambda: mc.BaseMotion("a", "b", "c"), f"T {NUMBERS}"),
    # Regressors and base parameters.
    "a mechanism's regressor": (lambda: of_arm(ARM), "tree needs a Tree"),
    "a mechanism's torques": (lambda: of_arm(ARM, of=mc.joint_torque_regressor), "tree needs a Tree"),
    "a mechanism's wrenches": (lambda: mc.total_wrench(ARM, Q, None, []), "tree needs a Tree"),
    "complex angles": (lambda: of_arm(q=Q * 1j), f"q {NUMBERS}"),
    "angles of NaN": (lambda: of_arm(q=Q * np.nan), "Joint states need finite numbers"),
    "few angles": (lambda: of_arm(q=Q[:, :2]), "Joint coordinates need 3 columns"),
    "gravity of two numbers": (lambda: of_arm(gravity=[0, 0]), "Gravity needs three finite numbers"),
    "few parameters": (lambda: REGROUPED.regroup(np.zeros(3)), "phi needs 30 columns, one for each parameter"),
    "few columns": (lambda: REGROUPED.reduce(np.zeros((3, 3))), "Y needs 30 columns, one for each parameter"),
    "a text for what is measured": (lambda: mc.Sensors(base_wrench="no"), "base_wrench needs True or False"),
    "equations of nothing": (lambda: mc.Equations.of_wrench(3), "mechanism needs a Mechanism"),
    "nothing to solve": (lambda: mc.least_squares(mc.Equations.of_wrench(PENDULUM), 3), "source needs a Samples"),
    "samples of nothing": (
        lambda: mc.least_squares(mc.Equations.of_wrench(PENDULUM), mc.Samples(3, 4)),
        "The samples must have a Motion",
    ),
    # Objects of another kind.
    "a path to identify": (lambda: mc.identify("arm.xml", "run.csv"), f"mechanism {MECHANISM} 'arm.xml'"),
    "an estimate to fit": (lambda: mc.identify(ARM, driven_arm.quick()), "recording needs a Recording, "),
    "columns in a list": (lambda: mc.identify(ARM, "run.csv", columns=["a"]), "columns needs the path of a TOML file"),
    "a log without a mechanism": (lambda: mc.read_log("run.csv", "arm.xml"), f"mechanism {MECHANISM} 'arm.xml'"),
    "a path to regroup": (lambda: mc.find_base_parameters("arm.xml"), f"source {MECHANISM} 'arm.xml'"),
    "a path as a log": (lambda: mc.identify_payload(ARM, "a", body="a", sensor="b"), "needs a Recording"),
    "an estimate as bodies": (lambda: mc.write_model("a.xml", PENDULUM, driven_arm.quick()), "estimate.consistent();"),
    "no bodies": (lambda: mc.write_model("new.xml", PENDULUM, None), "need 30 finite parameters, got shape"),
    "a mechanism as a path": (lambda: mc.write_model(ARM, "new.xml", None), "path needs the path of a file to write"),
    "a path to write": (lambda: mc.write_model("new.xml", "arm.xml", None), f"mechanism {MECHANISM} 'arm.xml'"),
    "a path to update": (lambda: mc.updated_spec("arm.xml", None), f"mechanism {MECHANISM} 'arm.xml'"),
    "no model": (lambda: mc.mechanism(None), "source needs the path of a model, an MjSpec or an MjModel; got None"),
    "no estimate to report": (lambda: mc.report(LOG, "out"), "estimate needs an Estimate, "),
    "no folder to report to": (lambda: mc.report(driven_arm.quick(), None), "folder needs the path of a folder"),
    "no path to load": (lambda: mc.Estimate.load(3), "path needs a path; got 3"),
    "no excitation": (lambda: mc.simulate(SPEC, None), "excitation needs a desired motion, "),
    "a path to simulate": (lambda: mc.simulate("arm.xml", None), "spec needs an MjSpec, such as "),
    "a recording to predict": (lambda: driven_arm.quick().predict(LOG), "motion needs a Motion"),
    "a place of a joint": (lambda: fixed({"joint1": "here"}), FIX),
    "a joint by number": (lambda: fixed({3: 0.1}), FIX),
    # Identification.
    "one recording twice": (lambda: identified([LOG, LOG]), "fitted once only, but one of them is given twice"),
    "one recording in two": (
        lambda: identified([LOG, mc.Recording(LOG.time, LOG.measured)]),
        "fitted once only, but one of them is given twice",
    ),
    "one recording in one": (
        lambda: identified([LOG, part_of_log(1, 400)]),
        "one of them is given twice: most samples of number 2 are those of number 1.",
    ),
    "a part held out": (lambda: identified(held_out=part_of_log(50, 200)), "has to be another one than the recording"),
    "held out and fitted": (lambda: identified(held_out=LOG), "has to be another one than the recording that is fit"),
    "columns of a recording": (lambda: identified(columns={"time": "t"}), "columns maps the columns of logs"),
    "a text for offsets": (lambda: identified(offsets="no"), "offsets needs True or False; got 'no'"),
    "a negative cut-off": (lambda: identified(cutoff=-3), "A cut-off is 'auto' or from 0"),
    "a cut-off beyond numbers": (lambda: identified(cutoff=10**309), "A cut-off is 'auto' or from 0"),
    "drives in an array": (lambda: identified(drive=np.zeros((3, 3))), "drive needs a list out of"),
    "an array for a deviation": (lambda: identified(known=np.zeros((3, 3))), "known needs standard deviations by name"),
    "an estimator by number": (lambda: identified(estimator=3), "estimator needs a text"),
    "left out in a text": (lambda: identified(leave_out="turn"), "leave_out needs a list of texts; got 'turn'"),
    "a text for known": (lambda: identified(known="yes"), "known needs standard deviations by name"),
    "a payload by number": (lambda: mc.identify_payload(ARM, [LOG], body=3, sensor="x"), "body needs a text"),
    "a text for gaps": (lambda: mc.read_log({"time": T}, ARM, gaps="no"), "gaps needs True or False"),
    "complex columns": (lambda: mc.read_log({"time": T, "turn_position": T * 1j}, ARM), "needs numbers, got complex"),
    # Estimates.
    "a comparison with nothing": (lambda: driven_arm.quick().compare(None), "other needs an Estimate, as of"),
    "a level in a text": (lambda: driven_arm.quick().interval("x"), "level needs a number between 0 and 1"),
    "a parameter in a list": (lambda: driven_arm.quick()[["a"]], "The estimate has no parameter"),
    "a folder for an estimate": (lambda: driven_arm.quick().save("."), "path needs the path of a file to write"),
    "an estimate from a folder": (lambda: mc.Estimate.load("."), "cannot be read"),
    "a motion of texts": (lambda: driven_arm.quick().predict(mc.Motion("a", "b", "c")), "A motion needs arrays"),
    "negative masses": (lambda: consistent(masses=-1.0), "masses needs a relative standard deviation of zero or more"),
    "no regrouping": (lambda: consistent(base=None), "base needs a BaseParameters"),
    "a prior in a list of texts": (lambda: consistent(prior=["x"]), f"prior {NUMBERS}"),
    # Simulation.
    "a rate of NaN": (lambda: simulated(rate=np.nan), "rate needs a finite number; got nan"),
    "a rate of zero": (lambda: simulated(rate=0), "A scene needs a positive rate"),
    "half a sample": (lambda: simulated(samples=2.5), "samples needs a whole number; got 2.5"),
    "a negative seed": (lambda: simulated(seed=-1), "A seed is a whole number from zero, got -1"),
    "noise in a text": (lambda: simulated(noise_scale="x"), "The noise scale must be from 0 to 1000"),
    "half a thread": (lambda: mc.simulate_many(SPEC, DOUBLE_PENDULUM, seeds=[1], threads=1.5), "threads needs a whole"),
    "a specification that falls": (lambda: mc.fall(SPEC, "base", seconds=1.0), "model needs an MjModel"),
    "an excitation of texts": (lambda: mc.Excitation("a", "b", "c", "d"), f"offset {NUMBERS}"),
    "drives to write": (lambda: mc.write_model("x.xml", PENDULUM, PENDULUM.known, 3), "drives needs a mapping of"),
    "a folder for a model": (lambda: mc.write_model(".", PENDULUM, PENDULUM.known), "path needs the path of a file"),
}


@pytest.mark.parametrize(("call", "message"), CALLS.values(), ids=CALLS)
def test_a_mistaken_call_is_one_sentence(call, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sentence = sentence_of(call)
    assert message in sentence and len(sentence) < 450 and sentence.endswith((".", ").", "LeRobot"))
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_missing_is_one_sentence(tmp_path):
    saves = [(driven_arm.quick().save, "npz"), (LOG.save, "npz"), (LOG.save, "csv")]
    for save, end in [*saves, (lambda path: mc.write_model(path, PENDULUM, PENDULUM.known), "xml")]:
        with pytest.raises(mc.InputError, match=r"nowhere' does not exist; make it first\.$"):
            save(tmp_path / "nowhere" / f"new.{end}")


def test_a_misspelt_command_names_those_that_are_near():
    for given, near in (
        ("idntify", "there is no command 'idntify'; near that are identify"),
        ("xyzxyz", "there is no command 'xyzxyz'; there are paper, mech"),
    ):
        run = subprocess.run([sys.executable, "-m", "multicontact", given], capture_output=True, text=True)
        assert run.returncode == 2 and near in run.stderr


def test_what_is_meant_works():
    assert of_arm(q=Q.tolist(), dq=Q.tolist(), ddq=Q.tolist()).shape == (5, 6, 30)
    assert mc.Tree([mc.Body("a", -1, UNIT.tolist(), [0, 0, 0, 0, 0, 1.0])]).names == ("a",)
    assert identified(x for x in [LOG]).names == identified((LOG,), offsets=np.True_, cutoff=np.float32(8)).names
    assert recording({"a": list(range(100)), "b": range(100)}, base=np.tile(UNIT, (100, 1, 1)).tolist())["b"][3] == 3
    assert simulated(samples=np.int64(5), rate=np.float64(100), seed=np.int32(3)).rate == 100
    assert np.array_equal(REGROUPED.regroup(ARM.known.tolist()), REGROUPED.regroup(ARM.known))
    assert ["a"] not in driven_arm.quick()

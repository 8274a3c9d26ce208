"""Wrong arguments and mistaken calls of every front door, each refused in one sentence."""

import argparse
from dataclasses import replace
from functools import partial
from importlib.resources import files
from inspect import Parameter, signature

import driven_arm
import mujoco
import numpy as np
import pytest
from commands import refusal, sentence_of
from mechanisms import GRAVITY, double_pendulum, random_states, random_tree
from recorded_faults import PENDULUM, faulty, shortened

import multicontact as mc
from experiments.cli import options
from ident import BaseMotion, Body, Frame, Mechanism, Motion, Recording, Sensors, Tree, Wrench, total_wrench
from ident.estimation.samples import in_order
from ident.geometry import se3
from ident.geometry.inertia import com_from_parameters
from ident.mechanism.body import BASE, ball_twist
from ident.mechanism.dh import tree_from_mdh
from ident.mechanism.recovered_axes import estimate_screw, recover_axes
from ident.model.regressor import pulled_back
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.person_prior import Person
from ident.parameters.prior import body_covariance, known_covariances
from ident.recordings.smoothing import chosen_cutoff, differences, low_pass
from ident.trajectory.algebra.banded import WINDOW, Banded
from multicontact.__main__ import main
from sim import mechanism, simulate
from sim.models.mujoco_model import parameters_from_model
from sim.motion.excitation import DOUBLE_PENDULUM, FourierTrajectory, Trapezoids, basis

TREE, UNIT, NAN = double_pendulum(), np.eye(4), np.nan
STATES = random_states(np.random.default_rng(0), TREE, 3)
SAMPLES, CLOCK = np.arange(3.0), np.arange(40) / 100
POINT, HINGE = Body("a", BASE, UNIT, np.zeros(6)), Body("a", BASE, UNIT, np.eye(6)[3], "elbow")
SHOULDER = Body("arm", BASE, UNIT, ball_twist(np.zeros(3)), "shoulder")
MOVING = BaseMotion(np.tile(UNIT, (3, 1, 1)), *np.zeros((2, 3, 6)))
MOVES, SERIES = Trapezoids([[0]], [[1]], [[0, 1]]), FourierTrajectory(1.0, [0.0], [[1.0, 2.0]])
NO_TURN, ONE = (np.zeros((1, 4)), *np.zeros((2, 1, 3))), BaseMotion(UNIT[None], *np.zeros((2, 1, 6)))
SLIDE = Tree((Body("slide", BASE, UNIT, np.eye(6)[0], "rail"),))
STILL, HUMANOID = Mechanism(TREE, np.zeros(3)), mc.scenes.load("humanoid").compile()
ACROSS, SHAPES = double_pendulum((0, 1, 0), (0, 1, 0)), ((5, 2), (4, 2), (5, 2))
GHOST = '<body name="ghost"><site/></body><body name="rock"><geom size="1"/></body>'
ONE_JOINT = replace(DOUBLE_PENDULUM, offset=[0.0], amplitude=[[1.0]], frequency=[[1.0]], phase=[[0.0]])
CHAIN, WELDED = (random_tree(np.random.default_rng(0), 3, **kinds) for kinds in ({}, {"kinds": ("welded",)}))
WHITE, WAVE = np.random.default_rng(0).normal(size=(500, 1)), np.sin(2 * np.pi * 30 * np.arange(1200) / 100)
FALLS = str(files(mc.scenes) / "arm.csv")
SPEC, ARM, LOG = mc.scenes.load("double_pendulum"), driven_arm.mechanism(), driven_arm.log(4.0, 50.0)
CONSISTENT = partial(mc.consistent_parameters, np.ones(3), np.eye(3), find_base_parameters(ARM), ARM.known)
OTHER_LOG = shortened(faulty(0), 120)
ROWS, POSE = r"rows \(k, 6\)", "'b1' needs the pose of its sensor's frame"
FINITE = "'b1' needs wrenches .* finite or NaN throughout"
TWICE = "fitted once only, but one of them is given twice"
INDEFINITE = np.zeros((6, 6)), np.triu(np.ones((6, 6))), np.eye(5)


def of_another_body():
    spec = mc.scenes.load("double_pendulum")
    sensor = spec.sensor("joint1_acceleration")
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_BODY, "link1"
    return spec


def indefinite():
    matrix = Banded(WINDOW, 1, WINDOW)
    matrix.add(0, -np.ones((1, WINDOW, 1, WINDOW, 1)), np.arange(1))
    matrix.factored()


def regressor(tree, *states, gravity=GRAVITY, **given):
    return mc.base_wrench_regressor(tree, *states, gravity=gravity, **given)


def followers(first, second):
    """A table of two joints that follow others, with a fixed frame between them."""
    last = Frame("2", "fixed", "prismatic", follows=second)
    return tree_from_mdh([Frame("1", None, "revolute", follows=first), Frame("fixed", "1", "fixed"), last])


def on_ground(*contacts, **ground):
    wrench = Wrench(**{"values": np.zeros((4, 6)), **ground})
    return total_wrench(CHAIN, np.zeros((4, len(CHAIN.moving))), wrench, contacts)


def in_contact(**contact):
    return on_ground(Wrench(**{"values": np.zeros((4, 6)), "body": "b1", **contact}), time=np.arange(4.0))


def stream(time=CLOCK, values=CLOCK, name="a", **given):
    return Recording.from_streams({name: (time, values)}, **given)


def compiled(bodies):
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")


def not_finite():
    model = compiled('<body name="a"><geom size="1"/></body>')
    model.body_inertia[1, 2] = NAN
    return parameters_from_model(model)


def weighed(covariance):
    samples = mc.Samples(Motion(*STATES), np.zeros((3, 6)), covariance)
    return mc.least_squares(mc.Equations.of_wrench(STILL), samples)


def simulated(excitation=DOUBLE_PENDULUM, spec=SPEC, **given):
    return simulate(spec, excitation, **{"samples": 5, **given})


def identified(given=LOG, **given_options):
    return mc.identify(ARM, given, **{"estimator": "weighted", "cutoff": 8.0, **given_options})


def part_of_log(start, stop):
    return Recording(LOG.time[start:stop], {name: x[start:stop] for name, x in LOG.measured.items()})


REFUSED = [
    # Bodies, trees and motions of a base.
    ("'a'.*rigid home pose", lambda: replace(POINT, home=np.diag([2.0, 1, 1, 1]))),
    ("'a'.*4×4", lambda: replace(POINT, home=np.eye(3))),
    ("'a'.*joint twist", lambda: replace(POINT, twist=2 * HINGE.twist)),
    ("at least one body", lambda: Tree(())),
    ("parent index from -1 to 0, got 1", lambda: Tree((POINT, replace(POINT, name="b", parent=1)))),
    ("for every body; 'a' occurs twice", lambda: Tree((POINT, POINT))),
    ("for every joint; 'elbow' occurs twice", lambda: Tree((HINGE, replace(HINGE, name="b")))),
    ("has a rotation 'shoulder.x', and another", lambda: Tree((SHOULDER, replace(HINGE, joint="shoulder.x")))),
    (r"coordinates \(N, 7\).* got \(3, 6\), \(3, 6\) and", lambda: BaseMotion.from_free_joint(*np.ones((3, 3, 6)))),
    (r"T \(N, 4, 4\), V \(N, 6\) and dV \(N, 6\), got V \(2, 6\)", lambda: replace(MOVING, V=np.zeros((2, 6)))),
    ("finite", lambda: replace(MOVING, dV=np.full((3, 6), NAN))),
    ("rigid poses", lambda: replace(MOVING, T=np.zeros((3, 4, 4)))),
    (r"Row 1 \(frame '1'\) .*out of revolute, prismatic, fixed, got", lambda: tree_from_mdh([Frame("1", None, "x")])),
    ("Row 2 gives frame '1' a second time", lambda: tree_from_mdh(2 * [Frame("1", None, "fixed")])),
    (r"Row 1 .*parent from a row before it \(none but", lambda: tree_from_mdh([Frame("1", "2", "fixed")])),
    (r"Row 1 .* has follows without a joint", lambda: tree_from_mdh([Frame("1", None, "fixed", follows={"1": 1.0})])),
    (r"Row 1 .* constant without follows", lambda: tree_from_mdh([Frame("1", None, "revolute", constant=0.3)])),
    (r"Frame '1' needs to follow joints out of 2, got 'fixed'\.", lambda: followers({"fixed": 1.0}, {})),
    (r"The frames 1, 2 follow each other; one of them needs a", lambda: followers({"2": 1.0}, {"1": 1.0})),
    ("Joint 'link1'", lambda: recover_axes(TREE, TREE.poses(np.zeros((20, 2))))),
    ("'link1': The axis is perpend", lambda: recover_axes(TREE, ACROSS.poses(np.outer(np.arange(40) / 20, [1, 2])))),
    ("'rail' slides", lambda: recover_axes(SLIDE, np.tile(UNIT, (20, 1, 1, 1)))),
    ("at least 10 finite poses, got 3", lambda: estimate_screw(se3.exp(np.eye(6)[3], SAMPLES), np.eye(3)[0])),
    # Mechanisms.
    ("'tail', which is none of", lambda: replace(STILL, prior_known={"tail": {"mass": 0.1}})),
    ("prior_known needs standard deviations by the bodies' names", lambda: replace(STILL, prior_known="mass")),
    ("Gravity needs three finite numbers", lambda: Mechanism(TREE, "down")),
    ("A prior φ needs finite numbers", lambda: Mechanism(TREE, GRAVITY, np.full(30, NAN))),
    ("drives needs a Drive", lambda: Mechanism(TREE, GRAVITY, drives=3)),
    *(("fix needs joints", partial(mechanism, SPEC, fix=x)) for x in (np.zeros(3), {"joint1": "here"})),
    ("sites needs a mapping of tuples", lambda: Mechanism(TREE, GRAVITY, sites={"a": 3})),
    ("ignore needs a list of texts; got 'x'", lambda: mechanism(SPEC, ignore="x")),
    # Regressors and parameters.
    ("'shoulder' needs quaternions; that of sample 0 is zero", lambda: regressor(Tree((SHOULDER,)), *NO_TURN)),
    ("3 joint states need as many samples of the base's motion", lambda: regressor(TREE, *STATES, base=ONE)),
    ("has columns 0 to 29, not 60", lambda: regressor(TREE, *STATES, columns=[3, 60])),
    (r"shapes \(N, 2\), .* got \(5, 2\), \(4, 2\) and \(5, 2\)", lambda: regressor(TREE, *map(np.zeros, SHAPES))),
    ("Joint states need finite numbers", lambda: regressor(TREE, STATES[0] * NAN, *STATES[1:])),
    ("Joint coordinates need 2 columns", lambda: regressor(TREE, *(x[:, :1] for x in STATES))),
    (r"adjoints of shape \(3, 6, 2\) are needed", lambda: pulled_back(STILL, Motion(*STATES), [0, 1], np.ones(3))),
    ("finite numbers that are not all zero", lambda: find_base_parameters(np.zeros((5, 6, 30)))),
    ("30 columns needs as many names, got 2", lambda: find_base_parameters(regressor(TREE, *STATES), ["a", "b"])),
    ("phi needs 30 columns, one for each parameter", lambda: find_base_parameters(ARM).regroup(np.zeros(3))),
    ("see no parameter of this mechanism", lambda: find_base_parameters(WELDED, sensors=Sensors(False, True))),
    ("massless bodies has no parameters", lambda: find_base_parameters(Tree((replace(POINT, massless=True),)))),
    ("base wrench, joint torques, or both", lambda: Sensors(False, False)),
    *((ROWS, partial(Sensors, channels=x)) for x in (np.eye(5), np.zeros((1, 6)))),
    *((r"covariance.* (positive definite|symmetric|shape)", partial(weighed, x)) for x in INDEFINITE),
    ("The samples must have a Motion", lambda: mc.least_squares(mc.Equations.of_wrench(STILL), mc.Samples(3, 4))),
    ("zero mass", lambda: com_from_parameters(np.zeros(10))),
    ("A mechanism needs mass; ghost have none", lambda: parameters_from_model(compiled(GHOST), "ghost")),
    ("Body 'a' needs a finite mass, centre of mass and inertia", not_finite),
    ("one of winter, deleva, dumas, got 'vitruvius'", lambda: Person("vitruvius", 70, 1.7, "male")),
    ("one of female, male, got 'm'", lambda: Person("dumas", 70, 1.7, "m")),
    ("a height in m, got 70 and 175", lambda: Person("dumas", 70, 175, "male")),
    ("not positive definite", indefinite),
    ("masses needs a relative standard deviation of zero or more", partial(CONSISTENT, masses=-1.0)),
    # Wrenches.
    ("on 'hand', but the mechanism's bodies are b0, b1, b2", lambda: in_contact(body="hand")),
    (f"{POSE}.*got none", lambda: in_contact(pose=None)),
    (r"frame, \(4, 4\) or \(4, 4, 4\), got \(3, 3\)", lambda: in_contact(pose=np.eye(3))),
    ("'b1' needs 4 samples like the joint states, got 3", lambda: in_contact(values=np.zeros((3, 6)))),
    (r"'b1' needs wrenches \(N, 6\), each .*, got shape \(4, 5\)", lambda: in_contact(values=np.zeros((4, 5)))),
    *((FINITE, partial(in_contact, values=np.where(np.eye(4, 6), x, 0))) for x in (np.inf, NAN)),
    ("'b1' needs all six components; only the ground's", lambda: in_contact(values=np.full((4, 6), NAN))),
    ("sample times; they differ by up to 0.5 s, most at sample 2", lambda: in_contact(time=np.array([0, 1, 2.5, 3]))),
    ("'b1' needs the other wrenches' sample times", lambda: in_contact(time=np.full(4, NAN))),
    (r"'b1' needs 4 sample times, got shape \(9,\)", lambda: in_contact(time=np.arange(9.0))),
    (r"4 joint states need ground wrenches \(4, 6\), got \(3, 6\)", lambda: on_ground(values=np.zeros((3, 6)))),
    ("ground wrench needs a frame out of body, world, for the ground 'body'", lambda: on_ground(frame="world")),
    (r"ground wrench needs a symmetric covariance \(6, 6\), got", lambda: on_ground(covariance=np.eye(3))),
    ("total wrench needs finite joint states", lambda: total_wrench(TREE, np.full((4, 2), NAN), None, [])),
    ("need poses of a moving base", lambda: total_wrench(TREE, np.zeros((4, 2)), None, [], base=UNIT[None])),
    ("applied_to_link needs True or False; got 'no'", lambda: mc.Sensor(applied_to_link="no")),
    ("needs a rigid pose", lambda: mc.Sensor(pose=np.eye(3))),
    # Recordings and signals.
    (r"times \(N,\) and values \(N,\) or \(N, d\), got \(40,\) and \(39,\)", lambda: stream(CLOCK, CLOCK[1:])),
    ("stream 'a' needs a pair of times and values", lambda: Recording.from_streams({"a": CLOCK})),
    ("times of the stream 'a' must increase; sample 1 does not", lambda: stream(CLOCK[::-1])),
    ("times of the stream 'a' need finite numbers", lambda: stream(np.where(CLOCK > 0.2, NAN, CLOCK))),
    ("stream 'a' needs numbers, NaN for a missing", lambda: stream(CLOCK, np.where(CLOCK > 0.2, np.inf, CLOCK))),
    (r"rigid poses \(N, 16\), .* got shape \(40, 3\)", lambda: stream(CLOCK, np.ones((40, 3)), "base:pose")),
    ("Streams without joint positions need a rate", stream),
    (r"need a positive rate in Hz .*, got -1\.0", lambda: stream(rate=-1.0)),
    ("Streams need samples", lambda: stream(CLOCK, CLOCK * NAN, rate=10.0)),
    ("cover; 'b' begins at 1 s", lambda: Recording.from_streams({"a_position": [CLOCK] * 2, "b": [CLOCK + 1, CLOCK]})),
    ("streams needs a mapping of pairs", lambda: Recording.from_streams(3)),
    ("needs 1 components, got 3", lambda: Recording(SAMPLES, {"a": SAMPLES}, streams={"a": (SAMPLES, np.eye(3))})),
    ("must increase; sample 2 does not", lambda: Recording([0.0, 1, 1], {})),
    ("'time' needs finite numbers; sample 1 is nan", lambda: Recording([0.0, NAN], {})),
    (r"'a' needs 2 samples along its first axis, got shape \(3,\)", lambda: Recording([0.0, 1], {"a": SAMPLES})),
    ("'a' needs finite numbers; sample 1 is inf", lambda: Recording([0.0, 1], {"a": [[1.0, 2], [3, np.inf]]})),
    ("A moving base needs poses", lambda: Recording(SAMPLES, {}, base=[[1]])),
    ("The noise of channel 'a' needs a stand", lambda: Recording(SAMPLES, {"a": SAMPLES}, noise={"a": "x"})),
    ("no true values", lambda: Recording(SAMPLES, {"a": SAMPLES}).noise_free),
    ("The recording has no channel '3'", lambda: LOG[3]),
    ("A recording is saved as .npz or .csv", lambda: LOG.save(".")),
    ("the folder needs metadata.yaml", lambda: Recording.load(".")),
    ("needs at least one sample, got 0", lambda: next(Recording.chunks(FALLS, 0))),
    ("submitted ahead, got 0", lambda: list(in_order(None, str, [1], ahead=0))),
    ("at least 50 samples, got 40", lambda: chosen_cutoff(np.zeros((40, 2)), 100.0)),
    *(("a column that moves below 10 Hz", partial(chosen_cutoff, x, 100.0)) for x in (np.ones((100, 2)), WAVE)),
    ("not noise alone; state a cut-off", lambda: chosen_cutoff(WHITE, 100.0)),
    ("from 0.001 Hz to below half the rate, 50 Hz, got 50 Hz", lambda: low_pass(WAVE, 100.0, 50.0)),
    ("got nan Hz", lambda: low_pass(WAVE, 100.0, NAN)),
    ("more than 9 samples, got 9", lambda: low_pass(WAVE[:9], 100.0, 3.0)),
    ("at least 5 samples, got 4", lambda: differences(WAVE[:4], 100.0)),
    # Scenes, excitations and simulations.
    ("'triple'; the scenes are double_pendulum", lambda: mc.scenes.load("triple")),
    ("has neither tilt nor contact to choose", lambda: mc.scenes.load("humanoid", tilt_deg=5)),
    *(("from 0° to below 90°", partial(mc.scenes.load, "double_pendulum", tilt_deg=x)) for x in (-1, 90)),
    ("at least one sample, got 0 s at 100 Hz", lambda: mc.fall(HUMANOID, "pelvis", seconds=0, rate=100)),
    (r"timestep of 0.001 s must divide 0.0033\d* s", lambda: mc.fall(HUMANOID, "pelvis", seconds=1, rate=300)),
    ("needs 1 to 1000000 samples, got 0", lambda: simulated(samples=0)),
    ("samples needs a whole number; got 2.5", lambda: simulated(samples=2.5)),
    ("from 0 to 1000, got -1", lambda: simulated(noise_scale=-1)),
    ("rate needs a finite number; got nan", lambda: simulated(rate=NAN)),
    ("A scene needs a positive rate", lambda: simulated(rate=0)),
    ("A seed is a whole number from zero, got -1", lambda: simulated(seed=-1)),
    ("excitation needs a desired motion, ", lambda: simulated(None)),
    ("1 joints needs as many position servos", lambda: simulated(ONE_JOINT)),
    ("must report one number of a hinge", lambda: simulated(spec=of_another_body())),
    ("at least one thread, got 0", lambda: mc.simulate_many(SPEC, DOUBLE_PENDULUM, seeds=[1], threads=0)),
    (r"shapes \(1,\), \(2, 2\)", lambda: replace(DOUBLE_PENDULUM, offset=[0.0])),
    ("positive frequencies", lambda: replace(DOUBLE_PENDULUM, frequency=[[0.0, 1], [1, 1]])),
    ("zero or more, got -1.0", lambda: replace(DOUBLE_PENDULUM, noise=-1.0)),
    (r"got shapes \(1, 2\), \(1, 1\) and \(1, 2\)", lambda: replace(MOVES, start=[[0, 1]])),
    ("to end before the next one", lambda: Trapezoids([[0, 1]], [[1.5, 1]], [[0, 1, 2]])),
    ("take some time", lambda: replace(MOVES, lasting=[[0]])),
    (r"shapes \(1,\) and \(1, 3\)", lambda: replace(SERIES, coefficients=[[1.0, 2, 3]])),
    ("finite numbers", lambda: replace(SERIES, center=[NAN])),
    ("positive duration, got 0.0 s", lambda: replace(SERIES, duration=0.0)),
    ("at least 2 harmonics, got 1", lambda: basis(1.0, 1, np.zeros(1))),
    # Identification.
    *((TWICE, lambda x=x: identified([LOG, x])) for x in (LOG, Recording(LOG.time, LOG.measured), part_of_log(1, 400))),
    ("has to be another one than the rec", lambda: identified(held_out=part_of_log(50, 200))),
    ("columns needs the path of a TOML file", lambda: identified("run.csv", columns=["a"])),
    ("columns maps the columns of logs", lambda: identified(columns={"time": "t"})),
    *(("A cut-off is 'auto' or from 0", partial(identified, cutoff=x)) for x in (-3, 10**309)),
    ("estimate filters nothing", lambda: identified(estimator="joint", cutoff=5.0)),
    ("needs numbers, got complex", lambda: mc.read_log({"time": SAMPLES, "turn_position": SAMPLES * 1j}, ARM)),
    # Estimates and files.
    ("other needs an Estimate, as of", lambda: driven_arm.quick().compare(None)),
    ("level needs a number between 0 and 1", lambda: driven_arm.quick().interval("x")),
    ("The estimate has no parameter", lambda: driven_arm.quick()[["a"]]),
    ("motion needs a Motion", lambda: driven_arm.quick().predict(LOG)),
    ("A motion needs arrays", lambda: driven_arm.quick().predict(Motion("a", "b", "c"))),
    ("path needs the path of a file to write", lambda: driven_arm.quick().save(".")),
    ("path needs a path; got 3", lambda: mc.Estimate.load(3)),
    ("cannot be read", lambda: mc.Estimate.load(".")),
    ("folder needs the path of a folder", lambda: mc.report(driven_arm.quick(), None)),
    (r"estimate\.consistent\(\);", lambda: mc.write_model("a.xml", PENDULUM, driven_arm.quick())),
    ("drives needs a mapping of", lambda: mc.write_model("x.xml", PENDULUM, PENDULUM.known, 3)),
    ("joints carry, got 'tip'; bodies are", lambda: mc.write_model("x.xml", PENDULUM, None, None, {"tip": np.ones(3)})),
    ("need 30 finite parameters, got shape", lambda: mc.write_model("new.xml", PENDULUM, None)),
    # Options of commands.
    ("where it stands, got knee high", lambda: options.fixed([["knee", "high"]])),
    ("--drive takes auto alone", lambda: options.drives(["auto", "viscous"])),
    ("needs a whole number of at least 1, got 'x'", lambda: options.whole_number(1)("x")),
]


@pytest.mark.parametrize(("message", "call"), REFUSED, ids=[message for message, _ in REFUSED])
def test_a_mistaken_call_is_one_sentence(message, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((mc.InputError, argparse.ArgumentTypeError, np.linalg.LinAlgError), match=message) as error:
        call()
    sentence = str(error.value)
    assert "\n" not in sentence.partition("got [[")[0] and (len(sentence) < 450 or "got [[" in sentence)
    assert not list(tmp_path.iterdir())


def required(function):
    own = signature(function).parameters.values()
    return [x for x in own if x.default is x.empty and x.kind not in (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)]


CALLED = [x for x in (getattr(mc, name) for name in mc.__all__) if callable(x) and x.__name__[-5:] != "Error"]


@pytest.mark.parametrize("function", [x for x in CALLED if required(x) and x not in (mc.Estimate, Motion, mc.Samples)])
def test_front_doors_name_the_argument_that_is_of_another_kind(function):
    """Results and inputs of the inner loops are not checked when they are made."""
    sentence = sentence_of(function, **{x.name: object() for x in required(function)})
    assert any(sentence.startswith(f"{x.name} needs ") for x in required(function))


DEVIATION, NAMED = "needs a standard deviation, zero or false, got", "needs standard deviations by name"
OF_RECORDING = "needs a Recording, the path of a log, .* or a list; got"
WRONG_DEVIATIONS = [
    *(({"mass": x}, f"mass {DEVIATION} ") for x in ("a lot", -0.1, NAN, np.inf, None, True)),
    ({"weight": 0.1}, "has no entry 'weight'; valid are mass, center, inertia"),
    *((x, f"{NAMED}, out of mass, center, inertia; got") for x in ("mass", 3, ["mass"])),
]
WRONG_ARGUMENTS = [
    *(({"known": known}, f"^known.?{message}") for known, message in WRONG_DEVIATIONS),
    ({"setup": {"late": 0.1}}, "^setup has no entry 'late'; valid are delay, lag, clock, origin"),
    ({"setup": {"delay": -1}}, f"^setup.delay {DEVIATION} "),
    ({"setup": {"centre": 1e9}}, rf"^setup.centre {DEVIATION} .*; the largest is 10\.$"),
    ({"setup": {"lag": 1e6}}, rf"^setup.lag {DEVIATION} .*; the largest is 60\.$"),
    ({"setup": {"axis": 7}}, rf"^setup.axis {DEVIATION} 7; the largest is 3\.14159\.$"),
    ({"known": {"mass": 1e9}}, rf"^known.mass {DEVIATION} .*; the largest is 1e\+08\.$"),
    ({"setup": "delay"}, f"^setup {NAMED}"),
    *(({"holdout": x}, "^holdout needs a fraction") for x in (-0.1, 1, NAN, "0.4", True)),
    ({"drive": ["coulomb", "stiction"]}, "^drive needs a list out of rotor, .*; got stiction"),
    *(({"drive": x}, f"^drive needs a list out of rotor, .*; got {x}") for x in ("coulomb", 1)),
    ({"own": None}, "^own needs a list out of offset, .*, delay, lag, torque_delay, tracker_delay; got None"),
    ({"held_out": None}, f"^held_out {OF_RECORDING} None"),
    ({"held_out": ["run.csv"]}, r"^run\.csv: there is no such file"),
    ({"recording": 3}, f"^recording {OF_RECORDING} 3"),
    ({"recording": replace(OTHER_LOG, setup={"delay": -1})}, f"setup.delay {DEVIATION}"),
    ({"recording": replace(OTHER_LOG, known={"mass": NAN})}, f"known.mass {DEVIATION}"),
]


@pytest.mark.parametrize(("given", "message"), WRONG_ARGUMENTS)
def test_arguments_of_identify_are_refused_in_one_sentence(given, message):
    with pytest.raises(mc.InputError, match=message):
        mc.identify(PENDULUM, **{"recording": OTHER_LOG, **given})


def test_how_well_bodies_are_known_is_checked_wherever_it_is_said():
    (name, *_), phi = PENDULUM.bodies, PENDULUM.known[:10]
    for known, message in WRONG_DEVIATIONS:
        with pytest.raises(mc.ModelError, match=f"^prior_known of '{name}'.?{message}"):
            replace(PENDULUM, prior_known={name: known})
        for function, what in ((known_covariances, PENDULUM), (body_covariance, phi)):
            with pytest.raises(mc.InputError, match=f"^known.?{message}"):
                function(what, known)


def test_a_folder_that_is_missing_is_one_sentence(tmp_path):
    saves = [(driven_arm.quick().save, "npz"), (LOG.save, "npz"), (LOG.save, "csv")]
    for save, end in [*saves, (lambda path: mc.write_model(path, PENDULUM, PENDULUM.known), "xml")]:
        with pytest.raises(mc.InputError, match=r"nowhere' does not exist; make it first\.$"):
            save(tmp_path / "nowhere" / f"new.{end}")


def test_a_misspelt_command_names_those_that_are_near(capsys):
    for given, near in (("idntify", "near that are identify"), ("xyzxyz", "there are paper, mech")):
        assert f"there is no command '{given}'; {near}" in refusal(main, [given], capsys)


def test_what_is_meant_works():
    q, base = np.zeros((5, 3)).tolist(), find_base_parameters(ARM)
    assert regressor(ARM.tree, q, q, q).shape == (5, 6, 30)
    assert Tree([Body("a", -1, UNIT.tolist(), [0, 0, 0, 0, 0, 1.0])]).names == ("a",)
    assert identified(x for x in [LOG]).names == identified((LOG,), offsets=np.True_, cutoff=np.float32(8)).names
    assert Recording(CLOCK, {"a": [*range(40)], "b": range(40)}, base=np.tile(UNIT, (40, 1, 1)).tolist())["b"][3] == 3
    assert simulated(samples=np.int64(5), rate=np.float64(100), seed=np.int32(3)).rate == 100
    assert np.array_equal(base.regroup(ARM.known.tolist()), base.regroup(ARM.known))
    assert ["a"] not in driven_arm.quick()

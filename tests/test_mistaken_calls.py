"""Mistaken calls of every front door: one sentence that names the argument, and no other error."""

import subprocess
import sys

import driven_arm
import estimates
import numpy as np
import pytest

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM

T, Q = np.arange(100) / 100, np.zeros((5, 3))
ARM, LOG, SPEC = driven_arm.mechanism(), driven_arm.log(4.0, 50.0), mc.scenes.load("double_pendulum")
PENDULUM = mc.mechanism(SPEC, base="base")
TREE, GRAVITY, BASE = ARM.tree, ARM.gravity, mc.find_base_parameters(ARM)
ONE = np.eye(4)


def recording(channels=None, **fields):
    return mc.Recording(fields.pop("time", T), {"a": np.ones(100)} if channels is None else channels, **fields)


def identified(given=LOG, **options):
    return mc.identify(ARM, given, **{"estimator": "weighted", "cutoff": 8.0, **options})


def consistent(**options):
    own = estimates.quick()
    given = {"psi": own.psi_of_links, "covariance": own.covariance, "base": own.base, "prior": ARM.known, **options}
    return mc.consistent_parameters(**given)


def simulated(**options):
    return mc.simulate(SPEC, DOUBLE_PENDULUM, **{"samples": 5, **options})


def regressor(tree=TREE, q=Q, dq=Q, ddq=Q, gravity=GRAVITY, of=mc.base_wrench_regressor):
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
    "no ground": (lambda: mc.total_wrench(TREE, Q, 3, []), "ground needs a Wrench or None"),
    "a contact on nobody": (
        lambda: mc.total_wrench(TREE, Q, None, [mc.Wrench(np.ones((5, 6)), body="nope")]),
        "A contact is on 'nope', but the mechanism's bodies are",
    ),
    # Mechanisms.
    "ignore in a text": (lambda: mc.mechanism(SPEC, ignore="x"), "ignore needs a list of texts; got 'x'"),
    "ignore in a mapping": (lambda: mc.mechanism(SPEC, ignore={"a": 3}), "ignore needs a list of texts; got"),
    "joints to fix in an array": (lambda: mc.mechanism(SPEC, fix=np.zeros(3)), FIX),
    "base by number": (lambda: mc.mechanism(SPEC, base=3), "base needs a text or None; got 3"),
    "a mechanism for its tree": (lambda: mc.Mechanism(ARM, GRAVITY), "tree needs a Tree; got an object of type Mech"),
    "gravity downwards": (lambda: mc.Mechanism(TREE, "down"), "Gravity needs three finite numbers"),
    "a prior of NaN": (lambda: mc.Mechanism(TREE, GRAVITY, 0 * ARM.known + np.nan), "A prior φ needs finite numbers"),
    "sites that are none": (lambda: mc.Mechanism(TREE, GRAVITY, sites={"a": 3}), "sites needs a mapping of tuples"),
    "drives that are none": (lambda: mc.Mechanism(TREE, GRAVITY, drives=3), "drives needs a Drive"),
    "joints to fix": (lambda: ARM.fixed(3), "coordinates needs a mapping"),
    "a body by number": (lambda: ARM.beyond(3), "body needs a text"),
    "a site by number": (lambda: ARM.site(3), "name needs a text"),
    "no tree": (lambda: mc.Tree(None), "bodies needs a list of Body objects; got None"),
    "a body's name": (lambda: mc.Body(3, -1, ONE, np.zeros(6)), "name needs a text"),
    "a body's parent": (lambda: mc.Tree((mc.Body("a", "b", ONE, np.zeros(6)),)), "needs a parent index"),
    "no frames": (lambda: mc.tree_from_mdh([3]), "frames needs a list of Frame objects"),
    "no tree to recover axes of": (lambda: mc.recover_axes(3, np.eye(4)), "tree needs a Tree"),
    "no base's motion": (lambda: mc.BaseMotion("a", "b", "c"), f"T {NUMBERS}"),
    # Regressors and base parameters.
    "a mechanism's regressor": (lambda: regressor(ARM), "tree needs a Tree"),
    "a mechanism's torques": (lambda: regressor(ARM, of=mc.joint_torque_regressor), "tree needs a Tree"),
    "a mechanism's wrenches": (lambda: mc.total_wrench(ARM, Q, None, []), "tree needs a Tree"),
    "complex angles": (lambda: regressor(q=Q * 1j), f"q {NUMBERS}"),
    "angles of NaN": (lambda: regressor(q=Q * np.nan), "Joint states need finite numbers"),
    "few angles": (lambda: regressor(q=Q[:, :2]), "Joint coordinates need 3 columns"),
    "gravity of two numbers": (lambda: regressor(gravity=[0, 0]), "Gravity needs three finite numbers"),
    "few parameters": (lambda: BASE.regroup(np.zeros(3)), "phi needs 30 columns, one for each parameter"),
    "few columns": (lambda: BASE.reduce(np.zeros((3, 3))), "Y needs 30 columns, one for each parameter"),
    "a text for what is measured": (lambda: mc.Sensors(base_wrench="no"), "base_wrench needs True or False"),
    "equations of nothing": (lambda: mc.Equations.of_wrench(3), "mechanism needs a Mechanism"),
    "nothing to solve": (lambda: mc.least_squares(mc.Equations.of_wrench(PENDULUM), 3), "source needs a Samples"),
    "samples of nothing": (
        lambda: mc.least_squares(mc.Equations.of_wrench(PENDULUM), mc.Samples(3, 4)),
        "The samples must have a Motion",
    ),
    # Objects of another kind.
    "a path to identify": (lambda: mc.identify("arm.xml", "run.csv"), f"mechanism {MECHANISM} 'arm.xml'"),
    "an estimate to fit": (lambda: mc.identify(ARM, estimates.quick()), "recording needs a Recording, "),
    "columns in a list": (lambda: mc.identify(ARM, "run.csv", columns=["a"]), "columns needs the path of a TOML file"),
    "a log without a mechanism": (lambda: mc.read_log("run.csv", "arm.xml"), f"mechanism {MECHANISM} 'arm.xml'"),
    "a path to regroup": (lambda: mc.find_base_parameters("arm.xml"), f"source {MECHANISM} 'arm.xml'"),
    "a path as a log": (lambda: mc.identify_payload(ARM, "a", body="a", sensor="b"), "recording[0] needs a Recording"),
    "an estimate as bodies": (lambda: mc.write_model("a.xml", PENDULUM, estimates.quick()), "estimate.consistent();"),
    "no bodies": (lambda: mc.write_model("new.xml", PENDULUM, None), "need 30 finite parameters, got shape"),
    "a mechanism as a path": (lambda: mc.write_model(ARM, "new.xml", None), "path needs the path of a file to write"),
    "a path to write": (lambda: mc.write_model("new.xml", "arm.xml", None), f"mechanism {MECHANISM} 'arm.xml'"),
    "a path to update": (lambda: mc.updated_spec("arm.xml", None), f"mechanism {MECHANISM} 'arm.xml'"),
    "no model": (lambda: mc.mechanism(None), "source needs the path of a model, an MjSpec or an MjModel; got None"),
    "no estimate to report": (lambda: mc.report(LOG, "out"), "estimate needs an Estimate, "),
    "no folder to report to": (lambda: mc.report(estimates.quick(), None), "folder needs the path of a folder"),
    "no path to load": (lambda: mc.Estimate.load(3), "path needs a path; got 3"),
    "no excitation": (lambda: mc.simulate(SPEC, None), "excitation needs a desired motion, "),
    "a path to simulate": (lambda: mc.simulate("arm.xml", None), "spec needs an MjSpec, such as "),
    "a recording to predict": (lambda: estimates.quick().predict(LOG), "motion needs a Motion"),
    "a place of a joint": (lambda: fixed({"joint1": "here"}), FIX),
    "a joint by number": (lambda: fixed({3: 0.1}), FIX),
    # Identification.
    "one recording twice": (lambda: identified([LOG, LOG]), "fitted once only, but one of them is given twice"),
    "one recording in two": (
        lambda: identified([LOG, mc.Recording(LOG.time, LOG.measured)]),
        "fitted once only, but one of them is given twice",
    ),
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
    "a comparison with nothing": (lambda: estimates.quick().compare(None), "other needs an Estimate, as of"),
    "a level in a text": (lambda: estimates.quick().interval("x"), "level needs a number between 0 and 1"),
    "a parameter in a list": (lambda: estimates.quick()[["a"]], "The estimate has no parameter"),
    "a folder for an estimate": (lambda: estimates.quick().save("."), "path needs the path of a file to write"),
    "an estimate from a folder": (lambda: mc.Estimate.load("."), "cannot be read"),
    "a motion of texts": (lambda: estimates.quick().predict(mc.Motion("a", "b", "c")), "A motion needs arrays"),
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
    with pytest.raises(mc.InputError) as raised:
        call()
    sentence = str(raised.value)
    assert (
        message in sentence
        and "\n" not in sentence
        and len(sentence) < 450
        and sentence.endswith((".", ").", "LeRobot"))
    )
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_missing_is_one_sentence(tmp_path):
    saves = [(estimates.quick().save, "npz"), (LOG.save, "npz"), (LOG.save, "csv")]
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
    assert regressor(q=Q.tolist(), dq=Q.tolist(), ddq=Q.tolist()).shape == (5, 6, 30)
    assert mc.Tree([mc.Body("a", -1, ONE.tolist(), [0, 0, 0, 0, 0, 1.0])]).names == ("a",)
    assert identified(x for x in [LOG]).names == identified((LOG,), offsets=np.True_, cutoff=np.float32(8)).names
    assert recording({"a": list(range(100)), "b": range(100)}, base=np.tile(ONE, (100, 1, 1)).tolist())["b"][3] == 3
    assert simulated(samples=np.int64(5), rate=np.float64(100), seed=np.int32(3)).rate == 100
    assert np.array_equal(BASE.regroup(ARM.known.tolist()), BASE.regroup(ARM.known))
    assert ["a"] not in estimates.quick()

"""Bad input of every command is one sentence, exit code 2, and leaves no results behind."""

import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import refusal
from looped import FOUR_BAR, SPATIAL
from marked import labels_of, marked_person, trc, trial
from studies.test_compare import result
from studies.test_excite import FOLDING

import scenes
from ident.recordings.recording import STATES
from multicontact.__main__ import COMMANDS
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

ALONE = '<mujoco><worldbody><body name="a">{}<geom size="0.1" mass="1"/></body></worldbody></mujoco>'
MOTOR = '<actuator><motor joint="crank"/></actuator>'
TEXTS = {
    "fold.xml": FOLDING,
    "overlapping.xml": FOLDING.replace('size="0.1" mass="2"', 'size="0.5" mass="2"'),
    "free.xml": ALONE.format('<joint name="j" range="-1 1"/>').replace("<geom", '<geom contype="0" conaffinity="0"'),
    "rigid.xml": ALONE.format(""),
    "both.xml": ALONE.format('<joint name="s" type="slide" range="-1 1"/><joint name="b" type="ball"/>'),
    "endless.xml": ALONE.format('<joint name="j"/>'),
    "four_bar.xml": FOUR_BAR,
    "truss.xml": FOUR_BAR.replace("<connect", "<weld"),
    "driven.xml": FOUR_BAR.replace("<sensor>", f"{MOTOR}<sensor>"),
    "held.xml": SPATIAL.replace('axis="0.3 0.93 0.2"', 'type="ball"'),
    "empty.csv": "",
    "words.csv": "hello\n",
    "two.csv": "time,a\n1,2\n2,3\n",
    "hours.csv": "time,a,b\n" + "".join(f"12:00:{k:02},{k % 3},{k % 5}\n" for k in range(50)),
    "back.csv": "time,a,b\n" + "".join(f"{k % 20},{k % 3},{k % 5}\n" for k in range(50)),
    "timeless.csv": "a,b\n" + "".join(f"{(-1) ** k},{k % 3}\n" for k in range(50)),
    "file": "in the way",
    "nobody.toml": '[joints.nobody]\nposition = "q"\n',
    "nose.toml": '[markers.NOSE]\nsite = "pelvis_0"',
    "no_site.toml": '[markers.pelvis_0]\nsite = "nose"',
    "no_body.toml": '[markers.pelvis_0]\nbody = "x"\nposition = [0, 0, 0]',
    "no_position.toml": '[markers.pelvis_0]\nbody = "pelvis"',
    "two.toml": '[markers.pelvis_0]\nbody = "pelvis"\nsite = "a"',
    "one_site.toml": '[markers.pelvis_0]\nsite = "pelvis_1"',
    "unit.toml": 'unit = "m"',
    "groups.toml": '[scale]\ngroups = ["pelvis"]',
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("bad")
    for name, text in TEXTS.items():
        (out / name).write_text(text, encoding="utf-8")
    log = simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=600)
    still = {f"{joint}_{kind}": 0 * log.time for joint in ("joint1", "joint2") for kind in STATES}
    log.save(out / "log.csv")
    short = {name: 1.001 * x[:15] for name, x in log.measured.items()}  # Another recording.
    replace(log, time=log.time[:15], measured=short, true={}, noise={}).save(out / "short.csv")
    replace(log, measured={**log.measured, **still}, true={}, noise={}).save(out / "still.csv")
    (out / "pendulum.xml").write_bytes((Path(scenes.__file__).parent / "double_pendulum.xml").read_bytes())
    spec = marked_person()
    model = spec.compile()
    (out / "person.xml").write_text(spec.to_xml(), encoding="utf-8")
    time, _, x = trial(model, 3)
    (out / "walk.trc").write_text(trc(time, [f"Anna:{label}" for label in labels_of(model)], x), encoding="utf-8")
    (out / "loop.csv").symlink_to(out / "loop.csv")
    (out / "sub").mkdir()
    (out / "sub" / "pendulum.xml").write_bytes((out / "pendulum.xml").read_bytes())
    for name in BATCH:
        (out / f"{name}.csv").write_text("", encoding="utf-8")
    (out / "earlier").mkdir()
    for name in ("report.html", "batch.json", "batch_outcomes.npz"):
        (out / "earlier" / name).write_text(name, encoding="utf-8")
    for name in ("a", "b", "broken", "flat"):
        result(out / name, [1.0, 2.0, 3.0], log=name)
    result(out / "thigh", [1.0, 2.0, 3.0], log="x", bodies=("base", "thigh"))
    for name in ("one", "another"):
        result(out / name, [1.0, 2.0, 3.0], log=name, covariance=np.ones((3, 3)))
    for name, old, new in (("broken", '"covariance"', '"other"'), ("flat", r'("std_setup": \[)[^,]+', r"\g<1>0")):
        file = out / name / "estimate.json"
        file.write_text(re.sub(old, new, file.read_text(encoding="utf-8")), encoding="utf-8")
    return out


BATCH = ("Table_logs.csv", "provenance.json", "batch_outcomes_before.npz")
"""Names of a batch's own files, not all systems telling capital letters."""

MANY = "log.csv short.csv --out earlier --estimator weighted"
QUICK = "--starts 1 --iterations 5 --formats png"
LOOPED = "--starts 2 --iterations 4 --seconds 3 --harmonics 3 --position -1 1 --formats none"
PENDULUM = "identify pendulum.xml log.csv --base base"
REFUSED = [
    ("misaligned --tilt-deg 89.99999999", "perpendicular to the one it should resemble"),
    ("misaligned --azimuth-deg 1e308", "azimuth of at most 360°"),
    ("misaligned --trials 1", "2 to 1000000, or 0, got '1'"),
    ("misaligned --resume --samples 60", "--resume needs --trials"),
    ("misaligned --formats bmp", "invalid choice: 'bmp'"),
    ("misaligned --samples 60 --out file", "needs to be a writable folder, got"),
    ("sweep pendulum --over samples 100", "invalid choice: 'pendulum'"),
    ("sweep multicontact --over samples 100 many", "sweep.values needs a whole number of at least 1, got many"),
    ("sweep multicontact --over noise_scale 1 1.0", "all different, got [1.0, 1.0]"),
    ("study absent.toml", "misaligned, multicontact, several_contacts come with this package"),
    ("human --noise 40", "below 30 degrees, got 40"),
    ("human --activities sleeping", "sleeping"),
    ("human --resume", "belong to --persons"),
    ("human --from markers --noise 5", "(--noise) belongs to --from angles or correlated"),
    ("identify missing.xml missing.csv", "file that exists, got 'missing.xml'"),
    ("identify pendulum.xml log.csv --base foot", "no body named 'foot'; its bodies are base, link1, link2"),
    (f"{PENDULUM} --estimator ordinary --cutoff 90", "from 0 to 50 Hz, half the sampling rate"),
    (f"{PENDULUM} --estimator ordinary --cutoff fast", "'auto' or from 0 to 50 Hz"),
    (f"{PENDULUM} --cutoff 3", "filters nothing: --cutoff belongs to --estimator"),
    (f"{PENDULUM} --holdout 2", "needs a number from 0.05 to 0.9, or 0, got '2'"),
    ("identify pendulum.xml short.csv --base base", "too few"),
    (f"{PENDULUM} --held-out short.csv --estimator weighted --cutoff 1", "log to judge by has 15 samples"),
    (f"{PENDULUM} --estimator weighted --write-geometry", "--write-geometry needs the trajectory estimate"),
    (f"{PENDULUM} --formats none svg", "'none' stands alone, got none svg"),
    ("identify pendulum.xml still.csv --base base", "parameters; it does not separate"),
    (f"{PENDULUM} --name ../esc", "the name of one folder"),
    (f"{PENDULUM} --prior winter --mass 70", "--prior winter needs --mass, --height, --sex; --height, --sex is"),
    (f"{PENDULUM} --mass 70", "--mass belongs to a table of people, --prior winter, deleva, dumas."),
    (f"{PENDULUM} --prior dumas --mass -7", "--mass: needs a positive number"),
    ("identify sub/pendulum.xml log.csv --out . --name sub", "a folder without inputs"),
    ("identify pendulum.xml log.csv log.csv --base base", "once only, but 'log.csv' is given twice"),
    ("identify pendulum.xml loop.csv --base base", "loop.csv"),
    ("identify pendulum.xml log.csv --packages nope", "--packages needs folders that exist, got"),
    (f"batch absent.xml {MANY}", "absent.xml"),
    (f"batch pendulum.xml {MANY} --base nobody", "nobody"),
    (f"batch pendulum.xml {MANY} --columns nobody.toml", "nobody.toml: [joints] has no entry 'nobody'"),
    (f"batch pendulum.xml {MANY} --held-out absent.csv", "absent.csv"),
    (f"batch pendulum.xml {MANY} --gaps", "--gaps"),
    *((f"batch pendulum.xml log.csv {name}.csv", f"'{name}', but that is kept for the batch's own") for name in BATCH),
    ("compare loop.csv a", "loop.csv"),
    ("payload pendulum.xml log.csv --body link2", "either --sensor NAME, or --loaded LOG"),
    ("columns pendulum.xml missing.csv --base base", "there is no such file"),
    ("columns pendulum.xml empty.csv --base base", "the file is empty"),
    ("columns pendulum.xml words.csv --base base", "needs a table with two columns of numbers"),
    ("columns pendulum.xml timeless.csv --base base", "no column of it grows as times do"),
    ("columns pendulum.xml back.csv --base base", "row 22, column 'time' goes back in time by 19 and goes on"),
    ("columns pendulum.xml hours.csv --base base", "do: row 2, column 'time' needs a number, got '12:00:00'; a log"),
    ("columns pendulum.xml log.csv --base base --out log.csv --force", "is read; choose another by --out"),
    ("compare a a", "needs two or more different folders"),
    ("compare a absent", "needs to hold results of identify, but estimate.json: No such file or directory."),
    ("compare a a/..", "Its folders hold some: '"),
    ("compare a thigh", "Results of one mechanism can be compared"),
    ("compare a broken", "lacks covariance"),
    ("compare a flat", "its 'std_setup' has a deviation that is not positive"),
    ("compare one another", "need a covariance, but the sum of theirs is singular"),
    ("compare a b --out a", "needs a folder of its own"),
    (f"excite fold.xml {QUICK} --joints elbow", "Joint 'elbow' does not exist; the joints to choose from are lift, f"),
    (f"excite fold.xml {QUICK} --seconds 0.1", "5 harmonics at 100 Hz need 0.5 s to 10000 s"),
    (f"excite fold.xml {QUICK} --position 1 -1", "a lower limit below the upper one, got 1 to -1 rad"),
    (f"excite fold.xml {QUICK} --position 4 5", "where the model allows -2.84838 to 2.84838"),
    (f"excite fold.xml {QUICK} --floor 0 --collisions ignore", "--floor belongs to --collisions avoid"),
    (f"excite fold.xml {QUICK} --joints fold --position 2.9 3.0", "come closer than 0.005 m"),
    (f"excite overlapping.xml {QUICK}", "found: 'column' and 'fore' come closer than"),
    (f"excite free.xml {QUICK} --floor 0", "--floor needs moving bodies with geoms that can collide"),
    (f"excite rigid.xml {QUICK}", "needs a hinge or slide joint; this mechanism has none"),
    (f"excite both.xml {QUICK} --joints b", "Joint 'b' is neither hinge nor slide; the joints to choose from are s."),
    (f"excite endless.xml {QUICK}", "Joint 'j' has no range in the model; give one with --position LOW"),
    (f"excite arm {QUICK} --drive auto", "contains no drives: --drive needs --sensors torque"),
    (f"excite driven.xml {LOOPED} --joints rod", "loops make it depend on crank. Name crank with --joints, or"),
    (f"excite four_bar.xml {LOOPED} --joints crank rocker", "cannot be excited: loops make it depend on"),
    (f"excite held.xml {LOOPED} --joints crank", "loops hold it while rod rests. Name"),
    (
        f"excite truss.xml {LOOPED}",
        "Loops leave crank, rod, rocker no motion. Align axes that are meant to be parallel",
    ),
    ("excite nope", "A model is one of double_pendulum, bowing, humanoid, arm, or an MJCF, URDF or OpenSim file"),
    ("angles endless.xml walk.trc", "No marker has a site of its name: the markers are"),
    ("angles person.xml walk.trc --places nose.toml", "The file has no marker 'NOSE'"),
    ("angles person.xml walk.trc --places no_site.toml", "the model has no site 'nose'"),
    ("angles person.xml walk.trc --places no_body.toml", "the model has no body 'x'"),
    ("angles person.xml walk.trc --places no_position.toml", "a position [x, y, z] in m on it"),
    ("angles person.xml walk.trc --places two.toml", "got both"),
    ("angles person.xml walk.trc --places one_site.toml", "'Anna:pelvis_1' have the same site"),
    ("angles person.xml walk.trc --places unit.toml", "the file states its unit; leave out that lengths are in m"),
    ("angles person.xml walk.trc --places groups.toml", "scale.groups needs a list of lists of bodies, got pelvis"),
    ("angles person.xml walk.trc --mass 70", "--mass is about lengths that --scale finds"),
    ("angles person.xml walk.trc --fix left_knee 1 2", "--fix left_knee needs 1 coordinates, got 2"),
    ("angles person.xml walk.trc --wrenches two.csv", "no wrench is in this file"),
]


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
@pytest.mark.usefixtures("undrawn", "no_trajectory", "here")
@pytest.mark.parametrize(("command", "message"), REFUSED, ids=[command for command, _ in REFUSED])
def test_bad_input_is_one_sentence(folder, capsys, monkeypatch, command, message):
    monkeypatch.chdir(folder)
    name, *arguments = shlex.split(command)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    own = [] if "--out" in arguments else ["--out", "out.toml" if name == "columns" else "out"]
    error = refusal(COMMANDS[name].main, [*arguments, *own], capsys)
    assert message in " ".join(error.split()) and f"python -m experiments.{name}: error: " in error
    if name == "sweep":
        # The study's own results are written before its sweep is run.
        shutil.rmtree("out", ignore_errors=True)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before

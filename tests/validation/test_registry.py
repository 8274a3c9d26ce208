"""The registry of recordings, results of earlier versions, and other software on the same logs."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import sentence_of
from mechanisms import by_joint, sines
from registered import TEXT, files_of, recorded, written

from experiments.runs.workers import Workers
from experiments.studies.validation import files, peers, validation_study
from experiments.studies.validation.converters import CONVERTERS
from experiments.studies.validation.files import chosen, columns_file, read_entry, registry
from ident.errors import InputError
from ident.files.limits import toml
from ident.identification import identify
from ident.model.regressor import joint_torque_regressor
from ident.recordings.recording import Recording
from sim.models.model_mechanism import mechanism

ALLOWED = dict.fromkeys(("gaps", "offsets", "prior"), bool) | dict.fromkeys(("base", "columns"), str)
ALLOWED |= {"fix": dict, "ignore": list, "leave_out": list, "noise": dict}
"""Options that the recording's documentation decides. A choice that only the outcome could suggest is none: a cut-off,
weights, thresholds, knots, priors' sizes, samples to leave out, the estimator or its columns."""

OF_COLUMNS = {"time", "rate", "joints", "motors", "wrenches", "base", "file", "segments"}
"""Tables of an entry's columns file: not `setup`, `known` and `select`."""


@pytest.mark.parametrize("entry", registry().values(), ids=lambda entry: entry.name)
def test_every_entry_is_well_formed_and_what_was_tried_has_hashes_and_what_was_not_no_numbers(entry):
    assert entry.files and entry.about and entry.title and (entry.tried or entry.note)
    assert re.fullmatch(r"\w[\w.-]{0,99}/\w[\w.-]{0,99}", entry.source.repository, re.ASCII)
    assert re.fullmatch(r"([0-9a-f]{7,40})?", entry.source.commit)
    for file in entry.files:
        assert all(re.fullmatch(r"([0-9a-f]{64})?", each) for each in (file.sha256, file.original))
        assert {file.made, file.converter} <= {"", *CONVERTERS} and bool(file.sha256) == entry.tried
    if entry.tried:
        logs = (*entry.logs, *entry.empty, *entry.loaded)
        used = [*filter(None, [entry.model]), *entry.true_files, *(name for log in logs for name in log)]
        models = {path.name for path in columns_file("", "models").iterdir()}
        assert entry.fitted and set(used) - models <= {file.name for file in entry.files}
    else:
        assert not (entry.published or entry.held_out or entry.reference or entry.alike)
        assert not any(file.original for file in entry.files)
    assert all(isinstance(value, ALLOWED[name]) for name, value in entry.options.items())
    if "columns" in entry.options:
        columns = toml(columns_file(entry.options["columns"]), "a mapping needs")
        assert set(columns) <= OF_COLUMNS
        assert not any({"kp_std", "torque_std"} & {*joint} for joint in columns.get("joints", {}).values())


def test_recordings_are_chosen_by_name():
    entries = registry()
    assert [each.name for each in chosen(["ur10", "bow"], entries)] == ["bow", "ur10"]
    assert len(chosen([], entries)) == len(entries)


def test_a_malformed_entry_is_one_sentence(tmp_path):
    given = TEXT.format(files='[[files]]\nname = "arm.xml"\npath = "models/arm.xml"', more="")
    assert read_entry(written(tmp_path, given)).folder == "arm"
    for old, new, sentence in (
        ('"arm"', '"../../evil"', "stay in their folder"),
        ('"arm"', '"/tmp/evil"', "stay in their folder"),
        ('name = "arm.xml"', 'name = ".."', "stay in their folder"),
        ('name = "arm.xml"', r'name = "a\u0000b"', "stay in their folder"),
        ('"models/arm.xml"', '"../arm.xml"', "stay in their folder"),
        ('"somebody/arms"', '"../arm"', "stay in their folder"),
        ("tried = true", 'tried = "no"', "tried"),
        ("[source]", "[sources]", "is no entry"),
        ("[source]", 'published = [{ name = "m", value = 1.0, std = -0.1 }]\n[source]', "std needs a number of at"),
        ("[source]", "options = { columns = 3 }\n[source]", "options.columns needs a text, got 3"),
    ):
        assert sentence in sentence_of(read_entry, written(tmp_path, given.replace(old, new, 1)))


def test_results_of_other_sources_or_entries_are_not_resumed(tmp_path, monkeypatch, here):
    recorded(tmp_path / "arm")
    entry = read_entry(written(tmp_path, TEXT.format(files=files_of(tmp_path / "arm"), more="")))
    refused = {"refused": "Not today."}
    monkeypatch.setattr(validation_study, "work", lambda task: refused)
    monkeypatch.setattr(validation_study, "collected", lambda entries, tasks, answers, refused: answers)

    def answers(entry, **options):
        return validation_study.study([entry], files.Places(tmp_path), tmp_path, Workers(1, **options))

    assert answers(entry) == answers(entry, resume=True) == [refused] * 3
    other = replace(entry, options={**entry.options, "holdout": 0.3})
    assert "of another run: tasks differ; leave out --resume" in sentence_of(answers, other, resume=True)
    monkeypatch.setattr(validation_study, "SOURCES", ("sim",))
    assert "of another run: code differ; leave out --resume" in sentence_of(answers, entry, resume=True)


LINK = """<link name="{name}"><inertial><origin xyz="0.02 0 -0.2"/><mass value="{mass}"/>
<inertia ixx="0.02" iyy="0.02" izz="0.005" ixy="0" ixz="0.001" iyz="0"/></inertial>
<visual><geometry><mesh filename="nowhere.stl"/></geometry></visual></link>"""
JOINT = """<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 {z}"/><axis xyz="0 1 0"/></joint>"""
LINKS = LINK.format(name="upper", mass=2.0) + LINK.format(name="lower", mass=1.0)
SHOULDER = JOINT.format(name="shoulder", parent="world", child="upper", z=0)
ELBOW = JOINT.format(name="elbow", parent="upper", child="lower", z=-0.4)
URDF = f'<?xml version="1.0"?><robot name="two"><link name="world"/>{LINKS}{SHOULDER}{ELBOW}</robot>'
COULOMB, VISCOUS = (0.3, 0.2), (0.1, 0.05)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Path of the model, and the estimate from its exact torques with a little noise."""
    path = tmp_path_factory.mktemp("arm") / "two.urdf"
    path.write_text(URDF, encoding="utf-8")
    with pytest.warns(Warning, match="nowhere"):
        two = mechanism(path)
    rng, time = np.random.default_rng(0), np.arange(0, 8, 0.01)
    phase, rates = rng.uniform(0, 6, (4, 2)).T, np.array([1.1, 2.3, 3.1, 4.7])
    q, dq, ddq = sines(time, np.full((2, 4), 0.35), rates, phase)
    links = joint_torque_regressor(two.tree, q, dq, ddq, gravity=two.gravity) @ two.known
    torque = links + np.sign(dq) * COULOMB + dq * VISCOUS
    q, torque = (x + size * rng.standard_normal(q.shape) for x, size in ((q, 1e-5), (torque, 0.01)))
    return path, identify(two, Recording(time, by_joint(two.joints, position=q, torque=torque)))


@pytest.mark.slow
def test_plain_least_squares_are_compared_and_what_is_missing_names_the_extra(arm, monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(peers, "import_module", missing)
    path, estimate = arm
    answers = peers.compared(path, estimate, [])
    assert list(answers) == ["plain least squares", "FIGAROH", "mujoco.sysid"]
    plain = answers["plain least squares"]
    assert max(plain["ratios"]) < 0.2 and len(plain["ratios"]) == 2 and plain["seconds"] > 0
    for name in ("FIGAROH", "mujoco.sysid"):
        assert "which the extra 'peers' brings: pip install" in answers[name]
    assert list(peers.compared(path.with_suffix(".xml"), estimate, [])) == ["plain least squares"]


def test_nimblephysics_is_not_run_beside_a_numpy_that_it_does_not_survive(monkeypatch):
    """Beside another one it may lack: constraints.txt has none that it survives."""
    monkeypatch.setitem(sys.modules, "nimblephysics", None)
    for version in ("2.4.0", "1.26.4"):
        monkeypatch.setattr(peers.np, "__version__", version)
        with pytest.raises(InputError, match=r'numpy 2, so .* pip install -e "\.\[nimble\]", without constraints'):
            peers.nimble(Path("person.osim"), [], None)


@pytest.mark.extras
@pytest.mark.parametrize(("name", "packages"), [("FIGAROH", ["figaroh"]), ("mujoco.sysid", ["mujoco.sysid", "absl"])])
def test_other_software_s_parameters_predict_an_arm_without_much_noise(arm, name, packages, monkeypatch):
    for package in packages:
        pytest.importorskip(package, reason="it is in MuJoCo 4, or in the extra 'peers'")
    monkeypatch.setattr(peers, "PEERS", {name: peers.PEERS[name]})
    path, estimate = arm
    answer = peers.compared(path, estimate, [])[name]
    assert max(answer["ratios"]) < 0.2

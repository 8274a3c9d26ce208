"""The command that identifies a user's own mechanism: on the real recording, on faulty scenes, and on bad input."""

import json
import os
import re
from contextlib import redirect_stdout
from dataclasses import replace
from functools import cache
from io import StringIO
from pathlib import Path

import mujoco
import numpy as np
import pytest
from coded import coded, doubts_of
from commands import refusal
from scipy.signal import butter, sosfiltfilt
from stand_ins import leave_undrawn

import scenes
from experiments import identify
from experiments.document.writer import Card
from experiments.reports import identify_report
from experiments.studies.user_files import prepare
from ident.estimate import Estimate
from ident.geometry.inertia import pseudo_inertia
from ident.identification import identified
from ident.judgement.finding import Finding
from ident.recordings.recording import Recording
from sim.models.mujoco_model import parameters_from_model
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

PENDULUM = Path(scenes.__file__).parent / "double_pendulum.xml"
DATA = Path(os.environ.get("MULTICONTACT_DATA", "")) / "human_bowing"
needs_data = pytest.mark.skipif(
    not (os.environ.get("MULTICONTACT_DATA") and DATA.is_dir()), reason="MULTICONTACT_DATA names no recorded data"
)

BOWING = """
[joints.ankle]
position = "q_ankle"
velocity = ""
acceleration = ""
[joints.hip]
position = "q_hip"
velocity = ""
acceleration = ""
[wrenches.ground]
force = ["foot_fx", "foot_fy", "foot_fz"]
torque = ["foot_mx", "foot_my", "foot_mz"]
"""

WEIGHTED = {"estimator": "weighted"}
"""Options of estimates whose findings do not depend on the estimator, and that take a tenth of the time."""


@cache
def recording(tilt_deg=0.0, contact=None):
    spec = scenes.load("double_pendulum", tilt_deg=tilt_deg, azimuth_deg=120, contact=contact)
    return simulate(spec, DOUBLE_PENDULUM, samples=600)


def with_channels(original, **channels):
    return replace(original, measured={**original.measured, **channels}, true={}, noise={})


def doubts_and_result(tmp_path, log, mapping=None, **options):
    """Doubts on the aligned pendulum's model, values by code, and the result."""
    path, columns = tmp_path / "log.csv", None
    log.save(path)
    if mapping:
        columns = tmp_path / "columns.toml"
        columns.write_text(mapping, encoding="utf-8")
    result = identified(prepare(PENDULUM, path, base="base", columns=columns), **options)
    return doubts_of(result), result


@pytest.fixture(scope="module")
def aligned(tmp_path_factory):
    """Folder of the command's results for the aligned scene, its estimate, and what it prints."""
    folder, made, whole = tmp_path_factory.mktemp("aligned"), [], identify.identified_from
    recording().save(folder / "log.csv")
    with pytest.MonkeyPatch.context() as patched, redirect_stdout(StringIO()) as printed:
        leave_undrawn(patched)
        patched.setattr(identify, "identified_from", lambda *given: made.append(whole(*given)) or made[0])
        arguments = [str(PENDULUM), str(folder / "log.csv"), "--base", "base", "--name", "me", "--out", str(folder)]
        assert identify.main(arguments) == 0
    return folder / "me", made[0][0], printed.getvalue()


@pytest.fixture
def bowing(tmp_path):
    columns = tmp_path / "bowing.toml"
    columns.write_text(BOWING, encoding="utf-8")
    return columns


@pytest.mark.usefixtures("undrawn")
@needs_data
def test_a_bow_on_a_force_plate(bowing, tmp_path, capsys):
    model = DATA / "threeLinkHuman_subject1_sensorExt.urdf"
    options = ["--columns", str(bowing), "--cutoff", "3", "--estimator", "weighted", "--name", "bow"]
    assert identify.main([str(model), str(DATA / "bowing.csv"), *options, "--out", str(tmp_path)]) == 0
    printed, estimate = capsys.readouterr().out, json.loads((tmp_path / "bow" / "estimate.json").read_text())
    held_out = {channel: numbers["ratio"] for channel, numbers in estimate["held_out"].items()}
    assert held_out["Fx"] <= 0.31 and held_out["Fz"] <= 0.42 and held_out["My"] <= 0.23
    value = dict(zip(estimate["columns"], estimate["values"], strict=True))
    std = dict(zip(estimate["columns"], estimate["std"], strict=True))
    assert abs(value["m1"] - 61.65) < 0.1
    assert abs(value["m3rz3"] - 8.5) < 0.4
    assert abs(value["offset(Fx)"] - 4.5) < 2 * std["offset(Fx)"] < 1
    assert printed.startswith("✕ Unusable. One finding speaks against it; it predicts all 3 channels that count.")
    assert "It predicts all 3 channels that count. Not counted: Fy, Mx, Mz" in estimate["verdict"]
    phi = parameters_from_model(tmp_path / "bow" / "model.urdf")
    assert (np.linalg.eigvalsh(pseudo_inertia(phi.reshape(-1, 10))) > 0).all()
    prepared = prepare(model, DATA / "bowing.csv", columns=bowing, cutoff=3.0)
    assert_predicts_as_well(identified(prepared, estimator="weighted"), phi)
    assert {path.name for path in (tmp_path / "bow").iterdir()} >= {"report.html", "model.urdf", "figure_held_out.svg"}


@needs_data
def test_a_bow_from_angles_alone_without_any_choice(bowing):
    """A real person: the model is imperfect, and the verdict has to be right about that."""
    result = identified(prepare(DATA / "three_link_human.xml", DATA / "bowing.csv", columns=bowing))
    low_pass = butter(2, 3.0, fs=100, output="sos")
    held = result.held_out
    residual, measured = (sosfiltfilt(low_pass, x, axis=0) for x in (held.residual, held.samples.measured))
    ratio = dict(zip(result.channels, np.sqrt((residual**2).mean(axis=0)) / measured.std(axis=0), strict=True))
    assert ratio["Fx"] <= 0.30 and ratio["Fz"] <= 0.42 and ratio["My"] <= 0.22
    model = result.base.regroup(result.prepared.mechanism.known)
    z = dict(zip(result.base.names, (result.psi - model) / result.std_setup, strict=True))
    assert abs(z["Iyy2"]) < 2 and abs(z["Iyy3"]) < 2
    assert result.widening > 2 and coded(result, "halves_disagree")
    # Gravity tilted by 11° would explain the fitted part, but predict worse.
    assert not any(each.kind == "gravity" for each in result.setup)


def assert_predicts_as_well(result, phi):
    """Checks that held-out weighted residuals of full parameters exceed those of the free fit by less than 1 %."""
    explained = [c not in result.unexplained for c in result.channels]
    weights = (result.held_out.samples.measured.std(axis=0) / result.scale)[explained]
    before = np.linalg.norm(result.held_out.ratio[explained] * weights)
    after = np.linalg.norm(result.held_out.ratio_with(result.base.regroup(phi))[explained] * weights)
    assert after < 1.01 * before


def test_tilted_axes_are_found_and_taken_into_account(tmp_path):
    doubts, result = doubts_and_result(tmp_path, recording(tilt_deg=5.0))
    assert not doubts
    tilts = {each.name: np.degrees(each.value) for each in result.setup}
    # About z either the plate or both axes are turned; about y the axes are.
    assert tilts["rotation_z(ground)"] == pytest.approx(2.5, abs=0.1)
    assert tilts["axis_y(joint1)"] == pytest.approx(-4.33, abs=0.1) == tilts["axis_y(joint2)"]
    assert any("a turn of all joint axes about z" in each.alternatives for each in result.setup)
    truth = result.base.regroup(result.prepared.mechanism.known)
    assert (abs(result.psi - truth) < 2 * result.std_setup).all()


def test_gross_outliers_move_no_parameter_out_of_its_interval(tmp_path, aligned):
    log, rng = recording(), np.random.default_rng(0)
    _, clean, _ = aligned
    spoilt = {name: np.array(log.measured[name]) for name in ("ground_force", "ground_torque", "joint1_position")}
    for name, values in spoilt.items():
        bad = rng.choice(len(values), len(values) // 100, replace=False)
        size = 3.0 if "position" in name else 50 * values.std()
        values[bad] += size * rng.choice([-1.0, 1.0], size=(len(bad), *values.shape[1:]))
    _, result = doubts_and_result(tmp_path, with_channels(log, **spoilt))
    rank = clean.prepared.equations.parameters.rank
    assert (abs(result.psi - clean.psi) < 1.96 * clean.fit.std[:rank]).all()
    assert any("outliers" in note for note in result.prepared.notes)


def test_the_updated_scene_reloads_and_needs_the_same_wrenches(aligned):
    folder, result, printed = aligned
    phi = parameters_from_model(folder / "model.xml", "base")
    assert (np.linalg.eigvalsh(pseudo_inertia(phi.reshape(-1, 10))) > 0).all()
    assert_predicts_as_well(result, phi)
    assert mujoco.MjModel.from_xml_path(str(folder / "model.xml")).nu == 2
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64") == 3 and "http" not in page.replace("http-equiv", "")
    assert "<h1>double_pendulum.xml, identified from log.csv</h1>" in page and "2 is link1, 3 is link2" in page
    links = {link for link in re.findall(r'href="([^#"]*)"', page) if link}
    assert {"table_base_parameters.csv", "figure_held_out.svg"} <= links
    assert all((folder / link).is_file() for link in links)
    assert "✓ Usable. It predicts all 5 channels that count; held-out residuals are at most" in printed


def test_a_model_that_is_not_contradicted_keeps_its_bodies_and_others_are_named(tmp_path, aligned):
    path, light = tmp_path / "log.csv", tmp_path / "light.xml"
    recording().save(path)
    assert not coded(aligned[1], "masses_shown", "masses_hardly_shown")
    spec = scenes.load("double_pendulum")
    spec.body("link2").mass /= 3
    spec.compile()
    light.write_text(spec.to_xml(), encoding="utf-8")
    result = identified(prepare(light, path, base="base"))
    (named,) = coded(result, "masses_shown", "masses_limited", "masses_hardly_shown")
    assert named.code == "masses_limited" and not named.doubt
    (mass,) = named.values["masses"].values()
    assert named.place.bodies == ("link2",) and 10 < mass["mass"] < 20
    assert mass["model"] == pytest.approx(4.43, abs=0.005) and 4.43 < mass["lower"] < 13.3
    assert mass["upper"] is None or mass["upper"] > 13.3


def board(**missing):
    """Mapping of the ground wrench without some channels."""
    columns = {c: f"ground_{'force' if c[0] == 'F' else 'torque'}.{c[1]}" for c in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")}
    names = [missing.get(c, name) for c, name in columns.items()]
    return f"[wrenches.ground]\nforce = {json.dumps(names[:3])}\ntorque = {json.dumps(names[3:])}\n"


def unchecked(result):
    """Reasons for which the weight could not be checked, and channels in which it would show."""
    values = [finding.values for finding in coded(result, "unchecked")]
    return [(each["reason"], *each["channels"]) for each in values if each["check"] == "weight"]


def test_the_weight_takes_the_vertical_force_alone_and_says_where_it_is_missing(tmp_path):
    log = recording()
    _, result = doubts_and_result(tmp_path, log, board(Fx="", Fy=""), **WEIGHTED)
    assert abs(result.checks.weight.measured - 20.99) < 0.1 and abs(result.checks.weight.drift) < 0.1
    _, result = doubts_and_result(tmp_path, log, board(Fz=""), **WEIGHTED)
    assert result.checks.weight is None
    assert unchecked(result) == [("not measured", "Fz")]
    _, result = doubts_and_result(tmp_path, log, board(Fx="", Fy="", Fz=""), **WEIGHTED)
    assert unchecked(result) == [("no force",)]


def test_a_model_without_gravity_is_not_believed_to_explain_a_weight(tmp_path):
    model, path = tmp_path / "model.xml", tmp_path / "log.csv"
    spec = scenes.load("double_pendulum")
    spec.option.gravity = [0, 0, 0]
    spec.compile()
    model.write_text(spec.to_xml(), encoding="utf-8")
    recording().save(path)
    result = identified(prepare(model, path, base="base"), **WEIGHTED)
    assert unchecked(result) == [("no gravity",)]
    offsets = doubts_of(result)["large_offsets"]
    assert offsets["offsets"]["Fz"][0] == pytest.approx(206, abs=0.5)
    assert offsets["shares"]["Fz"] == pytest.approx(1, abs=0.005)


@pytest.mark.usefixtures("undrawn")
def test_a_stuck_channel_is_left_out_and_named(tmp_path, capsys):
    log = recording()
    force = log.measured["ground_force"].copy()
    force[:, 2] = 0
    path = tmp_path / "log.csv"
    with_channels(log, ground_force=force).save(path)
    arguments = [str(PENDULUM), str(path), "--base", "base", "--name", "stuck", "--out", str(tmp_path)]
    assert identify.main([*arguments, "--verbose"]) == 0
    printed = capsys.readouterr().out
    assert "Stuck at one value, though the model" in printed and "Fz (0)" in printed
    assert "5 channels." in printed and "\nFz " not in printed
    assert "The weight could not be checked: it shows in Fz of the sensor" in printed
    constant = {name: 0 * log.measured[name] + 7 for name in ("ground_force", "ground_torque")}
    with_channels(log, **constant).save(path)
    message = refusal(identify.main, arguments, capsys)
    assert "is constant in every channel (Fx, Fy, Fz, Mx, My, Mz); check sensors and columns." in message


def test_a_log_with_nothing_to_fit_gets_the_lines_that_map_it(tmp_path, capsys):
    log, path, columns = recording(), tmp_path / "log.csv", tmp_path / "columns.toml"
    kept = {name: x for name, x in log.measured.items() if name.startswith("joint")}
    plate = {f"Plate F{a}": log.measured["ground_force"][:, k] for k, a in enumerate("xyz")}
    plate |= {f"Plate M{a}": log.measured["ground_torque"][:, k] for k, a in enumerate("xyz")}
    Recording(log.time, kept | plate).save(path)
    arguments = [str(PENDULUM), str(path), "--base", "base", "--out", str(tmp_path / "out")]
    message, *lines = refusal(identify.main, arguments, capsys).splitlines()
    assert "neither a wrench nor a joint torque to fit" in message and "Plate Fx, Plate Fy" in message
    assert "--columns" in message and len(lines) == 3
    columns.write_text("\n".join(lines), encoding="utf-8")
    prepared = prepare(PENDULUM, path, base="base", columns=columns)
    np.testing.assert_array_equal(prepared.samples.measured, log.wrench("ground").values)


def test_a_finding_on_the_screen_is_a_whole_sentence_if_it_fits():
    cards = [Card("", "Torques rub. Weigh the arm.", False), Card("", "long " * 99, True)]
    whole, cut = identify_report.first_lines(cards)
    assert whole == "  - Torques rub." and cut.startswith("  ! long") and cut.endswith(" …")


@pytest.mark.usefixtures("undrawn")
def test_the_terminal_begins_with_the_verdict_and_is_short(tmp_path, capsys, monkeypatch):
    """However many findings, channels and parameters there are, files and page have them all."""
    long = Finding.of("offsets_taken_out", offsets={f"joint{k}": (0.6, 0.1, "N m") for k in range(12)})
    plain = vars(Estimate)["findings"].func
    findings = property(lambda estimate: [*plain(estimate), *[long] * 20])
    monkeypatch.setattr(Estimate, "findings", findings)
    recording().save(tmp_path / "log.csv")
    arguments = [str(PENDULUM), str(tmp_path / "log.csv"), "--base", "base", "--out", str(tmp_path), "--name", "x"]
    assert identify.main([*arguments, "--estimator", "weighted", "--formats", "none"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("✓ Usable. It predicts ") and len(lines) <= 24
    assert max(map(len, lines[:-1])) <= 120 and "open report.html" in lines[-1]
    assert lines[3].split() == ["channel", "estimate", "model", "best"] and lines[-2].startswith("--verbose prints ")
    assert sum(line.startswith("  - ") for line in lines) == 5
    page = (tmp_path / "x" / "report.html").read_text(encoding="utf-8")
    assert page.count("Constant offsets are taken out") >= 20
    assert identify.main([*arguments, "--estimator", "weighted", "--formats", "none", "--verbose"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("Verdict: ") and "more remark" in shown and "table_base_parameters.md (" in shown

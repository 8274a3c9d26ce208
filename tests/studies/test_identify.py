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
from commands import entries_of, refusal
from pages import PENDULUM
from scipy.signal import butter, sosfiltfilt
from stand_ins import leave_undrawn, once

import scenes
from experiments import identify
from experiments.document.writer import Card
from experiments.reports import identify_page
from experiments.studies.user_files import prepare
from ident.estimate import Estimate
from ident.estimation.preparation import prepared
from ident.geometry.inertia import pseudo_inertia
from ident.identification import identified
from ident.judgement.finding import Finding
from ident.recordings.recording import Recording
from sim.models.model_mechanism import mechanism
from sim.models.mujoco_model import parameters_from_model
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

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
def recording(tilt_deg=0.0):
    return simulate(scenes.load("double_pendulum", tilt_deg=tilt_deg, azimuth_deg=120), DOUBLE_PENDULUM, samples=600)


def with_channels(original, **channels):
    return replace(original, measured={**original.measured, **channels}, true={}, noise={})


def given(folder, log, *more):
    log.save(folder / "log.csv")
    return [str(PENDULUM), str(folder / "log.csv"), "--base", "base", "--name", "me", "--out", str(folder), *more]


def result_of(folder, log, *, model=None, mapping=None, **options):
    path, columns, file = folder / "log.csv", folder / "columns.toml", folder / "model.xml"
    log.save(path)
    columns.write_text(mapping or "", encoding="utf-8")
    if model:
        model.compile()
        file.write_text(model.to_xml(), encoding="utf-8")
    ready = prepare(file if model else PENDULUM, path, base="base", columns=columns if mapping else None)
    return identified(ready, **options)


@pytest.fixture(scope="module")
def aligned(tmp_path_factory):
    """Folder of the command's results for the aligned scene, its estimate, and what it prints."""
    folder, made = tmp_path_factory.mktemp("aligned"), once(identify.identified_from)
    with pytest.MonkeyPatch.context() as patched, redirect_stdout(StringIO()) as printed:
        leave_undrawn(patched)
        patched.setattr(identify, "identified_from", made)
        assert identify.main(given(folder, recording())) == 0
    return folder / "me", made()[0], printed.getvalue()


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
    printed, estimate = capsys.readouterr().out, entries_of(tmp_path / "bow" / "estimate.json")
    held_out = {channel: numbers["ratio"] for channel, numbers in estimate["held_out"].items()}
    assert held_out["Fx"] <= 0.31 and held_out["Fz"] <= 0.42 and held_out["My"] <= 0.23
    value, std = (dict(zip(estimate["columns"], estimate[key], strict=True)) for key in ("values", "std"))
    assert abs(value["m1"] - 61.65) < 0.1 and abs(value["m3rz3"] - 8.5) < 0.4
    assert abs(value["offset(Fx)"] - 4.5) < 2 * std["offset(Fx)"] < 1
    assert printed.startswith("✕ Unusable. One finding speaks against it; it predicts all 3 channels that count.")
    assert "It predicts all 3 channels that count. Not counted: Fy, Mx, Mz" in estimate["verdict"]
    result = identified(prepare(model, DATA / "bowing.csv", columns=bowing, cutoff=3.0), estimator="weighted")
    assert_predicts_as_well(result, parameters_from_model(tmp_path / "bow" / "model.urdf"))


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
    """Checks that bodies are physical, and held-out weighted residuals less than 1 % above those of the free fit."""
    assert (np.linalg.eigvalsh(pseudo_inertia(phi.reshape(-1, 10))) > 0).all()
    explained = [c not in result.unexplained for c in result.channels]
    weights = (result.held_out.samples.measured.std(axis=0) / result.scale)[explained]
    before = np.linalg.norm(result.held_out.ratio[explained] * weights)
    after = np.linalg.norm(result.held_out.ratio_with(result.base.regroup(phi))[explained] * weights)
    assert after < 1.01 * before


def test_tilted_axes_are_found_and_taken_into_account(tmp_path):
    result = result_of(tmp_path, recording(tilt_deg=5.0))
    assert not doubts_of(result)
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
    result = result_of(tmp_path, with_channels(log, **spoilt))
    assert (abs(result.psi - clean.psi) < 1.96 * clean.std).all()
    assert any("outliers" in note for note in result.prepared.notes)


def test_the_updated_scene_reloads_and_needs_the_same_wrenches(aligned):
    folder, result, printed = aligned
    assert_predicts_as_well(result, parameters_from_model(folder / "model.xml", "base"))
    assert mujoco.MjModel.from_xml_path(str(folder / "model.xml")).nu == 2
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64") == 3 and "http" not in page.replace("http-equiv", "")
    assert "<h1>double_pendulum.xml, identified from log.csv</h1>" in page and "2 is link1, 3 is link2" in page
    links = {link for link in re.findall(r'href="([^#"]*)"', page) if link}
    assert {"table_base_parameters.csv", "figure_held_out.svg"} <= links
    assert all((folder / link).is_file() for link in links)
    assert "✓ Usable. It predicts all 5 channels that count; held-out residuals are at most" in printed


def test_a_model_that_is_not_contradicted_keeps_its_bodies_and_others_are_named(tmp_path, aligned):
    assert not coded(aligned[1], "masses_shown", "masses_hardly_shown")
    light = scenes.load("double_pendulum")
    light.body("link2").mass /= 3
    result = result_of(tmp_path, recording(), model=light)
    (named,) = coded(result, "masses_shown", "masses_limited", "masses_hardly_shown")
    assert named.code == "masses_limited" and not named.doubt and named.place.bodies == ("link2",)
    (mass,) = named.values["masses"].values()
    assert mass["model"] == pytest.approx(4.43, abs=0.005) and 4.43 < mass["lower"] < 13.3
    assert 10 < mass["mass"] < 20 and (mass["upper"] is None or mass["upper"] > 13.3)


def test_the_weight_takes_the_vertical_force_alone_and_says_where_it_is_missing(tmp_path):
    def unchecked(result):
        """Reasons for which the weight could not be checked, and channels in which it would show."""
        values = [finding.values for finding in coded(result, "unchecked")]
        return [(each["reason"], *each["channels"]) for each in values if each["check"] == "weight"]

    Fx, Fy, Fz, *moments = (f"ground_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz")
    for force, expected in (
        (["", "", Fz], []),
        ([Fx, Fy, ""], [("not measured", "Fz")]),
        (["", "", ""], [("no force",)]),
    ):
        mapping = f"[wrenches.ground]\nforce = {json.dumps(force)}\ntorque = {json.dumps(moments)}\n"
        result = result_of(tmp_path, recording(), mapping=mapping, **WEIGHTED)
        assert unchecked(result) == expected
        weight = result.checks.weight
        assert (weight is None) == bool(expected)
        assert not weight or (abs(weight.measured - 20.99) < 0.1 and abs(weight.drift) < 0.1)
    weightless = scenes.load("double_pendulum")
    weightless.option.gravity = [0, 0, 0]
    result = result_of(tmp_path, recording(), model=weightless, **WEIGHTED)
    assert unchecked(result) == [("no gravity",)]
    offsets = doubts_of(result)["large_offsets"]
    assert offsets["offsets"]["Fz"][0] == pytest.approx(206, abs=0.5)
    assert offsets["shares"]["Fz"] == pytest.approx(1, abs=0.005)


@pytest.mark.usefixtures("undrawn")
def test_stuck_and_empty_channels_are_left_out_and_named(tmp_path, capsys):
    log, none = recording(), np.full(len(recording().time), np.nan)
    force, commands = log["ground_force"] * [1, 1, 0], {"joint1_command": none, "joint2_command": none}
    spoilt = with_channels(log, ground_force=force, **commands)
    assert identify.main(given(tmp_path, spoilt, "--verbose", "--estimator", "weighted")) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("Verdict: ") and "table_base_parameters.md (" in printed
    assert "Stuck at one value, though the model" in printed and "Fz (0)" in printed
    assert "5 channels." in printed and "\nFz " not in printed
    assert "The weight could not be checked: it shows in Fz of the sensor" in printed
    empty = "Column 'joint1_command' (joints.joint1.command) is empty"
    assert empty in " ".join(printed.split())
    constant = {name: 0 * log[name] + 7 for name in ("ground_force", "ground_torque")}
    message = refusal(identify.main, given(tmp_path, with_channels(log, **constant)), capsys)
    assert "is constant in every channel (Fx, Fy, Fz, Mx, My, Mz); check sensors and columns." in message
    kept = {name: x for name, x in log.measured.items() if name.startswith("joint")}
    assert empty in refusal(identify.main, given(tmp_path, Recording(log.time, kept | commands)), capsys)
    own = prepared(mechanism(PENDULUM, base="base"), Recording(log.time, log.measured | commands))
    assert "Left out, since they have no numbers: joint1_command, joint2_command." in own.notes


def test_a_log_with_nothing_to_fit_is_told_how_its_columns_are_mapped(tmp_path, capsys):
    log = recording()
    kept = {name: x for name, x in log.measured.items() if name.startswith("joint")}
    plate = zip((f"Plate {kind}{axis}" for kind in "FM" for axis in "xyz"), log.wrench("ground").values.T, strict=True)
    message = refusal(identify.main, given(tmp_path, Recording(log.time, kept | dict(plate))), capsys)
    assert "neither a wrench nor a joint torque to fit" in message and "Plate Fx, Plate Fy" in message
    assert "`multicontact columns MODEL LOG`" in message


@pytest.mark.usefixtures("undrawn")
def test_the_terminal_begins_with_the_verdict_and_is_short(tmp_path, capsys, monkeypatch):
    """However many findings, channels and parameters there are, files and page have them all."""
    long = Finding.of("offsets_taken_out", offsets={f"joint{k}": (0.6, 0.1, "N m") for k in range(12)})
    plain = vars(Estimate)["findings"].func
    monkeypatch.setattr(Estimate, "findings", property(lambda estimate: [*plain(estimate), *[long] * 20]))
    monkeypatch.setattr(identify, "identified_from", once(identify.identified_from))
    arguments = given(tmp_path, recording(), "--estimator", "weighted", "--formats", "none")
    assert identify.main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("✓ Usable. It predicts ") and len(lines) <= 24
    assert max(map(len, lines[:-1])) <= 120 and "open report.html" in lines[-1]
    assert lines[3].split() == ["channel", "estimate", "model", "best"] and lines[-2].startswith("--verbose prints ")
    assert sum(line.startswith("  - ") for line in lines) == 5
    assert (tmp_path / "me" / "report.html").read_text(encoding="utf-8").count("Constant offsets are taken out") >= 20
    assert identify.main([*arguments, "--verbose"]) == 0
    assert "more remark" in capsys.readouterr().out
    cards = [Card("", "Torques rub. Weigh the arm.", False), Card("", "long " * 99, True)]
    whole, cut = identify_page.first_lines(cards)
    assert whole == "  - Torques rub." and cut.startswith("  ! long") and cut.endswith(" …")

"""From a laboratory's file to parameters in two commands; and one sentence for bad input."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import entries_of, refusal
from guesses.odd_logs import arm, laboratory, motors, write

import ident
import scenes
from experiments import columns, identify
from experiments.studies.person_recordings import Laboratory, recorded

MODEL = next(iter(scenes.__path__)) + "/double_pendulum.xml"


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("log", [laboratory, pytest.param(motors, marks=pytest.mark.slow)])
def test_two_commands_lead_from_a_file_to_its_parameters(tmp_path, capsys, log):
    path, _ = write(tmp_path, log)
    assert columns.main([MODEL, str(path), "--base", "base"]) == 0
    output = capsys.readouterr().out
    *_, command = output.strip().splitlines()
    assert command == (f"multicontact identify {MODEL} {path} --columns {path.with_suffix('.toml')} --base base")
    assert identify.main([*command.split()[2:], "--out", str(tmp_path), "--name", "out"]) == 0
    estimate = entries_of(tmp_path / "out" / "estimate.json")
    sensors = ident.Sensors(log is laboratory, log is motors)
    truth = ident.find_base_parameters(arm(), sensors=sensors).regroup(arm().known)
    values, std = (np.array(estimate[key])[: len(truth)] for key in ("values", "std_setup"))
    # Gains of motors agree with the model within a few per cent.
    assert np.abs((values - truth) / np.hypot(std, 0.03 * np.abs(truth) * (log is motors))).max() < 4


def test_what_is_there_is_replaced_by_force_alone_and_other_logs_need_the_same_columns(tmp_path, capsys):
    path, _ = write(tmp_path, laboratory)
    arguments, mapping = [MODEL, str(path), "--base", "base"], path.with_suffix(".toml")
    assert columns.main(arguments) == 0
    first = mapping.read_bytes()
    mapping.write_text("# mine")
    message = refusal(columns.main, arguments, capsys)
    assert re.fullmatch(r"python -m experiments\.columns: error: '.*' is there already; --force .*\n", message)
    assert mapping.read_text() == "# mine"
    assert columns.main([*arguments, "--force"]) == 0 and mapping.read_bytes() == first
    another = tmp_path / "another.csv"
    another.write_text(path.read_text().replace("Joint 2 angle", "Joint 2 winkel"))
    message = refusal(columns.main, [MODEL, str(path), str(another), "--base", "base"], capsys)
    assert "another.csv: one mapping serves logs of the same columns, and here is no Joint 2 angle" in message


def test_plates_under_a_person_rest_in_the_world(tmp_path, capsys):
    """Angles with the poses of the base beside forces of two plates, without the plates' places."""
    motion = recorded("squats", 1.0, 0, Laboratory(rate=50.0, rail=False))
    log, model = tmp_path / "angles.csv", tmp_path / "person.xml"
    replace(motion, sensors={}, setup={}).save(log)
    model.write_text(scenes.load("humanoid").to_xml(), encoding="utf-8")
    arguments = [str(model), str(log), "--base", "pelvis"]
    message = refusal(identify.main, [*arguments, "--out", str(tmp_path)], capsys)
    assert "Nothing holds the base, so that a wrench on a body or a joint torque is needed, and none" in message
    assert "columns that are not used are left_force.x, left_force.y, left_force.z" in message
    assert columns.main(arguments) == 0
    assert not re.search("Open:|not used", capsys.readouterr().out)
    wrenches = tomllib.loads((tmp_path / "angles.toml").read_text(encoding="utf-8"))["wrenches"]
    assert {name: (each["frame"], each["on"]) for name, each in wrenches.items()} == {
        side: ("world", f"{side}_foot") for side in ("left", "right")
    }


def test_few_of_many_columns_are_listed(tmp_path, capsys):
    path, _ = write(tmp_path, laboratory)
    header, *rows = path.read_text().splitlines()
    wide = [";".join([header, *(f"x{k}" for k in range(150))])]
    for i, row in enumerate(rows):
        wide.append(";".join([row, *(str(0.1 * (i + k) ** 2 % 7).replace(".", ",") for k in range(150))]))
    path.write_text("\n".join(wide), encoding="utf-8")
    assert columns.main([MODEL, str(path), "--base", "base"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"and \d+ more that change", printed) and len(printed.splitlines()) < 150


@pytest.mark.parametrize("huge", ["9e29", "-1e100"])
def test_numbers_that_no_sensor_reads_do_not_overflow(tmp_path, huge):
    folder, log = Path(MODEL).parent, tmp_path / "arm.csv"
    rows = (folder / "arm.csv").read_text(encoding="utf-8").splitlines()[:200]
    rows[100] = rows[100].replace(rows[100].split(",")[1], huge)
    log.write_text("\n".join(rows), encoding="utf-8")
    assert columns.main([str(folder / "arm.xml"), str(log), "--base", "base"]) == 0

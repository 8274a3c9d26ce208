"""The command that identifies a robot's payload: its files, forms for other programs, and bad input."""

import re
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
import wrist
from commands import entries_of, refusal
from stand_ins import once
from written_formats import write_csv

from experiments import payload
from ident.payload import beyond_sensor

COLUMNS = """
[wrenches.wrist]
body = "tool"
force = ["fx", "fy", "fz"]
torque = ["tx", "ty", "tz"]
position = [0, 0, 0.01]
rpy_deg = [0, 0, 45]
applied_to_link = true
"""


@pytest.fixture
def files(tmp_path):
    """The arm with a tool whose mass is wrong, and a log in two files with their own columns."""
    model, log, felt, columns = (tmp_path / name for name in ("arm.xml", "run.csv", "felt.csv", "columns.toml"))
    model.write_text(wrist.model(tool={**wrist.TOOL, "mass": 0.25}), encoding="utf-8")
    recording = wrist.log(seconds=5.0)
    angles = [recording[f"{joint}_position"] for joint in wrist.JOINTS]
    wrench = [*recording["wrist_force"].T, *recording["wrist_torque"].T]
    for path, names, cells in ((log, wrist.JOINTS, angles), (felt, ("fx", "fy", "fz", "tx", "ty", "tz"), wrench)):
        write_csv(path, {"time": recording.time} | dict(zip(names, cells, strict=True)))
    columns.write_text(COLUMNS, encoding="utf-8")
    return [str(model), f"{log}+{felt}", "--body", "tool", "--sensor", "wrist", "--columns", str(columns)]


@pytest.mark.usefixtures("undrawn")
def test_a_payload_comes_out_in_every_form_and_a_screen_has_the_numbers(files, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(beyond_sensor, "identify_payload", once(beyond_sensor.identify_payload))
    files += ["--name", "out", "--out", str(tmp_path)]
    assert payload.main([*files, "--flange", "link7", "--verbose"]) == 0
    printed, out = capsys.readouterr().out, tmp_path / "out"
    assert (out / "table_flange.csv").exists()
    written = entries_of(out / "payload.json")
    values, at_flange = (written["frames"][name]["values"] for name in ("tool", "link7"))
    assert written["verdict"].startswith("Usable") and abs(values[0] - 0.1) < 0.002
    text = (out / "payload.txt").read_text(encoding="utf-8")
    assert text in printed and "Verdict: Usable" in printed

    urdf = ET.fromstring(re.search(r"<inertial>.*?</inertial>", text, re.DOTALL)[0])
    numbers = [urdf.find("mass").get("value"), *urdf.find("origin").get("xyz").split()]
    numbers += [urdf.find("inertia").get(f"i{axes}") for axes in ("xx", "yy", "zz", "xy", "xz", "yz")]
    np.testing.assert_allclose(np.array(numbers, float), values, rtol=1e-5)

    inertial = re.search(r"<inertial mass.*?/>", text)[0]
    body = f'<mujoco><worldbody><body name="tool">{inertial}</body></worldbody></mujoco>'
    compiled = mujoco.MjModel.from_xml_string(body).body("tool")
    updated = mujoco.MjModel.from_xml_path(str(out / "model.xml")).body("tool")
    for key in ("mass", "ipos", "inertia"):
        np.testing.assert_allclose(*(np.sort(getattr(each, key)) for each in (compiled, updated)), rtol=1e-4, atol=1e-9)

    def arguments_of(function):
        return [float(x) for x in re.findall(r"[-\d.e]+", re.search(rf"{function}\((.*)\)", text)[1])]

    np.testing.assert_allclose(arguments_of("set_target_payload"), at_flange, rtol=1e-5)
    assert at_flange[3] - values[3] == pytest.approx(0.107)
    xx, yy, zz, xy, xz, yz = at_flange[4:]
    np.testing.assert_allclose(arguments_of("setLoad")[4:], [xx, xy, xz, xy, yy, yz, xz, yz, zz], rtol=1e-5)

    (log,) = entries_of(out / "provenance.json")["recording"]["logs"]
    assert [(each["file"], len(each["sha256"])) for each in log["files"]] == [("run.csv", 64), ("felt.csv", 64)]
    assert log["samples"] == 500
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "set_target_payload" in page and "&lt;inertial" in page

    assert payload.main(files) == 0
    lines = capsys.readouterr().out.splitlines()
    _, _, estimate, _, _, model = next(line for line in lines if line.startswith("mass ")).split()
    assert not (out / "table_flange.csv").exists(), "the flange is the body itself"
    assert len(model) == len(estimate), "the model's value has the estimate's decimals"
    assert len(lines) <= 24 and max(map(len, lines)) <= 120 and lines[0].startswith("✓ Usable. ")
    assert any(line.startswith("Iyz ") for line in lines) and "setLoad" not in " ".join(lines)
    assert "payload.txt has these for URDF" in " ".join(lines)


def test_a_flange_is_refused_before_anything_is_fitted(files, monkeypatch, capsys):
    monkeypatch.setattr(beyond_sensor, "identify_payload", None)
    for flange, sentence in {"tcp": "body or site, got 'tcp'; bodies and", "link5": "is on 'link5', which"}.items():
        assert sentence in refusal(payload.main, [*files, "--flange", flange], capsys)


@pytest.mark.parametrize(
    ("old", "new", "lacking"), [('torque = ["tx", "ty", "tz"]\n', "", "Mx, My, Mz"), ('"ty"', '""', "My")]
)
def test_a_log_without_the_whole_wrench_is_named_with_what_it_lacks(files, tmp_path, old, new, lacking, capsys):
    (tmp_path / "columns.toml").write_text(COLUMNS.replace(old, new), encoding="utf-8")
    error = refusal(payload.main, files, capsys)
    assert f"error: {files[1]}: A payload needs all six components of the wrench 'wrist'" in error
    assert error.endswith(f"missing or constant: {lacking}.\n")

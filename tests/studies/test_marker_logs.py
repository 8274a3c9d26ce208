"""`identify MODEL.osim TRIAL.trc+PLATES.mot`: angles are fitted to markers first, and missing ones are reported."""

from pathlib import Path

import pytest
from commands import refusal
from opensim_walker import leg, trial

from experiments.identify import main

PLATE = """[base]
held = false
[wrenches.plate]
frame = "world"
on = "tibia"
force = ["ground_force_1_vx", "ground_force_1_vy", "ground_force_1_vz"]
point = ["ground_force_1_px", "ground_force_1_py", "ground_force_1_pz"]
free_moment = ["ground_force_1_mx", "ground_force_1_my", "ground_force_1_mz"]
"""
pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("leg")
    trial(out, leg(out))
    (out / "plate.toml").write_text(PLATE)
    return out


def log_of(folder):
    return Path(f"{folder / 'walk.trc'}+{folder / 'walk.mot'}")


def test_what_is_wrong_is_said_of_the_files_that_were_given(folder, tmp_path, capsys):
    (tmp_path / "bad.toml").write_text(PLATE.replace("ground_force_1_vx", "gone"))
    given = [str(folder / "leg.osim"), str(log_of(folder)), "--out", str(tmp_path / "out"), "--columns"]
    message = refusal(main, [*given, str(tmp_path / "bad.toml")], capsys)
    assert f"{log_of(folder)}: " in message and "'gone'" in message and "/tmp" not in message.replace(str(folder), "")
    lines = (folder / "walk.trc").read_text(encoding="utf-8").replace("tibia", "other")
    (tmp_path / "walk.trc").write_text(lines, encoding="utf-8")
    message = refusal(main, [given[0], f"{tmp_path / 'walk.trc'}+{folder / 'walk.mot'}", *given[2:], "x"], capsys)
    assert "the markers do not determine knee; leave what they do not tell of out by --fix knee." in message

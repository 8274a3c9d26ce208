"""From angles in one file and forces in another to parameters, by the commands alone."""

import json
from pathlib import Path

import numpy as np
import pytest
from guesses.odd_logs import recording
from written_formats import DEG, write_csv, write_mot

import scenes
from experiments import columns, identify

MODEL = str(Path(scenes.__file__).parent / "double_pendulum.xml")


def files(tmp_path, number=1):
    """OpenSim's pair of files, with a plate at its own rate and other column names."""
    angles, forces = tmp_path / f"trial{number}_ik.mot", tmp_path / f"trial{number}_grf.csv"
    taken = slice(100 * number, 100 * number + 250)
    time, wrench = recording().time[taken], recording().wrench("ground").values[taken]
    write_mot(angles, {"time": time, **{f"joint{k}": DEG * recording()[f"joint{k}_position"][taken] for k in (1, 2)}})
    own = np.arange(time[0], time[-1], 1 / 200)
    names = [f"plate_{letter}{axis}" for letter in "fm" for axis in "xyz"]
    write_csv(
        forces,
        {"clock_ms": 1e3 * own, **{name: np.interp(own, time, x) for name, x in zip(names, wrench.T, strict=True)}},
    )
    return f"{angles}+{forces}"


@pytest.mark.usefixtures("undrawn")
def test_two_commands_lead_from_two_files_to_parameters(tmp_path, capsys):
    log = files(tmp_path)
    assert columns.main([MODEL, log, "--base", "base"]) == 0
    *_, command = capsys.readouterr().out.strip().splitlines()
    written = (tmp_path / "trial1_ik.toml").read_text(encoding="utf-8")
    assert 'time = [{ column = "time", unit = "s" }, { column = "clock_ms", unit = "ms" }]' in written
    arguments = [*command.split()[2:], "--out", str(tmp_path), "--name", "out"]
    assert identify.main(arguments) == 0
    logs = json.loads((tmp_path / "out" / "provenance.json").read_text(encoding="utf-8"))["recording"]["logs"]
    assert [each["file"] for each in logs[0]["files"]] == ["trial1_ik.mot", "trial1_grf.csv"]
    estimate = json.loads((tmp_path / "out" / "estimate.json").read_text(encoding="utf-8"))
    assert estimate["held_out"]["Mx"]["ratio"] < 0.2 and estimate["held_out"]["Fz"]["ratio"] < 0.5

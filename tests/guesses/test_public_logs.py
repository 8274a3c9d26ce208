"""Logs as public data sets and drivers write them: numbered wrenches, percentages, arrays, namespaces and mirrors."""

import json
from importlib.resources import files

import numpy as np
import pytest
from guesses.test_laboratory_names import ARM, JOINTS, TAU, TIME, Q, belief_of, columns_of, mapped

import ident
import scenes
import sim
from experiments.guesses.belief import DOUBTFUL, write_mapping
from experiments.guesses.guess import believed

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


@pytest.mark.parametrize(
    ("name", "size"), [("observation.state.{n}.pos", 95.0), ("{n} pos [%]", 40.0), ("{n}_percent", 9.0)]
)
def test_percentages_of_a_range_are_no_degrees(tmp_path, name, size):
    belief = belief_of(tmp_path, columns_of(name, size / np.abs(Q).max() * Q))
    assert mapped(belief, "position") == {} and "percentages of calibrated ranges" in belief.open[0]
    assert {x.sure for x in belief.quantities.values()} == {DOUBTFUL}


def test_a_mirrored_component_of_a_wrench_gets_a_gain(tmp_path):
    arm = sim.mechanism(scenes.load("arm"), base="base")
    columns = ident.read_log(str(files(scenes) / "arm.csv"), arm).measured
    wrench = np.hstack([columns["ground_force"], columns["ground_torque"]])
    belief = belief_of(
        tmp_path,
        {f"{joint}_position": columns[f"{joint}_position"] for joint in arm.joints}
        | dict(zip([f"plate_{x}" for x in WRENCH], (wrench * [1, -1, 1, 1, 1, 1]).T, strict=True)),
        arm,
    )
    write_mapping(tmp_path / "c.toml", belief)
    read = ident.read_log(tmp_path / "log.csv", arm, tmp_path / "c.toml")
    np.testing.assert_allclose(read["ground_force"], wrench[:, :3], atol=1e-5)


@pytest.mark.parametrize("stamp", [False, True])
@pytest.mark.parametrize("torque", ["effort", "torque"])
def test_json_lines_of_three_joints_are_no_vectors(tmp_path, stamp, torque):
    rows = zip(TIME, Q, TAU, strict=True)
    clock = (
        (lambda t: {"header": {"stamp": {"sec": int(t), "nanosec": round(t % 1 * 1e9)}}})
        if stamp
        else lambda t: {"t": t}
    )
    lines = [
        json.dumps({**clock(t), "name": JOINTS, "position": q.tolist(), torque: tau.tolist()}) for t, q, tau in rows
    ]
    (tmp_path / "log.jsonl").write_text("\n".join(lines))
    belief = believed(ARM, [tmp_path / "log.jsonl"])
    assert mapped(belief, "position") == {n: f"position.{x}" for n, x in zip(JOINTS, "xyz", strict=True)}
    assert mapped(belief, "torque") == {n: f"{torque}.{x}" for n, x in zip(JOINTS, "xyz", strict=True)}
    write_mapping(tmp_path / "c.toml", belief)
    read = ident.read_log(tmp_path / "log.jsonl", ARM, tmp_path / "c.toml")
    np.testing.assert_allclose(read["lift_torque"], TAU[:, 1], atol=1e-6)


def test_a_wrench_that_no_model_could_place_is_asked_about(tmp_path):
    columns = columns_of("{n}_position", Q[:17]) | dict(zip(WRENCH, np.hstack([Q, TAU])[:17].T, strict=True))
    belief = belief_of(tmp_path, columns)
    assert "ground" not in belief.groups and "It is open where" in belief.open[0]

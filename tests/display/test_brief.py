"""Recordings, mechanisms, regroupings and payloads in a few lines."""

import driven_arm
import numpy as np
import pytest

import ident


@pytest.mark.parametrize(
    ("thing", "parts"),
    [
        (lambda: driven_arm.log(6.0, 50.0), ["300 at 50 Hz", "turn_position", "bend_torque"]),
        (driven_arm.mechanism, ["column, upper, fore", "turn, lift, bend", "8.5 kg in 3 bodies"]),
        (lambda: ident.find_base_parameters(driven_arm.mechanism()), ["of 30 parameters", "m1 + m2 + m3"]),
    ],
)
def test_a_repr_has_at_most_ten_lines_and_says_the_most_important(thing, parts):
    made = thing()
    lines = repr(made).splitlines()
    assert len(lines) <= 10 and max(map(len, lines)) <= 100
    html = made._repr_html_()
    assert all(part in repr(made) and part in html for part in parts)
    assert lines[0] == f"<{type(made).__name__}" and lines[-1].endswith(">")


def test_a_recording_is_plotted_with_all_that_it_measures():
    log = driven_arm.log(6.0, 50.0)
    wrenches = {"ground_force": np.ones((300, 3)), "ground_torque": np.zeros((300, 3))}
    of_body = {"hand_position": np.zeros((300, 3)), "hip_position": np.tile([1.0, 0, 0, 0], (300, 1))}
    recording = ident.Recording(log.time, {**log.measured, **wrenches, **of_body}, units={"lift_torque": "mN m"})
    panels = {ax.get_ylabel(): {line.get_label(): line for line in ax.lines} for ax in recording.plot().axes}
    joints = (*driven_arm.JOINTS, *(f"hip.{x}" for x in "wxyz"))
    assert {label: tuple(lines) for label, lines in panels.items()} == {
        "Joint position\n(rad or m)": joints,
        "Joint torque\n(N m or N, mN m)": driven_arm.JOINTS,
        "Force ground\n(N)": ("F.x", "F.y", "F.z"),
        "Moment ground\n(N m)": ("M.x", "M.y", "M.z"),
    }
    line = panels["Joint position\n(rad or m)"]["lift"]
    np.testing.assert_array_equal(line.get_xydata(), np.stack([log.time, log["lift_position"]], axis=1))


def test_a_recording_as_a_data_frame_is_read_back(monkeypatch):
    pytest.importorskip("pandas")
    log = driven_arm.log(4.0, 50.0)
    recording = ident.Recording(log.time, {**log.measured, "ground_force": np.ones((200, 3))})
    frame = recording.to_frame()
    assert frame.index.name == "time" and [name for name in frame if "force" in name] == [
        "ground_force.x",
        "ground_force.y",
        "ground_force.z",
    ]
    again = ident.read_log(frame, driven_arm.mechanism())
    np.testing.assert_allclose(again.time, log.time)
    assert {*log.measured} <= {*again.measured} and (again["bend_torque"] == log["bend_torque"]).all()

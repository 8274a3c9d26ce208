"""Names and sensors of laboratories and of public data sets: series, units, commands, percentages, wrist sensors."""

import json
import re
from importlib.resources import files
from pathlib import Path

import mujoco
import numpy as np
import pytest
import wrist
from guesses.forty_logs import series, seven
from guesses.odd_logs import DEG, belief_of, read_as_guessed, text, vector
from mechanisms import by_joint, sines

import ident
import scenes
import sim
from experiments import columns as command
from experiments.guesses.belief import DOUBTFUL, SURE, write_mapping
from experiments.guesses.guess import believed
from experiments.guesses.log_contents import log_contents
from ident import Motion, identify_payload
from ident.estimation.equations import predicted_channels
from ident.files.csv_file import Layout

TIME = np.arange(900) / 100
JOINTS = ("pan", "lift", "elbow")
LINK = '<body name="{1}" pos="{2}"><joint name="{0}" axis="{3}"/><inertial mass="2" pos=".12 .02 .05" {4}/>'
LINKS = zip(JOINTS, ("l1", "l2", "l3"), ("0 0 .1", "0 0 .2", ".3 0 0"), ("0 0 1", "0 1 0", "0 1 0"), strict=True)
CHAIN = "".join(LINK.format(*link, 'diaginertia=".02 .01 .02"') for link in LINKS) + 3 * "</body>"
MODEL = f"<mujoco><worldbody>{CHAIN}</worldbody></mujoco>"
ARM = sim.mechanism(mujoco.MjSpec.from_string(MODEL))
ROBOT = sim.mechanism(mujoco.MjSpec.from_string(wrist.model()))
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


def noisy_log():
    """Positions and torques of sums of four sines, with some noise (N, 3)."""
    rng = np.random.default_rng(3)
    size, phase = 0.5 * rng.uniform(0.3, 1, (3, 4)), rng.uniform(0, 6, (3, 4))
    q, *rates = sines(TIME, size, np.array([0.9, 1.7, 2.9, 4.1]), phase)
    exact = predicted_channels(ARM, Motion(q, *rates), np.eye(4), torques=True)
    tau = np.stack([exact[joint] for joint in JOINTS], axis=1)
    return q + 1e-4 * rng.normal(size=q.shape), tau + 0.02 * rng.normal(size=tau.shape)


Q, TAU = noisy_log()


def columns_of(pattern, x):
    return {pattern.format(k, n=joint): own for k, (joint, own) in enumerate(zip(JOINTS, x.T, strict=True), start=1)}


def names(pattern):
    """Columns of the joints by their names."""
    return dict(zip(JOINTS, columns_of(pattern, Q), strict=True))


def mapped(belief, kind):
    return {joint: x.column for joint, x in belief.of(kind).items()}


@pytest.mark.parametrize(
    ("position", "torque"),
    [
        *(("axis{}", "torque{}"), ("A{}", "M{}"), ("q{}", "u{}"), ("jointpos{}", "jointtorque{}")),
        *(("Gelenk{} Winkel", "Gelenk{} Moment"), ("{n}_rad", "{n}_nm"), ("{n}Pos", "{n}Tau")),
        ("$AXIS_ACT.A{}", "$TORQUE_AXIS_ACT[{}]"),
    ],
)
def test_positions_and_torques_of_a_laboratory_are_known(tmp_path, position, torque):
    factor = 1.0 if "rad" in position else DEG
    belief = belief_of(tmp_path, columns_of(position, factor * Q) | columns_of(torque, TAU), ARM)
    assert mapped(belief, "position") == names(position), belief.open
    assert mapped(belief, "torque") == names(torque)
    assert {x.unit for x in belief.of("position").values()} == {"deg" if factor > 1 else "rad"}


@pytest.mark.parametrize("torque", ["joint{}_effort", "joint{}_torque_Nm", "joint{}_tau"])
def test_torques_have_the_numbers_of_positions_that_are_named_exactly(tmp_path, torque):
    """Also of a joint about the vertical whose torque is mostly friction, which the model does not explain."""
    text = MODEL
    for k, joint in enumerate(JOINTS, start=1):
        text = text.replace(f'"{joint}"', f'"joint{k}"')
    rubs = TAU + [8, 0, 0] * np.sign(np.gradient(Q, axis=0))
    columns = columns_of("joint{}_position", Q) | columns_of(torque, rubs)
    belief = belief_of(tmp_path, columns, sim.mechanism(mujoco.MjSpec.from_string(text)))
    assert mapped(belief, "torque") == {f"joint{k}": torque.format(k) for k in (1, 2, 3)}


MIXED = tuple(f"axis{k}" for k in range(1, 5))


def with_slide():
    """Arm whose third joint is a slide, and its positions and torques (N, 4)."""
    axes = zip(MIXED, ("l1", "l2", "l3", "l4"), ("0 0 .1", "0 0 .2", ".3 0 0", "0 0 .1"), "zyxy", strict=True)
    vectors = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    chain = "".join(LINK.format(*own, vectors[axis], 'diaginertia=".02 .01 .02"') for *own, axis in axes)
    chain = chain.replace('name="axis3" axis', 'name="axis3" type="slide" axis')
    arm = sim.mechanism(mujoco.MjSpec.from_string(f"<mujoco><worldbody>{chain}{4 * '</body>'}</worldbody></mujoco>"))
    rng, size = np.random.default_rng(4), np.array([0.5, 0.4, 0.1, 0.5])[:, None]
    q, *rates = sines(
        TIME, size * rng.uniform(0.3, 1, (4, 4)), np.array([0.9, 1.7, 2.9, 4.1]), rng.uniform(0, 6, (4, 4))
    )
    exact = predicted_channels(arm, Motion(q, *rates), np.eye(4), torques=True)
    tau = np.stack([exact[joint] for joint in MIXED], axis=1)
    return arm, q + 1e-5 * rng.normal(size=q.shape), tau + 0.02 * rng.normal(size=tau.shape)


@pytest.mark.parametrize("pattern", ["axis{}_pos_{}/axis{}_torque_Nm/axis{}_force_N", "A{}_{}/T{}_Nm/F{}_N"])
@pytest.mark.parametrize("lacks_slide", [False, True])
def test_a_slide_among_hinges_has_the_column_of_its_number_and_unit(tmp_path, pattern, lacks_slide):
    arm, q, tau = with_slide()
    position, torque, force = pattern.split("/")
    units, forces = ("deg", "deg", "mm", "deg"), (torque, torque, force, torque)
    positions = [position.format(k, unit) for k, unit in enumerate(units, start=1)]
    torques = [name.format(k) for k, name in enumerate(forces, start=1)]
    kept = [0, 1, 3] if lacks_slide else [0, 1, 2, 3]
    columns = {positions[k]: (DEG if units[k] == "deg" else 1e3) * q[:, k] for k in kept}
    belief = belief_of(tmp_path, columns | {torques[k]: tau[:, k] for k in kept}, arm)
    assert mapped(belief, "position") == {MIXED[k]: positions[k] for k in kept}, belief.open
    assert mapped(belief, "torque") == {MIXED[k]: torques[k] for k in kept}
    assert {x.unit for x in belief.of("position").values()} == {units[k] for k in kept}
    assert [sentence for sentence in belief.open if "'axis3'" in sentence] == belief.open and any(
        belief.open
    ) == lacks_slide


def test_a_slide_is_not_measured_in_degrees(tmp_path):
    arm, q, tau = with_slide()
    columns = {f"{joint}_deg": DEG * x for joint, x in zip(MIXED, q.T, strict=True)}
    belief = belief_of(tmp_path, columns | by_joint(MIXED, torque=tau), arm)
    assert mapped(belief, "position") == {joint: f"{joint}_deg" for joint in MIXED if joint != "axis3"}
    assert "The position of 'axis3', a slide, may be in axis3_deg, whose name states deg" in belief.open[0]


@pytest.mark.parametrize(("reversed_", "factor"), [("lift", 1.0), ("elbow", DEG)])
def test_a_reversed_encoder_does_not_change_the_unit(tmp_path, reversed_, factor):
    """Of small motions, which a model whose angles are far too small explains better than one of opposite sign."""
    rng = np.random.default_rng(3)
    q, *rates = sines(TIME, rng.uniform(0.05, 0.15, (3, 4)), np.array([0.9, 1.7, 2.9, 4.1]), rng.uniform(0, 6, (3, 4)))
    exact = predicted_channels(ARM, Motion(q, *rates), np.eye(4))
    wrench = np.stack([exact[c] for c in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")], axis=1)
    plate = dict(zip(WRENCH, (wrench + 0.02 * rng.normal(size=wrench.shape)).T, strict=True))
    signs = np.where(np.array(JOINTS) == reversed_, -factor, factor)
    belief = belief_of(tmp_path, columns_of("{n}_position", signs * q) | plate, ARM)
    positions = belief.of("position")
    assert {x.unit for x in positions.values()} == {"deg" if factor > 1 else "rad"}
    assert [joint for joint, x in positions.items() if x.gain < 0] == [reversed_]
    assert "turned, since the model explains" in positions[reversed_].why[-1]


@pytest.mark.parametrize("order", [range(7), (0, 3, 6, 4, 1, 2, 5)])
def test_joints_with_names_of_their_own_are_found_whatever_their_order(tmp_path, order):
    robot, own = seven(), ("base", "shoulder", "upper arm", "elbow", "forearm", "wrist", "flange")
    columns = {"time": robot.time} | {f"{own[k]} angle [deg]": DEG * robot.q[:, k] for k in order}
    belief = belief_of(tmp_path, columns | {f"{own[k]} torque [Nm]": robot.tau[:, k] for k in order}, robot.mechanism)
    assert belief.open == [] and belief.complete
    for kind, quantity in (("position", "angle [deg]"), ("torque", "torque [Nm]")):
        assert mapped(belief, kind) == {joint: f"{n} {quantity}" for joint, n in zip(robot.joints, own, strict=True)}


def test_joints_with_names_of_their_own_are_found_in_degrees_that_no_name_states(tmp_path):
    """Below 60 degrees, so that their size leaves open whether they are radians."""
    robot, own = seven(), ("base", "shoulder", "upper arm", "elbow", "forearm", "wrist", "flange")
    q = 0.4 * robot.q
    dq = np.gradient(q, robot.time, axis=0)
    states, tree = (q, dq, np.gradient(dq, robot.time, axis=0)), robot.mechanism.tree
    tau = ident.joint_torque_regressor(tree, *states, gravity=robot.mechanism.gravity) @ robot.mechanism.known
    order = 0, 3, 6, 4, 1, 2, 5
    columns = {"time": robot.time} | {f"{own[k]} angle": DEG * q[:, k] for k in order}
    columns |= {f"{own[k]} torque [Nm]": tau[:, k] for k in order}
    belief = belief_of(tmp_path, columns, robot.mechanism)
    assert mapped(belief, "position") == {joint: f"{n} angle" for joint, n in zip(robot.joints, own, strict=True)}
    assert {x.unit for x in belief.of("position").values()} == {"deg"}


@pytest.mark.parametrize("joint", ["lift", "elbow"])
def test_a_joint_and_its_torque_of_opposite_sign_are_turned(tmp_path, joint):
    """Beside rotors another joint's sign explains half of the rest as well; no axes of a wrench are in doubt."""
    acceleration = np.gradient(np.gradient(Q, axis=0), axis=0) / 0.01**2
    tau = TAU + acceleration + 0.5 * np.sign(np.gradient(Q, axis=0))
    signs = np.where(np.array(JOINTS) == joint, -1, 1)
    columns = columns_of("{n}_position", signs * Q) | columns_of("{n}_torque", signs * tau)
    belief = belief_of(tmp_path, columns, ARM)
    for kind in ("position", "torque"):
        assert [x.gain for x in belief.of(kind).values()] == signs.tolist()
    assert belief.open == []


def test_torques_are_in_the_unit_of_the_others(tmp_path):
    """Also one that friction hides from the model."""
    rubs = 1e3 * (TAU + [8, 0, 0] * np.sign(np.gradient(Q, axis=0)))
    belief = belief_of(tmp_path, columns_of("{n}_position", Q) | columns_of("{n}_torque", rubs), ARM)
    assert {x.unit for x in belief.of("torque").values()} == {"N mm"}


def test_rows_of_words_and_numbers_have_no_header(tmp_path):
    """As those of ros2 topic echo --csv: stamp, frame, names, positions and efforts."""
    robot, columns = seven(), [str(k + 1) for k in range(24)]
    stamps = [f"{1700000000 + int(t)},{round(t % 1 * 1e9)},,{','.join(robot.joints)}" for t in robot.time]
    numbers = np.hstack([robot.q, robot.tau]).tolist()
    rows = [",".join([stamp, *map(repr, row)]) for stamp, row in zip(stamps, numbers, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    belief = believed(robot.mechanism, [tmp_path / "log.csv"], rate=50.0)
    for kind, first in (("position", 10), ("torque", 17)):
        assert mapped(belief, kind) == dict(zip(robot.joints, columns[first : first + 7], strict=True)), belief.open
    read = read_as_guessed(tmp_path, belief, robot.mechanism)
    np.testing.assert_allclose(read.of_joints(robot.joints, "position"), robot.q, atol=1e-9)


def test_names_that_are_numbers_are_no_samples(tmp_path):
    columns = {"time": TIME} | {str(k): x for k, x in enumerate(np.hstack([Q, TAU]).T, start=1)}
    (tmp_path / "log.csv").write_text(text(columns), encoding="utf-8")
    log = log_contents(tmp_path / "log.csv")
    assert log.layouts == (Layout(header=False, skip=1),)
    np.testing.assert_allclose(log.samples["2"], Q[:, 0])


def test_a_counter_of_samples_is_no_time(tmp_path):
    columns = {"Frame": np.arange(900)} | columns_of("{n}_position", Q) | columns_of("{n}_torque", TAU)
    (tmp_path / "log.csv").write_text(text(columns), encoding="utf-8")
    with pytest.raises(ident.LogError, match=r"'Frame' counts samples; a log needs one, or --rate HZ"):
        believed(ARM, [tmp_path / "log.csv"])
    assert believed(ARM, [tmp_path / "log.csv"], rate=100.0).complete


@pytest.mark.parametrize("torque", ["actual_current_{}", None])
def test_numbers_of_a_known_driver_are_those_of_the_joints(tmp_path, torque):
    """Also where the model explains less than half of what is measured, for friction, or nothing is measured."""
    joints = ("shoulder", "lift", "elbow")
    arm = sim.mechanism(mujoco.MjSpec.from_string(MODEL.replace('"pan"', '"shoulder"')))
    rubs = TAU + [16, 16, 8] * np.sign(np.gradient(Q, axis=0))
    rubs += 3 * np.random.default_rng(0).normal(size=rubs.shape)
    columns = series("actual_q_{}", Q) | (series(torque, rubs) if torque else {})
    belief = belief_of(tmp_path, columns, arm)
    assert mapped(belief, "position") == {joint: f"actual_q_{k}" for k, joint in enumerate(joints)}
    others = {name.replace("actual_q", "motor_q"): x for name, x in columns.items()}
    belief, path = belief_of(tmp_path, others, arm), tmp_path / "log.toml"
    write_mapping(path, belief)
    assert mapped(belief, "position") == {}
    assert '# position = { column = "motor_q_0", unit = "rad" }    # ? tried: in the model\'s order' in path.read_text()
    assert torque is None or "what is measured, where it takes 50 %" in belief.open[0]
    backwards = series("actual_q_{}", Q[:, ::-1]) | series("tau_{}", TAU[:, ::-1])
    reverse = {joint: f"actual_q_{2 - k}" for k, joint in enumerate(joints)}
    assert mapped(belief_of(tmp_path, backwards, arm), "position") == reverse


@pytest.mark.parametrize(("current", "unit"), [("{n}_current_A", "A"), ("motor_current_{} [mA]", "mA")])
def test_currents_that_the_model_does_not_explain_ask_for_their_gains(tmp_path, current, unit):
    rubs = TAU / 4 + 2 * np.sign(np.gradient(Q, axis=0))
    belief = belief_of(tmp_path, columns_of("{n}_position", Q) | columns_of(current, rubs), ARM)
    first, *_, last = columns_of(current, Q)
    entry = f'torque = {{ column = "{first}", unit = "{unit}", gain = GAIN }}'
    assert mapped(belief, "torque") == {}
    assert any(f"not known here: {first} to {last}. State {entry}" in note for note in belief.notes)


def test_a_velocity_whose_name_has_a_unit_shows_that_of_the_position(tmp_path):
    rates = np.gradient(8 * Q, TIME, axis=0)
    columns = columns_of("{n}_position", 8 * Q) | columns_of("{n}_velocity [rad/s]", rates)
    belief = belief_of(tmp_path, columns, ARM)
    assert {(x.unit, x.sure) for x in belief.of("position").values()} == {("rad", SURE)}


@pytest.mark.parametrize(
    ("measured", "commanded"),
    [
        *(("observation.state.{n}.position", "action.{n}.position"), ("observation.state.{n}", "action.{n}")),
        *(("{n}_pos", "{n}_goal"), ("{n}_pos", "{n}_command"), ("position_{n}", "q_d_{n}")),
        *(("{n}.present_position", "{n}.goal_position"), ("{n} ist", "{n} soll")),
    ],
)
def test_commanded_positions_are_commands(tmp_path, measured, commanded):
    columns, path = columns_of(commanded, DEG * (Q + 0.05 * TAU)) | columns_of(measured, DEG * Q), tmp_path / "c.toml"
    belief = belief_of(tmp_path, columns, ARM)
    assert mapped(belief, "command") == names(commanded), belief.open
    assert mapped(belief, "position") == names(measured)
    write_mapping(path, belief)
    path.write_text(re.sub(r"^(\[joints\..*)$", r"\1\nkp = 20", path.read_text(), flags=re.MULTILINE))
    read = ident.read_log(tmp_path / "log.csv", ARM, path)
    np.testing.assert_allclose(read["lift_command"], Q[:, 1] + 0.05 * TAU[:, 1], atol=1e-6)


@pytest.mark.parametrize(
    ("own", "size", "command"),
    [
        (("position", "torque"), 1, False),
        (("actual position", "commanded position"), 10, True),
        (("angle", "x"), 1, False),
        (("q", "u"), 0.4, False),
        (("q", "u"), 0.6, True),
        (("q", "u"), 1.8, True),
        (("q", "u"), 2.2, False),
    ],
)
def test_the_only_position_is_that_of_the_only_joint_and_what_follows_it_its_command(tmp_path, own, size, command):
    """Torques are called u as well, but hardly are as large."""
    fixed = ARM.fixed({"pan": [0.0], "elbow": [0.0]})
    belief = belief_of(tmp_path, {own[0]: Q[:, 1], own[1]: size * (Q[:, 1] + 0.05 * np.roll(Q[:, 1], 3))}, fixed)
    assert mapped(belief, "position") == {"lift": own[0]}
    assert mapped(belief, "command") == ({"lift": own[1]} if command else {})


def with_sensor(force, torque, text=None):
    """Columns of an arm with a sensor at its wrist."""
    log = wrist.log(seconds=6.0, rate=50.0, text=text)
    columns = {"time": log.time} | {f"{joint}_position": log[f"{joint}_position"] for joint in wrist.JOINTS}
    return columns | vector(force, log["wrist_force"] + 3) | vector(torque, log["wrist_torque"])


def of_sensor(folder, columns):
    """The only wrench of a log, and the belief."""
    belief = belief_of(folder, columns, ROBOT)
    (group,) = belief.groups.values()
    assert group.name != "ground" and group.is_inner and group.entries["body"].value == "tool"
    assert group.entries["unit"].value == "N" and all("correct its position" in sentence for sentence in belief.open)
    return group, belief


def test_a_wrist_sensor_beside_torques_or_without_moments_is_a_remark_for_payload(tmp_path, capsys):
    columns = with_sensor("tool.force.{}", "tool.torque.{}")
    torques, forces = by_joint(wrist.JOINTS, torque=seven().tau), {k: x for k, x in columns.items() if "tor" not in k}
    for each, words in (
        (columns | torques, "for `payload`"),
        (forces, "a remark without all six components, which `payload` needs"),
    ):
        group, belief = of_sensor(tmp_path, each)
        assert group.is_doubtful and any(words in note for note in belief.notes)
    assert "position" not in group.entries
    (tmp_path / "arm.xml").write_text(wrist.model())
    assert command.main([str(tmp_path / "arm.xml"), str(tmp_path / "log.csv")]) == 0
    assert "multicontact payload" not in capsys.readouterr().out


def test_a_wrist_sensor_is_not_the_grounds(tmp_path, capsys):
    group, belief = of_sensor(tmp_path, with_sensor("wrist_f{}", "wrist_m{}"))
    assert group.entries["torque_unit"].value == "N m" and not group.is_doubtful
    sensor = read_as_guessed(tmp_path, belief, ROBOT).sensors["wrist"]
    np.testing.assert_allclose(sensor.pose, wrist.sensors()["wrist"].pose, atol=1e-6)
    assert sensor.body == "tool" and sensor.applied_to_link
    assert belief.open == []


def test_a_wrist_sensor_whose_place_nothing_states_is_asked_about_and_calibrated(tmp_path, capsys):
    """It is 10 cm from the frame of the body: intervals hold with the file as it is written."""
    path, model, mapping = (tmp_path / name for name in ("log.csv", "arm.xml", "log.toml"))
    farther = wrist.model().replace('name="wrist" pos="0 0 0.01"', 'name="wrist" pos="0 0 0.1"')
    path.write_text(text(with_sensor("FT{}", "MT{}", farther)), encoding="utf-8")
    model.write_text(wrist.model())
    assert command.main([str(model), str(path)]) == 0
    *lines, last = capsys.readouterr().out.strip().splitlines()
    assert any(line.startswith("Open: It is open where the sensor of ") for line in lines)
    payload, name = last.rsplit(" ", 1)
    assert payload == f"multicontact payload {model} {path} --columns {mapping} --body tool --sensor"
    payload = identify_payload(ROBOT, ident.read_log(path, ROBOT, mapping), body="tool", sensor=name)
    low, high = payload.in_frame().intervals.T
    truth = np.array([wrist.TOOL["mass"], *wrist.TOOL["com"], *wrist.TOOL["inertia"]])
    assert ((low < truth) & (truth < high)).all() and high[0] - low[0] < 0.02


def test_a_time_that_is_repeated_with_other_values_takes_gaps(tmp_path):
    q, tau = (np.insert(x, 20, x[25], axis=0)[:500] for x in (Q, TAU))
    columns = {"time": np.insert(TIME, 20, TIME[19])[:500]} | by_joint(JOINTS, position=q, torque=tau)
    belief = belief_of(tmp_path, columns, ARM)
    assert belief.log.has_gaps and not any("could not be checked" in note for note in belief.notes)


def test_markers_lead_to_the_angles(tmp_path, capsys):
    sites = "".join(f'<site name="M{k}" pos=".{k} 0 .0{k}"/>' for k in range(1, 5))
    model, path = tmp_path / "arm.xml", tmp_path / "walk.csv"
    model.write_text(MODEL.replace("</body>", sites + "</body>", 1))
    path.write_text(text({"time": TIME} | {f"M{k}.{axis}": np.sin(TIME + k) for k in range(1, 5) for axis in "xyz"}))
    assert command.main([str(model), str(path), "--fix", "pan"]) == 0
    output = capsys.readouterr().out
    assert output.endswith(f"\nmulticontact angles {model} {path} --fix pan\n")
    assert "positions of 4 markers: M1, M2, M3, M4" in output and "may be in" not in output


@pytest.mark.parametrize(("name", "size"), [("observation.state.{n}.pos", 95.0), ("{n} pos [%]", 9.0)])
def test_percentages_of_a_range_are_no_degrees(tmp_path, name, size):
    belief = belief_of(tmp_path, columns_of(name, size / np.abs(Q).max() * Q), ARM)
    assert mapped(belief, "position") == {} and "percentages of calibrated ranges" in belief.open[0]
    assert {x.sure for x in belief.quantities.values()} == {DOUBTFUL}


def test_a_mirrored_component_of_a_wrench_gets_a_gain(tmp_path):
    arm = sim.mechanism(scenes.load("arm"), base="base")
    columns = ident.read_log(str(files(scenes) / "arm.csv"), arm).measured
    wrench = np.hstack([columns["ground_force"], columns["ground_torque"]])
    positions = {f"{joint}_position": columns[f"{joint}_position"] for joint in arm.joints}
    plate = dict(zip([f"plate_{x}" for x in WRENCH], (wrench * [1, -1, 1, 1, 1, 1]).T, strict=True))
    read = read_as_guessed(tmp_path, belief_of(tmp_path, positions | plate, arm), arm)
    np.testing.assert_allclose(read["ground_force"], wrench[:, :3], atol=1e-5)


@pytest.mark.parametrize(("stamp", "torque"), [(False, "effort"), (True, "torque")])
def test_json_lines_of_three_joints_are_no_vectors(tmp_path, stamp, torque):
    numbers = zip(Q[:500].tolist(), TAU[:500].tolist(), strict=True)
    rows = [{"name": JOINTS, "position": q, torque: tau} for q, tau in numbers]
    for t, row in zip(TIME, rows, strict=False):
        row |= {"header": {"stamp": {"sec": int(t), "nanosec": round(t % 1 * 1e9)}}} if stamp else {"t": t}
    (tmp_path / "log.jsonl").write_text("\n".join(map(json.dumps, rows)))
    belief = believed(ARM, [tmp_path / "log.jsonl"])
    for kind, name in (("position", "position"), ("torque", torque)):
        assert mapped(belief, kind) == {n: f"{name}.{x}" for n, x in zip(JOINTS, "xyz", strict=True)}


@pytest.mark.parametrize("ends", [("secs", "nsecs"), ("sec", "nanosec")])
def test_whole_seconds_and_nanoseconds_are_one_time(tmp_path, ends):
    """In one file, and in each of two."""
    stamps = {f"header.stamp.{ends[0]}": 1_700_000_000 + TIME // 1, f"header.stamp.{ends[1]}": np.rint(TIME % 1 * 1e9)}
    positions, torques = by_joint(JOINTS, position=Q), by_joint(JOINTS, torque=TAU)
    for logs in ([positions | torques], [positions, torques]):
        paths = [tmp_path / f"{k}.csv" for k in range(len(logs))]
        for path, columns in zip(paths, logs, strict=True):
            path.write_text(text(stamps | columns), encoding="utf-8")
        log = Path("+".join(map(str, paths)))
        belief = believed(ARM, [log])
        write_mapping(tmp_path / "log.toml", belief, force=True)
        assert belief.unused == [] and mapped(belief, "torque") == {joint: f"{joint}_torque" for joint in JOINTS}
        recording = ident.read_log(log, ARM, tmp_path / "log.toml")
        np.testing.assert_allclose(recording.time, TIME, atol=1e-6)
        np.testing.assert_allclose(recording["lift_position"], Q[:, 1], atol=1e-6)


def test_a_wrench_that_no_model_could_place_is_asked_about(tmp_path):
    columns = columns_of("{n}_position", Q[:17]) | dict(zip(WRENCH, np.hstack([Q, TAU])[:17].T, strict=True))
    belief = belief_of(tmp_path, columns, ARM)
    assert "ground" not in belief.groups and "It is open where" in belief.open[0]

"""Joints with servos, whose commands stand in for torques: how they are read, and what they identify."""

import re
from dataclasses import replace
from functools import cache

import driven_arm
import mujoco
import numpy as np
import pytest
from coded import coded
from written_formats import write_csv

import ident
import sim
from experiments.reports.identify_report import parameters_table, scales_table
from ident import InputError, LogError, Motion
from ident.recordings.followers import with_servos
from ident.recordings.stated import Servo

SERVOS = {j: Servo(kp, kv) for j, kp, kv in zip(driven_arm.JOINTS, driven_arm.KP, driven_arm.KV, strict=True)}
MAPPING = 'time = "time"\n' + "".join(
    f'[joints.{joint}]\nposition = "q{k}"\ncommand = "u{k}"\nkp = {servo.kp}\nkv = {servo.kv}\n'
    for k, (joint, servo) in enumerate(SERVOS.items())
)
WRONG = dict(zip(driven_arm.JOINTS, (0.85, 1.1, 1.2), strict=True))  # Stated over true stiffness of the servos.


@cache
def mechanism(*, actuators=False):
    more = driven_arm.ACTUATORS if actuators else ""
    return sim.mechanism(mujoco.MjSpec.from_string(driven_arm.text(more=more)))


@cache
def recording(lag=0):
    time, channels = driven_arm.commanded(seconds=6.0, lag=lag)
    return with_servos(ident.Recording(time, channels), {}, mechanism(actuators=True), [])


def read(folder, mapping=MAPPING, *, arm=None, scale=1.0):
    time, channels = driven_arm.commanded(seconds=2.0)
    columns = {"time": time}
    for k, joint in enumerate(driven_arm.JOINTS):
        columns |= {f"q{k}": channels[f"{joint}_position"], f"u{k}": scale * channels[f"{joint}_command"]}
    (folder / "columns.toml").write_text(mapping, encoding="utf-8")
    return ident.read_log(write_csv(folder / "log.csv", columns), arm or mechanism(), folder / "columns.toml")


def test_gains_are_read_from_the_mapping_or_else_from_the_model_s_actuators(tmp_path):
    log = read(tmp_path)
    assert log.servos == recording().servos == SERVOS and not log.unused
    without = "\n".join(line for line in MAPPING.splitlines() if not line.startswith(("kp", "kv")))
    assert read(tmp_path, without, arm=mechanism(actuators=True)).servos == SERVOS
    with pytest.raises(LogError, match=r"nothing is left to fit. Commands of turn, lift, bend are not used: the model"):
        read(tmp_path, without)
    some = read(tmp_path, without.replace('command = "u1"', 'command = "u1"\nkp = 80'))
    assert set(some.servos) == {"lift"} and "turn_command" not in some.measured
    assert any("Commands of turn, bend are not used" in note for note in some.notes)


@pytest.mark.parametrize(
    ("of_command", "of_angle", "noise", "off"),
    [(1, 1, 1e-4, 5e-3), (4, 1, 0.0, 0.02), (1, 4, 0.0, 1e-3)],
)
def test_least_squares_of_held_commands_have_the_inertia(of_command, of_angle, noise, off):
    """As commands do not read within samples, it was kp T²/12 too large, and a quarter too small with noise.

    Between commands at other times than angles, which are held until the next one, it was up to a half off.
    """
    rng, inertia, servo, time = np.random.default_rng(0), 0.28, Servo(700.0, 28.0), 0.005 / of_command * np.arange(8000)
    u = sum(0.4 * f * np.sin(2 * np.pi * f * time) for f in (0.31, 0.52, 0.78))[::of_command].repeat(of_command)
    q = driven_arm.of_one_joint(inertia, servo, u, time[1])
    streams = {
        "hip_position": (time[::of_angle], (q + noise * rng.normal(size=q.size))[::of_angle]),
        "hip_command": (time[::of_command], u[::of_command]),
    }
    one = f"""<mujoco><worldbody><body><joint name="hip" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/></body></worldbody></mujoco>"""
    log = ident.Recording.from_streams(streams, servos={"hip": servo})
    assert log.torques(("hip",)) is None
    arm = sim.mechanism(mujoco.MjSpec.from_string(one))
    for estimator in ("ordinary", "weighted"):
        estimate = ident.identify(arm, log, estimator=estimator, cutoff="auto", known=False, drive=["viscous"])
        assert estimate.psi == pytest.approx([inertia], rel=off)


def test_commands_of_poses_at_rest_act_at_their_own_poses():
    """In any order: the mean of neighbours was half of another pose's."""
    q = np.random.default_rng(0).uniform(-1, 1, (30, 3))
    torques = driven_arm.torques(q, 0 * q, 0 * q, **driven_arm.NONE)
    commands = q + torques / np.array(driven_arm.KP)
    channels = {f"{j}_position": x for j, x in zip(driven_arm.JOINTS, q.T, strict=True)}
    channels |= {f"{j}_command": x for j, x in zip(driven_arm.JOINTS, commands.T, strict=True)}
    log = ident.Recording(np.arange(30.0), channels, servos=SERVOS, still=True)
    tree = mechanism().tree
    np.testing.assert_allclose(log.torques_at(tree, Motion(q, 0 * q, 0 * q)), torques, atol=1e-9)
    estimate = ident.identify(mechanism(), log, estimator="weighted", known=False, drive=[])
    np.testing.assert_allclose(estimate.psi, estimate.fit.equations.from_model[: estimate.base.rank], atol=1e-9)
    assert estimate.verdict()  # Of exact torques of nothing, too: the search for gravity did not end.


def test_links_drives_and_the_lag_of_commands_are_identified():
    estimate = ident.identify(mechanism(actuators=True), recording(lag=1))
    drives = dict(zip(estimate.fit.names, estimate.fit.values, strict=True))
    for k, joint in enumerate(driven_arm.JOINTS):
        assert drives[f"Fv({joint})"] == pytest.approx(driven_arm.TRUE["damping"][k], rel=0.15)
        assert drives[f"Fc({joint})"] == pytest.approx(driven_arm.TRUE["frictionloss"][k], rel=0.15)
    assert drives["Ia(bend)"] == pytest.approx(0.05, rel=0.1)
    model = estimate.fit.equations.from_model[: estimate.base.rank]
    z = (estimate.psi - model) / estimate.std_setup
    assert np.sqrt((z**2).mean()) < 3
    (finding,) = coded(estimate, "setup_lag")
    assert finding.values["value"] == pytest.approx(0.01, abs=2e-3)
    assert (estimate.held_out.ratio < 0.05).all() and estimate.verdict().usable


@pytest.mark.slow
def test_viscous_friction_of_commanded_joints_is_marked_as_the_lag():
    fitted = ident.identify(mechanism(actuators=True), recording())
    exact = ident.identify(mechanism(actuators=True), recording(), setup={"lag": 0.0})
    tables = [parameters_table(each) for each in (fitted, exact)]
    for table, means in zip(tables, ("only the s.d. setup includes it", "no s.d. here includes it"), strict=True):
        note = f"* Viscous friction of a commanded joint is the lag of its servo, ΔFv = kp Δlag: {means}."
        assert note in " ".join(table.text().split()) and "Fv(lift)*" in table.text()
    cells = [dict(zip(tables[0].columns, row, strict=True)) for row in tables[0].rows]
    shares = {row["parameter"]: row["std_setup"] / row["std"] for row in cells}
    assert tables[0].marked == {f"Fv({joint})" for joint in driven_arm.JOINTS} and shares["Fv(lift)"] > 3
    assert not parameters_table(driven_arm.quick()).footnote


def test_bad_gains_are_one_sentence(tmp_path):
    for before, after, message in (
        ("kp = 60.0", "kp = -60.0", "joints.turn.kp needs a number above 0, got -60.0"),
        ("kp = 60.0\n", "", "joints.turn. needs kp; it has kv"),
        ('command = "u0"\n', "", "joints.turn states kp, kv of a servo; that needs its command as well"),
        ("kp = 60.0", "kp = 60.0\nkp_std = 1.5", "joints.turn.kp_std needs a number above 0 and at most 1, got 1.5"),
        ("kp = 60.0", "kp = 60.0\ntorque_std = 0.1", "joints.turn states torque_std; that needs its torque as well"),
        ("kp = 60.0", 'kp = 60.0\ntorque = "q0"', "joints.turn maps a torque and a command"),
    ):
        with pytest.raises(LogError, match=message):
            read(tmp_path, MAPPING.replace(before, after, 1))


def test_commands_in_degrees_are_named(tmp_path):
    with pytest.raises(LogError, match=r"the commands of joint 'turn' reach .*, its positions .*; both need one unit"):
        read(tmp_path, scale=180 / np.pi)
    stated = re.sub('command = ("u.")', r'command = { column = \1, unit = "deg" }', MAPPING)
    log = read(tmp_path, stated, scale=180 / np.pi)
    np.testing.assert_allclose(log["turn_command"], driven_arm.commanded(seconds=2.0)[1]["turn_command"], atol=1e-9)


def scaled(joints, known):
    """Estimate with the servos of some joints stated wrongly, within 20 %."""
    # In larger steps servos seem to act half a step later, and joints less damped.
    time, channels = driven_arm.commanded(seconds=5.0, step=1e-4)
    log, arm = ident.Recording(time, channels, scales=dict.fromkeys(joints, 0.2)), mechanism(actuators=True)
    factors = {joint: WRONG[joint] if joint in joints else 1.0 for joint in driven_arm.JOINTS}
    stated = {joint: Servo(own.kp * factors[joint], own.kv * factors[joint]) for joint, own in SERVOS.items()}
    return ident.identify(arm, with_servos(log, stated, arm, []), known=known)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joints", "known", "std", "fixed_by"),
    [
        (driven_arm.JOINTS, True, 0.12, "the model's bodies, as far as they are known"),
        (("bend",), False, 0.01, "the torques of turn, lift"),
        (driven_arm.JOINTS, False, 0.15, "the stated one alone: masses"),
    ],
)
def test_uncertain_gains_are_estimated_and_it_is_said_what_fixes_them(joints, known, std, fixed_by):
    estimate = scaled(joints, known)
    assert set(estimate.scales) == set(joints)
    for joint, (scale, own) in estimate.scales.items():
        assert abs(scale * WRONG[joint] - 1) < 2 * own < 2 * std
        servo, factor = estimate.servos[joint], WRONG[joint] * scale
        assert (servo.kp, servo.kv) == pytest.approx((SERVOS[joint].kp * factor, SERVOS[joint].kv * factor))
        (actuator,) = estimate.drives_updated[joint].actuators
        assert (actuator.kp, actuator.kv, actuator.gain) == (servo.kp, servo.kv, servo.kp)
    (finding,) = coded(estimate, "torque_scale_estimated")
    assert fixed_by in finding.text and not finding.doubt
    assert not coded(estimate, "torque_scale_taken_as_exact", "setup_taken_as_exact")
    drives = dict(zip(estimate.fit.names, zip(estimate.fit.values, estimate.fit.std, strict=True), strict=False))
    for k, joint in enumerate(driven_arm.JOINTS):
        for column, key in (("Fv", "damping"), ("Fc", "frictionloss")):
            value, own = drives[f"{column}({joint})"]
            assert abs(value - driven_arm.TRUE[key][k]) < 3 * own + 0.005
    table = scales_table(estimate)
    assert table.columns == ("joint", "scale", "std", "kp_stated", "kp", "kv")
    for joint, *numbers in table.rows:
        (scale, own), stated = estimate.scales[joint], SERVOS[joint].kp * WRONG[joint]
        assert numbers == pytest.approx([scale, own, stated, stated * scale, SERVOS[joint].kv * WRONG[joint] * scale])
    # Candidates are held against the same torques, so that wrong gains count against the model alone.
    assert (estimate.rivals["least squares"] < 0.05).all()
    assert estimate.rivals["model"][driven_arm.JOINTS.index("bend")] > 0.1


def test_least_squares_say_that_they_take_as_exact_what_is_stated_as_uncertain(tmp_path):
    """Of the commands of a joint, which are known within 30 %, and of the lag."""
    log = read(tmp_path, MAPPING.replace("kp = 60.0", "kp = 60.0\nkp_std = 0.3") + "[setup]\nlag = 0.01\n")
    options = {"estimator": "weighted", "cutoff": 6.0}
    estimate = ident.identify(mechanism(), log, **options)
    torques, setup = coded(estimate, "torque_scale_taken_as_exact", "setup_taken_as_exact")
    assert torques.doubt and torques.values["joints"] == ("turn",) and not setup.doubt
    assert setup.values["kinds"] == ("lag",) and not estimate.verdict().usable
    # What is stated to be exact after all is no finding.
    exact = ident.identify(mechanism(), log, **options, setup={"scale": 0.0, "lag": False})
    assert not coded(exact, "torque_scale_taken_as_exact", "setup_taken_as_exact")
    np.testing.assert_array_equal(exact.psi, estimate.psi)


def test_commands_are_no_torques_that_may_be_late():
    with pytest.raises(InputError, match="own has torque_delay, but no recording has joint torques; leave it out"):
        ident.identify(mechanism(actuators=True), recording(), own=["torque_delay"])


def test_uncertainties_that_would_have_no_effect_are_refused():
    for options, message in (
        ({"setup": {"delay": 0.1, "gain": 0.0}, "estimator": "weighted"}, "'weighted' leave out delay in setup"),
        ({"setup": {"scale": 0.5}}, r"setup\.scale needs zero or false .* got 0\.5: .*torque_std"),
    ):
        with pytest.raises(InputError, match=message):
            ident.identify(mechanism(actuators=True), recording(), **options)


def test_an_uncertain_torque_constant_is_estimated_from_the_other_torques():
    log = driven_arm.log()
    wrong = replace(log, measured={**log.measured, "bend_torque": 1.3 * log["bend_torque"]}, scales={"bend": 0.3})
    exact = {kind: std for kind, std in driven_arm.EXACT.items() if kind != "scale"}
    estimate = ident.identify(driven_arm.mechanism(), wrong, setup=exact, known=False)
    scale, std = estimate.scales["bend"]
    assert std < 0.02 and abs(1.3 * scale - 1) < 3 * std
    assert scales_table(estimate).rows == (("bend", pytest.approx(scale), pytest.approx(std), None, None, None),)
    (finding,) = coded(estimate, "torque_scale_estimated")
    assert "is fixed by the torques of turn, lift." in finding.text
    assert not estimate.servos

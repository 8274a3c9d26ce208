"""Predicted deviations are those of estimates; designs that minimise them keep limits and are off collisions."""

import re
from dataclasses import replace

import driven_arm
import mujoco
import numpy as np
import pytest
from commands import entries_of, refusal, rows_of
from looped import FIVE_BAR, FOUR_BAR, GRIPPER, MODELS, ROD_ON_BALLS, by_mujoco, read
from mechanisms import by_joint, sines
from scipy.linalg import block_diag

import scenes
import sim
from experiments import excite
from experiments.data import paper
from experiments.studies import designed_excitation, excitation_problem
from experiments.studies.excitation_problem import SLIP, drive_signals
from ident.errors import InputError
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.geometry.se3 import pose
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.parameters.prior import body_covariance
from ident.recordings.recording import STATES, Recording
from ident.recordings.wrench import transform_covariance
from ident.regression.ordinary import least_squares
from sim.models.model_mechanism import mechanism
from sim.motion.collisions import Collisions, Walls, reachable
from sim.motion.excitation import DOUBLE_PENDULUM, FourierTrajectory
from sim.motion.excitation_design import Limits, _Search, design, random_start, scaled_into

pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
TIME = np.arange(943) / 100
LIMITS = Limits([-1.0, -2.0], [1.5, 0.0], [1.0, 3.0], [2.0, 8.0])
QUICK = ["--starts", "1", "--iterations", "5", "--formats", "png"]

FOLDING = """
<mujoco><worldbody><geom name="floor" type="plane" size="2 2 0.1"/>
  <body name="column" pos="0 0 0.7"><geom type="sphere" size="0.1" mass="2"/>
  <body name="upper"><joint name="lift" axis="0 1 0" range="-170 170"/>
    <geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.4" mass="2"/>
  <body name="fore" pos="0 0 0.4"><joint name="fold" axis="0 1 0" range="-175 175"/>
    <geom type="capsule" size="0.04" fromto="0 0 0 0 0 0.3" mass="1"/>
  <body name="hand" pos="0 0 0.3"><geom type="sphere" size="0.06" mass="1"/></body></body></body></body>
</worldbody></mujoco>
"""
"""An arm whose forearm and hand can hit its column and the floor."""


MODEL = mujoco.MjModel.from_xml_string(FOLDING)
PROBLEM = excitation_problem.problem(mechanism(MODEL, "column"), None, sensors="wrench", noise=(0.5, 0.05))
TREE, LAST = PROBLEM.mechanism.tree, PROBLEM.mechanism.fixed({"lift": [0.0]}).tree


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(FOLDING)
    return path


@pytest.mark.slow
def test_the_papers_excitation_is_improved_within_its_limits(tmp_path, capsys):
    options = ["--starts", "3", "--iterations", "30", "--formats", "pdf", "png", "--out", str(tmp_path)]
    assert excite.main(["double_pendulum", *options]) == 0
    assert r"\emph{link2}" in (tmp_path / "table_deviations.tex").read_text(encoding="utf-8")
    printed = " ".join(capsys.readouterr().out.split())
    assert "geometric mean before, the paper's excitation: 1.15e-03; after: " in printed
    assert "Condition number before: 38.2; after: " in printed
    assert {"figure_excitation.png", "figure_excitation.pdf"} <= {path.name for path in tmp_path.iterdir()}
    quality = {row["criterion"]: row for row in rows_of(tmp_path / "table_quality.csv")}["condition_number"]
    assert float(quality["before"]) == pytest.approx(38.16, abs=0.01) and float(quality["after"]) < 38.1 / 2
    *parameters, mean = rows_of(tmp_path / "table_deviations.csv")
    assert len(parameters) == 13 and float(mean["std_after"]) < 0.7 * float(mean["std_before"])

    recording, binary = (Recording.load(tmp_path / f"trajectory.{kind}") for kind in ("csv", "npz"))
    np.testing.assert_array_equal(recording.time, TIME)
    states = recording.joint_states(["joint1", "joint2"])
    np.testing.assert_array_equal(binary.joint_states(["joint1", "joint2"]), states)
    allowed = DOUBLE_PENDULUM.trajectory(TIME)
    assert (states[0] > allowed[0].min(axis=0)).all() and (states[0] < allowed[0].max(axis=0)).all()
    for state, limit in zip(states[1:], allowed[1:], strict=True):
        assert (abs(state).max(axis=0) < abs(limit).max(axis=0)).all()
        np.testing.assert_allclose(state[[0, -1]], 0, atol=1e-12)
    series = entries_of(tmp_path / "provenance.json")["recording"]["series"]
    again = FourierTrajectory(series["duration"], series["center"], series["coefficients"])
    np.testing.assert_allclose(again.states(TIME), states, atol=1e-12)


def test_limits_are_kept_between_the_samples():
    time = np.linspace(0, 4, 5_001)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        assert (LIMITS.use(*random_start(LIMITS, 4.0, 6, rng).states(time)) < 1).all()
        wild = FourierTrajectory(4.0, 5 * rng.normal(size=2), 5 * rng.normal(size=(2, 10)))
        assert (LIMITS.use(*wild.states(time)) > 1).any()
        assert (LIMITS.use(*scaled_into(wild, LIMITS).states(time)) < 1).all()


def check_gradient(function, x, part=..., rel=1e-5):
    """Checks the derivatives of a function's value in a direction that changes a part of its argument."""
    direction, h = np.zeros_like(x), 1e-6
    direction[part] = np.random.default_rng(1).normal(size=x[part].shape)
    up, down = (function(x + sign * h * direction)[0] for sign in (1, -1))
    assert np.sum(function(x)[1] * direction) == pytest.approx((up - down) / (2 * h), rel=rel, abs=1e-6)


def test_gradients_of_the_search_and_of_walls_are_those_of_their_values():
    for criterion in paper.CRITERIA:
        search = _Search(excitation_problem.cost(PROBLEM, criterion, 501), LIMITS, 5.0, 3)
        check_gradient(search.value_and_gradient, 0.2 * np.random.default_rng(0).normal(size=(2, 5)))
    rng = np.random.default_rng(0)
    maps = rng.normal(size=(2, 50, 3))
    maps[:, :, 0] = [[0.5], [1.0]]
    walls = Walls(Collisions(MODEL, TREE, 0.1), maps, np.array([0.0, 2.0]), np.array([0.5, 1.0]))
    collides = rng.normal(size=(2, 3))
    assert walls.hit(collides) and walls.barrier(collides)[0] == np.inf
    x = walls.shrunk(collides)
    assert not walls.hit(x) and 0 < walls.barrier(x)[0] < np.inf
    check_gradient(walls.barrier, x)


@pytest.mark.parametrize("tree", [TREE, LAST])
def test_the_barrier_before_collisions_has_the_slope_of_its_differences(tree):
    """Arms of spheres and capsules, whose nearest points move smoothly, also with resting joints."""
    collisions = Collisions(MODEL, tree, 0.01)
    q = np.random.default_rng(0).uniform(-0.5, 0.5, size=(200, tree.size))
    q[:, -1] += 2.4
    q = q[(collisions.depth(q, 0.02) == 0) & (collisions.depth(q, 0.3) > 0)][:20]
    assert len(q) > 5 and 0 < collisions.barrier_and_slope(q, 0.01, 0.3)[0] < np.inf
    for posture in q:
        check_gradient(lambda x: collisions.barrier_and_slope(x, 0.01, 0.3), posture[None], rel=1e-3)


def test_collisions_are_found_and_named():
    postures = np.array([[0.0, 0.0], [0.0, 3.0], [2.9, 0.0]])
    both = Collisions(MODEL, TREE, 0.005)
    assert (both.depth(postures) > 0).tolist() == [False, True, True]
    folded, on_floor = {("column", "fore"): 1, ("column", "hand"): 1}, {("world", "fore"): 2, ("world", "hand"): 2}
    assert both.touching(postures) == folded | on_floor
    # Above the column by 0.4 - 0.04 - 0.1 m; bodies on the locked joint, closer to the column, do not count.
    assert Collisions(MODEL, LAST, 0.3).depth(np.zeros((1, 1))) == pytest.approx([0.04])


@pytest.mark.usefixtures("undrawn")
def test_designs_follow_their_options_and_seed(arm, tmp_path, capsys):
    """They stay off stops and floor, hold fixed joints, and may ignore collisions."""
    out = tmp_path / "out"

    def designed(*options):
        assert excite.main([str(arm), "--seconds", "5", *QUICK, *options, "--out", str(out)]) == 0
        limits = {(row["joint"], row["quantity"]): float(row["limit"]) for row in rows_of(out / "table_limits.csv")}
        return (out / "trajectory.csv").read_bytes(), limits

    motion, limits = designed()
    assert limits["lift", "highest position, rad"] == pytest.approx(np.radians(170 - 0.02 * 340))
    assert designed()[0] == motion != designed("--seed", "1")[0]
    motion, limits = designed("--margin", "0.1", "--floor", "0.2", "--fix", "fold", "1.5")
    assert limits["lift", "lowest position, rad"] == pytest.approx(-np.radians(170 - 0.1 * 340))
    assert b"lift_position" in motion and b"fold_position" not in motion
    assert "all geoms stay that far above the floor at 0.2 m" in " ".join(capsys.readouterr().out.split())
    designed("--joints", "fold", "--position", "2.9", "3.0", "--collisions", "ignore")
    assert "Collisions: not checked." in capsys.readouterr().out


@pytest.mark.usefixtures("undrawn")
def test_a_log_of_ones_own_is_compared_with_the_design(arm, tmp_path, capsys):
    """Of angles alone, at another rate, and twice as long."""
    time, waves = np.arange(0, 20, 1 / 50), (np.array([[0.3], [0.2]]), np.array([[1], [1.7]]), [[0], [np.pi / 2]])
    Recording(time, by_joint(TREE.joints, position=sines(time, *waves)[0])).save(tmp_path / "mine.csv")
    assert excite.main([str(arm), *QUICK, "--log", str(tmp_path / "mine.csv"), "--out", str(tmp_path / "out")]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "mine.csv: " in shown and "random" not in shown
    assert re.search(r"Before lasts 1[89]\.?\d* s, after 10 s", shown)
    *rows, _ = rows_of(tmp_path / "out" / "table_deviations.csv")
    problem = excitation_problem.problem(mechanism(arm), None, sensors="wrench")
    expected = excitation_problem.predicted_deviations(problem, Motion(*sines(np.arange(0.5, 19.5, 0.01), *waves)))
    np.testing.assert_allclose([float(row["std_before"]) for row in rows], expected, rtol=0.1)


def test_a_motion_around_collisions_is_found():
    limits = Limits([-1.5, -2.9], [1.5, 2.9], [2.0, 3.0], [8.0, 12.0])
    cost = excitation_problem.cost(PROBLEM, "determinant", 601)
    time = np.linspace(0, 6, 2001)
    collisions = Collisions(MODEL, TREE, 0.01)
    start = random_start(limits, 6.0, 4, np.random.default_rng(0))
    careless = design(cost, limits, start, iterations=30)
    assert collisions.depth(careless.states(time)[0]).any()
    careful = design(cost, limits, start, collisions=collisions, iterations=30)
    assert not collisions.depth(careful.states(time)[0]).any()
    assert (limits.use(*careful.states(time)) < 1).all()


def test_deviations_are_relative_to_masses_where_the_model_has_some(tmp_path, capsys):
    model = tmp_path / "massless.urdf"
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    joint = f'<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>{limit}</joint>'
    model.write_text(f'<robot name="r"><link name="a"/><link name="b"/>{joint}</robot>')
    given = [str(model), *QUICK, "--out", str(tmp_path / "out")]
    assert "no body has one; choose --criterion determinant or condition" in refusal(excite.main, given, capsys)
    assert excite.main([*given, "--criterion", "determinant"]) == 0
    row, *_ = rows_of(tmp_path / "out" / "table_deviations.csv")
    assert [*row] == ["parameter", "body", "std_before", "std_after"]


def test_bad_limits_are_refused():
    bounds = r"a lower one below an upper one, both within ±1e\+08, got \[1.0\] and"
    for limits, message in (
        ((1.0, 0.0, 1.0, 1.0), bounds),
        ((0.0, 1.0, 0.0, 1.0), r"velocity need to be positive and below 1e\+08, got \[0.0\]"),
    ):
        with pytest.raises(ValueError, match=message):
            Limits(*([x] for x in limits))


@pytest.mark.usefixtures("undrawn")
def test_a_four_bar_is_excited_by_its_crank(tmp_path):
    # Turned that far, the crank would come to the end of what the rod reaches.
    text = FOUR_BAR.replace('name="rod" axis', 'name="rod" range="-0.5 0.6" axis')
    (tmp_path / "arm.xml").write_text(text.replace("<sensor>", '<actuator><motor joint="crank"/></actuator><sensor>'))
    options = "--starts 1 --iterations 2 --seconds 3 --harmonics 3 --position -1 1 --sensors torque --drive auto"
    assert excite.main([str(tmp_path / "arm.xml"), *options.split(), "--out", str(tmp_path / "out")]) == 0
    motion, arm = Recording.load(tmp_path / "out" / "trajectory.npz"), read(FOUR_BAR).closed(("rod", "rocker"))
    q, dq, _ = motion.joint_states(("crank", "rod", "rocker"))
    assert q[:, 1].min() > -0.5 and q[:, 1].max() < 0.6 and np.ptp(q[:, 0]) > 0.3
    own = [motion[f"crank_{kind}"][:5, None] for kind in STATES]
    gaps, *_ = by_mujoco("four-bar", arm, own)
    assert abs(gaps).max() < 1e-9
    np.testing.assert_allclose(arm.tree.dependent_states(*own)[1], dq[:5, 1:], atol=1e-7)


def test_the_cost_of_a_five_bar_has_exact_derivatives(monkeypatch):
    monkeypatch.setattr(excitation_problem, "determined", lambda *_: ("Fv(crank)", "Fc(right)", "Ia(right)"))
    design = excitation_problem.problem(read(FIVE_BAR), ["crank", "right"], sensors="torque", drive=None)
    assert design.joints == ("crank", "right") and design.mechanism.tree.dependent == ("rod", "arm")
    cost, states = excitation_problem.cost(design, "determinant", 40), np.random.default_rng(0).normal(size=(3, 40, 2))
    for kind in range(3):
        check_gradient(lambda states: cost(*states), 0.2 * states, kind, rel=1e-3)


def test_collisions_of_dependent_bodies_count():
    sphere = '<geom size=".01" pos="0 0 .05" mass=".08"/>'  # In place of a finger.
    text = GRIPPER.replace('<inertial mass="0.08" pos="0.02 0.0008 0.05" diaginertia="1e-3 1.2e-3 8e-4"/>', sphere)
    model = mujoco.MjModel.from_xml_string(text)
    arm = sim.mechanism(model)
    walls = Collisions(model, arm.closed([joint for joint in arm.tree.joints if joint != "left_driver"]).tree, 0.01)
    q = np.linspace(-0.6, 0.6, 25)[:, None]
    depth = walls.depth(q, 0.08)
    assert (depth > 0).any() and (depth == 0).any()
    check_gradient(lambda x: walls.barrier_and_slope(x, 1e-3, 0.08), q[depth > 0][:1], rel=1e-4)


def test_a_designed_motion_has_no_columns_of_the_hinges_in_place_of_a_ball(monkeypatch):
    # It needs no parameters, whose search takes seconds, and without drives no motion that separates them.
    monkeypatch.setattr(excitation_problem, "find_base_parameters", lambda *_, **__: None)
    monkeypatch.setattr(excitation_problem, "random_motion", None)
    design = excitation_problem.problem(read(ROD_ON_BALLS), ["hip", "knee", "crank"], sensors="torque")
    motion = Motion(*np.zeros((3, 5, 3)))
    columns = designed_excitation.recording(design, np.arange(5.0), motion, {}).measured
    assert "tarsus_position" in columns and not [name for name in columns if name.startswith("rod")]


@pytest.mark.slow
def test_ranges_are_those_in_which_loops_close():
    tree = read(MODELS["slider"][0]).closed(("rod", "piston"), ("crank",)).tree
    low, high = reachable(tree, {"piston": (-0.05, 0.05)}, np.zeros(1), np.array([-3.0]), np.array([3.0]))
    q = np.linspace(low[0], high[0], 50)[:, None]
    assert tree.closes(q).all() and abs(tree.dependent_states(q)[0][:, 1]).max() < 0.05
    with pytest.raises(InputError, match="The loops of rod, piston do not close, or leave these joints' ranges, near"):
        reachable(tree, {"piston": (0.2, 0.3)}, np.zeros(1), np.array([-3.0]), np.array([3.0]))


@pytest.fixture(scope="module")
def pendulum():
    return excitation_problem.problem(mechanism(scenes.load("double_pendulum"), "base"), None, sensors="wrench")


def test_predicted_deviations_are_those_of_an_estimate(pendulum):
    arm, noise, motion = pendulum.mechanism, (0.5, 0.05), Motion(*DOUBLE_PENDULUM.trajectory(TIME[:300]))
    wrench = base_wrench_regressor(arm.tree, *motion.states, gravity=arm.gravity) @ arm.prior
    samples = Samples(motion, wrench, np.diag(np.repeat(noise, 3) ** 2))
    problem = excitation_problem.problem(arm, None, sensors="wrench", noise=noise)
    predicted = excitation_problem.predicted_deviations(problem, motion)
    np.testing.assert_allclose(predicted, least_squares(Equations.of_wrench(arm), samples).std, rtol=0.01)


def test_what_a_model_knows_is_carried_through_the_regrouping(pendulum):
    base, phi = pendulum.parameters, pendulum.mechanism.prior
    B = np.zeros((base.rank, len(phi)))
    B[range(base.rank), list(base.kept)] = 1
    B[:, list(base.dependent)] = base.beta
    np.testing.assert_allclose(B @ phi, base.regroup(phi))
    L = excitation_problem.known_root(pendulum)
    S = block_diag(*(body_covariance(own) for own in phi.reshape(-1, 10)))
    np.testing.assert_allclose(L.T @ L, B @ S @ B.T, atol=1e-14)
    m1 = np.sqrt(np.sum((0.2 * phi[::10]) ** 2))
    assert np.linalg.norm(L, axis=0)[0] == pytest.approx(m1)


def test_what_cannot_be_seen_stays_as_known(pendulum):
    resting = Motion(np.ones((100, 2)), *np.zeros((2, 100, 2)))
    assert 0.1 < np.exp(excitation_problem.cost(pendulum, "deviations", 100)(*resting.states)[0]) < 1
    quiet, papers = replace(pendulum, whitening=1e-9 * pendulum.whitening), Motion(*DOUBLE_PENDULUM.trajectory(TIME))
    assert excitation_problem.quality(quiet, papers)["geometric_mean_of_relative_deviations"] == pytest.approx(1)
    assert np.isfinite(excitation_problem.predicted_deviations(pendulum, resting)).all()


SENSING = """
<mujoco><worldbody><body name="base"><site name="plate" pos="0.1 0 -0.2" euler="0 30 0"/><geom size="0.1"/>
<body name="arm"><joint name="hinge" range="-1 1"/><geom size="0.1" pos="0 0 1"/><site name="elsewhere"/></body></body>
</worldbody><sensor><force site="plate" noise="2"/><torque site="plate" noise="0.3"/>
  <force site="elsewhere" noise="7"/><jointactuatorfrc joint="hinge" noise="0.4"/></sensor></mujoco>
"""


def test_noise_is_what_the_models_sensors_state():
    arm = mechanism(mujoco.MjModel.from_xml_string(SENSING), "base")

    def covariance(sensors, noise=None):
        W = excitation_problem.problem(arm, None, sensors=sensors, noise=noise).whitening
        return np.linalg.inv(W.T @ W)

    at_plate = np.diag([4.0, 4, 4, 0.09, 0.09, 0.09])
    expected = transform_covariance(pose(np.eye(3), np.array([0.1, 0, -0.2])), at_plate)
    np.testing.assert_allclose(covariance("wrench"), expected, atol=1e-12)
    np.testing.assert_allclose(covariance("wrench", (1.0, 0.1)), np.diag([1, 1, 1, 0.01, 0.01, 0.01]), atol=1e-12)
    assert covariance("torque") == pytest.approx(0.16)
    assert covariance("torque", (1.0, 0.1)) == pytest.approx(0.01)


ALL = ("rotor", "viscous", "coulomb", "stribeck", "spring")


def driven(drive, **stated):
    return excitation_problem.problem(driven_arm.mechanism(**stated), None, sensors="torque", drive=drive)


def random_motion(n=40):
    q, dq, ddq = np.random.default_rng(0).uniform(-1, 1, size=(3, n, 3))
    return Motion(q, 0.3 * dq, ddq)


def test_columns_are_the_torques_of_unit_drives():
    design, motion = driven(ALL), random_motion()
    columns = dict(zip(design.drives, drive_signals(design.mechanism, design.drives, motion).T, strict=True))
    q, dq, ddq = motion.q[:, 1], motion.dq[:, 1], motion.ddq[:, 2]
    np.testing.assert_allclose(columns["K(lift)"][1], q - 0.4)
    np.testing.assert_allclose(columns["Fv(lift)"][1], dq)
    np.testing.assert_allclose(columns["Fc(lift)"][1], np.tanh(dq / SLIP))
    np.testing.assert_allclose(columns["Ia(bend)"][2], ddq)
    assert all(np.count_nonzero(column.any(axis=1)) == 1 for column in columns.values())
    Y = design.regressor(*motion.states)
    assert Y.shape == (len(motion), 3, len(design.names))


@pytest.mark.parametrize("samples", [40, 3])
@pytest.mark.parametrize("criterion", paper.CRITERIA)
def test_derivatives_are_differences(criterion, samples):
    """With few samples, some combinations are not excited."""
    cost = excitation_problem.cost(driven(ALL), criterion, 1000)
    for which in range(3):
        check_gradient(lambda states: cost(*states), np.array(random_motion(samples).states), which, rel=1e-3)

"""Motions that are designed for mechanisms with loops: dependent joints move along, within their ranges."""

import mujoco
import numpy as np
import pytest
from looped import FIVE_BAR, FOUR_BAR, GRIPPER, MODELS, ROD_ON_BALLS, by_mujoco

import sim
from experiments import excite
from experiments.studies import criteria
from experiments.studies.designed_excitation import recording
from experiments.studies.excitation_problem import problem
from ident.errors import InputError
from ident.mechanism.motion import Motion
from ident.recordings.recording import Recording
from sim.motion.collisions import Collisions, reachable

pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")

QUICK = ["--starts", "1", "--iterations", "2", "--seconds", "3", "--harmonics", "3", "--position", "-1", "1"]
SPHERE = '<geom size=".01" pos="0 0 .05" mass=".08"/>'
MOTOR = '<actuator><motor joint="crank"/></actuator>'


def read(text):
    return sim.mechanism(mujoco.MjSpec.from_string(text))


@pytest.mark.usefixtures("undrawn")
def test_a_four_bar_is_excited_by_its_crank(tmp_path):
    # Turned that far, the crank would come to the end of what the rod reaches.
    text = FOUR_BAR.replace('name="rod" axis', 'name="rod" range="-0.5 0.6" axis')
    (tmp_path / "arm.xml").write_text(text.replace("<sensor>", f"{MOTOR}<sensor>"))
    drives = ["--sensors", "torque", "--drive", "auto"]
    assert excite.main([str(tmp_path / "arm.xml"), *QUICK, *drives, "--out", str(tmp_path / "out")]) == 0
    motion = Recording.load(tmp_path / "out" / "trajectory.npz")
    names, arm = ("crank", "rod", "rocker"), read(FOUR_BAR).closed(("rod", "rocker"))
    states = [np.stack([motion[f"{name}_{kind}"] for name in names], axis=1) for kind in ("position", "velocity")]
    assert states[0][:, 1].min() > -0.5 and states[0][:, 1].max() < 0.6
    assert np.ptp(states[0][:, 0]) > 0.3
    own = [motion[f"crank_{kind}"][:5, None] for kind in ("position", "velocity", "acceleration")]
    gaps, *_ = by_mujoco("four-bar", arm, own)
    assert abs(gaps).max() < 1e-9
    np.testing.assert_allclose(arm.tree.dependent_states(*own)[1], states[1][:5, 1:], atol=1e-7)


def test_the_cost_of_a_five_bar_has_exact_derivatives():
    design, rng = problem(read(FIVE_BAR), ["crank", "right"], sensors="torque", drive=None), np.random.default_rng(0)
    assert design.joints == ("crank", "right") and design.mechanism.tree.dependent == ("rod", "arm")
    value, states = criteria.cost(design, "determinant", 40), 0.2 * rng.normal(size=(3, 40, 2))
    _, slopes = value(*states)
    for kind, k in ((0, 0), (0, 1), (1, 0), (2, 1)):
        step = np.zeros((3, 40, 2))
        step[kind, 7, k] = 1e-4
        higher, lower = (value(*(states + sign * step))[0] for sign in (1, -1))
        assert slopes[kind][7, k] == pytest.approx((higher - lower) / 2e-4, rel=1e-4, abs=1e-7)


def test_collisions_of_dependent_bodies_count():
    # Fingers that are spheres.
    text = GRIPPER.replace('<inertial mass="0.08" pos="0.02 0.0008 0.05" diaginertia="1e-3 1.2e-3 8e-4"/>', SPHERE)
    model = mujoco.MjModel.from_xml_string(text)
    arm = sim.mechanism(model)
    tree = arm.closed([joint for joint in arm.tree.joints if joint != "left_driver"]).tree
    walls = Collisions(model, tree, 0.01)
    q = np.linspace(-0.6, 0.6, 25)[:, None]
    depth = walls.depth(q, 0.08)
    assert (depth > 0).any() and (depth == 0).any()
    apart = q[depth > 0][:1]
    low, high = (walls.barrier_and_slope(apart + step, 1e-3, 0.08)[0] for step in (-1e-6, 1e-6))
    assert walls.barrier_and_slope(apart, 1e-3, 0.08)[1] == pytest.approx((high - low) / 2e-6, rel=1e-4)


def test_a_designed_motion_has_no_columns_of_the_hinges_in_place_of_a_ball():
    design, t = problem(read(ROD_ON_BALLS), ["hip", "knee", "crank"], sensors="torque"), np.arange(5.0)
    motion = Motion(*np.zeros((3, 5, 3)))
    columns = recording(design, t, motion, {}).measured
    assert "tarsus_position" in columns and not [name for name in columns if name.startswith("rod")]


@pytest.mark.slow
def test_ranges_are_those_in_which_loops_close():
    tree = read(MODELS["slider"][0]).closed(("rod", "piston"), ("crank",)).tree
    low, high = reachable(tree, {"piston": (-0.05, 0.05)}, np.zeros(1), np.array([-3.0]), np.array([3.0]))
    q = np.linspace(low[0], high[0], 50)[:, None]
    assert tree.closes(q).all() and abs(tree.dependent_states(q)[0][:, 1]).max() < 0.05
    with pytest.raises(InputError, match="The loops of rod, piston do not close, or leave these joints' ranges, near"):
        reachable(tree, {"piston": (0.2, 0.3)}, np.zeros(1), np.array([-3.0]), np.array([3.0]))

"""OpenSim files: against results of OpenSim itself, against MJCF of the same mechanism, and errors."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import opensim_files
import pytest
from commands import sentence_of
from mechanisms import random_phi
from numpy.polynomial import Polynomial
from opensim_files import Joint, constant, coordinate, coupler, document, every_kind, linear, spatial, table

import sim
from ident.errors import ModelError
from ident.model.regressor import joint_torque_regressor
from sim.models.notes import ModelNote
from sim.models.opensim_elements import CLOSE, curve

DATA = Path(__file__).parents[1] / "data" / "opensim"
COUPLED = "<ConstraintSet><objects>"
ROTATIONS = [("", np.eye(3)[k], constant(0)) for k in range(3)]
pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
read = sim.mechanism


@pytest.fixture
def stated(written):
    return lambda text, **options: read(written("model.osim", text), **options)


@pytest.mark.parametrize("version", [3, 4])
def test_opensim_computes_the_same(version):
    """Poses, markers and torques by OpenSim 4.6 for a model with all kinds of joints (see the file's `source`)."""
    arm = read(DATA / f"opensim_joints_{version}.osim")
    for sample in json.loads((DATA / "opensim_joints.json").read_text())["samples"]:
        q, dq, ddq = np.array([sample["states"][joint] for joint in arm.tree.joints]).T[:, None]
        poses = dict(zip(arm.tree.names, arm.tree.poses(q)[0], strict=True))
        for body, expected in sample["poses"].items():
            np.testing.assert_allclose(poses[body][:3], expected, atol=3 * CLOSE)
        for marker, expected in sample["markers"].items():
            body, place = arm.sites[marker]
            np.testing.assert_allclose((poses[body] @ place)[:3, 3], expected, atol=3 * CLOSE)
        torques = dict(sample["torques"])
        for follower in set(torques) - set(arm.tree.joints):
            rate = sample["states"][follower][1] / sample["states"]["bend"][1]
            torques["bend"] += rate * torques[follower]
        computed = (joint_torque_regressor(arm.tree, q, dq, ddq, gravity=arm.gravity) @ arm.prior)[0]
        expected = np.array([torques[joint] for joint in arm.tree.joints])
        # The second derivatives of a cubic spline and its polynomial differ most.
        np.testing.assert_allclose(computed, expected, atol=3e-4 * abs(expected).max())


@pytest.mark.parametrize("kind", ["SimmSpline", "NaturalCubicSpline"])
def test_a_spline_through_points_of_a_cubic_is_that_cubic_and_straight_beyond(kind):
    cubic, x = Polynomial([0.3, -0.2, 0.5, 0.7]), np.array([-1, -0.6, 0.1, 0.4, 1.3])
    rows = "".join(f"<{tag}>{' '.join(map(str, values))}</{tag}>" for tag, values in (("x", x), ("y", cubic(x))))
    spline = curve(ET.fromstring(f"<{kind}>{rows}</{kind}>"))
    inside = np.linspace(x[0], x[-1], 40)
    np.testing.assert_allclose(spline.evaluated(inside), cubic(inside), atol=1e-12)
    for end, beyond in ((x[0], -0.5), (x[-1], 0.5)):
        straight = cubic(end) + cubic.deriv()(end) * beyond
        np.testing.assert_allclose(spline.evaluated(np.array([end + beyond])), straight, rtol=1e-12)


@pytest.mark.parametrize("kind", ["SimmSpline", "PiecewiseLinearFunction"])
def test_tables_need_two_points_or_more_that_rise(kind):
    two = curve(ET.fromstring(table([-1, 1], [0.5, 1.5], kind)))
    np.testing.assert_allclose(two.evaluated(np.array([-1, 0, 1.0])), [0.5, 1, 1.5], atol=1e-15)
    for x, y in (([0], [1]), ([0, 0], [1, 2]), ([0, 1, 1], [1, 2, 3]), ([1, 0], [1, 2]), ([0, 1, 2], [1, 2])):
        with pytest.raises(ModelError, match=rf"needs two points or more .* got {len(x)} and {len(y)}\."):
            curve(ET.fromstring(table(x, y, kind)))


def test_tables_become_polynomials_and_the_distance_is_stated(written):
    """A shin on a thigh, moved along x and y by tables, and about z."""
    angles, corners = np.linspace(-2.1, 0.2, 6), ([-2.1, -1, 0.2], [0.1, 0, 0.3])
    shift = table(angles, [-0.0032, 0.0018, 0.0041, 0.0021, -0.0020, -0.0045])
    moves = [("bend", [0, 0, 1], linear(1)), ("bend", [1, 0, 0], shift)]
    axes = [*ROTATIONS[:2], *moves, ("bend", [0, 1, 0], table(*corners, "PiecewiseLinearFunction")), ROTATIONS[2]]
    joints = [
        Joint("PinJoint", "hip", "ground", "thigh", [coordinate("hip")]),
        Joint("CustomJoint", "knee", "thigh", "shin", [coordinate("bend", limits=(-2.0, 0.1))], spatial(axes)),
    ]
    phi = dict(zip(("thigh", "shin"), random_phi(np.random.default_rng(0), 2).reshape(-1, 10), strict=True))
    with pytest.warns(ModelNote, match=r"polynomials here, off by at most [\d.]+ mm \(knee, translation2\)\.") as notes:
        arm = read(written("model.osim", document(joints, phi)))
    bend = np.linspace(-2, 0.1, 50)
    poses = arm.tree.poses(np.column_stack([0 * bend, bend]))[:, arm.tree.names.index("shin"), :3, 3]
    at_knots = np.interp(angles[1:-1], bend, poses[:, 0])
    np.testing.assert_allclose(at_knots, [0.0018, 0.0041, 0.0021, -0.0020], atol=2e-4)
    distance = float(re.search(r"most ([\d.]+) mm", str(notes[0].message))[1]) / 1e3
    assert abs(poses[:, 1] - np.interp(bend, *corners)).max() <= 1.02 * distance
    assert arm.ranges["bend"] == (-2.0, 0.1)


def test_coordinates_stay_where_they_are_locked_or_fixed_and_go_where_a_constraint_is_ignored(stated):
    text = every_kind(2)[0]
    assert "beta_0" in stated(text, ignore=["couple_beta_0"]).tree.joints
    assert "no enforced constraint named gone; it has couple_beta_0" in sentence_of(stated, text, ignore=["gone"])
    arm, fixed = (stated(text, fix=fix) for fix in (None, {"slip": [], "bend": [0.3]}))
    assert not {"jaw_0", "beta_0"} & set(arm.tree.joints)
    assert not {"slip", "bend"} & set(fixed.tree.joints)
    q = np.zeros(len(arm.tree.joints))
    q[arm.tree.joints.index("bend")] = 0.3
    still = np.zeros(len(fixed.tree.joints))
    np.testing.assert_allclose(arm.tree.poses(q)[-1], fixed.tree.poses(still)[-1], atol=1e-12)


def test_a_base_carries_its_part_of_the_model_and_has_gravity_in_its_axes_where_it_rests(stated):
    text = every_kind(3)[0]
    whole, leg = (stated(text, base=base) for base in (None, "thigh"))
    assert leg.bodies == ("thigh", "shank", "patella", "foot", "toes")
    assert leg.tree.joints == ("slip", "bend", "ankle_0", "ankle_1")
    np.testing.assert_array_equal(leg.gravity, whole.gravity)
    q = np.random.default_rng(0).uniform(-1, 1, len(whole.tree.joints))
    poses = whole.tree.poses(q)
    own = leg.tree.poses(q[[whole.tree.joints.index(joint) for joint in leg.tree.joints]])
    expected = np.linalg.inv(poses[whole.tree.names.index("thigh")]) @ poses[whole.tree.names.index("toes")]
    np.testing.assert_allclose(own[leg.tree.names.index("toes")], expected, atol=1e-12)
    led = sentence_of(stated, text.replace("name>beta_0", "name>ankle_0"), base="shank")
    assert "model.osim" in led and "follows 'bend', which is no joint with one coordinate of its tree" in led
    turned = Joint("WeldJoint", "root", "ground", "pelvis", at=(np.zeros(3), np.array([0, 0, np.pi / 2])))
    text = document([turned], {"pelvis": random_phi(np.random.default_rng(0), 1)})
    x, y, z = stated(text).gravity
    np.testing.assert_allclose(stated(text, base="pelvis").gravity, [y, -x, z], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("BallJoint", "EllipsoidJoint", r'<EllipsoidJoint name="hip">: joints that are read are CustomJoint'),
        ("SimmSpline", "GCVSpline", "functions of coordinates are Constant, LinearFunction.*got <GCVSpline>"),
        ("CoordinateCouplerConstraint", "RollingOnSurfaceConstraint", "--ignore couple_beta_0"),
        ("<mass>", "<mass>-1 ", r'<Body name="pelvis"> needs a finite number in <mass>, got \'-1'),
        ("<socket_child_frame>thigh_offset", "<socket_child_frame>toe_offset", "'toe_offset' is none"),
        ("/ground</socket_parent>", "/bodyset/head</socket_parent>", "No chain of joints leads from the ground"),
        ('Version="40000"', 'Version="20302"', "files of OpenSim 3 and later are read"),
        ("OpenSimDocument", "SomeDocument", "an OpenSim file is an <OpenSimDocument>"),
        ("<coordinates>bend</coordinates>", "<coordinates>bend slip</coordinates>", "one coordinate of its joint at"),
        ("<gravity>", "<gravity>x ", "needs 3 finite numbers in <gravity>"),
        ('name="ball_2"', 'name="ball_1"', "name of its own"),
        ("<independent_coordinate_names>bend", "<independent_coordinate_names>knee", "got 'beta_0' on 'knee'"),
        ("<independent_coordinate_names>bend", "<independent_coordinate_names>beta_0", "each other in a circle"),
        (
            COUPLED,
            f"{COUPLED}{coupler('slip', 'beta_0', linear(2.0))}",
            "on 'bend', another constraint on 'slip'; leav",
        ),
    ],
)
def test_what_cannot_be_read_is_named(written, old, new, message):
    text = every_kind(1)[0]
    assert old in text
    path = written("model.osim", text.replace(old, new))
    sentence = sentence_of(read, path)
    assert sentence.startswith(str(path)) and re.search(message, sentence)


END_3 = """<body_{k}>{body}</body_{k}><location_body_{k}>{x} 0 0</location_body_{k}>
<orientation_body_{k}>0 0 0.7</orientation_body_{k}>"""
END_4 = """<socket_frame{k}>end{k}</socket_frame{k}><frames><PhysicalOffsetFrame name="end{k}">
<socket_parent>{path}</socket_parent><translation>{x} 0 0</translation><orientation>0 0 0.7</orientation>
</PhysicalOffsetFrame></frames>"""


@pytest.mark.parametrize("version", [3, 4])
def test_a_weld_closes_a_loop(stated, version):
    """A coupler in halves, one on the crank and one on the rocker, whose frames are turned by half a right angle."""
    at = lambda *x: (np.array(x), np.zeros(3))  # noqa: E731
    joints = [
        Joint("PinJoint", "one", "ground", "crank", [coordinate("crank")]),
        Joint("PinJoint", "two", "crank", "rod", [coordinate("rod")], at=at(0, 0.3, 0)),
        Joint("PinJoint", "three", "ground", "rocker", [coordinate("rocker")], at=at(0.4, 0, 0)),
        Joint("PinJoint", "four", "rocker", "half", [coordinate("half")], at=at(0, 0.3, 0)),
    ]
    names = "crank", "rod", "rocker", "half"
    phi = dict(zip(names, random_phi(np.random.default_rng(0), 4).reshape(4, 10), strict=True))

    def joined(kind, second):
        end = END_3 if version == 3 else END_4
        ends = end.format(k=1, body="rod", path=opensim_files.path("rod"), x=0.2)
        ends += end.format(k=2, body=second, path=opensim_files.path(second), x=-0.2)
        constraint = f'<{kind} name="glue"><isEnforced>true</isEnforced>{ends}</{kind}>'
        return document(joints, phi, version=version, constraints=constraint)

    x = np.linspace(-1, 1, 7)[:, None]
    tree = stated(joined("WeldConstraint", "half")).closed(("rod", "rocker", "half")).tree
    assert tree.joints == ("crank",)
    np.testing.assert_allclose(tree.dependent_states(x)[0], np.hstack([-x, x, -x]), atol=1e-9)
    with pytest.raises(ModelError, match=r"'glue' is between a body of the .* --ignore glue"):
        stated(joined("PointConstraint", "ground"))


@pytest.mark.parametrize("version", [3, 4])
def test_a_file_is_written_back_with_nothing_else_changed_also_where_it_leaves_numbers_out(written, version):
    text = every_kind(7, version)[0].replace("<mass_center> ", "<mass_center><!-- kept? -->", 1)
    lacking = re.sub(r"<inertia>[^<]*</inertia>", "", re.sub(r"<mass_center> [^<]*<", "<mass_center><", text), count=1)
    blank = r"(<(mass|mass_center|inertia(_..)?)>)[^<]*(?:<!--.*?-->)?[^<]*(</\2>)"
    for stated in (lacking, text):
        path = written("model.osim", stated)
        arm, new = read(path), path.with_name("new.osim")
        sim.write_model(new, arm, arm.prior.copy())
        assert new.read_bytes() == path.read_bytes()
        phi = random_phi(np.random.default_rng(1), len(arm.bodies))
        phi[10:20] = arm.prior[10:20]
        sim.write_model(new, arm, phi)
        np.testing.assert_allclose(read(new).prior, phi, rtol=1e-9, atol=1e-9)
        assert read(new).tree == arm.tree and ("inertia_xx" in new.read_text(encoding="utf-8")) == (version == 3)
    after = new.read_text(encoding="utf-8")
    assert re.sub(blank, r"\1\4", after) == re.sub(blank, r"\1\4", text) and "<mass>7</mass>" in after


def test_what_cannot_be_written_is_said(written, tmp_path):
    wide = tmp_path / "wide.osim"
    wide.write_text(every_kind(1)[0].replace("UTF-8", "UTF-16"), encoding="utf-16")
    path, new = written("model.osim", every_kind(1)[0]), tmp_path / "new.osim"
    arm = read(path)
    for call, *given, message in (
        (sim.write_model, tmp_path / "model.xml", arm, arm.prior, r"write 'model.osim' instead"),
        (sim.write_model, new, arm, "heavier", "phi needs φ of the bodies"),
        (sim.updated_spec, arm, arm.prior, "no MuJoCo specification"),
        (sim.write_model, new, read(wide), 2 * arm.prior, "save it in UTF-8"),
        (sim.tree_from_model, path, "MuJoCo reads no OpenSim files"),
    ):
        assert message in sentence_of(call, *given)
    assert not new.exists()

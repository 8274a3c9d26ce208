"""Updated models: bodies and displaced joints are written back, with all else as it was."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mechanisms import random_phi
from opensim_files import Joint, coordinate, document, quietly_read
from opensim_walker import PHI

import scenes
from ident.errors import InputError, ModelError
from sim.models.model_mechanism import mechanism
from sim.models.model_update import updated_spec, write_model
from sim.models.mujoco_model import parameters_from_model
from sim.models.urdf import model_from_urdf

MJCF = """<mujoco><!-- kept --><compiler angle="radian"{compiler}/>
<default><default class="c"><joint damping="0.123456789"/></default></default>
<worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="base" pos="0.123456789 0 1">
<geom size=".1"/><body pos="0 0 0.3333333333"><joint class="c" name="u" axis="1 0.123456789 0"/><geom size=".1"/>
<site name="tip" pos="0.987654321 0 0"/><frame pos="0 0 1"><body name="hand"><inertial pos=".1 0 0" mass="1.5"
fullinertia=".2 .3 .4 .01 0 0"/><joint name="w" axis="0 1 0"/></body></frame></body></body>
<body name="other" pos="2 0 0"><inertial pos="0 0 .1" mass="2" diaginertia=".1 .1 .1"/><geom size=".2"/></body>
</worldbody></mujoco>"""
OVERRIDES = ("", ' inertiafromgeom="true"', ' boundmass="1.7" boundinertia=".3"', ' balanceinertia="true"')


def written(tmp_path, text, name):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def compiled(path):
    return mujoco.MjModel.from_xml_path(str(path))


def assert_others_untouched(updated, expected, members):
    """Checks that only those fields of a compiled model differ that follow from the inertias of some bodies."""
    follow = r"body_(mass|subtreemass|invweight0|ipos|iquat|inertia|sameframe|simple)|(geom|site)_sameframe"
    follow += r"|dof_(invweight0|M0|length|simplenum)|(actuator_acc|tendon_invweight|light_poscom|cam_poscom)0|bvh_.*"
    follow += r"|names|paths|.*map.*|.*[MDBC]_.*"
    fields = [f for f in dir(expected) if isinstance(getattr(expected, f, None), np.ndarray) and f[0] != "_"]
    kept = [f for f in fields if not re.fullmatch(follow, f)]
    assert len(kept) > 100
    for field in kept:
        ours, theirs = getattr(updated, field), getattr(expected, field)
        np.testing.assert_array_equal(ours, theirs, err_msg=field)
    others = [b for b in range(expected.nbody) if b not in members]
    for field in ("body_mass", "body_ipos", "body_inertia"):
        np.testing.assert_allclose(getattr(updated, field)[others], getattr(expected, field)[others], rtol=1e-12)


@pytest.mark.parametrize("compiler", OVERRIDES)
@pytest.mark.parametrize("kind", ["file", "specification"])
def test_an_updated_mjcf_reads_back_as_the_parameters_with_all_else_untouched(tmp_path, compiler, kind):
    path = written(tmp_path, MJCF.format(compiler=compiler), "arm.xml")
    source = path if kind == "file" else mujoco.MjSpec.from_file(str(path))
    phi = random_phi(np.random.default_rng(0), 3)
    spec = updated_spec(mechanism(source, "base"), phi)
    np.testing.assert_allclose(parameters_from_model(spec, "base"), phi, rtol=1e-9, atol=1e-12)
    before = compiled(path)
    assert_others_untouched(spec.compile(), before, {1, 2, 3})
    out = tmp_path / "updated.xml"
    write_model(out, mechanism(source, "base"), phi)
    np.testing.assert_allclose(parameters_from_model(out, "base"), phi, rtol=1e-9, atol=1e-12)
    if kind == "file":
        assert_others_untouched(compiled(out), before, {1, 2, 3})
        assert "<!-- kept -->" in out.read_text(encoding="utf-8")


def test_what_cannot_be_updated_is_refused_in_a_sentence(tmp_path):
    nameless = written(tmp_path, "<robot name='x'><link/></robot>", "arm.urdf")
    path = written(tmp_path, MJCF.format(compiler=""), "arm.xml")
    phi = random_phi(np.random.default_rng(0), 3)
    bad = phi.copy()
    bad[14] = -1
    arm = mechanism(path, "base")
    before = set(tmp_path.iterdir())
    for call, message in {
        lambda: write_model(tmp_path / "x.xml", arm, phi[:-1]): "base, body2, hand need 30 finite parameters",
        lambda: write_model(tmp_path / "x.xml", arm, bad): "'body2' are not those of a physical body",
        lambda: write_model(tmp_path / "x.urdf", arm, phi): "write 'x.xml' instead",
        lambda: updated_spec(mechanism(compiled(path), "base"), phi): "not a compiled one or none",
        lambda: updated_spec(replace(arm, source=None), phi): "not a compiled one or none",
        lambda: model_from_urdf(path): "a URDF file has a <robot>, this one a <mujoco>",
        lambda: model_from_urdf(nameless): "arm.urdf: ",
    }.items():
        with pytest.raises(InputError, match=message):
            call()
    assert set(tmp_path.iterdir()) == before


SHIFT = np.array([0.012, 0.0, -0.003])
DISPLACED_MJCF = """<mujoco><compiler angle="degree"/><worldbody><body name="root">
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<frame pos="0 1 0" euler="0 90 0"><frame euler="30 0 0"><body name="arm" pos="0.3 0.1 0">
<joint name="elbow" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="hand"><joint name="wrist"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
</body></frame></frame></body></worldbody></mujoco>"""
DISPLACED_URDF = """<robot name="r"><link name="root"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0"
iyy="1" iyz="0" izz="1"/></inertial></link><link name="arm">
<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1"
iyz="0" izz="1"/></inertial></link><link name="hand"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1"
iyz="0" izz="1"/></inertial></link>
<joint name="elbow" type="continuous"><origin rpy="0 0.5 0"  xyz="0.30  1e-1 2" /><parent link="root"/>
<child link="arm"/></joint><joint name="wrist" type="continuous"><parent link="arm"/><child link="hand"/>
<axis xyz="0 0 1"/></joint></robot>"""


def check(arm, path, displaced, read=mechanism):
    """Writes a model and compares all homes with those of the model before."""
    write_model(path, arm, arm.known, displaced=displaced)
    for before, after in zip(arm.tree.bodies, read(path).tree.bodies, strict=True):
        home = before.home.copy()
        home[:3, 3] += displaced.get(before.name, np.zeros(3))
        np.testing.assert_allclose(after.home, home, atol=1e-12)
        np.testing.assert_array_equal(after.twist, before.twist)


def test_mjcf_bodies_in_turned_frames_or_without_a_place(tmp_path):
    (tmp_path / "a.xml").write_text(DISPLACED_MJCF)
    arm = mechanism(tmp_path / "a.xml")
    check(arm, tmp_path / "b.xml", {"arm": SHIFT, "hand": 2 * SHIFT})
    check(mechanism(scenes.load("arm")), tmp_path / "c.xml", {"fore": SHIFT})
    (tmp_path / "a.xml").write_text(MJCF.format(compiler=""))
    check(mechanism(tmp_path / "a.xml", "base"), tmp_path / "b.xml", {"body2": SHIFT}, lambda p: mechanism(p, "base"))


def test_urdf_joints_keep_every_other_byte(tmp_path):
    (tmp_path / "a.urdf").write_text(DISPLACED_URDF)
    arm, new = mechanism(tmp_path / "a.urdf", "root"), tmp_path / "b.urdf"

    def read(path):
        return mechanism(path, "root")

    check(arm, new, {"arm": SHIFT}, read)
    expected = DISPLACED_URDF.replace('xyz="0.30  1e-1 2"', f'xyz="{0.3 + 0.012!r}  1e-1 {2 - 0.003!r}"')
    assert new.read_text() == expected
    check(arm, new, {"hand": SHIFT}, read)
    assert re.sub(r'<origin xyz="[^"]*"/>', "", new.read_text()) == DISPLACED_URDF


@pytest.mark.parametrize("version", [3, 4])
def test_opensim_joints_move_with_their_frames(tmp_path, version):
    turned = np.array([0.1, -0.4, 0.2])
    joints = [
        Joint("WeldJoint", "root", "ground", "pelvis"),
        Joint("PinJoint", "hip", "pelvis", "femur", [coordinate("hip")], at=(np.array([0, -0.1, 0]), turned)),
        Joint("PinJoint", "knee", "femur", "tibia", [coordinate("knee")], at=(np.array([0, -0.4, 0]), 2 * turned)),
    ]
    path, new = tmp_path / "a.osim", tmp_path / "b.osim"
    path.write_text(document(joints, PHI, version=version))
    check(quietly_read(path), new, {"femur": SHIFT, "tibia": 2 * SHIFT}, quietly_read)
    before, after = (re.sub(r"[-+.\de]+", "#", each.read_text()) for each in (path, new))
    assert before == after
    if version == 4:
        path.write_text(path.read_text().replace("<translation>", "<other>").replace("</translation>", "</other>"))
        with pytest.raises(ModelError, match="the joint that carries 'femur' has no offset frame of its own; add one"):
            write_model(new, quietly_read(path), quietly_read(path).known, displaced={"femur": SHIFT})

"""Updated models: bodies and displaced joints are written back, with all else as it was."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from commands import sentence_of
from mechanisms import random_phi
from opensim_files import Joint, coordinate, document
from opensim_walker import PHI
from test_urdf import ARM

import scenes
from sim.models.model_mechanism import mechanism
from sim.models.model_update import updated_spec, write_model
from sim.models.mujoco_model import parameters_from_model
from sim.models.urdf import model_from_urdf

pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
MJCF = """<mujoco><!-- kept --><compiler angle="radian"{compiler}/>
<default><default class="c"><joint damping="0.123456789"/></default></default>
<worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="base" pos="0.123456789 0 1">
<geom size=".1"/><body pos="0 0 0.3333333333"><joint class="c" name="u" axis="1 0.123456789 0"/><geom size=".1"/>
<site name="tip" pos="0.987654321 0 0"/><frame pos="0 1 0" euler="0 1.5 0"><frame euler="0.5 0 0">
<body name="hand" pos="0.3 0.1 0"><inertial pos=".1 0 0" mass="1.5" fullinertia=".2 .3 .4 .01 0 0"/>
<joint name="w" axis="0 1 0"/></body></frame></frame></body></body>
<body name="other"><inertial pos="0 0 .1" mass="2" diaginertia=".1 .1 .1"/><geom size=".2"/></body>
</worldbody></mujoco>"""
OVERRIDES = ("", ' inertiafromgeom="true"', ' boundmass="1.7" boundinertia=".3"', ' balanceinertia="true"')


FOLLOWS = r"body_(mass|subtreemass|invweight0|ipos|iquat|inertia|sameframe|simple)|(geom|site)_sameframe|bvh_.*"
FOLLOWS += r"|dof_(invweight0|M0|length|simplenum)|(actuator_acc|tendon_invweight|light_poscom|cam_poscom)0"
FOLLOWS += r"|names|paths|_.*|.*map.*|.*[MDBC]_.*"
"""Arrays of a compiled model that follow from its bodies' inertias, and those of names and memory."""


def assert_others_untouched(updated, expected):
    """Checks that nothing of a compiled model differs but the inertias of bodies 1 to 3."""
    arrays = {name: getattr(expected, name, None) for name in dir(expected) if not re.fullmatch(FOLLOWS, name)}
    kept = {name: x for name, x in arrays.items() if isinstance(x, np.ndarray)}
    assert len(kept) > 100
    for name, x in kept.items():
        np.testing.assert_array_equal(getattr(updated, name), x, err_msg=name)
    for field in ("body_mass", "body_ipos", "body_inertia"):
        np.testing.assert_allclose(getattr(updated, field)[4:], getattr(expected, field)[4:], rtol=1e-12)


@pytest.mark.parametrize("compiler", OVERRIDES)
@pytest.mark.parametrize("kind", ["file", "specification"])
def test_an_updated_mjcf_reads_back_as_the_parameters_with_all_else_untouched(written, compiler, kind):
    path = written("arm.xml", MJCF.format(compiler=compiler))
    source = path if kind == "file" else mujoco.MjSpec.from_file(str(path))
    phi = random_phi(np.random.default_rng(0), 3)
    before, out = mujoco.MjModel.from_xml_path(str(path)), path.with_name("updated.xml")
    spec = updated_spec(mechanism(source, "base"), phi)
    write_model(out, mechanism(source, "base"), phi)
    assert_others_untouched(spec.compile(), before)
    for each in (spec, out):
        np.testing.assert_allclose(parameters_from_model(each, "base"), phi, rtol=1e-9, atol=1e-12)
    if kind == "file":
        assert_others_untouched(mujoco.MjModel.from_xml_path(str(out)), before)
        assert "<!-- kept -->" in out.read_text(encoding="utf-8")


def test_what_cannot_be_updated_is_refused_in_a_sentence(written, tmp_path):
    nameless = written("arm.urdf", "<robot name='x'><link/></robot>")
    path = written("arm.xml", MJCF.format(compiler=""))
    phi = random_phi(np.random.default_rng(0), 3)
    bad = phi.copy()
    bad[14] = -1
    arm, loaded = mechanism(path, "base"), mechanism(mujoco.MjModel.from_xml_path(str(path)), "base")
    for call, *given, message in (
        (write_model, tmp_path / "x.xml", arm, phi[:-1], "base, body2, hand need 30 finite parameters"),
        (write_model, tmp_path / "x.xml", arm, bad, "'body2' are not those of a physical body"),
        (write_model, tmp_path / "x.urdf", arm, phi, "write 'x.xml' instead"),
        (updated_spec, loaded, phi, "not a compiled one or none"),
        (updated_spec, replace(arm, source=None), phi, "not a compiled one or none"),
        (model_from_urdf, path, "a URDF file has a <robot>, this one a <mujoco>"),
        (model_from_urdf, nameless, "arm.urdf: "),
    ):
        assert message in sentence_of(call, *given)
    assert {each.name for each in tmp_path.iterdir()} == {"arm.urdf", "arm.xml"}


SHIFT = np.array([0.012, 0.0, -0.003])


def check(path, new, displaced, base=None):
    """Writes a file's model and compares all homes with those of the model before."""
    arm = mechanism(path, base)
    write_model(new, arm, arm.known, displaced=displaced)
    for before, after in zip(arm.tree.bodies, mechanism(new, base).tree.bodies, strict=True):
        home = before.home.copy()
        home[:3, 3] += displaced.get(before.name, np.zeros(3))
        np.testing.assert_allclose(after.home, home, atol=1e-12)
        np.testing.assert_array_equal(after.twist, before.twist)


def test_mjcf_bodies_in_turned_frames_or_without_a_place(written, tmp_path):
    path = written("a.xml", MJCF.format(compiler=""))
    check(path, tmp_path / "b.xml", {"body2": SHIFT, "hand": 2 * SHIFT, "other": 3 * SHIFT})
    check(path, tmp_path / "b.xml", {"body2": SHIFT}, "base")
    check(scenes.load("arm"), tmp_path / "c.xml", {"fore": SHIFT})


def test_urdf_joints_keep_every_other_byte(written, tmp_path):
    text = ARM.replace('<parent link="root"/>', '<origin rpy="0 0.5 0"  xyz="0.30  1e-1 2" /><parent link="root"/>')
    path, new = written("a.urdf", text), tmp_path / "b.urdf"
    check(path, new, {"lean": SHIFT}, "root")
    expected = text.replace('xyz="0.30  1e-1 2"', f'xyz="{0.3 + 0.012!r}  1e-1 {2 - 0.003!r}"')
    assert new.read_bytes().decode() == expected
    check(path, new, {"bare": SHIFT}, "root")
    assert re.sub(r'<origin xyz="[^"]*"/>', "", new.read_bytes().decode()) == text


@pytest.mark.parametrize("version", [3, 4])
def test_opensim_joints_move_with_their_frames(written, version):
    turned = np.array([0.1, -0.4, 0.2])
    joints = [
        Joint("WeldJoint", "root", "ground", "pelvis"),
        Joint("PinJoint", "hip", "pelvis", "femur", [coordinate("hip")], at=(np.array([0, -0.1, 0]), turned)),
        Joint("PinJoint", "knee", "femur", "tibia", [coordinate("knee")], at=(np.array([0, -0.4, 0]), 2 * turned)),
    ]
    path = written("a.osim", document(joints, PHI, version=version))
    new = path.with_name("b.osim")
    check(path, new, {"femur": SHIFT, "tibia": 2 * SHIFT})
    before, after = (re.sub(r"[-+.\de]+", "#", each.read_text()) for each in (path, new))
    assert before == after
    if version == 4:
        arm = mechanism(written("a.osim", path.read_text().replace("translation>", "other>")))
        message = "the joint that carries 'femur' has no offset frame of its own; add one"
        assert message in sentence_of(write_model, new, arm, arm.known, displaced={"femur": SHIFT})

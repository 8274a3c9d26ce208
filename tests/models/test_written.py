"""Written models: drives, bodies with their intervals, and constraints change, and nothing else."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from looped import MODELS
from mechanisms import random_phi
from opensim_files import Joint, coordinate, document
from test_model_update import MJCF
from test_urdf import ARM
from test_urdf_files import CORNERS

from ident.geometry.inertia import com_from_parameters
from ident.mechanism.drives import Actuator, Drive
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.consistency import consistent_parameters
from sim.models.inertials import DIGITS, shortened
from sim.models.model_mechanism import mechanism
from sim.models.model_update import write_model
from sim.models.xml_files import ModelFile, set_comment

pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
SERVOS = """<mujoco><default><joint damping="9" armature="1" stiffness="5"/>
  <default class="stiff"><position kp="7" dampratio="1"/></default>
  <default class="own"><general gainprm="9" biasprm="0 -9 -1"/></default></default>
  <worldbody><body><joint name="a" springdamper="1 1"/><geom size="1"/>
  <body><joint name="b" axis="0 1 0"/><geom size="1"/></body>
  <body><joint name="c" axis="0 1 0"/><geom size="1"/></body></body></worldbody>
  <actuator><motor name="free" joint="a"/><position name="pa" class="stiff" joint="a"/></actuator>
  <actuator><general name="pb" class="own" joint="b" biastype="affine"/></actuator>
  <actuator><position name="pc" joint="c" kp="3" kv="0.5"/></actuator>
  </mujoco>"""


def test_numbers_are_set_whatever_the_classes_of_joints_and_actuators_have(written):
    path = written("arm.xml", SERVOS)
    arm, new = mechanism(path), path.with_name("new.xml")
    drives = {"a": arm.drives["a"].with_servo(20.0, 1.5), "b": arm.drives["b"].with_servo(30.0, 2.5)}
    own = {"viscous": 1.25, "coulomb": 0.75, "rotor": 0.5, "stiffness": 0.0}
    drives = {"a": replace(drives["a"], **own), "b": drives["b"], "c": arm.drives["c"]}
    write_model(new, arm, arm.known, drives)
    assert mechanism(new).drives == drives
    np.testing.assert_allclose(mechanism(new).known, arm.known, rtol=1e-12, atol=1e-15)
    joints = {joint.get("name"): joint for joint in ET.parse(new).iter("joint")}
    assert joints["a"].get("damping") == "1.25" and joints["c"].attrib == {"name": "c", "axis": "0 1 0"}
    model = mujoco.MjModel.from_xml_path(str(new))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = 0.1, 0.2, 0.3
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator[:2], [0.3 + 20 * 0.2 - 1.5 * 0.2, 30 * 0.2 - 2.5 * 0.2], rtol=1e-12)
    assert arm.drives["c"].with_servo(3.0, 0.5) == arm.drives["c"] and Drive().with_servo(1.0, 1.0) == Drive()


def test_of_urdf_only_the_numbers_of_dynamics_change(written):
    before = ARM.replace('<child link="lean"/>', '<child link="lean"/><dynamics friction="0.5"   damping="1.0"/>')
    path = written("arm.urdf", before)
    arm, new, joint = mechanism(path), path.with_name("new.urdf"), '<joint name="b" type="continuous">'
    write_model(new, arm, arm.known, {"a": Drive(1.25, 0.75, 0.5), "b": Drive(0.125, 0.0625, 0.25, 3.0)})
    after = before.replace('friction="0.5"   damping="1.0"', 'friction="0.75"   damping="1.25"')
    after = after.replace(joint, f'{joint}<dynamics damping="0.125" friction="0.0625"/>')
    assert new.read_bytes().decode() == after
    write_model(new, arm, arm.known, arm.drives)
    assert new.read_bytes().decode() == before


ATTLIST = "<!DOCTYPE a [<!ATTLIST a b CDATA '1'>]>"
COMMENT = re.compile(r"<!-- 95 % intervals.*?-->", re.DOTALL)
NUMBER = re.compile(r"\d\.?\d*(?:e-?\d+)?")


def full_of(arm, seed=0):
    phi = random_phi(np.random.default_rng(seed), len(arm.bodies))
    base = find_base_parameters(arm)
    psi = base.regroup(phi)
    return consistent_parameters(psi, np.diag((0.01 * abs(psi) + 1e-3) ** 2), base, phi, bodies=arm.bodies)


def assert_short(text):
    """Comments apart, every number of an inertial has seven digits at most."""
    inertials = re.findall(r"<inertial>.*?</inertial>|<inertial .*?>", COMMENT.sub("", text), re.DOTALL)
    assert inertials
    for word in NUMBER.findall(" ".join(re.sub(r"<origin rpy[^x]*", "", each) for each in inertials)):
        assert len(word.partition("e")[0].replace(".", "").lstrip("0")) <= 7, word


def opensim(version):
    joints = [Joint("PinJoint", f"pin{k}", on, f"b{k}", [coordinate(f"q{k}")]) for k, on in enumerate(("ground", "b0"))]
    phi = random_phi(np.random.default_rng(2), 2).reshape(2, 10)
    return document(joints, dict(zip(("b0", "b1"), phi, strict=True)), version=version)


@pytest.mark.parametrize(
    ("text", "name", "base"),
    [
        (MJCF.format(compiler=""), "arm.xml", "base"),
        (ARM, "arm.urdf", "root"),
        (opensim(3), "3.osim", "b0"),
        (opensim(4), "4.osim", "b0"),
    ],
)
def test_bodies_are_written_with_their_intervals_and_short_numbers(written, text, name, base):
    path = written(name, text)

    def updated(arm, phi):
        write_model(path.with_name(f"new_{name}"), arm, phi)
        return path.with_name(f"new_{name}").read_text(encoding="utf-8")

    original = arm = mechanism(path, base)
    for seed in range(2):
        full = full_of(arm, seed)
        after = updated(arm, full)
        assert len(COMMENT.findall(after)) == len(arm.bodies) and after.isascii() == text.isascii()
        for body, row in zip(arm.bodies, full.rows[::10], strict=True):
            assert f"mass {row.words} kg" in full.comments[body] and full.comments[body] in after
        if "osim" not in name:
            assert_short(after)
        arm = mechanism(written(f"with_{name}", after), base)
        for ours, theirs in zip(arm.known.reshape(-1, 10), full.phi.reshape(-1, 10), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-4 * abs(theirs).max())
    assert len(COMMENT.findall(updated(arm, arm.known))) == len(arm.bodies)
    noted = SimpleNamespace(phi=arm.known, comments=dict.fromkeys(arm.bodies, "95 % intervals are others."))
    assert updated(arm, noted).count("<!-- 95 % intervals are others. -->") == len(arm.bodies)
    assert not COMMENT.search(updated(arm, 1.01 * arm.known) + updated(original, full.phi))


ODD = """<?xml version='1.0' encoding="UTF-8"?>
<!-- Größe: drawn by hand -->
<mujoco model = 'odd'>
    <compiler angle="radian" settotalmass="-1"/>
    <worldbody> <!-- a > b -->
        <body name='Fuß'>
            <geom size=".1"/>
        </body>
        <body  name="Knie"
               pos="1  0 2e-1" ><!-- left -->
            <joint name='Gelenk'   axis="0 1 0"
                   damping='.5'/>

            <inertial mass = '2.50'  pos="0 0  .1" euler="0 0 0.1"
                      diaginertia="0.010 .02 2.0e-2"></inertial>
            <body name="Hand" pos='0 .5 0'>
                <joint name='w'/>
                <geom size='.2'
                      mass="1"/>
            </body>
        </body>
    </worldbody>
    <actuator><!-- none
         before --><position name="p" joint="Gelenk" kp="5" kv=".1"/></actuator>
</mujoco>
<!-- the end, without a new line -->"""


@pytest.fixture(params=["\n", "\r\n"])
def odd(written, request):
    """A mechanism whose file has an odd layout, its text, and a function that writes it and returns the text."""
    text = ODD.replace("\n", request.param)
    path = written("odd.xml", text)
    arm = mechanism(path, "Knie")

    def update(phi=arm.known, name="new.xml", arm=arm, **given):
        write_model(path.with_name(name), arm, phi, **given)
        return path.with_name(name).read_bytes().decode()

    return arm, text, update


def test_of_mjcf_what_does_not_change_is_kept_byte_for_byte(odd):
    _, text, update = odd
    assert update() == text
    stiffer = {"Gelenk": Drive(viscous=0.5, actuators=(Actuator("p", gain=6.0, kp=6.0, kv=0.1),))}
    assert update(drives=stiffer) == text.replace('kp="5"', 'kp="6.0"')
    assert update(displaced={"Knie": np.array([0.0, 0.25, 0.0])}) == text.replace('"1  0 2e-1"', '"1  0.25 2e-1"')
    assert update(drives={"Gelenk": Drive(viscous=0.75)}) == text.replace("'.5'", "'0.75'")


def test_of_mjcf_only_inertias_that_change_are_written(odd):
    arm, text, update = odd
    knee, hand = arm.known.copy(), arm.known.copy()
    knee[:10] *= 2
    hand[10:] *= 2
    after = update(knee)
    stated, new = (re.search(r"<inertial.*?>", each, re.DOTALL)[0] for each in (text, after))
    assert after == text.replace(stated, new)
    assert new.startswith("<inertial mass = '5.0'  pos=\"0 0  .1\"") and "euler" not in new
    assert '\n                      diaginertia="' in new
    after = update(hand)
    (line,) = set(after.splitlines(keepends=True)) - set(text.splitlines(keepends=True))
    assert line.startswith('                <inertial mass="2.0" pos="0.0 0.0 0.0"') and line.rstrip().endswith('"/>')
    assert after.replace(line, "", 1) == text
    again = mechanism(arm.source.text.with_name("new.xml"), "Knie")
    np.testing.assert_allclose(again.known, hand, rtol=1e-9, atol=1e-12)
    assert update(hand, "again.xml", again) == after


def commented(comment):
    return lambda root: set_comment(root, "new", comment)


@pytest.mark.parametrize(
    ("before", "change", "after"),
    [
        ("<a><b/><!-- x --></a>", lambda r: r.set("k", 'é"&<'), '<a k="é&quot;&amp;&lt;"><b/><!-- x --></a>'),
        ("<a b='1'\n c = \"2\" />", lambda r: r.attrib.pop("b"), '<a\n c = "2" />'),
        ("<a b='&#49; &lt;  &#50;'/>", lambda r: r.set("b", "1 > 2"), "<a b='&#49; &gt;  &#50;'/>"),
        ("<a>\r\n <b/>\r\n</a>", commented("new: 2"), "<a>\r\n <!-- new: 2 -->\r\n <b/>\r\n</a>"),
        ("<a><b/><!--new: 1--> </a>", commented("new: 2"), "<a><b/><!--new: 2--> </a>"),
        ("<a>\n <b/>\n <!--new: 1--><!---->\n</a>", commented(""), "<a>\n <b/><!---->\n</a>"),
        ("<a><b/></a>", commented(""), "<a><b/></a>"),
        ("<a><!-- old --><!-- new : 1 --></a>", commented("new: 2"), "<a><!-- old --><!-- new: 2 --></a>"),
        ("<a><b> 1  2 </b></a>", lambda r: setattr(r[0], "text", "1 3"), "<a><b> 1  3 </b></a>"),
        ("<a><b/></a>", lambda r: setattr(r[0], "text", "1 < 3"), "<a><b>1 &lt; 3</b></a>"),
        ("<a> <b/> <c/></a>", lambda r: r.insert(1, ET.Element("d", e="1")), '<a> <b/> <d e="1"/> <c/></a>'),
        ("\ufeff<!--x--><a><b /></a >", lambda r: r[0].append(ET.Element("c")), "\ufeff<!--x--><a><b><c/></b></a >"),
        (f"{ATTLIST}<a/>", commented("new: 2"), f"{ATTLIST}<a><!-- new: 2 --></a>"),
    ],
)
def test_elements_change_in_their_places(before, change, after):
    file = ModelFile(Path("a.xml"), before.encode())
    assert file.changed().decode() == before
    change(file.root)
    assert file.changed().decode() == after


def test_short_numbers_are_those_of_a_body_or_the_ones_that_were():
    """Rounded, the moments of a thin disc would be those of no body."""
    for phi in random_phi(np.random.default_rng(0), 20).reshape(-1, 10):
        for exact, short in zip(com_from_parameters(phi), shortened(*com_from_parameters(phi)), strict=True):
            assert 0 < np.max(abs(short - exact)) / np.max(np.abs(exact)) < 0.5 * 10.0 ** (1 - DIGITS)
    point = shortened(0.12345678, np.zeros(3), np.zeros((3, 3)))
    assert point[0] == 0.123457 and not point[1].any() and not point[2].any()
    assert not np.signbit(shortened(1.0, np.array([-1e-9, 0, 0.5]), np.eye(3))[1]).any()
    disc = 1.0, np.zeros(3), np.diag([1.000004, 1.000004, 2.000008])
    np.testing.assert_array_equal(shortened(*disc)[2], disc[2])


def test_a_file_in_another_folder_finds_its_meshes_and_has_the_same_lines(written):
    written("Teile/a.obj", CORNERS)
    asset = '<asset>\n        <mesh name="a" file="a.obj"/>\n    </asset>\n    <worldbody>'
    text = ODD.replace("<worldbody>", asset).replace("settotalmass", "meshdir='Teile' settotalmass")
    arm, out = mechanism(written("odd.xml", text), "Knie"), written("out/odd.xml", "")
    write_model(out, arm, arm.known)
    folders = '    <compiler meshdir="../Teile" texturedir=".."/>\n'
    expected = text.replace(" meshdir='Teile'", "").replace("    <compiler", folders + "    <compiler", 1)
    assert out.read_bytes().decode() == expected


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("</worldbody>", "<replicate count='2' offset='1 0 0'><geom size='.1'/></replicate></worldbody>"),
        ("<joint name='w'/>", "<include file='w.xml'/>"),
    ],
)
def test_files_that_generate_bodies_are_written_by_mujoco(written, old, new):
    written("w.xml", "<mujocoinclude><joint name='w'/></mujocoinclude>")
    path = written("odd.xml", ODD.replace(old, new))
    arm = mechanism(path, "Knie")
    write_model(path.with_name("new.xml"), arm, 2 * arm.known)
    again = mechanism(path.with_name("new.xml"), "Knie")
    np.testing.assert_allclose(again.known, 2 * arm.known, rtol=1e-9, atol=1e-12)
    assert again.tree.joints == arm.tree.joints


@pytest.mark.parametrize("name", ["gripper", "tendons", "welded", "delta"])
def test_constraints_are_written_back_byte_for_byte(written, name):
    text, driven = MODELS[name]
    before = text.replace('<geom size=".02" mass="1"/>', '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>')
    odd = "<!-- ä, as > is -->\n  <joint  name='odd' active='false' joint1=\"{0}\" polycoef=' 0  1' ></joint>"
    before = before.replace("</equality>", odd.format(driven[0]) + "</equality>", 1)
    path = written("arm.xml", before)
    arm, new = mechanism(path), path.with_name("new.xml")
    phi = 1.25 * arm.closed([joint for joint in arm.tree.joints if joint not in driven]).known
    write_model(new, arm, phi)
    after = new.read_text(encoding="utf-8")
    sections = [re.findall(r"<(equality|tendon)>(.*?)</\1>", each, re.DOTALL) for each in (before, after)]
    assert sections[0] == sections[1] and "polycoef=' 0  1' >" in after and after != before
    np.testing.assert_allclose(mechanism(new).known, phi, rtol=1e-6, atol=1e-9)

"""Written models: drives, bodies with their intervals, and constraints change, and nothing else."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import driven_arm
import mujoco
import numpy as np
import opensim_files
import pytest
from looped import MODELS
from mechanisms import random_phi
from test_model_update import MJCF
from test_urdf import ARM
from test_urdf_files import CORNERS

import sim
from ident.mechanism.drives import Actuator, Drive
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.consistency import consistent_parameters
from sim.models.model_mechanism import mechanism
from sim.models.model_update import write_model
from sim.models.xml_files import ModelFile, restated, set_comment

CLASSES = driven_arm.text(**{key: (2.0, 2.0, 2.0) for key in ("damping", "frictionloss", "armature")}).replace(
    "<worldbody>", '<default><joint damping="9" armature="1" stiffness="5"/></default><worldbody>'
)
URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <joint name="turn" type="revolute"><!-- geared -->
    <parent link="base"/><child link="one"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="9" velocity="9"/>
    <dynamics friction="0.5"   damping="1.0"/>
  </joint>
  <link name="one"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bend" type="revolute">
    <parent link="one"/><child link="two"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/>
  </joint>
  <link name="two"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""
NEW = {"turn": Drive(1.25, 0.75, 0.5), "bend": Drive(0.125, 0.0625, 0.03125, 3.0)}


def test_numbers_are_set_on_the_joint_whatever_its_class_has(tmp_path):
    (tmp_path / "arm.xml").write_text(CLASSES, encoding="utf-8")
    arm = sim.mechanism(tmp_path / "arm.xml")
    write_model(tmp_path / "new.xml", arm, arm.known, NEW)
    written = sim.mechanism(tmp_path / "new.xml")
    assert written.drives["turn"] == NEW["turn"]
    assert written.drives["bend"] == replace(NEW["bend"], springref=written.drives["bend"].springref)
    assert written.drives["lift"] == arm.drives["lift"]
    np.testing.assert_allclose(written.known, arm.known, rtol=1e-12, atol=1e-15)
    joints = {joint.get("name"): joint for joint in ET.parse(tmp_path / "new.xml").iter("joint") if joint.get("name")}
    assert joints["turn"].get("damping") == "1.25" and joints["bend"].get("stiffness") == "3.0"
    # What does not change is not stated anew.
    assert joints["turn"].get("stiffness") == "0.0" and joints["lift"].get("damping") == "2.0"


SERVOS = """<mujoco><default><default class="stiff"><position kp="7" dampratio="1"/></default>
  <default class="own"><general gainprm="9" biasprm="0 -9 -1"/></default></default>
  <worldbody><body><joint name="a"/><geom size="1"/><body><joint name="b" axis="0 1 0"/><geom size="1"/></body>
  <body><joint name="c" axis="0 1 0"/><geom size="1"/></body></body></worldbody>
  <actuator><motor name="free" joint="a"/><position name="pa" class="stiff" joint="a"/></actuator>
  <actuator><general name="pb" class="own" joint="b" biastype="affine"/></actuator>
  <actuator><position name="pc" joint="c" kp="3" kv="0.5"/></actuator>
  </mujoco>"""


def test_gains_of_position_actuators_are_set_whatever_their_classes_have(tmp_path):
    (tmp_path / "arm.xml").write_text(SERVOS, encoding="utf-8")
    arm = sim.mechanism(tmp_path / "arm.xml")
    new = {"a": arm.drives["a"].with_servo(20.0, 1.5), "b": arm.drives["b"].with_servo(30.0, 2.5)}
    assert new["a"] != arm.drives["a"] and new["b"] != arm.drives["b"]
    write_model(tmp_path / "new.xml", arm, arm.known, new | {"c": arm.drives["c"]})
    written = sim.mechanism(tmp_path / "new.xml")
    gains = {each.name: (each.kp, each.kv, each.kind) for own in written.drives.values() for each in own.actuators}
    servos = {"pa": (20.0, 1.5), "pb": (30.0, 2.5), "pc": (3.0, 0.5)}
    assert gains == {"free": (0, 0, "motor")} | {name: (*own, "position") for name, own in servos.items()}
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml"))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = 0.1, 0.2, 0.3
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator[:2], [0.3 + 20 * 0.2 - 1.5 * 0.2, 30 * 0.2 - 2.5 * 0.2], rtol=1e-12)
    same = {"c": arm.drives["c"].with_servo(3.0, 0.5)}
    assert same == {"c": arm.drives["c"]} and Drive().with_servo(1.0, 1.0) == Drive()


def test_of_urdf_only_the_numbers_of_dynamics_change(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF, encoding="utf-8")
    arm = sim.mechanism(tmp_path / "arm.urdf")
    write_model(tmp_path / "new.urdf", arm, arm.known, NEW)
    expected = URDF.replace('friction="0.5"   damping="1.0"', 'friction="0.75"   damping="1.25"')
    expected = expected.replace(
        '<joint name="bend" type="revolute">\n    ',
        '<joint name="bend" type="revolute">\n    <dynamics damping="0.125" friction="0.0625"/>\n    ',
    )
    assert (tmp_path / "new.urdf").read_text(encoding="utf-8") == expected
    write_model(tmp_path / "same.urdf", arm, arm.known, arm.drives)
    assert (tmp_path / "same.urdf").read_text(encoding="utf-8") == URDF


COMMENT = re.compile(r"<!-- 95 % intervals.*?-->", re.DOTALL)
NUMBER = re.compile(r"\d\.?\d*(?:e-?\d+)?")


def full_of(arm, seed=0):
    """Bodies of a mechanism with intervals."""
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


@pytest.mark.parametrize(("text", "name"), [(MJCF.format(compiler=""), "arm.xml"), (ARM, "arm.urdf")])
@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_bodies_are_written_with_their_intervals_and_short_numbers(tmp_path, text, name):
    path, out, again = (tmp_path / each for each in (name, f"new_{name}", f"again_{name}"))
    path.write_text(text, encoding="utf-8", newline="")
    base = "base" if name == "arm.xml" else "root"
    arm = mechanism(path, base)
    full = full_of(arm)
    write_model(out, arm, full)
    first = out.read_text(encoding="utf-8")
    assert len(COMMENT.findall(first)) == len(arm.bodies) and first.isascii() == text.isascii()
    for body, row in zip(arm.bodies, full.rows[::10], strict=True):
        assert f"mass {row.words} kg" in full.comments[body] and full.comments[body] in first
    assert_short(first)
    written = mechanism(out, base)
    for ours, theirs in zip(written.known.reshape(-1, 10), full.phi.reshape(-1, 10), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-5 * abs(theirs).max())
    other = full_of(written, seed=1)
    write_model(again, written, other)
    second = again.read_text(encoding="utf-8")
    assert len(COMMENT.findall(second)) == len(arm.bodies) and other.comments[arm.bodies[-1]] in second
    write_model(out, arm, full.phi)
    assert not COMMENT.search(out.read_text(encoding="utf-8"))
    np.testing.assert_allclose(mechanism(out, base).known, full.phi, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("version", [3, 4])
def test_an_opensim_file_has_the_intervals_of_its_bodies(tmp_path, version):
    path, out = tmp_path / "model.osim", tmp_path / "new.osim"
    phi = random_phi(np.random.default_rng(2), 2)
    joints = [
        opensim_files.Joint("PinJoint", f"pin{k}", parent, f"b{k}", [opensim_files.coordinate(f"q{k}")])
        for k, parent in enumerate(("ground", "b0"))
    ]
    own = {f"b{k}": phi[10 * k : 10 * k + 10] for k in range(2)}
    path.write_text(opensim_files.document(joints, own, version=version))
    arm = mechanism(path, "b0")
    write_model(out, arm, full_of(arm))
    assert len(COMMENT.findall(out.read_text())) == len(arm.bodies)
    np.testing.assert_allclose(mechanism(out, "b0").known, full_of(arm).phi, rtol=1e-4, atol=1e-4)


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
def odd(tmp_path, request):
    """A mechanism whose file has an odd layout, its text, and a function that writes it and returns the text."""
    text = ODD.replace("\n", request.param)
    (tmp_path / "odd.xml").write_bytes(text.encode())
    arm = mechanism(tmp_path / "odd.xml", "Knie")

    def written(phi=arm.known, **given):
        write_model(tmp_path / "new.xml", arm, phi, **given)
        return (tmp_path / "new.xml").read_bytes().decode()

    return arm, text, written


def test_of_mjcf_what_does_not_change_is_kept_byte_for_byte(odd):
    _, text, written = odd
    assert written() == text
    stiffer = {"Gelenk": Drive(viscous=0.5, actuators=(Actuator("p", gain=6.0, kp=6.0, kv=0.1),))}
    assert written(drives=stiffer) == text.replace('kp="5"', 'kp="6.0"')
    displaced = written(displaced={"Knie": np.array([0.0, 0.25, 0.0])})
    assert displaced == text.replace('"1  0 2e-1"', '"1  0.25 2e-1"')
    assert written(drives={"Gelenk": Drive(viscous=0.75)}) == text.replace("'.5'", "'0.75'")


def test_of_mjcf_only_inertias_that_change_are_written(odd):
    arm, text, written = odd
    phi = arm.known.copy()
    phi[:10] *= 2
    stated = re.search(r"<inertial.*?>", text, re.DOTALL)[0]
    new = re.search(r"<inertial.*?>", written(phi), re.DOTALL)[0]
    assert written(phi) == text.replace(stated, new)
    assert new.startswith("<inertial mass = '5.0'  pos=\"0 0  .1\"") and "euler" not in new
    assert '\n                      diaginertia="' in new
    phi = arm.known.copy()
    phi[10:] *= 2
    after = written(phi)
    (line,) = set(after.splitlines(keepends=True)) - set(text.splitlines(keepends=True))
    assert line.startswith('                <inertial mass="2.0" pos="0.0 0.0 0.0"') and line.rstrip().endswith('"/>')
    assert after.replace(line, "", 1) == text
    again = mechanism(arm.source.text.with_name("new.xml"), "Knie")
    np.testing.assert_allclose(again.known, phi, rtol=1e-9, atol=1e-12)
    write_model(again.source.text.with_name("again.xml"), again, phi)
    assert again.source.text.with_name("again.xml").read_bytes().decode() == after


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_comments_of_mjcf_are_replaced_in_their_places(odd):
    arm, text, written = odd
    first = written(full_of(arm))
    arm = mechanism(arm.source.text.with_name("new.xml"), "Knie")
    write_model(arm.source.text.with_name("again.xml"), arm, full_of(arm, seed=1))
    second = arm.source.text.with_name("again.xml").read_bytes().decode()
    lines = [each.splitlines(keepends=True) for each in (first, second)]
    changed = [x for x, y in zip(*lines, strict=True) if x != y]
    assert 0 < len(changed) == sum("95 %" in x or "inertia" in x for x in changed)
    assert COMMENT.sub("", first).count("<!--") == text.count("<!--")


def with_comment(root):
    set_comment(root, "new: 2")


@pytest.mark.parametrize(
    ("before", "change", "after"),
    [
        ("<a><b/><!-- x --></a>", lambda r: r.set("k", 'é"&<'), '<a k="é&quot;&amp;&lt;"><b/><!-- x --></a>'),
        ("<a b='1'\n c = \"2\" />", lambda r: r.attrib.pop("b"), '<a\n c = "2" />'),
        ("<a b='&#49; &lt;  &#50;'/>", lambda r: r.set("b", "1 > 2"), "<a b='&#49; &gt;  &#50;'/>"),
        ("<a b='1 2'/>", lambda r: r.set("b", "1 2 3"), "<a b='1 2 3'/>"),
        ("<a/>", with_comment, "<a><!-- new: 2 --></a>"),
        ("<a>\r\n <b/>\r\n</a>", with_comment, "<a>\r\n <!-- new: 2 -->\r\n <b/>\r\n</a>"),
        ("<a><b/><!--new: 1--> </a>", with_comment, "<a><b/><!--new: 2--> </a>"),
        ("<a><!-- old --><!-- new : 1 --></a>", with_comment, "<a><!-- old --><!-- new: 2 --></a>"),
        ("<a><b> 1  2 </b></a>", lambda r: setattr(r[0], "text", "1 3"), "<a><b> 1  3 </b></a>"),
        ("<a><b/></a>", lambda r: setattr(r[0], "text", "1 < 3"), "<a><b>1 &lt; 3</b></a>"),
        ("<a> <b/> <c/></a>", lambda r: r.insert(1, ET.Element("d", e="1")), '<a> <b/> <d e="1"/> <c/></a>'),
        ("\ufeff<!--x--><a><b /></a >", lambda r: r[0].append(ET.Element("c")), "\ufeff<!--x--><a><b><c/></b></a >"),
        ("<!DOCTYPE a [<!ATTLIST a b CDATA '1'>]><a/>", with_comment, None),
    ],
)
def test_elements_change_in_their_places(before, change, after):
    file = ModelFile(Path("a.xml"), before.encode())
    assert file.changed().decode() == before
    change(file.root)
    assert file.changed().decode() == (after or before.replace("<a/>", "<a><!-- new: 2 --></a>"))


def test_numbers_are_restated_where_they_differ_by_more_than_rounding():
    assert restated("1.50 .20 0e0", [1.5, 0.25, 1e-13]) == "1.50 0.25 0e0"
    assert restated("1.50 .20 0x0", [1.5, 0.25, 0.0]) == "1.50 0.25 0.0"
    assert restated("1.50 .20", [1.5, 0.2, 0.0]) == "1.5 0.2 0.0" == restated(None, [1.5, 0.2, 0.0])
    assert restated("", [0.0, 1e-13], 1.0) == "" and restated("", [0.0, 1e-11], 1.0) == "0.0 1e-11"


def test_a_file_in_another_folder_finds_its_meshes_and_has_the_same_lines(tmp_path):
    (tmp_path / "Teile").mkdir()
    (tmp_path / "Teile" / "a.obj").write_text(CORNERS)
    asset = '<asset>\n        <mesh name="a" file="a.obj"/>\n    </asset>\n    <worldbody>'
    text = ODD.replace("<worldbody>", asset).replace("settotalmass", "meshdir='Teile' settotalmass")
    (tmp_path / "odd.xml").write_bytes(text.encode())
    (tmp_path / "out").mkdir()
    arm = mechanism(tmp_path / "odd.xml", "Knie")
    write_model(tmp_path / "out" / "odd.xml", arm, arm.known)
    after = (tmp_path / "out" / "odd.xml").read_bytes().decode()
    folders = '    <compiler meshdir="../Teile" texturedir=".."/>\n'
    assert after == text.replace(" meshdir='Teile'", "").replace("    <compiler", folders + "    <compiler", 1)


@pytest.mark.parametrize(
    "text",
    [
        ODD.replace("</worldbody>", "<replicate count='2' offset='1 0 0'><geom size='.1'/></replicate></worldbody>"),
        ODD.replace("<joint name='w'/>", "<include file='w.xml'/>"),
    ],
)
def test_files_that_generate_bodies_are_written_by_mujoco(tmp_path, text):
    (tmp_path / "w.xml").write_text("<mujocoinclude><joint name='w'/></mujocoinclude>")
    (tmp_path / "odd.xml").write_bytes(text.encode())
    arm = mechanism(tmp_path / "odd.xml", "Knie")
    write_model(tmp_path / "new.xml", arm, 2 * arm.known)
    again = mechanism(tmp_path / "new.xml", "Knie")
    np.testing.assert_allclose(again.known, 2 * arm.known, rtol=1e-9, atol=1e-12)
    assert again.tree.joints == arm.tree.joints


def constraints(text):
    """Sections with constraints of a file, byte for byte."""
    return re.findall(r"<(equality|tendon)>(.*?)</\1>", text, re.DOTALL)


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
@pytest.mark.parametrize("name", ["gripper", "tendons", "welded", "delta"])
def test_constraints_are_written_back_byte_for_byte(tmp_path, name):
    inertial = '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>'
    before = MODELS[name][0].replace('<geom size=".02" mass="1"/>', inertial)
    odd = "<!-- ä, as > is -->\n  <joint  name='odd' active='false' joint1=\"{0}\" polycoef=' 0  1' ></joint>"
    before = before.replace("</equality>", odd.format(MODELS[name][1][0]) + "</equality>", 1)
    (tmp_path / "arm.xml").write_text(before, encoding="utf-8")
    arm = sim.mechanism(tmp_path / "arm.xml")
    closed = arm.closed([joint for joint in arm.tree.joints if joint not in MODELS[name][1]])
    phi = 1.25 * closed.known
    write_model(tmp_path / "new.xml", arm, phi)
    after = (tmp_path / "new.xml").read_text(encoding="utf-8")
    assert constraints(after) == constraints(before) and "polycoef=' 0  1' >" in after
    assert after != before
    np.testing.assert_allclose(sim.mechanism(tmp_path / "new.xml").known, phi, rtol=1e-6, atol=1e-9)

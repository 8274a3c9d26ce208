"""Xacro files are the URDF files that they describe; without the package that expands them, a sentence has the cure."""

import sys

import numpy as np
import pytest

from ident.errors import InputError, ModelError
from sim.models.model_mechanism import mechanism
from sim.models.model_update import write_model

pytestmark = pytest.mark.extras

LINK = (
    '<link name="{}"><inertial><origin xyz="0 0 0.1"/><mass value="{}"/>'
    '<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="j" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
)
HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
PARTS = f'{HEAD}<xacro:macro name="part" params="name m">{LINK.format("${name}", "${m}")}</xacro:macro></robot>'
XACRO = (
    f'{HEAD}<xacro:arg name="mass" default="2"/><xacro:include filename="parts.xacro"/>'
    f'<xacro:part name="base" m="1"/><xacro:part name="l1" m="$(arg mass)"/>{JOINT}'
)
URDF = HEAD + LINK.format("base", 1) + LINK.format("l1", 2) + JOINT


@pytest.fixture
def files(tmp_path):
    for name, text in (("parts.xacro", PARTS), ("arm.urdf.xacro", XACRO), ("arm.urdf", URDF), ("named.urdf", XACRO)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("name", ["arm.urdf.xacro", "named.urdf"])
def test_a_xacro_file_is_the_urdf_file_that_it_describes(files, name):
    pytest.importorskip("xacrodoc", reason="xacrodoc is in the extra 'xacro'")
    arm, plain = mechanism(files / name, "base"), mechanism(files / "arm.urdf", "base")
    assert arm.tree.joints == plain.tree.joints == ("j",)
    assert arm.tree == plain.tree and arm.ranges == plain.ranges
    np.testing.assert_array_equal(arm.known, plain.known)
    write_model(files / "new.urdf", arm, 2 * arm.known)
    np.testing.assert_allclose(mechanism(files / "new.urdf", "base").known, 2 * plain.known, rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("xacro:part name", "xacro:nope name", "unknown macro name: xacro:nope"),
        ("parts.xacro", "absent.xacro", "absent.xacro"),
        ("$(arg mass)", "${mass}", "'mass' is not defined"),
        ('<xacro:arg name="mass" default="2"/>', "", "substitution argument mass"),
        ("$(arg mass)", "${__import__('os').getcwd()}", "invalid name"),
    ],
)
def test_what_cannot_be_expanded_is_one_sentence_with_a_cure(files, old, new, message):
    pytest.importorskip("xacrodoc", reason="xacrodoc is in the extra 'xacro'")
    (files / "arm.urdf.xacro").write_text(XACRO.replace(old, new), encoding="utf-8")
    with pytest.raises(ModelError, match=rf"no xacro file that can be expanded \(.*{message}") as raised:
        mechanism(files / "arm.urdf.xacro", "base")
    assert "\n" not in str(raised.value)
    assert str(raised.value).endswith(
        "write the URDF file yourself: xacro arm.urdf.xacro [ARG:=VALUE] > arm_expanded.urdf."
    )


@pytest.mark.parametrize("name", ["arm.urdf.xacro", "named.urdf"])
def test_without_the_package_the_sentence_names_the_extra(files, monkeypatch, name):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    needed = (
        rf"multicontact\[xacro\]; or write the URDF file yourself: xacro {name} \[ARG:=VALUE\] > \w+_expanded\.urdf\.$"
    )
    with pytest.raises(InputError, match=needed):
        mechanism(files / name, "base")
    assert mechanism(files / "arm.urdf", "base").tree.joints == ("j",)

"""URDF files: all stated inertias are read, physical or not; written back, nothing else changes."""

import os
import re

import numpy as np
import pytest
from commands import sentence_of
from random_models import numbers
from scipy.spatial.transform import Rotation

from ident.errors import InputError
from ident.geometry.inertia import com_from_parameters, parameters_from_com, symmetric
from sim.models.inertials import is_balanced
from sim.models.model_mechanism import mechanism
from sim.models.model_update import write_model
from sim.models.mujoco_model import compiled, parameters_from_model
from sim.models.notes import ModelNote

pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")

LINK = """<link name="l{i}"><inertial><mass value="{m!r}"/><origin xyz="{c}" rpy="{rpy}"/>
<inertia {entries}/></inertial></link>"""
JOINT = """<joint name="j{i}" type="{kind}"><parent link="l{parent}"/><child link="l{i}"/><axis xyz="0 1 0"/>
<origin xyz="0 0 .3"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""


def random_urdf(rng, bodies):
    """Links with any symmetric matrix as inertia, tiny, without mass, without extent or without inertial."""
    text, phi, odd = [], [], []
    sizes = {"any": 1.0, "tiny": 1e-14, "no mass": 1.0}
    for i in range(bodies):
        what = rng.choice(["any", "tiny", "point", "no mass", "nothing", "no inertial"]) if i else "any"
        m = {"any": rng.uniform(0.1, 3), "tiny": 1e-14, "point": 0.5}.get(what, 0.0)
        c, rpy, entries = rng.normal(size=3), rng.uniform(-1, 1, 3), sizes.get(what, 0.0) * rng.normal(size=6)
        keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        named = " ".join(f'{key}="{x!r}"' for key, x in zip(keys, entries.tolist(), strict=True))
        link = LINK.format(i=i, m=float(m), c=numbers(c), rpy=numbers(rpy), entries=named)
        text.append(f'<link name="l{i}"/>' if what == "no inertial" else link)
        R = Rotation.from_euler("xyz", rpy).as_matrix()
        phi.append(parameters_from_com(m, c, R @ symmetric(entries) @ R.T))
        if not is_balanced(np.linalg.eigvalsh(symmetric(entries))) and entries.any():
            odd.append(f"l{i}")
        if i:
            kind = str(rng.choice(["revolute", "prismatic", "fixed"]))
            text.append(JOINT.format(i=i, kind=kind, parent=int(rng.integers(0, i))))
    return f'<robot name="r">{"".join(text)}</robot>', np.concatenate(phi), odd


def test_parameters_are_those_that_the_file_states_and_are_written_back(written):
    for seed in range(6):
        rng = np.random.default_rng(seed)
        text, phi, odd = random_urdf(rng, int(rng.integers(2, 9)))
        path = written("r.urdf", text)
        robot, new = mechanism(path), path.with_name("new.urdf")
        order = np.array([int(name[1:]) for name in robot.tree.names])
        stated, read = phi.reshape(-1, 10)[order], robot.known.reshape(-1, 10)
        assert (abs(read - stated) <= 1e-12 * abs(stated).max(axis=1, keepdims=True)).all()
        heavy = read.copy()
        heavy[order == 0] = parameters_from_com(2.0, np.zeros(3), np.eye(3))
        for own, tolerance in ((read, {"rtol": 1e-12, "atol": 1e-30}), (heavy, {"rtol": 1e-9, "atol": 1e-12})):
            write_model(new, robot, own.ravel())
            np.testing.assert_allclose(parameters_from_model(new), own.ravel(), **tolerance)
        if odd:
            with pytest.warns(ModelNote, match=f"{odd[0]}.* no rigid body has it"):
                compiled(path)
            with pytest.raises(InputError, match="are not those of a physical body"):
                write_model(path.with_suffix(".xml"), robot, robot.known)


STATED = """<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="{}" ixy="0" ixz="0"
iyz="0"/></inertial></link><link name="b"/><joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>
<link name="c">{}</link><joint name="f" type="fixed"><parent link="b"/><child link="c"/></joint></robot>"""
MASS = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LINK_1 = f'<link name="a">{MASS.format(1)}</link>'
BODY = '<mujoco><worldbody><body name="a"><joint/><geom size=".1"/></body></worldbody></mujoco>'
NUMBERS = "link 'a' needs finite numbers and no negative mass; its inertia is 1 1"


def test_files_without_anything_are_refused(written):
    for text, message in (
        ("", "needs to be XML (no element found"),
        ("<robot name='r'/>", "has a <link> for every body, this one has none"),
        *((STATED.format(x, ""), f"{NUMBERS} {x}") for x in ("nan", "0x10", "1e308")),
        (STATED.format("1", MASS.format(-1)), "link 'c' needs finite numbers and no negative mass; its mass is"),
    ):
        assert message in sentence_of(compiled, written("a.urdf", text))


def test_names_of_files_and_all_of_mjcf_are_utf_8(written):
    assert "has to be text in UTF-8" in sentence_of(compiled, written(os.fsdecode(b"a\xff.xml"), BODY))
    latin = written("latin.xml", "")
    head = "<?xml version='1.0' encoding='latin-1'?>"
    latin.write_bytes((head + BODY.replace('"a"', '"ä"')).encode("latin-1"))
    assert "latin.xml: MJCF needs to be in UTF-8" in sentence_of(compiled, latin)


ARM = """<?xml version='1.0' encoding="UTF-8"?>\r
<!-- Größe: drawn by hand -->\r
<robot  name = "arm" >\r
  <link name="root">\r
    <inertial>\r
      <origin rpy="0 0.2 0"   xyz="0 0.10 1e-1" />\r
      <mass value = '3.0'></mass><!-- weighed -->\r
      <inertia ixx="1.0e-2" ixy="0"\r
               ixz="0" iyy="0.020"\tiyz="0." izz="0.015"/>\r
    </inertial>\r
    <visual><geometry><box size="1 1 1"/></geometry></visual>\r
  </link>\r
  <link name="lean">\r
    <inertial><mass value="2"/><inertia ixx=".01" iyy=".02" izz=".015" ixy="0" ixz="0" iyz="0"/></inertial>\r
  </link>\r
  <link name="bare">\r
    <visual><geometry><box size="1 1 1"/></geometry></visual>\r
  </link>\r
  <link name="flange" />\r
  <link name="blank"><inertial><origin rpy="0 0 0" /><mass value="0"/><inertia
  ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>\r
  <joint name="a" type="continuous"><parent link="root"/><child link="lean"/><axis xyz="0 1 0"/></joint>\r
  <joint name="b" type="continuous"><parent link="lean"/><child link="bare"/><axis xyz="0 0 1"/></joint>\r
  <joint name="c" type="fixed"><parent link="bare"/><child link="flange"/></joint>\r
  <joint name="d" type="fixed"><parent link="flange"/><child link="blank"/></joint>\r
  <transmission name="t"><type>any</type></transmission>\r
</robot><!-- the end, without a new line -->"""
WRITTEN_BODY = parameters_from_com(1.5, np.array([0.1, -0.2, 0.3]), np.diag([0.02, 0.03, 0.04]))


@pytest.fixture
def arm(written):
    path = written("arm.urdf", ARM)
    with pytest.warns(UserWarning, match="No mass is stated for bare"):
        return mechanism(path, "root")


def updated(arm, **changed):
    """Text of the file with other φ of some bodies, checked by reading it back."""
    phi = arm.known.reshape(-1, 10).copy()
    for name, own in changed.items():
        phi[arm.tree.names.index(name)] = own
    path = arm.source.text.with_name("new.urdf")
    write_model(path, arm, phi.ravel())
    np.testing.assert_allclose(mechanism(path, "root").known, phi.ravel(), rtol=1e-9, atol=1e-12)
    return path.read_bytes().decode()


def test_an_inertia_stays_in_the_axes_in_which_it_is_stated_and_the_rest_byte_by_byte(arm):
    assert updated(arm) == ARM
    mass, center, inertia = com_from_parameters(arm.known[:10])
    text = updated(arm, root=parameters_from_com(mass, center, 1.5 * inertia))
    numbers = [float(text.split(f'{key}="')[1].split('"')[0]) for key in ("ixx", "iyy", "izz")]
    np.testing.assert_allclose(numbers, [0.015, 0.03, 0.0225], rtol=1e-12)
    assert 'rpy="0 0.2 0"   xyz="0 0.10 1e-1"' in text and 'ixy="0"\r\n               ixz="0"' in text


def test_what_is_missing_is_put_in(arm):
    text, number = updated(arm, lean=WRITTEN_BODY), r'"-?[\d.e-]+"'
    origin = re.search(r'<inertial>(<origin xyz="[^"]*"/>)<mass', text)
    assert re.sub(number, "", text.replace(origin[1], "")) == re.sub(number, "", ARM)
    assert updated(arm, blank=WRITTEN_BODY).count('<origin rpy="0 0 0" xyz="') == 1
    for name, before in (("bare", ARM), ("flange", ARM.replace('"flange" />', '"flange"></link>'))):
        text = updated(arm, **{name: WRITTEN_BODY})
        new = re.search(rf'"{name}">(\s*<inertial><origin.*?</inertial>)', text, re.DOTALL)
        assert text.replace(new[1], "", 1) == before
    assert '<link name="bare">\r\n    <inertial><origin' in updated(arm, bare=WRITTEN_BODY)


def test_what_cannot_be_written_back_is_refused(tmp_path):
    for text, encoding, message in (
        (f'<?xml version="1.0" encoding="UTF-16"?><robot name="r">{LINK_1}</robot>', "utf-16", "save it in UTF-8"),
        (f"<!DOCTYPE r [<!ENTITY a '{LINK_1}'>]><robot name='r'>&a;</robot>", "utf-8", "come from entities"),
    ):
        path, new = tmp_path / "a.urdf", tmp_path / "new.urdf"
        path.write_text(text, encoding=encoding)
        assert message in sentence_of(write_model, new, mechanism(path), WRITTEN_BODY) and not new.exists()

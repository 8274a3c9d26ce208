"""URDF files written back: bytes change only with changed numbers and added elements."""

import re

import numpy as np
import pytest

from ident.errors import InputError, ModelError
from ident.geometry.inertia import com_from_parameters, parameters_from_com
from sim.models.model_mechanism import mechanism
from sim.models.model_update import write_model
from sim.models.mujoco_model import parameters_from_model

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
BODY = parameters_from_com(1.5, np.array([0.1, -0.2, 0.3]), np.diag([0.02, 0.03, 0.04]))


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_bytes(ARM.encode())
    with pytest.warns(UserWarning, match="No mass is stated for bare"):
        return mechanism(path, "root")


def written(arm, **changed):
    """Text of the file with other φ of some bodies, checked by reading it back."""
    phi = arm.known.reshape(-1, 10).copy()
    for name, own in changed.items():
        phi[arm.tree.names.index(name)] = own
    path = arm.source.text.with_name("new.urdf")
    write_model(path, arm, phi.ravel())
    read = parameters_from_model(mechanism(path, "root").source.model, "root")
    np.testing.assert_allclose(read, phi.ravel(), rtol=1e-9, atol=1e-12)
    return path.read_bytes().decode()


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_what_does_not_change_is_written_byte_by_byte(arm):
    assert written(arm) == ARM


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_an_inertia_stays_in_the_axes_in_which_it_is_stated(arm):
    mass, center, inertia = com_from_parameters(arm.known[:10])
    text = written(arm, root=parameters_from_com(mass, center, 1.5 * inertia))
    numbers = [float(text.split(f'{key}="')[1].split('"')[0]) for key in ("ixx", "iyy", "izz")]
    np.testing.assert_allclose(numbers, [0.015, 0.03, 0.0225], rtol=1e-12)
    assert 'rpy="0 0.2 0"   xyz="0 0.10 1e-1"' in text and 'ixy="0"\r\n               ixz="0"' in text


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_what_is_missing_is_put_in(arm):
    text, number = written(arm, lean=BODY), r'"-?[\d.e-]+"'
    origin = re.search(r'<inertial>(<origin xyz="[^"]*"/>)<mass', text)
    assert origin is not None
    assert re.sub(number, "", text.replace(origin[1], "")) == re.sub(number, "", ARM)
    assert written(arm, blank=BODY).count('<origin rpy="0 0 0" xyz="') == 1
    for name in ("bare", "flange"):
        text = written(arm, **{name: BODY})
        new = re.search(rf'"{name}">(\s*<inertial><origin.*?</inertial>)', text, re.DOTALL)
        assert new is not None
        left = text.replace(new[1], "", 1)
        assert left == (ARM.replace('"flange" />', '"flange"></link>') if name == "flange" else ARM)
    assert '<link name="bare">\r\n    <inertial><origin' in written(arm, bare=BODY)


def test_what_cannot_be_written_back_is_refused(tmp_path):
    link = '<link name="a"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    link += "</inertial></link>"
    texts = {
        "save it in UTF-8": f'<?xml version="1.0" encoding="UTF-16"?><robot name="r">{link}</robot>'.encode("utf-16"),
        "come from entities": f"<!DOCTYPE robot [<!ENTITY a '{link}'>]><robot name='r'>&a;</robot>".encode(),
    }
    for message, data in texts.items():
        path = tmp_path / "a.urdf"
        path.write_bytes(data)
        with pytest.raises(ModelError, match=message):
            write_model(tmp_path / "new.urdf", mechanism(path), BODY)
    path.write_text(f"<robot name='r'>{link}</robot>", encoding="utf-8")
    with pytest.raises(InputError, match="'a' are not those of a physical body"):
        write_model(tmp_path / "new.urdf", mechanism(path), -BODY)
    assert not (tmp_path / "new.urdf").exists()

"""URDF files in practice: all stated inertias are read, physical or not."""

import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ident.errors import InputError, ModelError
from ident.geometry.inertia import parameters_from_com, symmetric
from sim.models.inertials import is_balanced
from sim.models.model_mechanism import mechanism
from sim.models.model_update import write_model
from sim.models.mujoco_model import compiled, parameters_from_model
from sim.models.notes import ModelNote

LINK = """<link name="l{i}"><inertial><mass value="{m!r}"/><origin xyz="{c}" rpy="{rpy}"/>
<inertia {entries}/></inertial></link>"""
JOINT = """<joint name="j{i}" type="{kind}"><parent link="l{parent}"/><child link="l{i}"/><axis xyz="0 1 0"/>
<origin xyz="0 0 .3"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""


def numbers(x):
    return " ".join(map(repr, np.asarray(x, float).tolist()))


def random_urdf(rng, bodies):
    """Links with any symmetric matrix as inertia, tiny, without mass, without extent or without inertial.

    Returns:
        The text, φ as stated, and names of the links with unphysical inertia.
    """
    text, phi, odd = [], [], []
    for i in range(bodies):
        what = rng.choice(["any", "tiny", "point", "no mass", "nothing", "no inertial"]) if i else "any"
        size = {"any": 1.0, "tiny": 1e-14, "no mass": 1.0}.get(what, 0.0)
        m = {"any": rng.uniform(0.1, 3), "tiny": 1e-14, "point": 0.5}.get(what, 0.0)
        c, rpy, entries = rng.normal(size=3), rng.uniform(-1, 1, 3), size * rng.normal(size=6)
        if what == "no inertial":
            text.append(f'<link name="l{i}"/>')
            c, entries = np.zeros(3), np.zeros(6)
        else:
            keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            named = " ".join(f'{key}="{x!r}"' for key, x in zip(keys, entries.tolist(), strict=True))
            text.append(LINK.format(i=i, m=float(m), c=numbers(c), rpy=numbers(rpy), entries=named))
        R = Rotation.from_euler("xyz", rpy).as_matrix()
        phi.append(parameters_from_com(m, c, R @ symmetric(entries) @ R.T))
        if not is_balanced(np.linalg.eigvalsh(symmetric(entries))) and entries.any():
            odd.append(f"l{i}")
        if i:
            kind = str(rng.choice(["revolute", "prismatic", "fixed"]))
            text.append(JOINT.format(i=i, kind=kind, parent=int(rng.integers(0, i))))
    return f'<robot name="r">{"".join(text)}</robot>', np.concatenate(phi), odd


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_parameters_are_those_that_the_file_states_and_are_written_back(tmp_path):
    path, new = tmp_path / "r.urdf", tmp_path / "new.urdf"
    for seed in range(20):
        rng = np.random.default_rng(seed)
        text, phi, odd = random_urdf(rng, int(rng.integers(2, 9)))
        path.write_text(text, encoding="utf-8")
        robot = mechanism(path)
        order = np.array([int(name[1:]) for name in robot.tree.names])
        stated = phi.reshape(-1, 10)[order]
        read = robot.known.reshape(-1, 10)
        assert (abs(read - stated) <= 1e-12 * abs(stated).max(axis=1, keepdims=True)).all()
        write_model(new, robot, robot.known)
        np.testing.assert_allclose(parameters_from_model(new), read.ravel(), rtol=1e-12, atol=1e-30)
        heavy = read.copy()
        heavy[order == 0] = parameters_from_com(2.0, np.zeros(3), np.eye(3))
        write_model(new, robot, heavy.ravel())
        np.testing.assert_allclose(parameters_from_model(new), heavy.ravel(), rtol=1e-9, atol=1e-12)
        if odd:
            with pytest.warns(ModelNote, match=f"{odd[0]}.* no rigid body has it"):
                compiled(path)
            with pytest.raises(InputError, match="are not those of a physical body"):
                write_model(tmp_path / "new.xml", robot, robot.known)


STATED = """<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="{}" ixy="0" ixz="0"
iyz="0"/></inertial></link><link name="b"/><joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>
<link name="c">{}</link><joint name="f" type="fixed"><parent link="b"/><child link="c"/></joint></robot>"""
MASS = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


BODY = '<mujoco><worldbody><body name="a"><joint/><geom size=".1"/></body></worldbody></mujoco>'


def test_files_without_anything_and_names_that_are_no_text_are_refused(tmp_path):
    nameless = tmp_path / os.fsdecode(b"a\xff.xml")
    nameless.write_text(BODY, encoding="utf-8")
    with pytest.raises(ModelError, match="has to be text in UTF-8"):
        compiled(nameless)
    for text, message in {
        "": r"needs to be XML \(no element found",
        "<robot name='r'/>": "has a <link> for every body, this one has none",
        STATED.format("nan", ""): "link 'a' needs finite numbers and no negative mass; its inertia is 1 1 nan 0 0 0",
        STATED.format("0x10", ""): "link 'a' needs finite numbers and no negative mass; its inertia is 1 1 0x10 0 0 0",
        STATED.format("1e308", ""): "link 'a' needs finite numbers and no negative mass; its inertia is 1 1 1e308",
        STATED.format("1", MASS.format(-1)): "link 'c' needs finite numbers and no negative mass; its mass is",
    }.items():
        (tmp_path / "a.urdf").write_text(text, encoding="utf-8")
        with pytest.raises(ModelError, match=message):
            compiled(tmp_path / "a.urdf")

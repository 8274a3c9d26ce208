"""MuJoCo's inverse dynamics and its base sensor against the regressors, on random models."""

import mujoco
import numpy as np
import pytest
from random_models import inverse_dynamics, random_model, random_model_states

from ident import BaseMotion, Motion, Sensors, find_base_parameters
from ident.model import dim
from ident.model.regressor import FEW, base_wrench_regressor, joint_torque_regressor
from sim.models.model_mechanism import mechanism
from sim.models.mujoco_model import base_motion, gravity_in_base, parameters_from_model, state_columns, tree_from_model

MODELS = 45
SEEDS = range(MODELS)
RECORDED = SEEDS[::20]


def case(seed):
    """A model of 2 to 30 bodies, every third one without ground under it, and its states."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, int(rng.integers(2, 31)), floating=seed % 3 == 0)
    return model, random_model_states(rng, model, FEW if seed in RECORDED else 1)


def states_of(model, name, states):
    """States of the joints beyond a body."""
    coordinates, dofs = state_columns(model, name)
    return states[0][:, coordinates], states[1][:, dofs], states[2][:, dofs]


def assert_equal(computed, expected, scale=None, tolerance=1e-10):
    scale = abs(expected if scale is None else scale).max()
    np.testing.assert_allclose(computed, expected, rtol=0, atol=tolerance * scale)


def free_base(states):
    return BaseMotion.from_free_joint(*(x[:, :size] for x, size in zip(states, (7, 6, 6), strict=True)))


def external_wrench(states, forces):
    """Forces of a free joint as a wrench in the body's frame."""
    R = free_base(states).T[:, :3, :3]
    return np.concatenate([(R.swapaxes(1, 2) @ forces[:, :3, None])[..., 0], forces[:, 3:6]], axis=1)


def check_base_wrench_and_joint_torques(model, states, floating):
    forces, readings = inverse_dynamics(model, *states)
    wrench = external_wrench(states, forces) if floating else readings
    tree, phi, joints = tree_from_model(model, "b0"), parameters_from_model(model, "b0"), states_of(model, "b0", states)
    known = {"gravity": gravity_in_base(model, "b0"), "base": base_motion(model, "b0", *states) if floating else None}
    assert_equal(base_wrench_regressor(tree, *joints, **known) @ phi, wrench)
    torques = forces[:, state_columns(model, "b0")[1]]
    assert_equal(joint_torque_regressor(tree, *joints, **known) @ phi, torques, wrench)
    if len(wrench) == FEW:
        return  # The merged equations would have to be recorded too, and do not depend on how they are evaluated.
    merged, together = tree.without_welds()
    assert len(together) == 10 * (len(merged.moving) + 1 - sum(body.massless for body in merged.bodies))
    assert_equal(base_wrench_regressor(merged, *joints, **known) @ together @ phi, wrench)


def test_base_wrench_and_joint_torques():
    for seed in set(SEEDS) - set(RECORDED):
        check_base_wrench_and_joint_torques(*case(seed), seed % 3 == 0)


@pytest.mark.parametrize("seed", RECORDED)
def test_recorded_base_wrench_and_joint_torques_and_structural_ranks(seed):
    model, states = case(seed)
    floating = seed % 3 == 0
    check_base_wrench_and_joint_torques(model, states, floating)
    tree, gravity, rng = tree_from_model(model, "b0"), gravity_in_base(model, "b0"), np.random.default_rng(seed)
    states = random_model_states(rng, model, 2 * len(tree.inertial) + 10)
    base = base_motion(model, "b0", *states) if floating else None
    for sensors, regressor in (
        (Sensors(moving_base=floating), base_wrench_regressor),
        (Sensors(False, True, floating), joint_torque_regressor),
    ):
        Y = regressor(tree, *states_of(model, "b0", states), gravity=gravity, base=base)
        if Y.any():
            exact = find_base_parameters(tree, gravity=gravity, sensors=sensors)
            assert find_base_parameters(Y).rank == exact.rank


@pytest.mark.parametrize("gravity", ["switched off", "zero"])
def test_gravity_is_the_models(gravity):
    for seed in range(1, MODELS, 20):
        model, states = case(seed)
        if gravity == "zero":
            model.opt.gravity[:] = 0
        else:
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        check_base_wrench_and_joint_torques(model, states, seed % 3 == 0)
        assert not gravity_in_base(model, "b0").any()


@pytest.mark.parametrize("seed", range(1, MODELS, 10))
def test_the_world_as_base_and_the_papers_recursion(seed):
    model, states = case(seed)
    forces, _ = inverse_dynamics(model, *states)
    whole = mechanism(model)
    assert_equal(joint_torque_regressor(whole.tree, *states, gravity=model.opt.gravity) @ whole.known, forces)
    for force, sample in zip(forces, Motion(*states), strict=True):
        ground, torques = dim.inverse_dynamics(whole, sample)
        assert_equal(torques, force)
        assert_equal(dim.base_wrench_regressor(whole, sample) @ whole.known, ground)


@pytest.mark.parametrize("seed", range(0, MODELS, 30))
def test_motion_of_any_body_as_base(seed):
    """Cut at an inner body, the rest of the model needs a wrench there, on which MuJoCo's parts agree."""
    model, states = case(seed)
    name = f"b{np.random.default_rng(seed).integers(1, model.nbody - 1)}"
    tree, phi, joints = tree_from_model(model, name), parameters_from_model(model, name), states_of(model, name, states)
    forces, _ = inverse_dynamics(model, *states)
    Y = joint_torque_regressor(tree, *joints, gravity=model.opt.gravity, base=base_motion(model, name, *states))
    assert_equal(Y @ phi, forces[:, state_columns(model, name)[1]], np.maximum(abs(forces).max(), 1))
    by_model, direct = base_motion(model, "b0", *states), free_base(states)
    for key in ("T", "V", "dV"):
        assert_equal(getattr(by_model, key), getattr(direct, key), tolerance=1e-12)

"""MuJoCo's inverse dynamics and its base sensor against the regressor, on random models."""

import mujoco
import numpy as np
import pytest
from mechanisms import unit_vector

from ident import dim, regressor
from sim.mujoco_model import gravity_in_base, parameters_from_model, tree_from_model

STATES = 200


def random_model(rng, bodies):
    """Hinges and slides at random axes and anchors, turned body and inertial frames, branches, welded bodies."""

    def numbers(x):
        return " ".join(map(repr, np.asarray(x).tolist()))

    def body(i):
        joint = ""
        kind = rng.choice(["hinge", "slide", "none"], p=[0.5, 0.3, 0.2]) if i else "none"
        if kind != "none":
            joint = (
                f'<joint name="j{i}" type="{kind}" axis="{numbers(unit_vector(rng))}" '
                f'pos="{numbers(rng.normal(size=3))}" ref="{rng.normal():.3f}"/>'
            )
        principal = np.sort(rng.uniform(0.1, 1, 3))
        principal[2] = min(principal[2], 0.9 * (principal[0] + principal[1]))
        children = "".join(body(k) for k in range(1, bodies) if parents[k] == i)
        sensor_site = '<site name="ground"/>' if i == 0 else ""
        return (
            f'<body name="b{i}" pos="{numbers(rng.normal(size=3))}" quat="{numbers(rng.normal(size=4))}">{joint}'
            f'<inertial mass="{rng.uniform(0.1, 5)!r}" pos="{numbers(rng.normal(size=3))}" '
            f'quat="{numbers(rng.normal(size=4))}" diaginertia="{numbers(principal)}"/>{sensor_site}{children}</body>'
        )

    parents = [-1] + [int(rng.integers(0, k)) for k in range(1, bodies)]
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="{numbers(3 * rng.normal(size=3))}"/>'
        f"<worldbody>{body(0)}</worldbody>"
        '<sensor><force site="ground"/><torque site="ground"/></sensor></mujoco>'
    )


@pytest.mark.parametrize("seed", range(20))
def test_base_sensor_and_joint_torques(seed):
    rng = np.random.default_rng(seed)
    model = random_model(rng, int(rng.integers(2, 9)))
    tree, phi = tree_from_model(model, "b0"), parameters_from_model(model, "b0")
    gravity = gravity_in_base(model, "b0")
    data = mujoco.MjData(model)
    q, dq, ddq = rng.uniform(-2, 2, size=(3, STATES // 20, model.nv))
    wrench, torque = np.empty((len(q), 6)), np.empty_like(q)
    for k in range(len(q)):
        data.qpos, data.qvel, data.qacc = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        wrench[k], torque[k] = data.sensordata, data.qfrc_inverse

    predicted = regressor.base_wrench_regressor(tree, q, dq, ddq, gravity=gravity) @ phi
    np.testing.assert_allclose(predicted, wrench, rtol=0, atol=1e-12 * abs(wrench).max())
    for k, state in enumerate(zip(q, dq, ddq, strict=True)):
        ground, torques = dim.inverse_dynamics(tree, phi, *state, gravity=gravity)
        np.testing.assert_allclose(ground, wrench[k], rtol=0, atol=1e-12 * abs(wrench).max())
        np.testing.assert_allclose(torques, torque[k], rtol=0, atol=1e-12 * abs(wrench).max())
        Y = dim.base_wrench_regressor(tree, *state, gravity=gravity)
        np.testing.assert_allclose(Y @ phi, wrench[k], rtol=0, atol=1e-12 * abs(wrench).max())

"""Pose of one body."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ident.mechanism.body import Body, ball_twist


@pytest.mark.parametrize("center", [(0.1, 0.2, 0.3), (-0.4, 0.0, 0.7)])
def test_a_ball_turns_about_its_center(center):
    body = Body("head", -1, np.eye(4), ball_twist(np.array(center)), "neck")
    q = np.random.default_rng(0).normal(size=(5, 4))
    poses = body.joint_pose(q)
    for pose, R in zip(poses, Rotation.from_quat(q, scalar_first=True).as_matrix(), strict=True):
        np.testing.assert_allclose(pose[:3, :3], R, atol=1e-14)
        np.testing.assert_allclose(pose @ [*center, 1], [*center, 1], atol=1e-14)

"""All parameters from base parameters and what was known before, against the same observation of them at once."""

import numpy as np

import scenes
import sim
from ident.parameters.base_parameters import structural_base_parameters
from ident.parameters.prior import conditioned, deviations, known_covariance


def test_all_parameters_follow_from_an_estimate_of_base_parameters():
    arm, rng = sim.mechanism(scenes.load("humanoid"), base="pelvis"), np.random.default_rng(0)
    base = structural_base_parameters(arm)
    S, prior = np.diag(deviations(arm) ** 2), base.regroup(arm.known)
    B = base.regroup(np.eye(len(S))).T
    before = known_covariance(arm, base)
    np.testing.assert_allclose(B @ S @ B.T, before, atol=1e-6 * np.diag(before).max())
    # Observed base parameters, and the estimate that has the prior of theirs.
    noise = np.diag(rng.uniform(0.1, 2, size=len(prior)) * np.diag(before))
    seen = prior + rng.normal(size=len(prior)) * np.sqrt(np.diag(before + noise))
    gain = before @ np.linalg.inv(before + noise)
    phi, std = conditioned(arm, base, prior + gain @ (seen - prior), before - gain @ before)
    direct = S @ B.T @ np.linalg.inv(before + noise)
    np.testing.assert_allclose(phi, arm.known + direct @ (seen - prior), rtol=1e-5, atol=1e-8)
    variance = np.diag(S - direct @ B @ S)
    np.testing.assert_allclose(std, np.sqrt(variance), rtol=1e-4, atol=1e-9)

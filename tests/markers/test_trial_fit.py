"""Angles from markers: exact without noise, and with noise within the stated covariance."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from marked import errors, labels_of, marked_person, trial

from sim.markers.frame_fit import Kinematics
from sim.markers.marked_model import marked_model
from sim.markers.trial_fit import fit_trial
from sim.markers.trial_recording import swaps

FRAMES = 60


@pytest.fixture(scope="module")
def person():
    spec = marked_person()
    model = spec.compile()
    marked, unmatched = marked_model(spec, labels_of(model))
    assert not unmatched
    return marked, *trial(model, FRAMES)


def noisy(x, seed, std=0.002):
    return x + std * np.random.default_rng(seed).normal(size=x.shape)


def chi_squared(marked, postures, qpos):
    e = errors(marked.model, postures.qpos, qpos)
    return np.einsum("ni,nij,nj->n", e, np.linalg.inv(postures.covariance), e), e / postures.std


def test_jacobians_are_those_of_finite_differences(person):
    marked, _, qpos, _ = person
    kinematics, h = Kinematics(marked), 1e-6
    kinematics.positions(qpos[7])
    J = kinematics.jacobian().copy()
    for k, direction in enumerate(np.eye(len(marked.dofs))):
        ahead, behind = (kinematics.positions(kinematics.moved(qpos[7], s * h * direction)) for s in (1, -1))
        np.testing.assert_allclose(J[:, :, k], (ahead - behind) / (2 * h), atol=1e-8)


def test_without_noise_angles_are_exact_though_nothing_is_known_of_the_first_posture(person):
    marked, _, qpos, x = person
    postures = fit_trial(marked, x)
    assert np.abs(errors(marked.model, postures.qpos, qpos)).max() < 1e-9
    assert postures.sigma < 1e-9 and postures.determined.all() and (postures.robust == 1).all()


def test_with_noise_angles_are_within_their_covariance(person):
    marked, _, qpos, x = person
    n, all_chi, all_z = len(marked.dofs), [], []
    for seed in range(4):
        postures = fit_trial(marked, noisy(x, seed))
        assert postures.sigma == pytest.approx(0.002, rel=0.04)
        chi, z = chi_squared(marked, postures, qpos)
        all_chi.append(chi)
        all_z.append(z)
    chi, z = np.concatenate(all_chi), np.concatenate(all_z)
    assert chi.mean() == pytest.approx(n, abs=5 * np.sqrt(2 * n / len(chi)))
    # Each degree of freedom by itself: free joint, balls, hinges.
    np.testing.assert_allclose((z**2).mean(axis=0), 1, atol=5 * np.sqrt(2 / len(z)))


def test_outlying_and_exchanged_markers_are_found_and_do_no_harm(person):
    marked, _, qpos, x = person
    y = noisy(x, 5)
    a, b, c = (marked.labels.index(name) for name in ("left_shank_0", "right_shank_1", "thorax_2"))
    y[:, [a, b]] = y[:, [b, a]]
    y[10:14, c] += 0.2
    postures = fit_trial(marked, y)
    outlying = np.zeros(y.shape[:2], bool)
    outlying[:, [a, b]] = outlying[10:14, c] = True
    np.testing.assert_array_equal(postures.outlying, outlying)
    (swap,) = swaps(postures, y)
    assert set(swap.labels) == {"left_shank_0", "right_shank_1"} and swap.frames == FRAMES
    assert postures.sigma == pytest.approx(0.002, rel=0.06)
    chi, _ = chi_squared(marked, postures, qpos)
    assert chi.mean() == pytest.approx(41, rel=0.15)


@pytest.mark.parametrize(("towards", "exchanged"), [(0.6, False), (0.75, True)])
def test_labels_are_exchanged_where_each_marker_is_far_nearer_to_the_others_place(towards, exchanged):
    """Two markers displaced towards each other are not exchanged."""
    places = np.array([[[0.0, 0, 0], [1, 0, 0]]])
    measured = (1 - towards) * places + towards * places[:, ::-1]
    residuals = measured - places
    postures = SimpleNamespace(
        marked=SimpleNamespace(labels=("a", "b")),
        residuals=residuals,
        distances=np.linalg.norm(residuals, axis=2),
        outlying=np.ones((1, 2), bool),
    )
    assert [swap.labels for swap in swaps(postures, measured)] == [("a", "b")] * exchanged


def test_slides_and_fixed_joints():
    spec = mujoco.MjSpec.from_string("""<mujoco><worldbody><body name="a"><joint name="s" type="slide" axis="1 0 0"/>
        <geom size=".1"/><site name="p" pos="0 0 .1"/><body name="b" pos="0 0 .3"><joint name="h" axis="0 1 0"/>
        <joint name="stuck" axis="1 0 0"/><geom size=".1"/><site name="q" pos=".1 .05 .2"/></body></body>
        </worldbody></mujoco>""")
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos = [0.2, 0.5, 0.3]
    mujoco.mj_kinematics(model, data)
    marked, _ = marked_model(spec, ["p", "q"], fix={"stuck": [0.3]})
    postures = fit_trial(marked, np.array([data.site_xpos]))
    np.testing.assert_allclose(postures.qpos, [[0.2, 0.5, 0.3]], atol=1e-9)
    assert marked.dof_names == ["s", "h"]

import numpy as np
import pytest
import scipy
from mechanisms import GRAVITY, double_pendulum, random_phi, random_states, random_tree, tilted_axis
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from ident.judgement import diagnosis, misalignment
from ident.judgement.misalignment import estimate_misalignment
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.model.regressor import base_wrench_regressor
from ident.recordings.despike import despiked
from ident.recordings.wrench import transform_wrench

RNG = np.random.default_rng(0)
TREE = double_pendulum()
STATES = tuple(random_states(RNG, TREE, 300))
PHI = random_phi(RNG, 3)
PENDULUM, MOTION = Mechanism(TREE, GRAVITY), Motion(*STATES)
WRENCH = base_wrench_regressor(TREE, *STATES, gravity=GRAVITY) @ PHI


def turned(wrench, R):
    return (wrench.reshape(-1, 2, 3) @ R.T).reshape(-1, 6)


def test_there_are_24_right_angled_rotations():
    turns = diagnosis.right_angled_rotations()
    assert len(turns) == len({R.tobytes() for R in turns}) == 24
    np.testing.assert_array_equal(turns[0], np.eye(3))
    assert all(np.linalg.det(R) == 1 for R in turns)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("k", range(24))
def test_a_turned_or_flipped_wrench_is_recognised(k, sign):
    R = diagnosis.right_angled_rotations()[k]
    noisy = WRENCH + RNG.normal(size=WRENCH.shape)
    check = diagnosis.check_frame(sign * turned(noisy, R.T), WRENCH, np.eye(3))
    assert check.sign == sign
    np.testing.assert_array_equal(check.rotation, R)
    assert check.suspicious == (k > 0 or sign < 0)


def test_a_transposed_frame_is_recognised():
    R = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
    in_sensor = turned(WRENCH, R.T)
    # The user gives the transposed rotation, and the prediction is written in the frame that this makes.
    check = diagnosis.check_frame(in_sensor, turned(WRENCH, R), R.T)
    assert check.suspicious
    np.testing.assert_allclose(check.rotation, R @ R)
    assert check.error_turned < 1e-12


def test_missing_channels_do_not_hide_a_sign():
    partial = WRENCH.copy()
    partial[:, [0, 1, 5]] = np.nan
    assert diagnosis.check_frame(-partial, WRENCH, np.eye(3)).sign == -1
    assert not diagnosis.check_frame(partial, WRENCH, np.eye(3)).suspicious


@pytest.mark.parametrize("body", [1, 2])
def test_a_missing_contact_is_found(body):
    point = np.array([0.1, -0.2, 0.3])
    force = RNG.normal(size=(300, 3))
    poses = TREE.poses(STATES[0])[:, body] @ np.block([[np.eye(3), point[:, None]], [np.zeros(3), 1]])
    residual = transform_wrench(poses, np.hstack([force, np.zeros((300, 3))]))
    check = diagnosis.check_contact(TREE, STATES[0], residual)
    assert check.body == TREE.names[body]
    np.testing.assert_allclose(check.point, point, atol=1e-9)
    assert check.explained > 1 - 1e-12


def test_correlation_time_of_white_and_slow_noise():
    white = RNG.normal(size=5000)
    slow = np.convolve(white, np.exp(-np.arange(500) / 100), mode="same")
    found = diagnosis.correlation_time(np.stack([white, slow], axis=1), 100.0)
    assert found[0] == pytest.approx(0.01)
    assert 0.5 < found[1] < 1.6


@pytest.mark.parametrize("tilt_deg", [0, 1, 5])
def test_tilted_axes_are_measured_from_wrenches(tilt_deg):
    axis = tilted_axis(tilt_deg, 120)
    true = double_pendulum(axis, axis)
    rng = np.random.default_rng(0)
    wrench = base_wrench_regressor(true, *STATES, gravity=GRAVITY) @ PHI
    noise = np.maximum(0.01 * abs(wrench).max(axis=0), 0.01)
    found = estimate_misalignment(PENDULUM, MOTION, wrench + noise * rng.normal(size=wrench.shape), noise)
    assert found.joints == TREE.joints
    assert (abs(np.degrees(found.angle) - tilt_deg) < 5 * np.degrees(found.std) + 1e-3).all()
    assert (np.degrees(found.std) < 0.3).all()
    assert (found.p_value < 1e-6).all() == (tilt_deg > 0)
    if tilt_deg:
        np.testing.assert_allclose(found.tree.bodies[1].twist[3:], axis, atol=0.02)


def test_slopes_of_the_wrench_by_tilts_are_those_of_differences():
    """Any tree, resting and moving bases, tilts far from zero."""
    rng, worst = np.random.default_rng(0), 0.0
    for case in range(12):
        tree = random_tree(rng, massless=0.2)
        turning = tuple(i for i in tree.moving if not tree.bodies[i].is_ball and tree.bodies[i].twist[3:].any())
        states, phi = random_states(rng, tree, 4), random_phi(rng, len(tree.inertial))
        tilts = rng.uniform(-0.5, 0.5, 2 * len(turning))
        moving = BaseMotion.from_free_joint(*(rng.normal(size=(4, k)) for k in (7, 6, 6)))
        base = moving if case % 2 else None
        problem = misalignment._Problem(
            Mechanism(tree, GRAVITY), turning, Motion(*states, base), np.eye(6), np.zeros((6, 6))
        )

        def wrench(tilts, tree=tree, turning=turning, states=states, base=base, phi=phi):
            tilted = misalignment._tilted(tree, turning, tilts)
            return base_wrench_regressor(tilted, *states, gravity=GRAVITY, base=base) @ phi

        if len(turning):
            slopes = misalignment._slopes(problem, misalignment._Fit(tilts, np.eye(0), phi, np.zeros(0)))
            steps = 1e-6 * np.eye(len(tilts))
            expected = np.stack([(wrench(tilts + s) - wrench(tilts - s)) / 2e-6 for s in steps], axis=2)
            worst = max(worst, abs(slopes - expected).max() / abs(wrench(tilts)).max())
    assert worst < 1e-7


def test_seventeen_joints_take_few_and_short_regressors(monkeypatch):
    rng = np.random.default_rng(1)
    tree = random_tree(rng, 18, ("revolute",))
    states = tuple(random_states(rng, tree, 20_000))
    true = misalignment._tilted(tree, tree.moving, np.radians(3) * (np.arange(34) == 6))
    clean = base_wrench_regressor(true, *states, gravity=GRAVITY) @ random_phi(rng, 18)
    noise = 0.01 * clean.std(axis=0)
    counted = []

    def regressor(tree, q, *rest, columns, **known):
        counted.append((len(q), len(columns)))
        return base_wrench_regressor(tree, q, *rest, columns=columns, **known)

    monkeypatch.setattr(misalignment, "base_wrench_regressor", regressor)
    noisy = clean + noise * rng.normal(size=clean.shape)
    found = estimate_misalignment(Mechanism(tree, GRAVITY), Motion(*states), noisy, noise)
    assert len(counted) <= 17 and max(n for n, _ in counted) <= 236 and max(k for _, k in counted) < 180
    assert abs(np.degrees(found.angle[3]) - 3) < 5 * np.degrees(found.std[3]) < 1.5
    assert found.chance < 1e-6


def test_right_axes_explain_no_more_than_chance():
    """White noise and noise that lasts for ten samples, in long and in short recordings."""
    rng = np.random.default_rng(0)
    alarms = []
    for count, slow in ((40, 0.0), (60, 0.9), (300, 0.0), (300, 0.9)):
        for _ in range(4):
            q, dq, ddq = random_states(rng, TREE, count)
            wrench = base_wrench_regressor(TREE, q, dq, ddq, gravity=GRAVITY) @ random_phi(rng, 3)
            noise = 0.02 * wrench.std(axis=0) + 1e-3
            unit = lfilter([np.sqrt(1 - slow**2)], [1, -slow], rng.normal(size=(count + 100, 6)), axis=0)[100:]
            found = estimate_misalignment(PENDULUM, Motion(q, dq, ddq), wrench + noise * unit, noise)
            alarms.append(found.chance < 1e-3)
    assert not any(alarms)


def test_an_axis_that_is_farther_off_than_the_search_goes_is_told_as_such():
    axis = tilted_axis(45, 120)
    wrench = base_wrench_regressor(double_pendulum(axis, axis), *STATES, gravity=GRAVITY) @ PHI
    noisy = wrench + RNG.normal(size=wrench.shape)
    assert estimate_misalignment(PENDULUM, MOTION, noisy, np.ones(6)).at_bound.all()


def test_a_decomposition_that_fails_is_not_asked_for(monkeypatch):
    """LAPACK's gelsd can fail to converge on finite data; the checks take another driver."""

    def stubborn(*given, lapack_driver=None, **known):
        if lapack_driver in (None, "gelsd"):
            raise np.linalg.LinAlgError("SVD did not converge in Linear Least Squares")
        return lstsq(*given, lapack_driver=lapack_driver, **known)

    lstsq = scipy.linalg.lstsq
    monkeypatch.setattr(scipy.linalg, "lstsq", stubborn)
    assert diagnosis.check_contact(TREE, STATES[0], WRENCH).explained > 0
    noisy = WRENCH + RNG.normal(size=WRENCH.shape)
    estimate_misalignment(PENDULUM, MOTION, noisy, np.ones(6))


def test_axes_need_a_joint_that_turns():
    slider = TREE.with_twists(np.array([[1.0, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]]))
    with pytest.raises(ValueError, match="the mechanism has none"):
        estimate_misalignment(Mechanism(slider, GRAVITY), MOTION, WRENCH, np.ones(6))


def test_gross_outliers_are_interpolated_and_nothing_else():
    t = np.arange(1000) / 100
    clean = np.stack([np.sin(2 * np.pi * t) + 0.01 * RNG.normal(size=1000), np.full(1000, np.nan)], axis=1)
    spoilt = clean.copy()
    bad = np.arange(37, 1000, 100)
    spoilt[bad, 0] += 50
    repaired, counts = despiked(spoilt)
    assert counts.tolist() == [10, 0]
    np.testing.assert_allclose(repaired[bad, 0], clean[bad, 0], atol=0.1)
    untouched, none = despiked(clean)
    assert not none.any()
    np.testing.assert_array_equal(untouched, clean)


def test_a_turn_is_blamed_only_if_it_fits_better_than_a_tie():
    """Part of the way to a quarter turn a wrench has errors in proportion to the ways; in a tie nothing is blamed."""
    R = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    for share, named in ((0.54, False), (0.57, True)):
        between = (1 - share) * WRENCH + share * turned(WRENCH, R.T)
        check = diagnosis.check_frame(between, WRENCH, np.eye(3))
        expected = R if named else np.eye(3)
        np.testing.assert_allclose(check.rotation, expected, atol=1e-12)
    exact = diagnosis.check_frame(WRENCH, WRENCH, np.eye(3))
    assert (exact.sign, exact.error, exact.error_turned, exact.suspicious) == (1, 0, 0, False)

"""The paper's claims, checked on our numbers."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import double_pendulum, tilted_axis
from shared_studies import packaged_study

import scenes
from experiments.data import paper
from experiments.data.fitting import fit
from experiments.data.simulated_study import wrench_errors
from experiments.studies.simulation import study as study_of
from ident.geometry.inertia import pseudo_inertia
from ident.parameters.base_parameters import find_base_parameters
from sim.models.model_mechanism import mechanism
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate, with_noise


@pytest.fixture(scope="module", params=(0, 1, 2))
def study(request):
    return packaged_study("misaligned", seed=request.param)


@pytest.fixture(scope="module")
def noise_free():
    return study_of("misaligned", noise_scale=0)


def error(fit, name):
    return fit.error[fit.base.names.index(name)]


def test_condition_numbers_and_shapes(study):
    assert study.fit("simplified").estimate.condition_number == pytest.approx(38.1, rel=0.05)
    assert study.fit("full").estimate.condition_number == pytest.approx(334.2, rel=0.05)
    shapes = [(fit.estimate.rows, fit.base.rank) for fit in map(study.fit, ("simplified", "full"))]
    assert shapes == [paper.SHAPE_SIMPLIFIED, paper.SHAPE_FULL] == [(943 * 5, 13), (943 * 6, 13)]


def test_a_larger_condition_number_is_only_a_choice_of_columns(study):
    assert study.fit("full_on_table").estimate.condition_number < 40
    np.testing.assert_allclose(study.fit("full_on_table").predicted, study.fit("full").predicted, atol=1e-6)


@pytest.fixture(scope="module")
def spread():
    """Errors of the simplified and of the full model over twelve seeds (12, 13), by parameter."""
    studies = [packaged_study("misaligned", seed=seed) for seed in range(12)]
    errors = ([study.fit(name).error for study in studies] for name in ("simplified", "full_on_table"))
    return tuple(dict(zip(paper.TABLE_3, np.transpose(e), strict=True)) for e in errors)


LARGE = {"m1rx1": 1.67, "Ixy2": 1.04, "Ixz2": 0.98, "Ixy3": 0.895, "Ixz3": 0.895}
"""The simplified model's large errors over the paper's: fitted, but the first is not reached."""

OPPOSITE = ("m2ry2", "m2rz2", "Ixx2", "m3ry3", "Ixx3")  # Its small errors with the opposite sign of the paper's.


def test_neglecting_the_tilt_gives_the_papers_errors(spread):
    # Signs in every run, means to 2 %, and each run within four standard deviations of noise.
    for name, ratio in LARGE.items():
        published, errors = paper.TABLE_3[name][0], spread[0][name]
        assert (np.sign(errors) == np.sign(published)).all()
        assert errors.mean() / published == pytest.approx(ratio, abs=0.02)
        assert abs(errors - ratio * published).max() < 4 * max(errors.std(ddof=1), 0.02 * abs(published))
        assert abs(errors / published - 1).max() < (0.75 if name == "m1rx1" else 0.13)


def test_five_of_the_eight_small_errors_have_the_opposite_sign(spread, noise_free):
    small = [name for name in paper.TABLE_3 if name not in LARGE]
    for name in small:
        (published, _), errors = paper.TABLE_3[name], spread[0][name]
        assert abs(published) <= 0.10 and abs(errors.mean()) < 0.12 and abs(errors.mean() - published) < 0.17
        assert (errors.mean() * published < 0) == (name in OPPOSITE)
        assert (error(noise_free.fit("simplified"), name) * published < 0) == (name in OPPOSITE)
    # The sign of m2ry2 is due to noise; the others have theirs in every run.
    certain = {name for name in OPPOSITE if (spread[0][name] * paper.TABLE_3[name][0] < 0).all()}
    assert certain == {*OPPOSITE} - {"m2ry2"}
    assert abs(spread[0]["m2ry2"].mean()) < spread[0]["m2ry2"].std(ddof=1)


def test_the_full_model_is_right(study, spread):
    full, simplified = study.fit("full_on_table"), study.fit("simplified")
    assert full.base.names == tuple(paper.TABLE_3)
    for name in ("Ixy2", "Ixz2"):
        assert abs(error(full, name)) * 100 <= abs(error(simplified, name))
    for name, errors in spread[1].items():
        assert abs(errors.mean()) < (0.06 if name == "Ixx2" else 0.015), name
        assert abs(errors).max() < (0.12 if name == "Ixx2" else 0.03), name


def test_the_papers_full_column_is_not_reproduced(spread):
    # Six of its errors are 0.10 to 0.16; ours for these are at most a tenth of that, except a fifth for m2ry2.
    large = [name for name, (_, published) in paper.TABLE_3.items() if abs(published) >= 0.10]
    assert large == ["m1rx1", "m2ry2", "Ixy2", "Ixz2", "Ixy3", "Ixz3"]
    for name in large:
        assert abs(spread[1][name]).max() < (0.2 if name == "m2ry2" else 0.1) * abs(paper.TABLE_3[name][1])


def test_no_common_error_of_the_axes_gives_the_papers_full_column(noise_free):
    # The pattern of the simplified model, but smaller: the effect of the remaining tilt of the recovered axes.
    known, names = noise_free.known, tuple(paper.TABLE_3)
    axis, step = tilted_axis(*(noise_free.file.options[name] for name in ("tilt_deg", "azimuth_deg"))), np.radians(0.5)

    def turned(shift):
        moved = axis + np.array([0, *shift])
        return moved / np.linalg.norm(moved)

    def errors(shift):
        tree = known.tree.with_twists(np.tile([0, 0, 0, *turned(shift)], (2, 1)))
        return fit(replace(known, tree=tree), noise_free.recording, kept=names).error

    slopes = np.stack([(errors(d) - errors(-d)) / (2 * step) for d in step * np.eye(2)], axis=1)
    published = np.array([paper.TABLE_3[name][1] for name in names])
    five = [names.index(name) for name in LARGE]
    shift, (left,), _, _ = np.linalg.lstsq(slopes[five], published[five], rcond=None)
    assert 1 - left / (published[five] ** 2).sum() == pytest.approx(0.58, abs=0.01)
    assert np.degrees(np.arccos(turned(shift) @ axis)) == pytest.approx(0.75, abs=0.02)
    given = dict(zip(names, slopes @ shift, strict=True))
    for name in ("m2ry2", "Ixy3", "Ixz3"):
        assert abs(given[name] - paper.TABLE_3[name][1]) > 0.1


def test_errors_of_the_wrench_are_far_lower_in_three_channels_only(study):
    errors = wrench_errors(study, ["simplified", "full"])
    gain = {channel: x["rms_simplified"] / x["rms_full"] for channel, x in errors.items()}
    assert all(28 < gain[channel] < 56 for channel in ("Fx", "τy", "τz"))
    assert all(0.99 < gain[channel] < 1.02 for channel in ("Fy", "Fz")) and 1.04 < gain["τx"] < 1.10
    ratios = {channel: x["ratio_simplified"] for channel, x in errors.items()}
    expected = {"Fx": 1.007, "Fy": 0.044, "Fz": 0.034, "τx": 0.007, "τy": 0.446, "τz": 1.893}
    assert ratios == pytest.approx(expected, rel=0.02, abs=0.003)


def test_the_axes_are_recovered_and_not_given(study):
    assert 0 < study.axis_error(study.recovered).max() < np.radians(0.05)
    assert study.axis_error(study.recovered).max() < 4.5 * study.recovered.axes[0].std
    assert study.rank_apart == 15


def test_the_wrong_axis_passes_the_usual_checks(noise_free):
    """Section VI.B: condition number and residual look fine although the parameters are wrong."""
    simplified, full = noise_free.fit("simplified"), noise_free.fit("full")
    assert simplified.estimate.condition_number < full.estimate.condition_number
    assert simplified.estimate.epsilon < 0.02 * np.linalg.norm(noise_free.recording.wrench("ground").values)
    assert abs(simplified.error).max() > 1
    assert noise_free.axis_error(noise_free.recovered).max() < 1e-9
    assert max(abs(full.error).max(), abs(noise_free.fit("full_on_table").error).max()) < 1e-6


VERBATIM = np.zeros((3, 10))
"""φ that the paper must have used: inertias about the centres of mass taken as those about the frame origins."""
VERBATIM[0, 0] = 4.0
VERBATIM[1, [0, 3, 4]] = 3.7, 3.7 * 0.2, 0.0103
VERBATIM[2, [0, 1, 3, 4]] = 13.2939, 13.2939 * 0.1, 13.2939 * 0.2, 0.41


def test_regrouping_the_papers_robot_gives_all_true_values_of_table_4():
    base = find_base_parameters(double_pendulum())
    psi = dict(zip(base.names, base.regroup(VERBATIM.ravel()), strict=True))
    assert {name: round(value, 2) + 0.0 for name, value in psi.items()} == {k: v for k, (v, _) in paper.TABLE_4.items()}


def test_the_papers_robot_is_no_rigid_body(noise_free):
    # With any other inertias: a body with its mass at height z has at least m z² about x.
    for phi in VERBATIM[1:]:
        assert phi[4] < phi[3] ** 2 / phi[0]
        assert np.linalg.eigvalsh(pseudo_inertia(phi)).min() < 0
    # The physical scene differs from Table IV by parallel-axis terms only.
    fitted = noise_free.fit("simplified")
    off = {name: x - paper.TABLE_4[name][0] for name, x in zip(fitted.base.names, fitted.psi_true, strict=True)}
    differs = {name: x for name, x in off.items() if abs(x) > 0.006}
    expected = {"Ixx2": 3.7 * 0.2**2, "Ixx3": 13.2939 * 0.2**2, "Ixz3": -13.2939 * 0.1 * 0.2}
    assert differs == pytest.approx(expected, abs=0.006)


def test_table_3_errors_are_absolute():
    # The six true values that are zero have no relative error, but the paper prints one for each.
    zero = [name for name, (true, _) in paper.TABLE_4.items() if true == 0]
    assert len(zero) == 6 and all(name in paper.TABLE_3 for name in zero)


def test_acceleration_noise_ruins_the_estimate():
    """Errors in variables: q̈ noise six times larger biases ψ far beyond its predicted standard deviation."""
    spec = scenes.load("double_pendulum")
    clean = simulate(spec, DOUBLE_PENDULUM, noise_scale=0)
    levels = {s: 0.3 if s.endswith("acceleration") else 0.0 for s in clean.noise}
    trial = fit(mechanism(spec, "base"), with_noise(replace(clean, noise=levels), np.random.default_rng(0)))
    assert abs(trial.error).max() > 0.5 and abs(trial.error / trial.estimate.std).max() > 10

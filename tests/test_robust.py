import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from ident.robust import independent, robust_fit

TRUE = np.array([2.0, -1.0, 0.5])


def case(rng, samples=1000, noise=(0.1, 3.0)):
    columns = rng.normal(size=(samples, len(noise), 3))
    return columns, columns @ TRUE + np.array(noise) * rng.normal(size=(samples, len(noise)))


def test_noise_of_each_channel_is_found_and_weighted():
    rng = np.random.default_rng(0)
    columns, measured = case(rng)
    fit, ordinary = robust_fit(columns, measured), robust_fit(columns, measured, weighted=False)
    np.testing.assert_allclose(fit.scale, [0.1, 3.0], rtol=0.1)
    assert (fit.std < 0.1 * ordinary.std).all()
    np.testing.assert_array_less(abs(fit.values - TRUE), 4 * fit.std)


def test_ordinary_least_squares_is_lstsq():
    columns, measured = case(np.random.default_rng(0))
    expected = np.linalg.lstsq(columns.reshape(-1, 3), measured.ravel(), rcond=None)[0]
    np.testing.assert_allclose(robust_fit(columns, measured, weighted=False).values, expected, rtol=1e-10)


def test_gross_outliers_move_the_fit_by_less_than_its_interval():
    rng = np.random.default_rng(1)
    columns, measured = case(rng)
    clean = robust_fit(columns, measured)
    bad = rng.choice(len(measured), len(measured) // 100, replace=False)
    measured[bad] += 1000 * rng.choice([-1, 1], size=(len(bad), 2))
    spoilt = robust_fit(columns, measured)
    assert (abs(spoilt.values - clean.values) < 1.96 * clean.std).all()
    assert (spoilt.weights[bad] < 0.02).all()
    assert (abs(robust_fit(columns, measured, weighted=False).values - TRUE) > 0.5).any()


@pytest.mark.parametrize("colour", [None, 0.02])
def test_standard_deviations_are_right_for_white_and_for_slow_noise(colour):
    """Over 200 recordings the errors are as large as predicted, whatever the noise's autocorrelation."""
    samples, errors, predicted = 600, [], []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        t = np.arange(samples) / 100
        columns = np.stack([np.sin(2 * np.pi * f * t) for f in (0.3, 0.7, 1.1)], axis=1)[:, None]
        noise = rng.normal(size=samples + 500)
        if colour:
            noise = sosfilt(butter(1, colour, output="sos"), noise)
        noise = noise[500:] / noise[500:].std()
        fit = robust_fit(columns, (columns @ TRUE) + noise[:, None])
        errors.append(fit.values - TRUE)
        predicted.append(fit.std)
    found = np.std(errors, axis=0) / np.sqrt(np.mean(np.square(predicted), axis=0))
    assert (found > 0.75).all() and (found < 1.15).all()


def test_a_perfect_fit_is_perfect():
    columns, _ = case(np.random.default_rng(0))
    fit = robust_fit(columns, columns @ TRUE)
    np.testing.assert_allclose(fit.values, TRUE, atol=1e-12)


def test_which_candidates_are_independent():
    rng = np.random.default_rng(0)
    a, b, c = rng.normal(size=(3, 50, 2))
    columns = np.stack([a, b], axis=2)
    candidates = np.stack([a + b, c, 1e-3 * c, 0 * c], axis=2)
    assert independent(columns, candidates) == [1]


@pytest.mark.parametrize(
    ("columns", "measured", "message"),
    [
        (np.ones((2, 1, 3)), np.ones((2, 1)), "N of at least k"),
        (np.ones((5, 1, 3)), np.ones((4, 1)), r"got \(5, 1, 3\) and \(4, 1\)"),
        (np.full((5, 1, 2), np.nan), np.ones((5, 1)), "finite"),
        (np.ones((5, 1, 2)), np.ones((5, 1)), "separates 1 of 2 parameters"),
    ],
)
def test_what_cannot_be_fitted_is_refused(columns, measured, message):
    with pytest.raises(ValueError, match=message):
        robust_fit(columns, measured)

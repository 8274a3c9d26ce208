import numpy as np
import pytest
from scipy import linalg
from scipy.signal import butter, lfilter, sosfilt

from ident.estimation.robust import independent, innovations, remembered, robust_fit, sandwich

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


def test_the_fit_solves_hubers_equations():
    rng = np.random.default_rng(2)
    columns, measured = case(rng)
    measured += 2 * rng.standard_t(2, size=measured.shape)
    fit = robust_fit(columns, measured)
    size = abs(fit.residual) / fit.scale
    np.testing.assert_allclose(fit.weights, np.minimum(1, 1.345 / size), rtol=1e-4)
    pulls = columns * (fit.weights * fit.residual / fit.scale**2)[..., None]
    assert (abs(pulls.sum(axis=(0, 1))) < 1e-4 * abs(pulls).sum(axis=(0, 1))).all()


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


def autoregressive(rng, correlation, shape):
    """Noise of variance one with a correlation from one sample to the next, samples last."""
    u = rng.normal(size=(*shape[:-1], shape[-1] + 2000))
    return lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], u, axis=-1)[..., 2000:]


def errors_over_predicted(columns, correlation, recordings=300):
    """Root mean square errors of ordinary least squares over the root mean square of their standard deviations."""
    noise = autoregressive(np.random.default_rng(0), correlation, (recordings, len(columns)))
    fits = [robust_fit(columns[:, None], x[:, None], weighted=False) for x in noise]
    squares, variances = (
        np.mean([f(fit) for fit in fits], axis=0) for f in (lambda f: f.values**2, lambda f: f.std**2)
    )
    return np.sqrt(squares / variances)


def test_what_a_fit_takes_of_the_noise_is_given_back():
    """With few samples for their number of columns, and in recordings of a few of the noise's correlation times."""
    few = errors_over_predicted(np.random.default_rng(1).normal(size=(20, 8)), 0)
    assert (few > 0.9).all() and (few < 1.1).all()
    t = np.arange(300) / 100
    slow = errors_over_predicted(np.stack([np.sin(2 * np.pi * f * t + f) for f in (0.3, 0.7, 1.1)], axis=1), 0.98)
    assert (slow > 0.6).all() and (slow < 1).all()


def test_how_long_noise_is_taken_to_remember():
    rng = np.random.default_rng(0)
    # The residuals' correlation time is stretched by a fifth; a sum of correlations counts, not the first alone.
    decay, size = innovations(autoregressive(rng, 0.9, (4, 100_000)), 1)
    np.testing.assert_allclose(decay, 0.9 ** (1 / 1.2), atol=0.004)
    np.testing.assert_allclose((size**2).mean(axis=1), 1 - decay**2, rtol=0.05)
    u = rng.normal(size=(4, 100_000))
    blocks = (u[:, 2:] + u[:, 1:-1] + u[:, :-2]) / np.sqrt(3)
    # Correlations 2/3 and 1/3 add up to ρ / (1 - ρ) = 1 in the lags and as much again beyond, as an exponential.
    total = 2 / 3 + 1 / 3 / (1 - np.sqrt(1 / 3))
    np.testing.assert_allclose(innovations(blocks, 1)[0], (total / (1 + total)) ** (1 / 1.2), atol=0.01)
    # White noise shows more than two standard deviations in one of 44 cases.
    assert 0.95 < (innovations(rng.normal(size=(1000, 500)), 1)[0] == 0).mean() < 0.99


def test_the_middle_of_the_sandwich_is_the_sum_over_all_pairs_of_samples():
    rng = np.random.default_rng(0)
    columns, pull = rng.normal(size=(80, 3, 4)).cumsum(axis=0), autoregressive(rng, 0.8, (3, 80)).T
    slope = rng.uniform(0.5, 1, size=(80, 3))
    decay, size = innovations(pull.T, 4 / 3)
    variance = (size**2).mean(axis=1) / (1 - decay**2)
    middle = np.zeros((4, 4))
    for c in range(3):
        middle += columns[:, c].T @ (variance[c] * linalg.toeplitz(decay[c] ** np.arange(80))) @ columns[:, c]
    bread = np.linalg.inv(np.einsum("nck,nc,ncl->kl", columns, slope, columns))
    covariance, longest = sandwich(columns, pull, slope)
    np.testing.assert_allclose(covariance, bread @ middle @ bread, rtol=1e-9)
    assert longest == round(max(-1 / np.log(decay)))
    # The same in two parts.
    z = remembered(columns[:, 0].T, 0.8, np.zeros(4))
    after = remembered(columns[30:, 0].T, 0.8, z[:, 29])
    np.testing.assert_allclose(after, z[:, 30:], rtol=1e-12)
    np.testing.assert_allclose(z[:, 79], 0.8 ** np.arange(79, -1, -1) @ columns[:, 0], rtol=1e-12)


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


def test_what_barely_sticks_out_does_not_spoil_the_next():
    """Rounding grows from column to column unless it is taken away each time."""
    a, b, c, d = linalg.qr(np.random.default_rng(0).normal(size=(100, 4)), mode="economic")[0].T
    candidates = np.stack([a + 3e-6 * b, a + 3e-6 * c, c, b, b + c, a + 0.7e-6 * d, a + 1.4e-6 * d], axis=1)
    assert independent(a[:, None, None], candidates[:, None]) == [0, 1, 6]


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

"""Noise of known colour is white behind its filter, the filter is the least-squares one, the noise density the true
one.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest
from scipy import signal, stats

from discrepancy.evidence.whitening import Whitening, whitening
from messages.arrays import FloatArray
from tests.bench.linear_bench import autoregressive, likely_counts

_SEED = 7301
_DRAWS = 500
_N = 800
_TESTED_LAGS = 20
_LEVEL = 0.05
_COLOURS: dict[str, tuple[float, ...]] = {
    "white": (),
    "slow": (0.9,),
    "resonant": (1.5, -0.8),
    "drift": (0.995,),
    "alternating": (-0.7,),
}


@lru_cache
def draws(colour: str) -> tuple[FloatArray, Whitening]:
    """Return noise (500, n), as many channels too many to be mixed, and its whitening."""
    rows = autoregressive(np.random.default_rng(_SEED), (_DRAWS, _N), _COLOURS[colour])
    return rows, whitening(rows, np.ones(rows.shape, bool))


def ljung_box(rows: FloatArray) -> FloatArray:
    """Return the chance (rows,) that white noise is as correlated up to 20 lags (Ljung and Box 1978)."""
    n = rows.shape[1]
    statistic = np.zeros(len(rows))
    for lag in range(1, _TESTED_LAGS + 1):
        share = (rows[:, lag:] * rows[:, :-lag]).sum(axis=1) / (rows**2).sum(axis=1)
        statistic += n * (n + 2) * share**2 / (n - lag)
    return np.asarray(stats.chi2(_TESTED_LAGS).sf(statistic), dtype=np.float64)


def cumulative_periodogram(rows: FloatArray) -> FloatArray:
    """Return the chance (rows,) that white noise's cumulative periodogram is as far from a straight line (Bartlett
    1955).
    """
    power = np.abs(np.fft.rfft(rows, axis=1)[:, 1:-1]) ** 2
    m = power.shape[1]
    risen = np.cumsum(power, axis=1) / power.sum(axis=1, keepdims=True)
    furthest = np.abs(risen - np.arange(1, m + 1) / m).max(axis=1)
    return np.asarray(stats.kstwobign.sf(np.sqrt(m) * furthest), dtype=np.float64)


@pytest.mark.parametrize("chance", [ljung_box, cumulative_periodogram])
@pytest.mark.parametrize("colour", _COLOURS)
def test_noise_is_white_behind_its_filter(colour: str, chance: Callable[[FloatArray], FloatArray]) -> None:
    rows, white = draws(colour)
    rejected = int(np.sum(chance(white(rows)[:, white.kept[0]]) < _LEVEL))
    assert rejected <= likely_counts(_DRAWS, _LEVEL)[1], f"seed {_SEED}: {rejected} of {_DRAWS} draws are not white"
    if _COLOURS[colour]:
        assert np.all(chance(rows) < _LEVEL)


@pytest.mark.parametrize("colour", _COLOURS)
def test_whitened_noise_has_unit_power(colour: str) -> None:
    rows, white = draws(colour)
    assert np.allclose((white(rows)[:, white.kept[0]] ** 2).mean(axis=1), 1.0, rtol=1e-9)


@pytest.mark.parametrize("colour", _COLOURS)
def test_noise_density_is_the_true_one(colour: str) -> None:
    _, white = draws(colour)
    rate_hz = 50.0
    f_hz = np.linspace(0.5, 24.5, 49)
    _, response = signal.freqz([1.0], [1.0, *(-a for a in _COLOURS[colour])], f_hz, fs=rate_hz)
    truth = 2.0 / rate_hz * np.abs(response) ** 2
    told = np.log(white.noise_density(f_hz, rate_hz) / truth[:, None])
    # Fifteen weights out of 800 samples: each is off by 1/√800, the innovations' power too low by 2 %.
    assert np.abs(told.mean(axis=1)).max() < 0.1, f"seed {_SEED}"
    assert told.std(axis=1).max() < 0.6, f"seed {_SEED}"


def test_the_filter_is_the_least_squares_prediction_from_single_lags_and_bands() -> None:
    r = autoregressive(np.random.default_rng(_SEED), (200,), (0.9,))
    bands = [(1,), (2,), (3,), (4, 5, 6), (7, 8, 9, 10, 11, 12)]  # of 200 samples: a sixtieth single, to a twelfth
    past = np.array([[np.mean([r[abs(t - lag)] for lag in band]) for band in bands] for t in range(8, 200)])
    loaded = np.vstack((past, np.sqrt(1e-5 * np.sum(r[8:] ** 2)) * np.eye(len(bands))))
    weights = np.linalg.lstsq(loaded, np.concatenate((r[8:], np.zeros(len(bands)))), rcond=None)[0]
    expected = np.array([1.0, *(-w / len(band) for w, band in zip(weights, bands, strict=True) for _ in band)])
    assert np.allclose(whitening(r[None], np.ones((1, 200), bool)).kernels[0], expected, atol=1e-9)


def innovations(white: Whitening, values: FloatArray) -> FloatArray:
    """Return `values` (c, n) through the filters sample by sample; before its beginning a record is its own mirror."""
    out = np.zeros_like(values)
    for row, kernel in enumerate(white.kernels):
        for t in range(values.shape[1]):
            out[row, t] = sum(weight * values[row, abs(t - lag)] for lag, weight in enumerate(kernel))
    return out


def three_channels(n: int = 300) -> FloatArray:
    """Return noise of three colours with common innovations."""
    rng = np.random.default_rng(_SEED)
    mixed = np.array([[1.0, 0.0, 0.0], [2.0, 1.5, 0.0], [-0.3, 0.2, 0.1]]) @ rng.normal(size=(3, n + 200))
    rows = [signal.lfilter([1.0], [1.0, -a], row) for a, row in zip((0.9, 0.0, -0.5), mixed, strict=True)]
    return np.array(rows)[:, 200:]


def test_channels_are_filtered_then_mixed_and_minus_2_log_likelihood_is_that_of_the_innovations() -> None:
    rows = three_channels()
    white = whitening(rows, np.ones(rows.shape, bool))
    e = innovations(white, rows)[:, white.kept[0]]
    covariance = e @ e.T / e.shape[1]
    told = white(rows)[:, white.kept[0]]
    assert np.allclose(told @ told.T / e.shape[1], np.eye(3), atol=1e-6)
    assert np.allclose(told, np.linalg.inv(np.linalg.cholesky(covariance)) @ e, atol=1e-6)
    likelihood = stats.multivariate_normal(np.zeros(3), covariance).logpdf(e.T).sum()
    told_likelihood = white.log_det + np.sum(told**2) + told.size * np.log(2.0 * np.pi)
    assert told_likelihood == pytest.approx(-2.0 * likelihood, rel=1e-6)


def test_noise_density_of_mixed_channels_is_that_of_each_alone() -> None:
    rows = three_channels(3000)
    f_hz = np.linspace(0.01, 0.49, 25)
    together = whitening(rows, np.ones(rows.shape, bool)).noise_density(f_hz, 1.0)
    alone = [whitening(row[None], np.ones((1, 3000), bool)).noise_density(f_hz, 1.0) for row in rows]
    assert np.allclose(together, np.column_stack(alone), rtol=1e-6)


def test_any_values_are_whitened_by_the_same_linear_map() -> None:
    rows = three_channels()
    white = whitening(rows, np.ones(rows.shape, bool))
    other = np.random.default_rng(1).normal(size=(2, 3, 300))
    assert np.allclose(white(other)[1], white(other[1]))
    assert np.allclose(white(rows + 2.0 * other[0]), white(rows) + 2.0 * white(other[0]))


def test_samples_in_a_gap_and_eight_after_it_do_not_count_in_any_mixed_channel() -> None:
    rows = three_channels()
    valid = np.ones(rows.shape, bool)
    valid[1, 100:105] = False
    white = whitening(rows, valid)
    expected = np.ones(300, bool)
    expected[:8] = expected[100:113] = False
    assert np.array_equal(white.kept, np.broadcast_to(expected, (3, 300)))
    assert white.count == 3 * int(expected.sum())
    assert not np.any(white(rows)[~white.kept])


def test_channels_that_are_rarely_there_together_are_not_mixed() -> None:
    rows = three_channels()
    valid = np.ones(rows.shape, bool)
    valid[1, 100:200] = False
    white = whitening(rows, valid)
    assert np.array_equal(white.mix, np.diag(np.diag(white.mix)))
    assert white.kept[0].sum() == 292
    assert white.kept[1].sum() == 184
    assert np.allclose((white(rows) ** 2).sum(axis=1), white.kept.sum(axis=1))

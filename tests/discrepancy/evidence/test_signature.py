"""A planted remainder is told where it is: in its channel, at its frequency, in its time; coherence is free of bias."""

import numpy as np
import pytest
from scipy.signal import lfilter

from discrepancy.evidence.signature import coherence, nothing_left, power_density, signature
from discrepancy.evidence.whitening import whitening
from discrepancy.problem import Problem
from discrepancy.verdict import Signature
from messages.arrays import FloatArray
from tests.bench.linear_bench import LinearSimulation, autoregressive

_SEED = 7304
_N, _RATE_HZ = 2560, 100.0
_STRETCH_S = _N / _RATE_HZ / 40
_T_S = np.arange(_N) / _RATE_HZ


def told(structured: FloatArray, std: tuple[float, float] = (1.0, 1.0), seed: int = _SEED) -> Signature:
    """Return the signature of what is left (2, n) under white noise of these standard deviations."""
    rng = np.random.default_rng(seed)
    noise = np.array(std)[:, None] * rng.normal(size=(2, _N))
    problem = Problem(LinearSimulation((structured + noise).T, rng.normal(size=(_N, 1)), rate_hz=_RATE_HZ))
    return signature(problem, whitening(noise, problem.valid), structured)


def in_channel(row: int, values: FloatArray) -> FloatArray:
    out = np.zeros((2, _N))
    out[row] = values
    return out


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize("hz", [1.7, 12.3, 41.0])
def test_a_line_is_told_with_its_channel_and_frequency(row: int, hz: float) -> None:
    found = told(in_channel(row, np.sin(2.0 * np.pi * hz * _T_S)))
    low, high = found.band_hz
    assert found.channels == [f"y{row}"]
    assert low is not None
    assert high is not None
    assert hz - 0.2 < low <= high < hz + 0.2  # bins of 1024 samples are 0.1 Hz wide
    assert found.when_s is None


def test_a_band_holds_nine_tenths_of_the_power() -> None:
    lines = sum(np.sin(2.0 * np.pi * hz * _T_S + hz**2) for hz in np.arange(10.0, 30.0, 0.5))
    low, high = told(in_channel(0, np.asarray(lines))).band_hz
    assert low == pytest.approx(11.0, abs=0.6)
    assert high == pytest.approx(28.5, abs=0.6)


@pytest.mark.parametrize(("first", "last"), [(0.0, 4.0), (9.0, 12.0), (21.6, 25.6)])
def test_a_step_is_told_with_its_time(first: float, last: float) -> None:
    found = told(in_channel(1, np.where((first <= _T_S) & (last > _T_S), 1.0, 0.0)))
    assert found.channels == ["y1"]
    assert found.when_s is not None
    assert found.when_s[0] == pytest.approx(first, abs=_STRETCH_S)
    assert found.when_s[1] == pytest.approx(last, abs=_STRETCH_S)
    assert found.band_hz[0] == 0.0
    assert found.band_hz[1] is not None
    assert found.band_hz[1] < 2.0


def test_a_remainder_that_grows_with_the_amplitude_is_told_where_the_amplitude_is_large() -> None:
    amplitude = 0.2 + np.exp(-0.5 * ((_T_S - 14.0) / 1.2) ** 2)
    motion = amplitude * np.sin(2.0 * np.pi * 5.0 * _T_S)
    cubic = told(in_channel(0, motion**3))
    assert cubic.when_s is not None
    assert 14.0 - 2.4 < cubic.when_s[0] < 14.0 < cubic.when_s[1] < 14.0 + 2.4
    assert cubic.band_hz[0] == pytest.approx(5.0, abs=0.5)  # 3.1 % of the power are at 15 Hz
    assert told(in_channel(0, np.sin(2.0 * np.pi * 5.0 * _T_S))).when_s is None


def test_channels_and_frequencies_count_by_their_power_over_that_of_the_noise() -> None:
    same = np.repeat(np.sin(2.0 * np.pi * 8.0 * _T_S)[None], 2, axis=0)
    assert told(same).channels == ["y0", "y1"]
    assert told(same, (1.0, 4.0)).channels == ["y0"]
    assert told(same, (4.0, 1.0)).channels == ["y1"]

    noise = autoregressive(np.random.default_rng(_SEED), (1, _N), (0.95,))
    both = 2.0 * np.sin(2.0 * np.pi * 0.8 * _T_S) + np.sin(2.0 * np.pi * 30.0 * _T_S)
    problem = Problem(LinearSimulation((both + noise).T, np.ones((_N, 1)), rate_hz=_RATE_HZ))
    found = signature(problem, whitening(noise, problem.valid), both[None])
    assert found.band_hz[0] == pytest.approx(30.0, abs=0.3)  # where the noise is low


def test_nothing_has_no_signature() -> None:
    assert told(np.zeros((2, _N))) == nothing_left() == Signature([], (None, None), None)


def test_power_density_is_one_sided_and_holds_the_variance() -> None:
    rows = np.array([[2.0], [0.5]]) * np.random.default_rng(_SEED).normal(size=(2, 60000))
    f_hz, density = power_density(rows, _RATE_HZ)
    assert f_hz[-1] == 0.5 * _RATE_HZ
    assert np.allclose(density[1:-1].mean(axis=0) * 0.5 * _RATE_HZ, [4.0, 0.25], rtol=0.05)


def problem_of(inputs: FloatArray) -> Problem:
    return Problem(LinearSimulation(np.zeros((inputs.shape[1], 1)), inputs.T, rate_hz=_RATE_HZ))


def test_coherence_of_what_follows_linearly_is_1_and_of_a_mixture_its_share() -> None:
    rng = np.random.default_rng(_SEED)
    inputs = rng.normal(size=(2, 20000))
    follows = lfilter([1.0, 0.5], [1.0, -0.3], inputs[0]) + inputs[1]
    apart = rng.normal(size=20000) * np.std(follows)
    f_hz = np.linspace(0.0, 50.0, 129)
    found = coherence(problem_of(inputs), np.array([follows, apart, 0.6 * follows + 0.8 * apart]), f_hz)
    assert found.shape == (129, 3)
    assert found[1:-1, 0].min() > 0.98
    assert found[:, 1].mean() < 0.02
    assert found[20:60, 2].mean() == pytest.approx(np.mean(share_of(follows, apart, f_hz[20:60])), abs=0.04)


def share_of(follows: FloatArray, apart: FloatArray, f_hz: FloatArray) -> FloatArray:
    """Return the true share of 0.6 `follows` in its sum with 0.8 `apart` at `f_hz`."""
    z = np.exp(-2j * np.pi * f_hz / _RATE_HZ)
    density = np.abs((1.0 + 0.5 * z) / (1.0 - 0.3 * z)) ** 2 + 1.0
    white = np.var(apart)
    return np.asarray(0.36 * density / (0.36 * density + 0.64 * white))


def test_coherence_of_independent_noise_has_no_bias_over_500_draws() -> None:
    # Each channel is one draw. Clipped at zero, half of them are zero; unclipped, their mean is.
    rng = np.random.default_rng(_SEED)
    inputs = rng.normal(size=(3, 4000))
    found = coherence(problem_of(inputs), rng.normal(size=(500, 4000)), np.linspace(0.0, 50.0, 65))[8:-8:3]
    assert np.mean(found == 0.0) == pytest.approx(0.5, abs=0.1), f"seed {_SEED}"
    assert found.mean() < 0.02
    assert np.quantile(found, 0.999) < 0.2

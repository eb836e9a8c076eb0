"""The thesis's filters against what defines them."""

import numpy as np
import pytest
from scipy.signal import freqz, savgol_filter

from impedance.thesis.signals import (
    DERIVATIVE_LOST,
    LOW_PASS_LOST,
    derivative_taps,
    derivatives,
    low_pass_taps,
    low_passed,
)

RATE_HZ = 350.0


def _response(taps: np.ndarray, hz: float) -> complex:
    return complex(freqz(taps, worN=[hz], fs=RATE_HZ)[1][0])


def test_low_pass_is_half_at_its_cutoff_and_symmetric() -> None:
    taps = low_pass_taps(RATE_HZ)
    assert len(taps) == 101
    np.testing.assert_allclose(taps, taps[::-1], atol=1e-16)
    assert abs(_response(taps, 0.0)) == pytest.approx(1.0, abs=1e-12)
    assert abs(_response(taps, 40.0)) == pytest.approx(0.5, abs=1e-3)
    assert abs(_response(taps, 30.0)) == pytest.approx(1.0, abs=0.01)
    assert abs(_response(taps, 52.0)) < 0.01


def test_low_pass_delays_nothing() -> None:
    t_s = np.arange(700) / RATE_HZ
    slow = np.stack([np.sin(2 * np.pi * 7.0 * t_s), np.cos(2 * np.pi * 11.0 * t_s)], axis=1)
    gains = [abs(_response(low_pass_taps(RATE_HZ), hz)) for hz in (7.0, 11.0)]
    np.testing.assert_allclose(low_passed(slow, RATE_HZ), slow[LOW_PASS_LOST:-LOW_PASS_LOST] * gains, atol=1e-12)


def test_derivatives_are_those_of_the_interpolating_polynomial() -> None:
    t_s = np.arange(40) / RATE_HZ
    c = np.random.default_rng(3).normal(size=13)
    polynomial = np.polynomial.Polynomial(c, domain=[0, t_s[-1]], window=[-1, 1])
    value, first, second = derivatives(polynomial(t_s)[:, None], RATE_HZ)
    inner = t_s[DERIVATIVE_LOST:-DERIVATIVE_LOST]
    np.testing.assert_array_equal(value[:, 0], polynomial(inner))
    for found, order in ((first, 1), (second, 2)):
        expected = polynomial.deriv(order)(inner)
        np.testing.assert_allclose(found[:, 0], expected, atol=1e-8 * np.abs(expected).max())


def test_derivatives_agree_with_scipy_and_smooth_nothing() -> None:
    noise = np.random.default_rng(4).normal(size=(200, 2))
    for order, found in enumerate(derivatives(noise, RATE_HZ)):
        expected = savgol_filter(noise, 13, 12, deriv=order, delta=1.0 / RATE_HZ, axis=0)[6:-6]
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(derivative_taps(RATE_HZ, 0), np.eye(13)[6], atol=1e-9)


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="100 samples"):
        low_passed(np.zeros((100, 3)), RATE_HZ)

"""The noise of a resting force plate is recovered where it is known."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from impedance.recording.force_noise import fit_force_noise
from messages.arrays import FloatArray
from messages.errors import UserError

RATE_HZ = 100.0
T_S = np.arange(6000) / RATE_HZ
AR = np.array([0.9, -0.5])


def coloured(seed: int) -> FloatArray:
    """Return two channels: coloured with a line at 33 Hz, an offset and a drift; and white, half correlated with it."""
    rng = np.random.default_rng(seed)
    innovations = rng.standard_normal((len(T_S) + 500, 2)) @ np.array([[1.0, 0.5], [0.0, np.sqrt(0.75)]])
    first = lfilter([1.0], np.concatenate(([1.0], -AR)), innovations[:, 0])[500:]
    first += 5.0 + 0.01 * (T_S - T_S.mean()) + 0.4 * np.cos(2.0 * np.pi * 33.0 * T_S + 1.0)
    return np.column_stack((first, innovations[500:, 1]))


def test_a_known_model_is_recovered() -> None:
    noise = fit_force_noise(T_S, coloured(3), ("a", "b"))
    a, b = noise.channels
    assert noise.rate_hz == pytest.approx(RATE_HZ)
    np.testing.assert_allclose(a.autoregression, AR, atol=0.05)
    assert a.innovation == pytest.approx(1.0, rel=0.03)
    assert abs(a.offset - 5.0) < 3.0 * a.offset_deviation
    assert abs(a.drift_per_s - 0.01) < 3.0 * a.drift_deviation
    (line,) = noise.lines
    assert line.f_hz == pytest.approx(33.0, abs=0.01)
    np.testing.assert_allclose(line.amplitude, [0.4, 0.0], atol=0.06)
    assert line.mains_hz == 0.0
    assert len(b.autoregression) == 0
    assert noise.correlation[0, 1] == pytest.approx(0.5, abs=0.05)


@pytest.mark.long
def test_stated_deviations_of_offset_drift_and_mean_hold_over_draws() -> None:
    found = [fit_force_noise(T_S, coloured(seed), ("a", "b")).channels[0] for seed in range(10, 60)]
    for errors, stated in (
        ([c.offset - 5.0 for c in found], np.mean([c.offset_deviation for c in found])),
        ([c.drift_per_s - 0.01 for c in found], np.mean([c.drift_deviation for c in found])),
    ):
        assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(stated, rel=0.35)
    seconds = [coloured(seed)[:100, 0].mean() - 5.0 + 0.295 for seed in range(100, 300)]
    assert np.std(seconds) == pytest.approx(found[0].deviation_of_mean(1.0, RATE_HZ), rel=0.25)


def test_what_is_generated_has_the_models_spectrum_and_correlation() -> None:
    noise = fit_force_noise(T_S, coloured(4), ("a", "b"))
    again = fit_force_noise(T_S, noise.generate(len(T_S), np.random.default_rng(8), offsets=True), ("a", "b"))
    f_hz = np.linspace(1.0, 49.0, 25)
    ratio = again.channels[0].density(f_hz, RATE_HZ) / noise.channels[0].density(f_hz, RATE_HZ)
    np.testing.assert_allclose(ratio, 1.0, atol=0.25)
    assert again.channels[0].offset == pytest.approx(5.0, abs=0.15)
    assert again.correlation[0, 1] == pytest.approx(noise.correlation[0, 1], abs=0.05)
    assert again.lines[0].f_hz == pytest.approx(33.0, abs=0.01)


def test_mains_are_known_by_their_alias_and_walks_by_their_blocks() -> None:
    rng = np.random.default_rng(6)
    y = (
        rng.standard_normal(6000)
        + 0.3 * np.sin(2.0 * np.pi * 60.0 * T_S)
        + 0.3 * np.cumsum(rng.standard_normal(6000)) / 10.0
    )
    noise = fit_force_noise(T_S, y[:, None], ("a",))
    assert [(round(line.f_hz, 2), line.mains_hz) for line in noise.lines] == [(40.0, 60.0)]
    assert 0.05 < noise.channels[0].walk_per_root_s < 0.6


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda t, y: (t, np.where(np.arange(len(t))[:, None] == 7, np.nan, y)), "row 8: a is not a number"),
        (lambda t, y: (t[:500], y[:500]), "10 s or more"),
        (lambda t, y: (np.where(t > 30.0, t + 1.0, t), y), "row 3002: 1.01 s after the last, not 0.01017"),
        (lambda t, y: (t, y * np.array([1.0, 0.0])), "b never changes: not connected?"),
    ],
)
def test_records_that_cannot_be_used_are_named(
    spoil: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]], said: str
) -> None:
    t_s, values = spoil(T_S, coloured(5))
    with pytest.raises(UserError) as refused:
        fit_force_noise(t_s, values, ("a", "b"))
    assert said in str(refused.value)

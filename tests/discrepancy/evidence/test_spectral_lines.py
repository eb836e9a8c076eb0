"""The test for lines: noise of any colour holds none, a hum is one, and a record too short tells neither."""

import numpy as np
import pytest
from scipy import signal

from discrepancy.evidence.spectral_lines import strongest_line


@pytest.mark.parametrize(("samples", "channels"), [(100, 16), (400, 6), (3000, 6)])
@pytest.mark.parametrize("colour", [0.0, 0.9, 0.99])
def test_noise_holds_no_line(samples: int, channels: int, colour: float) -> None:
    rng = np.random.default_rng(5)
    white = rng.normal(size=(40, channels, samples + 500))
    noise = signal.lfilter([1.0], [1.0, -colour], white)[..., 500:]
    assert all(strongest_line(each) is None for each in noise)


@pytest.mark.parametrize("samples", [400, 3000])
def test_a_hum_is_a_line_of_its_channel(samples: int) -> None:
    noise = np.random.default_rng(6).normal(size=(6, samples))
    hum = 2.0 * np.sin(2.0 * np.pi * 0.29 * np.arange(samples))
    noise[2] += hum
    line = strongest_line(noise)
    assert line is not None
    assert line.row == 2
    assert abs(line.bin - 0.29 * samples) <= 1
    assert np.std(line.signal[2] - hum) < 0.5 * np.std(hum)
    assert not np.any(line.signal[[0, 1, 3, 4, 5]])


def test_three_cycles_are_drift_not_a_line() -> None:
    noise = np.random.default_rng(7).normal(size=(2, 400))
    noise[0] += 3.0 * np.sin(2.0 * np.pi * 3.0 * np.arange(400) / 400)
    assert strongest_line(noise) is None

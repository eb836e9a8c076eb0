"""Noise with the colour of a real force plate at rest, without its data.

The figures are those that `impedance.recording.force_noise` estimated for two plates of an instrumented treadmill, a
minute at rest: a quarter of the power in 16 to 19 lines between 20 and 50 Hz, shared by all channels with sizes of
their own; resonances around 23, 29, 33, 40 and 48 Hz; below 5 Hz half the density; and channels that are correlated.
"""

from typing import Final

import numpy as np

from messages.arrays import FloatArray

_RESONANCES_HZ: Final = (23.0, 29.3, 32.7, 40.2, 48.0)
_WIDTH_HZ: Final = 1.5
_LINES: Final = 17
_LINES_HZ: Final = (20.0, 50.0)
_LINES_SHARE: Final = 0.25
_SLOW_HZ: Final = 5.0
_SLOW_DENSITY: Final = 0.5
_TOGETHER: Final = 0.3
"""The share of the power that all channels have in common."""


class PlateNoise:
    """One plate's colour: sizes of lines and resonances are its own, phases and noise are of a record."""

    def __init__(self, channels: int, random: np.random.Generator) -> None:
        self._channels = channels
        self._height = np.exp(random.uniform(np.log(0.5), np.log(8.0), (channels, len(_RESONANCES_HZ))))
        self._lines_hz = random.uniform(*_LINES_HZ, _LINES)
        self._lines = random.exponential(1.0, (channels, _LINES))
        self._signs = random.choice((-1.0, 1.0), channels)

    def record(self, samples: int, rate_hz: float, random: np.random.Generator) -> FloatArray:
        """Return a record (c, n), each channel of unit standard deviation."""
        f_hz = np.fft.rfftfreq(samples, 1.0 / rate_hz)
        bumps = np.exp(-0.5 * ((f_hz[None] - np.array(_RESONANCES_HZ)[:, None]) / _WIDTH_HZ) ** 2)
        density = np.where(f_hz < _SLOW_HZ, _SLOW_DENSITY, 1.0) + self._height @ bumps
        own = np.fft.rfft(random.standard_normal((self._channels, samples)), axis=1)
        common = np.fft.rfft(random.standard_normal(samples))
        mixed = np.sqrt(1.0 - _TOGETHER) * own + np.sqrt(_TOGETHER) * self._signs[:, None] * common
        colour = np.fft.irfft(mixed * np.sqrt(density), samples, axis=1)
        t_s = np.arange(samples) / rate_hz
        phases = random.uniform(0.0, 2.0 * np.pi, _LINES)
        lines = self._lines @ np.cos(2.0 * np.pi * self._lines_hz[:, None] * t_s + phases[:, None])
        unit: FloatArray = np.sqrt(1.0 - _LINES_SHARE) * colour / np.sqrt(density.mean(axis=1, keepdims=True))
        power = 0.5 * (self._lines**2).sum(axis=1, keepdims=True)
        record: FloatArray = unit + np.sqrt(_LINES_SHARE / power) * lines
        return record

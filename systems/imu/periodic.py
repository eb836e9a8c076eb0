"""Records made periodic, so that filters and delays are products of their bins."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy import fft

from messages.arrays import ComplexArray, FloatArray

_BLEND_S: Final = 1.0
"""Length of the bridge from a record's end to its beginning, which makes it periodic."""
_FINER: Final = 4
"""Times the sample rate at which a cubic between samples is exact enough for a late stamp."""
_MOST_LATE: Final = 0.2
"""Of the record, before its first and after its last sample: a fit may try stamps that far off, and no further."""


@dataclass(frozen=True, eq=False)
class Periodic:
    """Records of `n` samples at `rate_hz`, bridged from their end to their beginning."""

    n: int
    rate_hz: float

    @cached_property
    def length(self) -> int:
        """Return the samples of a record with its bridge."""
        return int(fft.next_fast_len(self.n + round(_BLEND_S * self.rate_hz), real=True))

    @cached_property
    def f_hz(self) -> FloatArray:
        """Return the frequencies of the bins (k,)."""
        return np.asarray(np.fft.rfftfreq(self.length, 1.0 / self.rate_hz), dtype=np.float64)

    def bins(self, y: FloatArray) -> ComplexArray:
        """Return the spectrum (k, c) of a record (n, c); the bridge is of reflections of both ends."""
        count = self.length - len(y)
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1)[:, None] / (count + 1))
        after = 2.0 * y[-1] - y[-2 : -count - 2 : -1]
        before = 2.0 * y[0] - y[count:0:-1]
        found: ComplexArray = fft.rfft(np.concatenate((y, after + share * (before - after))), axis=0)
        return found

    def constant(self, value: FloatArray) -> FloatArray:
        """Return the bin at zero frequency (c,) of a constant (c,)."""
        return self.length * value

    def samples(self, bins: ComplexArray) -> FloatArray:
        """Return the record (n, c) of a spectrum (k, c)."""
        found: FloatArray = fft.irfft(bins, self.length, axis=0)[: self.n]
        return found

    def at(self, bins: ComplexArray, late_s: FloatArray) -> FloatArray:
        """Return the record (n, c) of a spectrum as it was `late_s` (n,) before each sample, by a cubic between samples
        four times as dense.
        """
        fine = _FINER * fft.irfft(bins, _FINER * self.length, axis=0)
        earliest, latest = -_MOST_LATE * self.n, (1.0 + _MOST_LATE) * self.n
        place = _FINER * np.clip(np.arange(self.n) - late_s * self.rate_hz, earliest, latest)
        below = np.floor(place).astype(np.int64)
        u = (place - below)[:, None]
        weights = (
            -u * (u - 1.0) * (u - 2.0) / 6.0,
            (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
            -(u + 1.0) * u * (u - 2.0) / 2.0,
            (u + 1.0) * u * (u - 1.0) / 6.0,
        )
        found: FloatArray = sum(  # type: ignore[assignment]
            weight * fine[(below + k) % len(fine)] for weight, k in zip(weights, (-1, 0, 1, 2), strict=True)
        )
        return found

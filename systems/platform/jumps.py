"""A wrench that jumps, sampled without an anti-alias filter.

A jump of Δ at t_j = (p + s) h, between the samples p and p + 1 of a rate h⁻¹, is a sum over the samples behind it where
band-limited sampling has an integral. With x = jωh the difference is, far below the rate,

    Δ e^(−x p) (1 / (eˣ − 1) − 1/x + s − s² x / 2! + s³ x² / 3! − s⁴ x³ / 4! …)                                   (1)
    1 / (eˣ − 1) − 1/x = −1/2 + x / 12 − x³ / 720 …

To first order that is an impulse Δ (s − 1/2). The jumps are told by the wrench that follows from the motion: Δ is the
step of a line with a step, fitted around t_j. The motion is differentiated below a limit M(f), so that a step rings,

    H(t) = 1/2 + ∫ M(f) sin(2π f t) / (π f) df                                                                      (2)

and a line with a sharp one would take it for a fifth larger than it is.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from messages.arrays import ComplexArray, FloatArray
from systems.platform.band import Band, motion_limit

_AROUND_S = np.array([-9e-3, -6.5e-3, -4e-3, 4e-3, 6.5e-3, 9e-3])
"""Places about a jump that tell its size: clear of the sharp rise itself, and near enough for a line between jumps."""
_BINS = 400
"""Of the integral (2), up to half the rate: each is far narrower than the ringing at `_AROUND_S` needs."""
_SLOWEST_HZ, _FASTEST_HZ = 15.0, 110.0
"""Rates of jumps that are looked for: slower ones are hard to tell from motion, faster ones lie within `_AROUND_S`."""
_FINER = 8
"""Bins for each one of the record's own: a rate between two of those is not missed."""
_RESOLUTION_S = 2e-4
"""Between the offsets that are tried, and of the last jump between the rates: a small part of a sample."""
_STEPS = 24
"""Rates tried to either side of the one where fast changes recur."""
_MOST_CHANGE = 9.0
"""Times the median power of a change: one larger jump counts no more, as it is no rhythm."""
_NOTHING = 1e-30
"""In place of a power of zero, as a divisor."""
_SERIES_SHARE = 0.3
"""Of the rate: how far (1) is summed; beyond lies the band's limit."""


def aliased(wrench: FloatArray, band: Band, update_hz: float, offset_s: float) -> FloatArray:
    """Return by (1) what sampling adds to a wrench (6, n) that jumps every 1 / `update_hz` from `offset_s` on."""
    n, rate_hz = wrench.shape[1], band.rate_hz
    margin_s = _AROUND_S[-1] + 1.0 / rate_hz
    first = np.ceil((margin_s - offset_s) * update_hz)
    last = np.floor(((n - 1) / rate_hz - margin_s - offset_s) * update_hz)
    t_j = offset_s + np.arange(first, last + 1.0) / update_hz
    jump = np.zeros((6, len(t_j)))
    for weight, away_s in zip(_step(rate_hz), _AROUND_S, strict=True):
        jump += weight * _at(wrench, (t_j + away_s) * rate_hz)
    place = t_j * rate_hz
    index = np.floor(place).astype(np.int64)
    part = place - index
    x: ComplexArray = 2j * np.pi / rate_hz * np.where(band.f_hz < _SERIES_SHARE * rate_hz, band.f_hz, 0.0)
    total = np.zeros((6, len(x)), dtype=np.complex128)
    factors: list[ComplexArray] = [
        -0.5 + x / 12.0 - x**3 / 720.0,
        np.ones_like(x),
        -x / 2.0,
        x**2 / 6.0,
        -(x**3) / 24.0,
    ]
    for power, factor in enumerate(factors):
        train = np.zeros_like(wrench)
        train[:, index] = jump * part**power
        total += factor * band.spectrum(train)
    return band.full(total)


def rhythm(wrench: FloatArray, left: FloatArray, rate_hz: float) -> tuple[float, float]:
    """Return how often (Hz) a wrench (6, n) jumps and when (s) first, as far as what is `left` (6, n) of it tells.

    The rate is sought where fast changes recur, then rate and offset as they best put impulses (1) into what is left.
    """
    change = np.diff(wrench, axis=1)
    power = (change**2 / np.maximum((change**2).mean(axis=1, keepdims=True), _NOTHING)).sum(axis=0)
    power = np.minimum(power, _MOST_CHANGE * np.median(power))
    length = _FINER * len(power)
    spectrum = np.abs(np.fft.rfft((power - power.mean()) * np.hanning(len(power)), length))
    f_hz = np.fft.rfftfreq(length, 1.0 / rate_hz)
    spectrum[(f_hz < _SLOWEST_HZ) | (f_hz > _FASTEST_HZ)] = 0.0
    best = float(f_hz[np.argmax(spectrum)])
    scale = np.maximum(left.var(axis=1, keepdims=True), _NOTHING)
    seconds = wrench.shape[1] / rate_hz
    jump = np.zeros_like(wrench)
    position = np.clip(np.arange(wrench.shape[1]) + _AROUND_S[:, None] * rate_hz, 0.0, wrench.shape[1] - 2.0)
    for weight, place in zip(_step(rate_hz), position, strict=True):
        jump += weight * _at(wrench, place)
    agreement = (jump * left / scale).sum(axis=0)
    sought = _Sought(agreement, (jump**2 / scale).sum(axis=0), rate_hz)
    spread = np.arange(-_STEPS, _STEPS + 1)
    found = []
    for centre_hz in (best, 0.5 * best):  # what recurs most may be twice as frequent as the jumps
        if centre_hz > _SLOWEST_HZ:
            step_hz = _RESOLUTION_S / seconds * centre_hz
            coarse = sought.best(centre_hz + step_hz * spread, np.arange(0.0, 1.0 / centre_hz, _RESOLUTION_S))
            finer = spread / _STEPS
            found.append(sought.best(coarse[1] + 2.0 * step_hz * finer, coarse[2] + 2.0 * _RESOLUTION_S * finer))
    _, update_hz, offset_s = max(found)
    return update_hz, offset_s


@dataclass(frozen=True)
class _Sought:
    """By sample (n,), how a jump there agrees with what is left, and its own size."""

    agreement: FloatArray
    size: FloatArray
    rate_hz: float

    def best(self, rates_hz: FloatArray, offsets_s: FloatArray) -> tuple[float, float, float]:
        """Return score, rate and offset of the best rhythm among these, every jump counting by (1)."""
        n = len(self.size)
        best = (-np.inf, float(rates_hz[0]), 0.0)
        for update_hz in rates_hz:
            count = int((n - 1) / self.rate_hz * update_hz) - 1
            place = (offsets_s[:, None] + np.arange(count) / update_hz) * self.rate_hz
            index = np.clip(np.rint(place), 0, n - 1).astype(np.int64)
            lever = place - np.floor(place) - 0.5
            size = (lever**2 * self.size[index]).sum(axis=1)
            score = (lever * self.agreement[index]).sum(axis=1) / np.sqrt(np.maximum(size, _NOTHING))
            k = int(np.argmax(score))
            best = max(best, (float(score[k]), float(update_hz), float(offsets_s[k])))
        return best


@lru_cache(maxsize=4)
def _step(rate_hz: float) -> FloatArray:
    """Return the weights (6,) of the places around a jump that tell its size by (2)."""
    f_hz = (np.arange(_BINS) + 0.5) * rate_hz / (2 * _BINS)
    ringing = np.sin(2.0 * np.pi * _AROUND_S[:, None] * f_hz) @ (motion_limit(f_hz, rate_hz) / f_hz)
    H = 0.5 + ringing * rate_hz / (2 * _BINS * np.pi)
    weights: FloatArray = np.linalg.pinv(np.column_stack((np.ones(6), _AROUND_S, H)))[2]
    return weights


def _at(values: FloatArray, position: FloatArray) -> FloatArray:
    below = np.floor(position).astype(np.int64)
    part = position - below
    between: FloatArray = (1.0 - part) * values[:, below] + part * values[:, below + 1]
    return between

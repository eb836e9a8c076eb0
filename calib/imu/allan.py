"""Noise of an IMU at rest: overlapping Allan deviations with 95 % intervals, and what they say of the noise.

    σ²(τ) = ⟨(x(t + 2τ) − 2 x(t + τ) + x(t))²⟩ / (2 τ²),   x the integral of the signal                        (1)

White noise of density N shows as N / √τ, bias instability B as 0.664 B, a random walk K as K √(τ / 3) [IEEE Std
952-1997, annex C]. The degrees of freedom behind an interval are those of white noise [Riley, Handbook of Frequency
Stability Analysis, NIST SP 1065, eq. for W FM].

Many publish the older form of (1), from means over periods that do not overlap. Of a short record it is another number:
with twelve differences behind it, it depends on where the first period begins. `apart` has it, to compare with.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from calib.imu.log import ImuLog
from calib.imu.rests import find_rests
from messages import UserError
from messages.arrays import FloatArray

LEAST_S = 60.0
_PER_DECADE = 12
_LONGEST_SHARE = 9.0
"""The longest τ is a ninth of the rest: eight or more periods stand behind each deviation."""
COMPARED_S = (1.0, 10.0, 50.0)
"""τ at which deviations are commonly published."""
_WHITE = (0.1, 1.0)
"""s, where a slope of −½ is looked for; to be within `_SLOPE` of it."""
_SLOPE = 0.15
_FLICKER = math.sqrt(2.0 * math.log(2.0) / math.pi)


class Estimate(NamedTuple):
    """A value with its 95 % interval; NaN where the rest is too short to tell."""

    value: float
    low: float
    high: float


NOT_TOLD = Estimate(math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class AxisNoise:
    """One axis: deviations (k,) at `tau_s` (k,) with their intervals; noise density, per √Hz; bias instability, an
    upper bound where the deviation still falls at the longest τ; random walk, per √s."""

    name: str
    tau_s: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray
    std: float
    density: Estimate
    instability: Estimate
    still_falls: bool
    walk: Estimate
    apart: dict[float, Estimate]

    def at(self, tau_s: float) -> Estimate:
        """Return the deviation at τ, between two known ones on their logarithmic line; NaN outside."""
        if not self.tau_s[0] <= tau_s <= self.tau_s[-1]:
            return NOT_TOLD
        values = (np.exp(np.interp(math.log(tau_s), np.log(self.tau_s), np.log(y))) for y in self._curves)
        return Estimate(*map(float, values))

    @property
    def _curves(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.deviation, self.low, self.high


def noise_of(logs: list[ImuLog], where: str) -> tuple[list[AxisNoise], float]:
    """Return the noise of each axis over the longest rest, and how long that is, s.

    Specific force is in m/s², rates are in rad/s. Raises UserError, its line beginning with `where`, where nothing
    rests for a minute.
    """
    rests = find_rests(logs)
    longest = max(rests, key=lambda rest: rest.seconds, default=None)
    if longest is None or longest.seconds < LEAST_S:
        seconds = 0.0 if longest is None else longest.seconds
        raise UserError(
            f"{where}: the longest rest is {seconds:.0f} s, allowed from {LEAST_S:.0f}: do not touch the unit"
        )
    log = logs[longest.log]
    part = slice(longest.first, longest.last)
    quiet = [log.sf[part], log.w[part]] if log.gyro_is_scaled else [log.sf[part]]
    if any((values == values[0]).all(axis=0).any() for values in quiet):
        raise UserError(f"{where}: an axis reads the same value all the time, as no sensor does")
    axes = [axis_noise(f"acc_{name}", log.sf[part, k], log.rate_hz) for k, name in enumerate("xyz")]
    if log.gyro_is_scaled:
        axes += [axis_noise(f"gyro_{name}", log.w[part, k], log.rate_hz) for k, name in enumerate("xyz")]
    return axes, longest.seconds


def axis_noise(name: str, values: FloatArray, rate_hz: float) -> AxisNoise:
    """Return the noise of evenly sampled values (n,)."""
    n, dt_s = len(values), 1.0 / rate_hz
    most = int(n // _LONGEST_SHARE)
    counts = np.unique(np.rint(np.geomspace(1, most, max(2, round(_PER_DECADE * math.log10(most))))).astype(int))
    x = np.concatenate(((0.0,), np.cumsum(values - values.mean()))) * dt_s
    deviation, freedom = np.empty(len(counts)), np.empty(len(counts))
    for k, m in enumerate(counts.tolist()):
        second = x[2 * m :] - 2.0 * x[m:-m] + x[: -2 * m]
        deviation[k] = math.sqrt(float((second**2).mean()) / 2.0) / (m * dt_s)
        freedom[k] = (1.5 * (n - 1) / m - 2.0 * (n - 2) / n) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    low, high = (deviation * np.sqrt(freedom / chi2.ppf(p, freedom)) for p in (0.975, 0.025))
    tau_s = counts * dt_s
    lowest = int(deviation.argmin())
    still_falls = lowest >= len(counts) - 2
    bounds = (deviation[lowest], 0.0 if still_falls else low[lowest], high[lowest])
    return AxisNoise(
        name=name,
        tau_s=tau_s,
        deviation=deviation,
        low=low,
        high=high,
        std=float(values.std()),
        density=_density(tau_s, deviation, low, high),
        instability=Estimate(*(float(value) / _FLICKER for value in bounds)),
        still_falls=still_falls,
        walk=_walk(tau_s, deviation, low, high, lowest),
        apart={tau: _apart(values, round(tau * rate_hz)) for tau in COMPARED_S},
    )


def _apart(values: FloatArray, m: int) -> Estimate:
    """Return the deviation from means over m samples each, none of which is in two; NaN where they are fewer than nine.

    Of white noise neighbouring differences share a mean, so that their squares correlate by ¼.
    """
    differences = np.diff(values[: len(values) // m * m].reshape(-1, m).mean(axis=1))
    n = len(differences)
    if n < _LONGEST_SHARE - 1.0:
        return NOT_TOLD
    deviation = math.sqrt(float((differences**2).mean()) / 2.0)
    freedom = n**2 / (n + 0.5 * (n - 1))
    low, high = (deviation * math.sqrt(freedom / chi2.ppf(p, freedom)) for p in (0.975, 0.025))
    return Estimate(deviation, low, high)


def _density(tau_s: FloatArray, deviation: FloatArray, low: FloatArray, high: FloatArray) -> Estimate:
    """Return N where the deviation falls as white noise's does, NaN where it does nowhere."""
    near = (tau_s >= _WHITE[0]) & (tau_s <= _WHITE[1])
    if near.sum() < 4:
        return NOT_TOLD
    slope = np.polyfit(np.log(tau_s[near]), np.log(deviation[near]), 1)[0]
    if abs(slope + 0.5) > _SLOPE:
        return NOT_TOLD
    root = np.sqrt(tau_s[near])
    value = math.exp(float(np.log(deviation[near] * root).mean()))
    # of all these deviations the widest interval: they overlap, and slow noise is in them too
    widest = int((high[near] / low[near]).argmax())
    return Estimate(
        value, value * float((low / deviation)[near][widest]), value * float((high / deviation)[near][widest])
    )


def _walk(tau_s: FloatArray, deviation: FloatArray, low: FloatArray, high: FloatArray, lowest: int) -> Estimate:
    """Return K at the longest τ where the deviation has surely risen from its lowest; NaN where it has not."""
    last = len(tau_s) - 1
    if lowest == last or low[last] <= high[lowest]:
        return NOT_TOLD
    by_root = math.sqrt(3.0 / tau_s[last])
    return Estimate(*(float(curve[last]) * by_root for curve in (deviation, low, high)))

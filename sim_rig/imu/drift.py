"""What changes about a chip while it runs: its temperature, and biases that move of themselves."""

from dataclasses import dataclass

import numpy as np

from messages import Vec3
from messages.arrays import FloatArray, IntArray

WARMING_S = 150.0
"""Time constant with which the die follows its own heat and the air around its housing."""


@dataclass(frozen=True)
class Drift:
    """Changes since power-on; the default is none.

    At power-on the die is `warming_K` colder than it comes to be; each of `air_steps` is when (s) and by how much (K)
    the air around it changes. Independent of that the gyroscope's bias moves by `w_rate_radps2`, and jumps at each of
    `w_steps`, given by when (s) and by how much (rad/s).
    """

    warming_K: float = 0.0
    air_steps: tuple[tuple[float, float], ...] = ()
    w_rate_radps2: Vec3 = (0.0, 0.0, 0.0)
    w_steps: tuple[tuple[float, Vec3], ...] = ()


NO_DRIFT = Drift()


@dataclass(frozen=True)
class Drifting:
    """`drift` on CLOCK_MONOTONIC: power-on is at `power_on_ns`, and nothing changes before."""

    drift: Drift
    power_on_ns: int

    def temperature_rise_K(self, t_ns: IntArray) -> FloatArray:
        """Return (n,) how much warmer than warmed up in the first air the die is."""
        since_s = self._since_s(t_ns)
        rise_K: FloatArray = -self.drift.warming_K * np.exp(-since_s / WARMING_S)
        for from_s, by_K in self.drift.air_steps:
            rise_K -= by_K * np.expm1(-np.maximum(since_s - from_s, 0.0) / WARMING_S)
        return rise_K

    def w_bias_radps(self, t_ns: IntArray) -> FloatArray:
        """Return (n, 3) how far the gyroscope's bias has moved of itself."""
        since_s = self._since_s(t_ns)
        moved: FloatArray = since_s[:, None] * np.array(self.drift.w_rate_radps2)
        for from_s, by_radps in self.drift.w_steps:
            moved += (since_s >= from_s)[:, None] * np.array(by_radps)
        return moved

    def _since_s(self, t_ns: IntArray) -> FloatArray:
        since_s: FloatArray = np.maximum(1e-9 * (t_ns - self.power_on_ns).astype(np.float64), 0.0)
        return since_s

"""A driven pendulum recorded by somebody else: what drives it, its angle with noise, and what of it nobody told.

    J q̈ + d q̇ + m g l sin q + f(q, q̇) = τ                                                                        (1)

with f one hidden effect: cogging c sin(8 q), Coulomb friction c sign q̇, drag c |q̇| q̇, or none. It is integrated by
Runge-Kutta's method in steps far shorter than a sample. The noise is written nowhere but into the angles.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from messages.arrays import FloatArray

RATE_HZ: Final = 50.0
INERTIA_KGM2, DAMPING_NMS, WEIGHT_NM = 0.05, 0.08, 1.2
"""J, d and m g l of (1)."""
SIZES: Final = {"cogging": 0.08, "coulomb": 0.03, "drag": 0.012}
"""c of (1), in N m, N m and N m s²/rad²."""
TEETH: Final = 8
_STEPS = 8
"""Of integration in a sample."""
_LINES = 14
"""Sines of the torque."""
_BAND_HZ = (0.15, 2.5)
"""Of the torque: about the pendulum's own frequency of 0.8 Hz."""
_TORQUE_NM = 0.35
"""Its root mean square."""
_STICK_RADPS = 1e-3
"""Within which Coulomb's friction changes its sign, so that steps meet it."""


@dataclass(frozen=True)
class Recorded:
    """A recording: times (n,), the torque held from each sample to the next (n,), and the angle with noise (n,)."""

    t_s: FloatArray
    torque_nm: FloatArray
    angle_rad: FloatArray


def drawn(seed: int, effect: str, *, size: float = 1.0, noise_rad: float = 1e-3, seconds: float = 40.0) -> Recorded:
    """Return a recording in which `effect` acts, "" for none, `size` times as strong as in `SIZES`."""
    rng = np.random.default_rng(seed)
    n = round(seconds * RATE_HZ)
    t_s = np.arange(n) / RATE_HZ
    f_hz = rng.uniform(*_BAND_HZ, _LINES)
    torque = np.sin(2.0 * np.pi * np.outer(t_s, f_hz) + rng.uniform(0.0, 2.0 * np.pi, _LINES)).sum(axis=1)
    torque *= _TORQUE_NM / torque.std()
    angle = _moved(torque, effect, size * SIZES.get(effect, 0.0))
    return Recorded(t_s, torque, angle + rng.normal(0.0, noise_rad, n))


def _moved(torque_nm: FloatArray, effect: str, c: float) -> FloatArray:
    """Return the angle (n,) of (1), at rest in the beginning."""

    def acceleration(q: float, w: float, tau: float) -> float:
        f = 0.0
        if effect == "cogging":
            f = c * math.sin(TEETH * q)
        elif effect == "coulomb":
            f = c * math.tanh(w / _STICK_RADPS)
        elif effect == "drag":
            f = c * abs(w) * w
        return (tau - DAMPING_NMS * w - WEIGHT_NM * math.sin(q) - f) / INERTIA_KGM2

    h = 1.0 / RATE_HZ / _STEPS
    q = w = 0.0
    out = np.empty(len(torque_nm))
    for k, tau in enumerate(torque_nm.tolist()):
        out[k] = q
        for _ in range(_STEPS):
            a1 = acceleration(q, w, tau)
            w2 = w + 0.5 * h * a1
            a2 = acceleration(q + 0.5 * h * w, w2, tau)
            w3 = w + 0.5 * h * a2
            a3 = acceleration(q + 0.5 * h * w2, w3, tau)
            w4 = w + h * a3
            a4 = acceleration(q + h * w3, w4, tau)
            q += h / 6.0 * (w + 2.0 * w2 + 2.0 * w3 + w4)
            w += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return out

"""Five systems unlike each other, recorded by somebody else, each with something that nobody told.

    pendulum      J q̈ + d q̇ + w sin q + f = τ                 f: cogging c sin(8 q), or drag c |q̇| q̇
    motor         J ω̇ + b ω + f = τ                           f: (c + s exp(−(ω / v)²)) sign ω (Stribeck)
    quarter car   m ẍ = −k (x − u) − d (ẋ − u̇) − f,            f: a dead-band spring c (x − u − clip(x − u, ±g)),
                  m_w ü = k (x − u) + d (ẋ − u̇) + f − k_t (u − r)     or a spring c (x − u)³
    two tanks     ḣ₁ = p − a √h₁ − f,  ḣ₂ = a √h₁ − b √h₂      f: overflow c max(h₁ − rim, 0), lost
    heater        C Ṫ = P − k (T − T_a) − f                    f: radiation c (T⁴ − T_a⁴)

Integrated by Runge-Kutta's method in steps far shorter than a sample. Noise is written nowhere but into the readings.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from messages.arrays import FloatArray

_STEPS = 10
"""Of integration in a sample."""
_LINES = 14
"""Sines of an input."""
_STICK = 0.01
"""Of a unit of velocity: within it dry friction changes its sign, so that steps meet it."""
NOISE_SHARE: Final = 2e-3
"""Of a reading's deviation: its noise."""
CLEAN: Final = "clean"

State = tuple[float, ...]
Rates = Callable[[State, float, Mapping[str, float]], State]


@dataclass(frozen=True)
class Recorded:
    """A recording: times (n,), the input held from each sample to the next (n,), readings with noise (n, c), and the
    noise's deviation (c,).
    """

    t_s: FloatArray
    input: FloatArray
    readings: FloatArray
    noise: FloatArray


@dataclass(frozen=True)
class _System:
    rate_hz: float
    seconds: float
    band_hz: tuple[float, float]
    mean: float
    rms: float
    start: State
    rates: Rates
    readings: Callable[[FloatArray], FloatArray]
    sizes: Mapping[str, Mapping[str, float]]  # by what is hidden: its constants


def _sign(v: float) -> float:
    return math.tanh(v / _STICK)


def _pendulum(x: State, u: float, c: Mapping[str, float]) -> State:
    q, w = x
    f = c.get("cogging", 0.0) * math.sin(8.0 * q) + c.get("drag", 0.0) * abs(w) * w
    return w, (u - 0.08 * w - 1.2 * math.sin(q) - f) / 0.05


def _motor(x: State, u: float, c: Mapping[str, float]) -> State:
    (w,) = x
    f = (c.get("coulomb", 0.0) + c.get("stribeck", 0.0) * math.exp(-((w / c.get("over", 1.0)) ** 2))) * _sign(w)
    return ((u - 0.02 * w - f) / 0.01,)


def _car(x: State, u: float, c: Mapping[str, float]) -> State:
    body, rate, wheel, wheel_rate = x
    travel, gap = body - wheel, c.get("gap", 1.0)
    f = c.get("dead_band", 0.0) * (travel - min(max(travel, -gap), gap)) + c.get("cubic", 0.0) * travel**3
    force = 16000.0 * travel + 1200.0 * (rate - wheel_rate) + f
    return rate, -force / 300.0, wheel_rate, (force - 160000.0 * (wheel - u)) / 40.0


def _tanks(x: State, u: float, c: Mapping[str, float]) -> State:
    upper, lower = max(x[0], 0.0), max(x[1], 0.0)
    passed = 0.05 * math.sqrt(upper)
    f = c.get("overflow", 0.0) * max(upper - c.get("rim", 0.0), 0.0)
    return max(u, 0.0) - passed - f, passed - 0.045 * math.sqrt(lower)


_AMBIENT_K = 293.0


def _heater(x: State, u: float, c: Mapping[str, float]) -> State:
    (t,) = x
    f = c.get("radiation", 0.0) * (t**4 - _AMBIENT_K**4)
    return ((u - 0.05 * (t - _AMBIENT_K) - f) / 8.0,)


SYSTEMS: Final[Mapping[str, _System]] = {
    "pendulum": _System(
        50.0, 24.0, (0.15, 2.5), 0.0, 0.35, (0.0, 0.0), _pendulum, lambda x: x[:, :1],
        {"cogging": {"cogging": 0.08}, "drag": {"drag": 0.012}},
    ),
    "motor": _System(
        50.0, 24.0, (0.1, 2.0), 0.0, 0.12, (0.0,), _motor, lambda x: x,
        {"stribeck": {"coulomb": 0.03, "stribeck": 0.03, "over": 0.6}},
    ),
    "quarter_car": _System(
        200.0, 6.0, (0.3, 8.0), 0.0, 0.02, (0.0, 0.0, 0.0, 0.0), _car,
        lambda x: np.column_stack((x[:, 0], x[:, 0] - x[:, 2])),
        {"dead_band": {"dead_band": 30000.0, "gap": 0.012}, "cubic": {"cubic": 3e7}},
    ),
    "two_tanks": _System(
        1.0, 1200.0, (0.0008, 0.02), 0.055, 0.025, (1.0, 1.0), _tanks, lambda x: x,
        {"overflow": {"overflow": 0.05, "rim": 1.6}},
    ),
    "heater": _System(
        1.0, 1200.0, (0.0008, 0.02), 9.0, 4.5, (_AMBIENT_K,), _heater, lambda x: x,
        {"radiation": {"radiation": 5e-10}},
    ),
}  # fmt: skip


def drawn(system: str, hidden: str, seed: int, *, seconds: float | None = None) -> Recorded:
    """Return a recording of a system in which `hidden` acts, or `CLEAN`; `seconds` long, by default as long as its
    motion asks for.
    """
    told = SYSTEMS[system]
    rng = np.random.default_rng(seed)
    n = round((seconds or told.seconds) * told.rate_hz)
    t_s = np.arange(n) / told.rate_hz
    f_hz = rng.uniform(*told.band_hz, _LINES)
    u = np.sin(2.0 * np.pi * np.outer(t_s, f_hz) + rng.uniform(0.0, 2.0 * np.pi, _LINES)).sum(axis=1)
    u = told.mean + told.rms * u / u.std()
    if told.mean:
        u = np.maximum(u, 0.0)
    true = told.readings(_path(told, u, told.sizes.get(hidden, {})))
    std = NOISE_SHARE * true.std(axis=0)
    return Recorded(t_s, u, true + std * rng.normal(size=true.shape), std)


def _path(system: _System, u: FloatArray, constants: Mapping[str, float]) -> FloatArray:
    """Return the states (n, s)."""
    h = 1.0 / system.rate_hz / _STEPS
    f, x = system.rates, system.start
    out = np.empty((len(u), len(x)))
    for k, held in enumerate(u.tolist()):
        out[k] = x
        for _ in range(_STEPS):
            k1 = f(x, held, constants)
            k2 = f(_moved(x, k1, 0.5 * h), held, constants)
            k3 = f(_moved(x, k2, 0.5 * h), held, constants)
            k4 = f(_moved(x, k3, h), held, constants)
            x = tuple(a + h / 6.0 * (b + 2.0 * (c + d) + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True))
    return out


def _moved(x: State, rates: State, h: float) -> State:
    return tuple(a + h * b for a, b in zip(x, rates, strict=True))

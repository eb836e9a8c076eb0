"""Five systems unlike each other, as somebody else builds and records them; something that nobody told may act in them.

    pendulum      J q̈ + d q̇ + w sin q = τ + f(joint)
    motor         J ω̇ + b ω = τ + f(shaft)
    quarter car   m ẍ = −k (x − u) − d (ẋ − u̇) − f(suspension),
                  m_w ü = k (x − u) + d (ẋ − u̇) + f(suspension) − k_t (u − r) − f(tyre)
    two tanks     ḣ₁ = p − a √h₁ + f(upper),  ḣ₂ = a √h₁ − b √h₂ + f(lower)
    heater        C Ṫ = P − k (T − T_a) + f(body)

Integrated by Runge-Kutta's method in steps far shorter than a sample. Noise is written nowhere but into the readings.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from lab.hidden.five.acting import Acting, Drive, Hidden
from messages.arrays import FloatArray

STEPS: Final = 10
"""Of integration in a sample."""
NOISE_SHARE: Final = 2e-3
"""Of a reading's deviation: its noise."""
_LINES = 14
"""Sines of an input."""
_SHIFT = 1e-3
"""Of a constant: by how much it is moved to see what it does."""

State = tuple[float, ...]
Constants = Mapping[str, float]
Rates = Callable[[State, float, Constants, Acting], State]


@dataclass(frozen=True)
class System:
    """A system: `rate_hz` and length of its recordings, the band and size of its input, where its `constants` and
    `start` put it, its states' `rates`, and what of the states is read, (n, s) to (n, c), under which `names`.
    """

    rate_hz: float
    seconds: float
    band_hz: tuple[float, float]
    mean: float
    rms: float
    start: State
    constants: Constants
    rates: Rates
    readings: Callable[[FloatArray], FloatArray]
    driven: str
    names: tuple[str, ...]


@dataclass(frozen=True)
class Recorded:
    """A recording: times (n,), the input held from each sample to the next (n,), readings with noise (n, c), the
    noise's deviation (c,), and `beyond`: by how much χ² of these readings would fall if a model that has the system's
    constants free, and nothing else, were told what is hidden.
    """

    t_s: FloatArray
    input: FloatArray
    readings: FloatArray
    noise: FloatArray
    beyond: float

    @property
    def noise_share(self) -> float:
        """Return the noise's share of the readings' deviation, RMS over the channels: the error of the true model."""
        return float(np.sqrt(np.mean((self.noise / self.readings.std(axis=0)) ** 2)))


def _pendulum(x: State, u: float, c: Constants, act: Acting) -> State:
    q, w = x
    return w, (u - c["damping"] * w - c["weight"] * math.sin(q) + act("joint", q, w, u)) / c["inertia"]


def _motor(x: State, u: float, c: Constants, act: Acting) -> State:
    (w,) = x
    return ((u - c["damping"] * w + act("shaft", w, u)) / c["inertia"],)


def _car(x: State, u: float, c: Constants, act: Acting) -> State:
    body, rate, wheel, wheel_rate = x
    travel, closing = body - wheel, rate - wheel_rate
    force = c["stiffness"] * travel + c["damping"] * closing - act("suspension", travel, closing)
    tyre = c["tyre"] * (wheel - u) - act("tyre", wheel - u)
    return rate, -force / 300.0, wheel_rate, (force - tyre) / 40.0


def _tanks(x: State, u: float, c: Constants, act: Acting) -> State:
    upper, lower = max(x[0], 0.0), max(x[1], 0.0)
    passed = c["upper_outlet"] * math.sqrt(upper)
    left = c["lower_outlet"] * math.sqrt(lower)
    return max(u, 0.0) - passed + act("upper", upper, u), passed - left + act("lower", lower, upper)


AMBIENT_K: Final = 293.0


def _heater(x: State, u: float, c: Constants, act: Acting) -> State:
    (t,) = x
    return ((u - c["conductance"] * (t - AMBIENT_K) + act("body", t, u)) / c["capacity"],)


SYSTEMS: Final[Mapping[str, System]] = {
    "pendulum": System(
        50.0, 24.0, (0.15, 2.5), 0.0, 0.35, (0.0, 0.0),
        {"inertia": 0.05, "damping": 0.08, "weight": 1.2},
        _pendulum, lambda x: x[:, :1], "torque_nm", ("angle_rad",),
    ),
    "motor": System(
        50.0, 24.0, (0.1, 2.0), 0.0, 0.12, (0.0,),
        {"inertia": 0.01, "damping": 0.02},
        _motor, lambda x: x, "torque_nm", ("speed_radps",),
    ),
    "quarter_car": System(
        200.0, 6.0, (0.3, 8.0), 0.0, 0.02, (0.0, 0.0, 0.0, 0.0),
        {"stiffness": 16000.0, "damping": 1200.0, "tyre": 160000.0},
        _car, lambda x: np.column_stack((x[:, 0], x[:, 0] - x[:, 2])), "road_m", ("body_m", "travel_m"),
    ),
    "two_tanks": System(
        1.0, 1200.0, (0.0008, 0.02), 0.055, 0.025, (1.0, 1.0),
        {"upper_outlet": 0.05, "lower_outlet": 0.045},
        _tanks, lambda x: x, "pump_mps", ("upper_m", "lower_m"),
    ),
    "heater": System(
        1.0, 1200.0, (0.0008, 0.02), 9.0, 4.5, (AMBIENT_K,),
        {"capacity": 8.0, "conductance": 0.05},
        _heater, lambda x: x, "power_w", ("temperature_k",),
    ),
}  # fmt: skip


def drawn(
    name: str, hidden: Hidden, motion: np.random.Generator, noise: np.random.Generator, *, seconds: float | None = None
) -> Recorded:
    """Return a recording of a system in which `hidden` acts, its input drawn by `motion` and its noise by `noise`;
    `seconds` long, by default as long as its motion asks for.
    """
    told = SYSTEMS[name] if seconds is None else replace(SYSTEMS[name], seconds=seconds)
    t_s = np.arange(round(told.seconds * told.rate_hz)) / told.rate_hz
    drive = _drive(told, motion)
    true = _read(told, told.constants, hidden, drive, t_s)
    std = NOISE_SHARE * true.std(axis=0)
    readings = hidden.written(true + std * noise.normal(size=true.shape))
    return Recorded(t_s, drive(t_s), readings, std, _beyond(told, hidden.written(true), drive, t_s, std))


def _drive(system: System, rng: np.random.Generator) -> Drive:
    """Return the input as a function of time, of the system's mean and size."""
    f_hz = rng.uniform(*system.band_hz, _LINES)
    phase = rng.uniform(0.0, 2.0 * np.pi, _LINES)
    size = system.rms / math.sqrt(_LINES / 2.0)

    def drive(t_s: FloatArray) -> FloatArray:
        u = system.mean + size * np.sin(2.0 * np.pi * np.multiply.outer(t_s, f_hz) + phase).sum(axis=-1)
        return np.maximum(u, 0.0) if system.mean else np.asarray(u)

    return drive


def _read(system: System, constants: Constants, hidden: Hidden, drive: Drive, t_s: FloatArray) -> FloatArray:
    """Return what is read (n, c) but for its noise."""
    fine_s = (t_s[:, None] + np.arange(STEPS) / (STEPS * system.rate_hz)).ravel()
    driven = hidden.driven(drive, t_s, STEPS).ravel()
    path = system.readings(_path(system, constants, hidden, driven))
    return hidden.read(CubicSpline(fine_s, path), fine_s, t_s)


def _path(system: System, constants: Constants, hidden: Hidden, driven: FloatArray) -> FloatArray:
    """Return the states (n · STEPS, s) under an input held for each step."""
    h = 1.0 / system.rate_hz / STEPS
    act, own, x = Acting(hidden), hidden.own, system.start
    states = len(x)
    x = (*x, *([0.0] * own))
    out = np.empty((len(driven), states))

    def f(x: State, u: float) -> State:
        act.own = x[states:]
        rates = system.rates(x[:states], u, constants, act)
        return (*rates, *act.own_rates) if own else rates

    for k, u in enumerate(driven.tolist()):
        out[k] = x[:states]
        k1 = f(x, u)
        k2 = f(_moved(x, k1, 0.5 * h), u)
        k3 = f(_moved(x, k2, 0.5 * h), u)
        k4 = f(_moved(x, k3, h), u)
        x = tuple(a + h / 6.0 * (b + 2.0 * (c + d) + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True))
    return out


def _moved(x: State, rates: State, h: float) -> State:
    return tuple(a + h * b for a, b in zip(x, rates, strict=True))


def _beyond(system: System, true: FloatArray, drive: Drive, t_s: FloatArray, std: FloatArray) -> float:
    """Return ‖r‖² less what the constants' columns explain of r, what is hidden changes of the readings, in noises."""
    clean = _read(system, system.constants, Hidden(), drive, t_s)
    left = ((true - clean) / std).ravel()
    if not left.any():
        return 0.0
    columns = []
    for key, value in system.constants.items():
        moved = _read(system, {**system.constants, key: value * (1.0 + _SHIFT)}, Hidden(), drive, t_s)
        columns.append(((moved - clean) / std).ravel() / _SHIFT)
    solved, *_ = np.linalg.lstsq(np.array(columns).T, left, rcond=None)
    rest = left - np.array(columns).T @ solved
    return float(rest @ rest)

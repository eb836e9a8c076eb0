"""What each of the five systems can hide, in which sizes: what a library may name, and what none does.

Sizes are stated before anything is judged; the smallest leave next to nothing to be found, and are not scored then.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from lab.hidden.case import Sizes, log_uniform, sign
from lab.hidden.five.mechanisms import (
    Makes,
    Told,
    at,
    cogging,
    constant,
    coulomb,
    coupled,
    cubic_spring,
    dead_band,
    dead_band_spring,
    drag,
    drift,
    driven,
    driven_late,
    driven_slowly,
    gain,
    hysteresis,
    late,
    leak,
    lower_stop,
    offset,
    plain,
    play,
    read,
    read_slowly,
    read_with_time,
    rounded,
    saturation,
    slow_clock,
    stribeck,
    tone,
    upper_stop,
)
from lab.hidden.five.systems import AMBIENT_K

Draws = Callable[[np.random.Generator, float], Told]
"""From a random stream and the size: all constants."""


@dataclass(frozen=True)
class Mechanism:
    """Something that may be hidden: the range of its size, what else is drawn, and how it acts."""

    sizes: Sizes
    draws: Draws
    makes: Makes


def _value(key: str, *, either: bool = False) -> Draws:
    return lambda rng, size: {key: size * (sign(rng) if either else 1.0)}


def _with(key: str, **ranges: tuple[float, float]) -> Draws:
    """Return what draws the size under `key`, and each of `ranges` log-uniformly."""
    return lambda rng, size: {key: size, **{name: log_uniform(rng, *ends) for name, ends in ranges.items()}}


def _wave(rng: np.random.Generator, size: float) -> dict[str, float]:
    phase = rng.uniform(0.0, 2.0 * math.pi)
    return {"sine": size * math.cos(phase), "cosine": size * math.sin(phase)}


def _cogs(rng: np.random.Generator, size: float) -> Told:
    return {**_wave(rng, size), "periods": int(rng.integers(4, 17)) / (2.0 * math.pi)}


def _hum(low_hz: float, high_hz: float) -> Draws:
    return lambda rng, size: {**_wave(rng, size), "hz": log_uniform(rng, low_hz, high_hz)}


def _reading(
    name: str, channel: int, unit: str, deviation: float, seconds: float, step_s: float, mean: float = 0.0
) -> dict[str, Mechanism]:
    """Return what may be wrong with a reading of about that deviation."""
    of = f"_of_{name}"
    return {
        f"delay{of}": Mechanism(Sizes(0.1 * step_s, 4.0 * step_s, "s"), _value("value"), read_with_time(channel, late)),
        f"lag{of}": Mechanism(Sizes(0.2 * step_s, 5.0 * step_s, "s"), _value("value"), read_slowly(channel)),
        f"offset{of}": Mechanism(
            Sizes(2e-2 * deviation, 0.4 * deviation, unit), _value("value", either=True), read(channel, offset)
        ),
        f"drift{of}": Mechanism(
            Sizes(0.02 * deviation / seconds, deviation / seconds, f"{unit}/s"),
            _value("rate", either=True),
            read_with_time(channel, drift),
        ),
        f"clock_drift{of}": Mechanism(
            Sizes(0.3 * step_s / seconds, 6.0 * step_s / seconds, "s/s"),
            _value("rate"),
            read_with_time(channel, slow_clock),
        ),
        f"tone{of}": Mechanism(
            Sizes(5e-3 * deviation, 0.1 * deviation, unit),
            _hum(0.06 / step_s, 0.3 / step_s),
            read_with_time(channel, tone),
        ),
        f"saturation{of}": Mechanism(
            Sizes(mean + 0.9 * deviation, mean + 1.6 * deviation, unit), _value("upper"), read(channel, saturation)
        ),
        f"play{of}": Mechanism(Sizes(0.02 * deviation, 0.3 * deviation, unit), _value("width"), read(channel, play)),
        f"quantisation{of}": Mechanism(
            Sizes(0.03 * deviation, 0.2 * deviation, unit), _value("step"), rounded(channel)
        ),
    }


def _input(name: str, unit: str, deviation: float, mean: float = 0.0) -> dict[str, Mechanism]:
    """Return what may be wrong with an input of about that deviation; delays and lags of it are those of readings."""
    return {
        f"saturation_of_{name}": Mechanism(
            Sizes(mean + 0.9 * deviation, mean + 1.6 * deviation, unit), _value("upper"), driven(saturation)
        ),
        f"play_of_{name}": Mechanism(Sizes(0.05 * deviation, 0.6 * deviation, unit), _value("width"), driven(play)),
        f"offset_of_{name}": Mechanism(
            Sizes(0.02 * deviation, 0.3 * deviation, unit), _value("value", either=True), driven(offset)
        ),
    }


def _dead_band(name: str, unit: str, deviation: float) -> dict[str, Mechanism]:
    return {
        f"dead_band_of_{name}": Mechanism(
            Sizes(0.05 * deviation, 0.6 * deviation, unit), _value("half_width"), driven(dead_band)
        )
    }


def _delay(name: str, step_s: float) -> dict[str, Mechanism]:
    return {f"delay_of_{name}": Mechanism(Sizes(0.2 * step_s, 4.0 * step_s, "s"), _value("value"), driven_late)}


def _lag(name: str, low_s: float, high_s: float) -> dict[str, Mechanism]:
    return {f"lag_of_{name}": Mechanism(Sizes(low_s, high_s, "s"), _value("value"), driven_slowly)}


NAMED: Final[Mapping[str, Mapping[str, Mechanism]]] = {
    "pendulum": {
        "coulomb_friction_at_joint": Mechanism(Sizes(3e-3, 6e-2, "N·m"), _value("value"), at("joint", coulomb(1))),
        "stribeck_friction_at_joint": Mechanism(
            Sizes(2e-2, 0.1, "N·m"), _with("value", fades_at=(0.3, 1.2)), at("joint", stribeck(1))
        ),
        "quadratic_drag_at_joint": Mechanism(Sizes(1e-3, 3e-2, "N·m·s²"), _value("value"), at("joint", drag(1))),
        "hysteresis_at_joint": Mechanism(
            Sizes(2e-2, 0.15, "N·m"), _with("value", within=(0.05, 0.3)), at("joint", hysteresis(1), own=1)
        ),
        "cubic_spring_at_joint": Mechanism(
            Sizes(2e-2, 0.6, "N·m/rad³"), _value("value"), at("joint", cubic_spring(0))
        ),
        "dead_band_spring_at_joint": Mechanism(
            Sizes(0.1, 1.5, "N·m/rad"), _with("value", gap=(0.15, 0.4)), at("joint", dead_band_spring(0))
        ),
        "upper_stop_at_joint": Mechanism(
            Sizes(1.0, 8.0, "N·m/rad"), _with("stiffness", limit=(0.3, 0.5)), at("joint", upper_stop(0))
        ),
        "cogging_at_joint": Mechanism(Sizes(5e-3, 0.1, "N·m"), _cogs, at("joint", cogging(0))),
        **_input("torque_nm", "N·m", 0.36),
        **_dead_band("torque_nm", "N·m", 0.36),
        **_delay("torque_nm", 0.02),
        **_reading("angle_rad", 0, "rad", 0.35, 24.0, 0.02),
        "gain_of_angle_rad": Mechanism(Sizes(1e-2, 0.2, "1"), _value("share"), read(0, gain)),
    },
    "motor": {
        "coulomb_friction_at_shaft": Mechanism(Sizes(1e-3, 2e-2, "N·m"), _value("value"), at("shaft", coulomb(0))),
        "stribeck_friction_at_shaft": Mechanism(
            Sizes(1e-2, 4e-2, "N·m"), _with("value", fades_at=(0.4, 1.5)), at("shaft", stribeck(0))
        ),
        "quadratic_drag_at_shaft": Mechanism(Sizes(2e-4, 4e-3, "N·m·s²"), _value("value"), at("shaft", drag(0))),
        **_input("torque_nm", "N·m", 0.12),
        **_dead_band("torque_nm", "N·m", 0.12),
        **_delay("torque_nm", 0.02),
        **_reading("speed_radps", 0, "radps", 2.5, 24.0, 0.02),
    },
    "quarter_car": {
        "coulomb_friction_at_suspension": Mechanism(
            Sizes(5.0, 100.0, "N"), _value("value"), at("suspension", coulomb(1))
        ),
        "quadratic_drag_at_suspension": Mechanism(
            Sizes(30.0, 600.0, "N/(m/s)²"), _value("value"), at("suspension", drag(1))
        ),
        "cubic_spring_at_suspension": Mechanism(
            Sizes(1e6, 3e7, "N/m³"), _value("value"), at("suspension", cubic_spring(0))
        ),
        "dead_band_spring_at_suspension": Mechanism(
            Sizes(3e3, 6e4, "N/m"), _with("value", gap=(8e-3, 3e-2)), at("suspension", dead_band_spring(0))
        ),
        "upper_stop_at_suspension": Mechanism(
            Sizes(2e4, 2e5, "N/m"), _with("stiffness", limit=(2e-2, 4e-2)), at("suspension", upper_stop(0))
        ),
        "lower_stop_at_suspension": Mechanism(
            Sizes(2e4, 2e5, "N/m"),
            lambda rng, size: {"stiffness": size, "limit": -log_uniform(rng, 2e-2, 4e-2)},
            at("suspension", lower_stop(0)),
        ),
        "hysteresis_at_suspension": Mechanism(
            Sizes(20.0, 200.0, "N"), _with("value", within=(2e-3, 1e-2)), at("suspension", hysteresis(1), own=1)
        ),
        "cubic_spring_at_tyre": Mechanism(
            Sizes(2e8, 3e9, "N/m³"), _value("value"), at("tyre", cubic_spring(0))
        ),
        **_input("road_m", "m", 0.02),
        **_reading("body_m", 0, "m", 0.013, 6.0, 0.005),
        "cross_coupling_of_body_m": Mechanism(
            Sizes(5e-3, 0.1, "1"), _value("from_travel_m", either=True), coupled(0, 1, "from_travel_m")
        ),
        "gain_of_travel_m": Mechanism(Sizes(1e-2, 0.2, "1"), _value("share"), read(1, gain)),
        "delay_of_travel_m": Mechanism(
            Sizes(5e-4, 2e-2, "s"), _value("value"), read_with_time(1, late)
        ),
    },
    "two_tanks": {
        "overflow_at_upper": Mechanism(
            Sizes(5e-3, 5e-2, "1/s"), _with("stiffness", limit=(1.2, 1.7)), at("upper", upper_stop(0))
        ),
        "overflow_at_lower": Mechanism(
            Sizes(5e-3, 5e-2, "1/s"), _with("stiffness", limit=(1.1, 1.5)), at("lower", upper_stop(0))
        ),
        "leak_at_upper": Mechanism(Sizes(4e-4, 8e-3, "1/s"), _value("value"), at("upper", leak(0))),
        "leak_at_lower": Mechanism(Sizes(4e-4, 8e-3, "1/s"), _value("value"), at("lower", leak(0))),
        "constant_at_lower": Mechanism(
            Sizes(3e-4, 6e-3, "m/s"), _value("value", either=True), at("lower", constant())
        ),
        **_input("pump_mps", "mps", 0.025, mean=0.055),
        **_delay("pump_mps", 1.0),
        **_lag("pump_mps", 1.0, 20.0),
        **_reading("upper_m", 0, "m", 0.47, 1200.0, 1.0, mean=1.3),
        "gain_of_lower_m": Mechanism(Sizes(1e-2, 0.2, "1"), _value("share"), read(1, gain)),
        "delay_of_lower_m": Mechanism(Sizes(0.5, 10.0, "s"), _value("value"), read_with_time(1, late)),
    },
    "heater": {
        "constant_at_body": Mechanism(Sizes(2e-2, 0.8, "W"), _value("value", either=True), at("body", constant())),
        **_input("power_w", "w", 4.5, mean=9.0),
        **_delay("power_w", 1.0),
        **_lag("power_w", 1.0, 20.0),
        **_reading("temperature_k", 0, "k", 45.0, 1200.0, 1.0, mean=420.0),
    },
}  # fmt: skip
"""By system and by the name in a library of generic effects."""

OUTSIDE: Final[Mapping[str, Mapping[str, Mechanism]]] = {
    "pendulum": {
        "drag_of_power_three_halves": Mechanism(
            Sizes(3e-3, 5e-2, "N·m"),
            _value("c"),
            at("joint", plain(lambda s, p: -p["c"] * math.copysign(abs(s[1]) ** 1.5, s[1]))),
        ),
        "torque_by_angle": Mechanism(
            Sizes(3e-2, 0.5, "1"), _value("c"), at("joint", plain(lambda s, p: -p["c"] * s[2] * (1.0 - math.cos(s[0]))))
        ),
        "one_sided_quadratic_spring": Mechanism(
            Sizes(0.2, 4.0, "N·m/rad²"), _value("c"), at("joint", plain(lambda s, p: -p["c"] * max(s[0], 0.0) ** 2))
        ),
        "damping_by_angle": Mechanism(
            Sizes(3e-2, 0.6, "N·m·s"), _value("c"), at("joint", plain(lambda s, p: -p["c"] * s[1] * s[0] ** 2))
        ),
    },
    "motor": {
        "drag_of_power_three_halves": Mechanism(
            Sizes(5e-4, 1e-2, "N·m"),
            _value("c"),
            at("shaft", plain(lambda s, p: -p["c"] * math.copysign(abs(s[0]) ** 1.5, s[0]))),
        ),
        "torque_by_speed": Mechanism(
            Sizes(5e-3, 6e-2, "s/rad"), _value("c"), at("shaft", plain(lambda s, p: -p["c"] * s[1] * abs(s[0])))
        ),
        "cubed_speed": Mechanism(
            Sizes(3e-5, 8e-4, "N·m·s³"), _value("c"), at("shaft", plain(lambda s, p: -p["c"] * s[0] ** 3))
        ),
        "eddy_brake": Mechanism(
            Sizes(1e-2, 8e-2, "N·m"),
            _value("c"),
            at("shaft", plain(lambda s, p: -2.0 * p["c"] * (s[0] / 1.5) / (1.0 + (s[0] / 1.5) ** 2))),
        ),
    },
    "quarter_car": {
        "harder_rebound": Mechanism(
            Sizes(60.0, 1200.0, "N·s/m"), _value("c"), at("suspension", plain(lambda s, p: -p["c"] * max(s[1], 0.0)))
        ),
        "progressive_spring": Mechanism(
            Sizes(1e5, 2e6, "N/m²"),
            _value("c"),
            at("suspension", plain(lambda s, p: -p["c"] * s[0] * abs(s[0]))),
        ),
        "damping_by_travel": Mechanism(
            Sizes(2e5, 4e6, "N·s/m³"), _value("c"), at("suspension", plain(lambda s, p: -p["c"] * s[1] * s[0] ** 2))
        ),
        "tyre_leaves_the_road": Mechanism(
            Sizes(0.2, 0.9, "1"), _value("c"), at("tyre", plain(lambda s, p: p["c"] * 160000.0 * max(s[0] - 5e-3, 0.0)))
        ),
    },
    "two_tanks": {
        "weir": Mechanism(
            Sizes(5e-3, 6e-2, "√(1/m)/s"),
            _value("c"),
            at("upper", plain(lambda s, p: -p["c"] * max(s[0] - 1.2, 0.0) ** 1.5)),
        ),
        "submerged_outlet": Mechanism(
            Sizes(1e-3, 2e-2, "1/s"), _value("c"), at("lower", plain(lambda s, p: -p["c"] * s[0] * s[1]))
        ),
        "square_loss": Mechanism(
            Sizes(5e-4, 1e-2, "1/(m·s)"), _value("c"), at("upper", plain(lambda s, p: -p["c"] * s[0] ** 2))
        ),
    },
    "heater": {
        "radiation": Mechanism(
            Sizes(3e-11, 8e-10, "W/K⁴"),
            _value("c"),
            at("body", plain(lambda s, p: -p["c"] * (s[0] ** 4 - AMBIENT_K**4))),
        ),
        "convection": Mechanism(
            Sizes(1e-3, 2e-2, "W/K^1.25"),
            _value("c"),
            at("body", plain(lambda s, p: -p["c"] * max(s[0] - AMBIENT_K, 0.0) ** 1.25)),
        ),
        "power_fades": Mechanism(
            Sizes(2e-4, 2e-3, "1/K"), _value("c"), at("body", plain(lambda s, p: -p["c"] * s[1] * (s[0] - AMBIENT_K)))
        ),
    },
}  # fmt: skip
"""Likewise; by names that no library has."""


def mechanisms(system: str) -> dict[str, Mechanism]:
    """Return all that a system can hide, by name."""
    return {**NAMED[system], **OUTSIDE[system]}


def _with_port(port: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{name}_at_{port}" for name in names)


_DRY = ("coulomb_friction", "stribeck_friction", "asymmetric_friction", "hysteresis")
_BENT = ("cubic_spring", "dead_band_spring", "upper_stop", "lower_stop")
LOOK_ALIKES: Final[Mapping[str, tuple[tuple[str, ...], ...]]] = {
    "pendulum": (
        (*_with_port("joint", *_DRY), "play_of_torque_nm", "dead_band_of_torque_nm"),
        (*_with_port("joint", *_BENT), "curve_of_angle_rad"),
    ),
    "motor": (
        (*_with_port("shaft", *_DRY[:3]), "dead_band_of_torque_nm", "play_of_torque_nm"),
        ("quadratic_drag_at_shaft", "curve_of_speed_radps"),
    ),
    "quarter_car": (
        _with_port("suspension", *_DRY),
        _with_port("suspension", *_BENT),
        _with_port("tyre", *_BENT, "cogging"),
    ),
    "two_tanks": (
        ("leak_at_upper", "constant_at_upper", "offset_of_pump_mps", "gain_of_upper_m", "offset_of_upper_m"),
        ("leak_at_lower", "constant_at_lower", "gain_of_lower_m", "offset_of_lower_m"),
    ),
    "heater": (
        (
            "constant_at_body",
            "leak_at_body",
            "offset_of_power_w",
            "offset_of_temperature_k",
            "gain_of_temperature_k",
            "curve_of_temperature_k",
        ),
    ),
}
"""Effects that imitate each other where one of them is missing."""

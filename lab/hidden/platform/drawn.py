"""What can be hidden in a platform recording, how large it is drawn, and which parameters tell it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from lab.hidden.case import Sizes, log_uniform, sign
from lab.hidden.platform.outside import at_sensor, wobbling
from messages.arrays import FloatArray
from sim_rig.platform.extended.flaws import CHANNELS, Fields
from sim_rig.platform.extended.laboratory import Reference

_AXES: Final = ("z", "x")


SIZES: Final[Mapping[str, Sizes]] = {
    "force_delay": Sizes(1e-4, 5e-3, "s"),
    "force_lag": Sizes(1e-4, 5e-3, "s"),
    "motion_smoothing": Sizes(30.0, 60.0, "Hz"),
    "aliasing": Sizes(28.0, 70.0, "Hz"),
    "force_gain": Sizes(0.003, 0.1, "1"),
    "crosstalk": Sizes(0.003, 0.05, "1"),
    "reference_height": Sizes(0.005, 0.03, "m"),
    "plate_rotation": Sizes(float(np.deg2rad(0.2)), float(np.deg2rad(5.0)), "rad"),
    "foot_marker_offset": Sizes(0.002, 0.02, "m"),
    "joint_offset": Sizes(0.002, 0.015, "m"),
    "parallel_spring": Sizes(30.0, 1000.0, "N·m/rad"),
    "parallel_damping": Sizes(0.5, 20.0, "N·m·s/rad"),
    "coulomb_friction": Sizes(0.2, 5.0, "N·m"),
    "hidden_mass": Sizes(0.1, 1.0, "kg"),
    "backlash": Sizes(0.05, 0.4, "of the channel's deviation"),
    "tape_compliance": Sizes(30.0, 150.0, "Hz"),
    "tare_error": Sizes(0.5, 10.0, "N or 0.2 N·m"),
    "clock_drift": Sizes(2e-5, 1e-3, "1"),
    "saturation": Sizes(0.4, 0.85, "of the largest reading"),
    "quantisation": Sizes(6.0, 25.0, "N or 0.25 N·m"),
    "dropped_samples": Sizes(0.003, 0.1, "of all samples"),
    "position_scale": Sizes(0.002, 0.03, "1"),
    "mains_hum": Sizes(0.05, 0.3, "of the channel"),
    "warming_gain": Sizes(0.03, 0.15, "per minute"),
    "creep": Sizes(0.02, 0.1, "1"),
    "knocking_foot": Sizes(0.05, 0.3, "of the channel's deviation"),
    "cubic_gain": Sizes(0.03, 0.15, "at two deviations"),
    "marker_wobble": Sizes(25.0, 45.0, "Hz"),
    "stamp_jitter": Sizes(3e-4, 1.5e-3, "s"),
    "product_crosstalk": Sizes(0.02, 0.15, "of the channel's deviation"),
}
EFFECTS: Final = tuple(SIZES)[:22]
OUTSIDE: Final = tuple(SIZES)[22:]
"""Hum of 50 Hz that grows with the force, gain that follows temperature, creep of the load cells, a loose foot that
knocks at each reversal, a cubic gain, plate markers on a springy mast, jittering stamps, and a channel that shows the
product of two others."""
NEEDS_FOOT: Final = ("tape_compliance", "foot_marker_offset", "knocking_foot")
NEEDS_KNOWN_PLATE: Final = ("hidden_mass", "quantisation")
"""A rigid mass is what a body's unknown inertia says anyway. Rounding shows below a foot's forces only where it is
coarser than what the noise of the angles makes of them."""
_TOLD_BY: Final = ("fx", "fy", "fz", "tx", "tz")
"""The plate hardly turns about y: no recording tells what is wrong with a moment of a few tenths of a newton metre."""

Parameters = Mapping[str, float]


@dataclass(frozen=True)
class Drawn:
    """What hides one effect: the fields of `Flaws` that it sets, and its parameters as a verdict names them.

    `by_scale` gives both where they scale with the channels of the fit recording, which are known once that has run.
    """

    fields: Fields
    parameters: Parameters
    by_scale: Callable[[Reference], "Drawn"] | None = None

    def scaled(self, reference: Reference) -> "Drawn":
        """Return it for a fit recording whose channels are as large as `reference` says."""
        return self if self.by_scale is None else self.by_scale(reference)


Draw = Callable[[float, np.random.Generator], Drawn]
"""From an effect's size to what hides it."""


def drawn(effect: str, size: float, random: np.random.Generator) -> Drawn:
    """Return what hides `effect` of a drawn `size`."""
    if effect == "marker_wobble":
        return Drawn({"at_markers": partial(wobbling, size)}, {})
    if effect in OUTSIDE:
        return Drawn({}, {}, lambda reference: Drawn({"at_sensor": at_sensor(effect, size, reference.scale)}, {}))
    return _DRAWS[effect](size, random)


def _channel(random: np.random.Generator, among: tuple[str, ...] = _TOLD_BY) -> str:
    return str(random.choice(among))


def _signed(field_name: str, parameter: str) -> Draw:
    def draw(size: float, random: np.random.Generator) -> Drawn:
        value = sign(random) * size
        return Drawn({field_name: value}, {parameter: value})

    return draw


def _plain(field_name: str, parameter: str) -> Draw:
    return lambda size, _: Drawn({field_name: size}, {parameter: size})


def _gain(size: float, random: np.random.Generator) -> Drawn:
    name, value = _channel(random), sign(random) * size
    matrix = np.eye(6)
    matrix[CHANNELS.index(name), CHANNELS.index(name)] += value
    return Drawn({"matrix": matrix}, {name: value})


def _crosstalk(size: float, random: np.random.Generator) -> Drawn:
    of, source = (str(name) for name in random.choice(_TOLD_BY, 2, replace=False))
    value = sign(random) * size
    matrix = np.eye(6)
    matrix[CHANNELS.index(of), CHANNELS.index(source)] += value
    return Drawn({"matrix": matrix}, {f"{of}_from_{source}": value})


def _along(field_name: str, unit: str) -> Draw:
    def draw(size: float, random: np.random.Generator) -> Drawn:
        axis, value = int(random.integers(3)), sign(random) * size
        vector = np.zeros(3)
        vector[axis] = value
        return Drawn({field_name: vector}, {f"{'xyz'[axis]}_{unit}": value})

    return draw


def _strap(field_name: str, unit: str) -> Draw:
    def draw(size: float, random: np.random.Generator) -> Drawn:
        axes = [(0,), (1,), (0, 1)][int(random.integers(3))]
        values = np.zeros(2)
        values[axes[0]] = size
        if len(axes) == 2:
            values[1] = size * random.uniform(0.5, 1.0)
        return Drawn({field_name: values}, {f"{_AXES[axis]}_{unit}": float(values[axis]) for axis in axes})

    return draw


def _mass(size: float, random: np.random.Generator) -> Drawn:
    place = random.uniform((-0.2, -0.05, -0.12), (0.2, 0.1, 0.12))
    told = dict(zip(("x_m", "y_m", "z_m"), place.tolist(), strict=True))
    return Drawn({"masses": ((size, place),)}, {"mass_kg": size, **told})


def _play(size: float, random: np.random.Generator) -> Drawn:
    name = _channel(random, ("fx", "fz", "tx", "tz"))
    return _share(name, "play", lambda reference: size * reference.deviation)


def _limit(size: float, random: np.random.Generator) -> Drawn:
    name = _channel(random, ("fx", "fz", "tx", "tz"))
    return _share(name, "limit", lambda reference: size * reference.largest)


def _share(name: str, field_name: str, sizes: Callable[[Reference], FloatArray]) -> Drawn:
    """Return a flaw of one channel whose size is a share of what the fit recording shows there."""
    channel = CHANNELS.index(name)

    def by_scale(reference: Reference) -> Drawn:
        size = float(sizes(reference)[channel])
        return Drawn({field_name: (channel, size)}, {name: size})

    return Drawn({}, {}, by_scale)


def _tape(size: float, random: np.random.Generator) -> Drawn:
    which = int(random.integers(3))
    other = float(np.clip(size * log_uniform(random, 0.7, 1.4), 30.0, 150.0))
    hz = ((size, np.inf), (np.inf, size), (size, other))[which]
    zeta = log_uniform(random, 0.03, 0.15)
    told = {f"{axis}_hz": value for axis, value in zip(_AXES, hz, strict=True) if np.isfinite(value)}
    return Drawn({"tape_hz": hz, "tape_zeta": zeta, "tape_seen": float(random.integers(2))}, told)


def _tare(size: float, random: np.random.Generator) -> Drawn:
    name, value = _channel(random, CHANNELS), sign(random) * size
    tare = np.zeros(6)
    tare[CHANNELS.index(name)] = value if name[0] == "f" else 0.2 * value
    return Drawn({"tare": tare}, {name: float(tare[CHANNELS.index(name)])})


def _rounding(size: float, random: np.random.Generator) -> Drawn:
    which = int(random.integers(3))
    step = ((size, 0.0), (0.0, 0.25 * size), (size, 0.25 * size))[which]
    told = {name: value for name, value in zip(("force_n", "torque_nm"), step, strict=True) if value > 0.0}
    return Drawn({"step": step}, told)


_DRAWS: Final[Mapping[str, Draw]] = {
    "force_delay": _signed("delay_s", "value_s"),
    "force_lag": _plain("lag_s", "value_s"),
    "motion_smoothing": _plain("smoothing_hz", "value_hz"),
    "aliasing": lambda size, _: Drawn({"jumps": True}, {"update_hz": size}),
    "force_gain": _gain,
    "crosstalk": _crosstalk,
    "reference_height": _signed("height_m", "value_m"),
    "plate_rotation": _along("turn_rad", "rad"),
    "foot_marker_offset": _along("foot_marker_m", "m"),
    "joint_offset": _along("joint_m", "m"),
    "parallel_spring": _strap("spring_nmprad", "nmprad"),
    "parallel_damping": _strap("damper_nmsprad", "nmsprad"),
    "coulomb_friction": _strap("friction_nm", "nm"),
    "hidden_mass": _mass,
    "backlash": _play,
    "tape_compliance": _tape,
    "tare_error": _tare,
    "clock_drift": _signed("drift", "rate"),
    "saturation": _limit,
    "quantisation": _rounding,
    "dropped_samples": lambda size, _: Drawn({"lost_share": size}, {"held": 1.0}),
    "position_scale": _signed("position_scale", "value"),
}

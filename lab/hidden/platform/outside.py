"""Mechanisms that no library of the platform has: the finder must say that it does not know them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from messages.arrays import FloatArray
from sim_rig.platform.extended.flaws import SensorChange
from sim_rig.platform.rig import MOTION_HZ
from sim_rig.platform.run import STEP_S

_MAINS_HZ: Final = 50.0
_CREEP_S: Final = 0.4
_WOBBLE_ZETA: Final = 0.05
_KNOCK_S: Final = 0.004
_BENT_CHANNELS: Final = np.array([1.0, 0.0, 1.0, 1.0, 0.0, 1.0])


@dataclass(frozen=True)
class _Load:
    """A tared wrench (6, n) at `t_s` (n,), 3500 a second, and how large (6, 1) those of the fit recording are."""

    t_s: FloatArray
    wrench: FloatArray
    scale: FloatArray


def at_sensor(name: str, size: float, scale: FloatArray) -> SensorChange:
    """Return what the mechanism does to a wrench whose channels are as large as `scale` (6,) in the fit recording."""

    def changed(t_s: FloatArray, wrench: FloatArray, random: np.random.Generator) -> FloatArray:
        return wrench + _AT_SENSOR[name](size, _Load(t_s, wrench, scale[:, None]), random)

    return changed


def wobbling(size: float, poses: FloatArray) -> FloatArray:
    """Return poses (6, n) at 350 Hz of markers on a springy mast: the plate's angles ring at `size` Hz."""
    w = 2.0 * MOTION_HZ * np.tan(np.pi * size / MOTION_HZ)
    k, d = 4.0 * MOTION_HZ**2, 4.0 * MOTION_HZ * _WOBBLE_ZETA * w
    denominator = [k + d + w**2, 2.0 * (w**2 - k), k - d + w**2]
    changed: FloatArray = poses.copy()
    level = poses[4:, :1]
    changed[4:] = level + lfilter([d + w**2, 2.0 * w**2, w**2 - d], denominator, poses[4:] - level, axis=1)
    return changed


def _hum(size: float, load: _Load, random: np.random.Generator) -> FloatArray:
    """Hum of the mains that grows with the load of the channel."""
    phase = random.uniform(0.0, 2.0 * np.pi)
    hum: FloatArray = size * load.wrench * np.sin(2.0 * np.pi * _MAINS_HZ * load.t_s + phase)
    return hum


def _warming(size: float, load: _Load, _: np.random.Generator) -> FloatArray:
    """Gain of all channels that follows the amplifier's temperature, in one direction."""
    return size * load.wrench * (load.t_s / 60.0)


def _creep(size: float, load: _Load, _: np.random.Generator) -> FloatArray:
    """Load cells that give way slowly under load."""
    decay = np.exp(-STEP_S / _CREEP_S)
    crept: FloatArray = lfilter([size * (1.0 - decay)], [1.0, -decay], load.wrench, axis=1)
    return crept


def _knocks(size: float, load: _Load, _: np.random.Generator) -> FloatArray:
    """A foot that is loose and knocks against the plate whenever the force along x turns round."""
    turned = np.zeros(len(load.t_s))
    turned[1:] = (np.sign(load.wrench[0, 1:]) - np.sign(load.wrench[0, :-1])) / 2.0
    ring = np.exp(-np.arange(round(8 * _KNOCK_S / STEP_S)) * STEP_S / _KNOCK_S)
    knock = np.convolve(turned, ring)[: len(load.t_s)]
    return 4.0 * size * load.scale * np.outer(np.array([1.0, 0.3, 0.0, 0.0, 0.2, 0.7]), knock)


def _cubic(size: float, load: _Load, _: np.random.Generator) -> FloatArray:
    """Bridges that are not linear, their sensitivity right on average at the working amplitude; fy and ty are sound."""
    unit = load.wrench / load.scale
    bent: FloatArray = _BENT_CHANNELS[:, None] * size * load.scale * (unit**3 - 3.0 * unit) / 2.0
    return bent


def _jitter(size: float, load: _Load, random: np.random.Generator) -> FloatArray:
    """Samples taken at times that scatter about their stamps, slowly changing over some milliseconds."""
    knots = np.arange(load.t_s[0], load.t_s[-1] + 0.03, 0.01)
    off_s = CubicSpline(knots, size * random.standard_normal(len(knots)))(load.t_s)
    moved: FloatArray = CubicSpline(load.t_s, load.wrench, axis=1)(np.clip(load.t_s + off_s, load.t_s[0], load.t_s[-1]))
    return moved - load.wrench


def _product(size: float, load: _Load, _: np.random.Generator) -> FloatArray:
    """A moment about y and a force along y that show the product of the two horizontal forces."""
    unit = load.wrench / load.scale
    return size * load.scale * np.outer(np.array([0.0, 1.0, 0.0, 0.0, 1.0, 0.3]), unit[0] * unit[2])


_AT_SENSOR: Final[Mapping[str, Callable[[float, _Load, np.random.Generator], FloatArray]]] = {
    "mains_hum": _hum,
    "warming_gain": _warming,
    "creep": _creep,
    "knocking_foot": _knocks,
    "cubic_gain": _cubic,
    "stamp_jitter": _jitter,
    "product_crosstalk": _product,
}

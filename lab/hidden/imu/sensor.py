"""What an imperfect IMU reads on an exactly known motion: for the hidden-effect cases.

A late stamp is the motion at another time, a lever arm another point of the body, a filter or a mount a differential
equation on a grid eight times as dense.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, lfilter, lsim
from scipy.spatial.transform import Rotation

from lab.hidden.imu.motion import Curve, Motion
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2

_FINER: Final = 8
_MARGIN_S: Final = 1.0
_CALIBRATED_DEGC: Final = 25.0
_RECTIFIER_S: Final = 0.15


@dataclass(frozen=True, eq=False)
class Unit:
    """One sensor in one room: what is wrong with it, the same in both recordings. The defaults are a perfect one."""

    late_s: float = 0.0
    fast: float = 0.0
    w_matrix: FloatArray = field(default_factory=lambda: np.eye(3))
    sf_matrix: FloatArray = field(default_factory=lambda: np.eye(3))
    w_bias_radps: FloatArray = field(default_factory=lambda: np.zeros(3))
    w_drift_radps2: FloatArray = field(default_factory=lambda: np.zeros(3))
    w_per_sf: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    w_per_degC: FloatArray = field(default_factory=lambda: np.zeros(3))
    sf_bias_mps2: FloatArray = field(default_factory=lambda: np.zeros(3))
    arm_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    turned_rad: FloatArray = field(default_factory=lambda: np.zeros(3))
    tilt_rad: FloatArray = field(default_factory=lambda: np.zeros(3))  # of the vertical against the reference's z
    gravity_mps2: float = STANDARD_GRAVITY_MPS2
    w_limit_radps: float = np.inf
    sf_limit_mps2: float = np.inf
    cut_off_hz: tuple[float, float] = (np.inf, np.inf)  # of gyroscope and accelerometer
    mount_hz: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    mount_damping: float = 0.1
    outside: tuple[str, float, int] = ("", 0.0, 0)  # mechanism, size, axis


def readings(unit: Unit, curve: Curve, stamps_s: FloatArray, degC: FloatArray) -> FloatArray:
    """Return what a unit reads (n, 6) without noise at its stamps."""
    t_s = (stamps_s - stamps_s[0] - unit.late_s) / (1.0 + unit.fast) + stamps_s[0]
    motion = Motion(curve, unit.gravity_mps2, unit.arm_m)
    name, size, axis = unit.outside
    if np.isfinite(unit.cut_off_hz).any() or np.isfinite(unit.mount_hz).any():
        dense_s = np.arange(t_s[0] - _MARGIN_S, t_s[-1] + _MARGIN_S, float(np.median(np.diff(t_s))) / _FINER)
        y = make_interp_spline(dense_s, _dynamic(unit, motion, dense_s), k=3)(t_s)
    else:
        y = _static(unit, motion.turning(t_s), motion.specific_force(t_s) + _vertical(unit, motion, t_s))
    y[:, :3] += unit.w_drift_radps2 * (stamps_s - stamps_s[0])[:, None]
    y[:, :3] += unit.w_per_degC * (degC - _CALIBRATED_DEGC)[:, None]
    if name:
        y = _outside(name, size, axis, y, motion, t_s)
    return y


def _vertical(unit: Unit, motion: Motion, t_s: FloatArray) -> FloatArray:
    """Return what a vertical that leans in the reference's world adds to the specific force, (n, 3)."""
    leaning = Rotation.from_rotvec(unit.tilt_rad).apply((0.0, 0.0, 1.0)) - (0.0, 0.0, 1.0)
    added: FloatArray = motion.attitude(t_s).apply(unit.gravity_mps2 * leaning, inverse=True)
    return added


def _static(unit: Unit, w: FloatArray, sf: FloatArray) -> FloatArray:
    seat = Rotation.from_rotvec(unit.turned_rad)
    w, sf = seat.apply(w), seat.apply(sf)
    w = w @ unit.w_matrix.T + sf @ unit.w_per_sf.T + unit.w_bias_radps
    return np.hstack((w, sf @ unit.sf_matrix.T + unit.sf_bias_mps2))


def _dynamic(unit: Unit, motion: Motion, t_s: FloatArray) -> FloatArray:
    """Return the readings on a dense grid: the mount's oscillator first, the sensor's own filter last."""
    w, sf = motion.turning(t_s), motion.specific_force(t_s) + _vertical(unit, motion, t_s)
    since_s = t_s - t_s[0]
    for k, f_hz in enumerate(unit.mount_hz):
        if np.isfinite(f_hz):
            w0 = 2.0 * np.pi * f_hz
            spring, damper = w0**2, 2.0 * unit.mount_damping * w0
            about = sf[0, k]
            sf[:, k] = about + lsim(((damper, spring), (1.0, damper, spring)), sf[:, k] - about, since_s)[1]
    y = _static(unit, w, sf)
    for k, f_hz in enumerate(np.repeat(unit.cut_off_hz, 3)):
        if np.isfinite(f_hz):
            filter_ = butter(2, 2.0 * np.pi * f_hz, analog=True)
            y[:, k] = y[0, k] + lsim(filter_, y[:, k] - y[0, k], since_s)[1]
    return y


def _outside(name: str, size: float, axis: int, y: FloatArray, motion: Motion, t_s: FloatArray) -> FloatArray:
    """Return the readings with a mechanism that no library holds."""
    other, third = (axis + 1) % 3, (axis + 2) % 3
    if name == "axis_skew":
        y[:, axis] = motion.turning(t_s - size)[:, axis]
    elif name == "gyro_hysteresis":
        y[:, axis] = _play(y[:, axis], abs(size))
    elif name == "soft_sway":
        angle = size * (y[:, 3 + other] - y[:, 3 + other].mean())
        sway = Rotation.from_rotvec(np.outer(angle, np.eye(3)[axis]))
        y = np.hstack((sway.apply(y[:, :3]), sway.apply(y[:, 3:])))
        y[:, axis] += np.gradient(angle, t_s)
    elif name == "cross_coupled_rate":
        y[:, axis] += size * motion.turning_change(t_s)[:, other]
    elif name == "size_effect":
        for row, column, way in ((axis, other, 1.0), (other, third, -1.0)):
            y[:, 3 + row] = motion.specific_force(t_s, way * size * np.eye(3)[column])[:, row]
    elif name == "rectified_vibration":
        shaking = ((y[:, 3:] - y[:, 3:].mean(axis=0)) ** 2).sum(axis=1)
        memory = float(np.median(np.diff(t_s))) / _RECTIFIER_S
        y[:, axis] += size * lfilter((memory,), (1.0, memory - 1.0), shaking)
    return y


def _play(x: FloatArray, width: float) -> FloatArray:
    """Return what follows `x` (n,) with a play of `width` in all."""
    out, held = np.empty_like(x), float(x[0])
    for k, value in enumerate(x.tolist()):
        held = min(max(held, value - 0.5 * width), value + 0.5 * width)
        out[k] = held
    return out

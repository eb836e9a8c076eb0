"""What instruments make of what happened: delays by splines, filters by difference equations, play step by step."""

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, sosfiltfilt, upfirdn

from messages.arrays import FloatArray
from sim_rig.platform.extended.mechanics import SETTLE_S
from sim_rig.platform.rig import MOTION_HZ
from sim_rig.platform.run import OVERSAMPLING, STEP_S, anti_alias_taps

_PRESLIDING_RAD: Final = 2e-5
"""How far dry friction gives way before it slips: far below the bare plate's swing of 9e-3 rad RMS."""


def sampled(fine: FloatArray, count: int, *, raw: bool = False) -> FloatArray:
    """Return `count` samples (c, n) at 350 Hz from zero on, behind a linear-phase low pass, or without it if `raw`."""
    first = round(SETTLE_S / STEP_S)
    if raw:
        return fine[:, first::OVERSAMPLING][:, :count]
    taps = anti_alias_taps()
    half = len(taps) // 2
    kept: FloatArray = upfirdn(taps, fine[:, first - half :], down=OVERSAMPLING, axis=1)
    skipped = 2 * half // OVERSAMPLING
    return kept[:, skipped : skipped + count]


def warped(fine: FloatArray, t_s: FloatArray, at_s: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return values (c, n), known at `t_s`, at the times that `at_s` makes of those: a cubic spline between them."""
    found: FloatArray = CubicSpline(t_s, fine, axis=1)(np.clip(at_s(t_s), t_s[0], t_s[-1]))
    return found


def lagging(fine: FloatArray, lag_s: float) -> FloatArray:
    """Return values (c, n) behind a first-order lag: lag y' = x − y by the trapezoidal rule."""
    a = 2.0 * lag_s / STEP_S
    y: FloatArray = lfilter([1.0, 1.0], [1.0 + a, 1.0 - a], fine, axis=1)
    return y


def smoothed(poses: FloatArray, cutoff_hz: float) -> FloatArray:
    """Return poses (c, n) at 350 Hz behind a Butterworth filter of second order, run forth and back."""
    y: FloatArray = sosfiltfilt(butter(2, cutoff_hz, fs=MOTION_HZ, output="sos"), poses, axis=1)
    return y


def followed(x: FloatArray, play: float) -> FloatArray:
    """Return what a part (n,) does that is moved through a play, step by step."""
    place, half = float(x[0]), 0.5 * play
    way = []
    for value in x.tolist():
        if value - place > half:
            place = value - half
        elif place - value > half:
            place = value + half
        way.append(place)
    return np.array(way)


def rubbed(angle_rad: FloatArray, friction_nm: float) -> FloatArray:
    """Return the moment (n,) that dry friction takes: a spring that slips at `friction_nm`, stiff before it does."""
    slip = angle_rad - followed(angle_rad, 2.0 * _PRESLIDING_RAD)
    return friction_nm * slip / _PRESLIDING_RAD

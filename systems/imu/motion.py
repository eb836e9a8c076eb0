"""What an ideal IMU would have read on the reference motion, beside what the real one read, on one uniform grid.

With q = q_WS, the reference's position p and g = 9.8 m/s² up (Titterton and Weston, Strapdown Inertial Navigation
Technology, 2004, ch. 3):

    ω = vee(Rᵀ Ṙ) = 2 vec(q* ⊗ q̇) / |q|²                                                                          (1)
    f = Rᵀ (p̈ + g e_z)                                                                                            (2)

Derivatives are those of splines of degree seven through the reference. Its noise grows with frequency in them, by f and
by f²: measured and predicted alike pass a low pass that ends where the noise has buried the motion.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import binary_dilation
from scipy.signal import firwin, upfirdn

from messages.arrays import BoolArray, FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from messages.errors import UserError
from systems.imu.recording import LEAST_S, ImuRecording
from systems.imu.smoothing import SETTLED_S, Smoothing, smoothing

_DEGREE: Final = 7
"""Of the splines: two derivatives of a lower one fall short of the motion far below the reference's half rate."""
_BEYOND: Final = 16
"""Samples of an end's reflection."""
_GAP: Final = 1.5
"""Of the median step: a longer one is a gap."""
_REGULAR: Final = 1e-3
"""Of a step: stamps that near the grid lie on it, and their readings are taken as they are."""
_ROUNDED: Final = 1e-6
"""Of a step: a first or last stamp that near a point of the grid is that point, but for rounding."""
_SAME_RATE: Final = 0.05
"""Of a step of the reference: an IMU's that is longer than some of them by less is not divided once more."""
_PASSED: Final = 0.4
"""Of the sample rate behind the low pass: what it leaves alone."""
_MOST_OF_REFERENCE: Final = 0.3
"""Of the reference's rate: splines of degree seven keep second derivatives to 1 % that far."""
_HALF_WIDTH: Final = 13
"""Of the low pass's impulse response, in samples behind it."""
_KAISER_BETA: Final = 5.0
"""Of the low pass's window: beyond the fall it lets a few thousandths pass."""
_CUT_OFF: Final = 0.92
"""Of half the sample rate behind the low pass: −6 dB. It lets nothing fold back from beyond that half."""
_PINNED: Final = 5
"""Readings of the greatest magnitude: by chance two or three may share it."""
_PINNED_WITHIN: Final = 1e-6
"""Of the greatest magnitude: readings that near to it are equal, but for the rounding of a file."""
GUARD_S: Final = 0.1
"""What is left out around gaps of the reference: bridges swing that far into what was seen."""
END_S: Final = 0.5
"""What is left out at either end: filters and reflected ends reach that far."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Measured and ideal readings at the uniform stamps `t_s` (n,).

    `measured` (n, 6) is gyroscope before accelerometer, NaN at gaps and ends, `read` the same without NaN; `ideal`
    (n, 6) is (1) and (2) with all noise of the reference, `whole` the same with what was read in its gaps, and `world`
    (n, 3, 3) the world's axes in the sensor's, row by row: the last is Rᵀ e_z of (2). `inputs` (n, 6) are (1) and (2)
    freed of nearly all noise, `smooth` tells how much of the rest is motion (systems.imu.smoothing). `start_s` is the
    first stamp of the IMU, `most` the greatest raw reading of either sensor, rad/s and m/s², and `pinned` whether
    readings pile up exactly there. `fold` samples of the IMU make one, and `taps` are the low pass at the IMU's rate.
    """

    t_s: FloatArray
    measured: FloatArray
    read: FloatArray
    ideal: FloatArray
    whole: FloatArray
    world: FloatArray
    inputs: FloatArray
    temperature_degC: FloatArray | None
    start_s: float
    most: tuple[float, float]
    pinned: tuple[bool, bool]
    smooth: Smoothing
    fold: int
    taps: FloatArray

    @property
    def band_hz(self) -> float:
        """Return to where the motion's content reaches."""
        return self.smooth.band_hz

    def low_passed(self, fine: FloatArray) -> FloatArray:
        """Return (n, c) of what stands at the IMU's rate, `fold` n samples."""
        return _low_passed(fine, self.taps, self.fold)[: len(self.t_s)]

    def fine(self, values: FloatArray) -> FloatArray:
        """Return `values` (n, c) at the IMU's rate, `fold` n samples."""
        if self.fold == 1:
            return values
        half = len(self.taps) // 2
        raised: FloatArray = upfirdn(self.fold * self.taps, _padded(values, _HALF_WIDTH), up=self.fold, axis=0)
        first = half + _HALF_WIDTH * self.fold
        return raised[first : first + self.fold * len(values)]


def reading_of(recording: ImuRecording) -> Reading:
    """Return what a recording holds; raises UserError where gaps leave less than five seconds."""
    step_s, reference_step_s = _step_s(recording.t_s), _step_s(recording.reference_t_s)
    grid_s = _grid_s(recording, step_s)
    dense = max(1, int(np.ceil(step_s / reference_step_s - _SAME_RATE)))
    dense_s = grid_s[0] + step_s / dense * np.arange(dense * (len(grid_s) - 1) + 1)
    w, seen_q, R = _turning(recording, dense_s)
    acceleration, seen_p = _moving(recording, dense_s)
    seen = np.column_stack((seen_q, seen_q & seen_p))
    free = np.einsum("nij,ni->nj", R, acceleration)
    sf = free + STANDARD_GRAVITY_MPS2 * R[:, 2]
    most_hz = _PASSED / step_s
    measured = _on_grid(recording.t_s, np.hstack((recording.w_radps, recording.sf_mps2)), grid_s, step_s)
    lost_q, lost_p = _dilated(~seen, dense * int(np.ceil(GUARD_S / step_s))).T
    w_whole = _filled(w, lost_q, measured[:, :3], dense)
    free_whole = _filled(free, lost_p, measured[:, 3:] - STANDARD_GRAVITY_MPS2 * R[::dense, 2], dense)
    thin = _low_pass_taps(dense) if dense > 1 else np.ones(1)
    smooth = smoothing(
        (_low_passed(w, thin, dense), _low_passed(sf, thin, dense)),
        (measured[:, :3], measured[:, 3:]),
        seen[::dense],
        1.0 / step_s,
        min(most_hz, _MOST_OF_REFERENCE / reference_step_s),
    )
    fold = max(1, int(most_hz / smooth.band_hz))
    kept = dense * fold
    taps = np.ones(1) if fold == 1 else _low_pass_taps(fold)

    guard = int(np.ceil(GUARD_S / step_s)) + max(len(taps) // 2, round(SETTLED_S / step_s))
    lost = ~_there(recording.t_s, np.ones(len(recording.t_s), dtype=bool), grid_s)[:, None] | ~seen[::dense]
    edge = np.minimum(np.arange(len(grid_s)), np.arange(len(grid_s))[::-1]) < max(END_S / step_s, guard)
    masked = np.repeat(_dilated(lost, guard)[::fold] | edge[::fold, None], 3, axis=1)
    counted_s = float((~masked).mean(axis=1).sum() * fold * step_s)
    if counted_s < LEAST_S:
        raise UserError(f"recording: {counted_s:.2g} s without gaps of the reference, allowed {LEAST_S:g} s or more")
    degC = recording.temperature_degC
    if degC is not None:
        degC = _low_passed(np.interp(grid_s, recording.t_s, degC)[:, None], taps, fold)[:, 0]
    fold_taps = _low_pass_taps(kept) if kept > 1 else taps
    whole = np.hstack((w_whole, free_whole + STANDARD_GRAVITY_MPS2 * R[:, 2], R.reshape(-1, 9)))
    whole = _low_passed(whole, fold_taps, kept)
    return Reading(
        t_s=grid_s[::fold],
        measured=np.where(masked, np.nan, _low_passed(measured, taps, fold)),
        read=_low_passed(measured, taps, fold),
        ideal=_low_passed(np.hstack((w, sf)), fold_taps, kept),
        whole=whole[:, :6],
        world=whole[:, 6:].reshape(-1, 3, 3),
        inputs=smooth.inputs(w_whole[::dense], (free_whole + STANDARD_GRAVITY_MPS2 * R[:, 2])[::dense])[::fold],
        temperature_degC=degC,
        start_s=float(recording.t_s[0]),
        most=(float(np.abs(recording.w_radps).max()), float(np.abs(recording.sf_mps2).max())),
        pinned=(_is_pinned(recording.w_radps), _is_pinned(recording.sf_mps2)),
        smooth=smooth,
        fold=fold,
        taps=taps,
    )


def _step_s(t_s: FloatArray) -> float:
    """Return the period of the grid that stamps with gaps lie on."""
    median_s = float(np.median(np.diff(t_s)))
    return float((t_s[-1] - t_s[0]) / np.maximum(np.rint(np.diff(t_s) / median_s), 1.0).sum())


def _grid_s(recording: ImuRecording, step_s: float) -> FloatArray:
    """Return the IMU's uniform stamps within the reference's time."""
    first_s, last_s = (
        choose(recording.t_s[k], recording.reference_t_s[k]) - recording.t_s[0] for choose, k in ((max, 0), (min, -1))
    )
    first, last = int(np.ceil(first_s / step_s - _ROUNDED)), int(np.floor(last_s / step_s + _ROUNDED))
    grid_s: FloatArray = recording.t_s[0] + step_s * np.arange(first, last + 1)
    return grid_s


def _on_grid(t_s: FloatArray, values: FloatArray, grid_s: FloatArray, step_s: float) -> FloatArray:
    """Return samples (k, c) on the grid: as they are where the stamps lie on it, else by a cubic through them."""
    near = np.searchsorted(t_s, grid_s - 0.5 * step_s).clip(0, len(t_s) - 1)
    if np.abs(t_s[near] - grid_s).max() < _REGULAR * step_s:
        return np.asarray(values[near])
    found: FloatArray = _spline(t_s, values, 3)(grid_s)
    return found


def _is_pinned(values: FloatArray) -> bool:
    """Return whether more readings than chance allows share the greatest magnitude."""
    size = np.abs(values)
    return int((size > size.max() * (1.0 - _PINNED_WITHIN)).sum()) >= _PINNED


def _turning(recording: ImuRecording, grid_s: FloatArray) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Return (1), (n, 3), where the cameras saw it, and R_WS (n, 3, 3)."""
    seen = np.asarray(np.isfinite(recording.q_WS).all(axis=1))
    q = recording.q_WS[seen]
    flips = np.concatenate(([1.0], np.cumprod(np.where((q[1:] * q[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))))
    spline = _spline(recording.reference_t_s[seen], q * flips[:, None], _DEGREE)
    q, dq = spline(grid_s), spline(grid_s, 1)
    square = (q * q).sum(axis=1, keepdims=True)
    w = 2.0 * _vec_of_product(q, dq) / square
    return w, _there(recording.reference_t_s, seen, grid_s), _matrices(q / np.sqrt(square))


def _moving(recording: ImuRecording, grid_s: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return p̈ (n, 3) and where the cameras saw it."""
    seen = np.asarray(np.isfinite(recording.p_W_m).all(axis=1))
    spline = _spline(recording.reference_t_s[seen], recording.p_W_m[seen], _DEGREE)
    found: FloatArray = spline(grid_s, 2)
    return found, _there(recording.reference_t_s, seen, grid_s)


def _spline(t_s: FloatArray, values: FloatArray, degree: int) -> BSpline:
    """Return the interpolating spline.

    It swings at gaps and ends: gaps are bridged by a straight line, and both ends go on as their own reflections.
    """
    steps = np.diff(t_s)
    step_s = float(np.median(steps))
    gaps = np.flatnonzero(steps > _GAP * step_s)
    if len(gaps):
        bridges = [np.linspace(t_s[k], t_s[k + 1], round(steps[k] / step_s) + 1)[1:-1] for k in gaps]
        whole_s = np.sort(np.concatenate((t_s, *bridges)))
        values = np.column_stack([np.interp(whole_s, t_s, column) for column in values.T])
        t_s = whole_s
    before, after = slice(_BEYOND, 0, -1), slice(-2, -_BEYOND - 2, -1)
    times = (2.0 * t_s[0] - t_s[before], t_s, 2.0 * t_s[-1] - t_s[after])
    points = (2.0 * values[0] - values[before], values, 2.0 * values[-1] - values[after])
    return make_interp_spline(np.concatenate(times), np.concatenate(points), k=degree)


def _there(t_s: FloatArray, seen: BoolArray, grid_s: FloatArray) -> BoolArray:
    """Return whether each time of the grid lies between two samples without a gap."""
    times = t_s[seen]
    after = np.searchsorted(times, grid_s).clip(1, len(times) - 1)
    whole = times[after] - times[after - 1] < _GAP * float(np.median(np.diff(t_s)))
    there: BoolArray = whole & (grid_s >= times[0]) & (grid_s <= times[-1])
    return there


def _filled(values: FloatArray, lost: BoolArray, coarse: FloatArray, dense: int) -> FloatArray:
    """Return `values` (n, 3) with what is lost (n,) on lines through every `dense`-th value, `coarse`.

    Where the cameras lost the motion the sensor itself tells it best: a bridge's error would ring on beyond the gap.
    """
    at = np.flatnonzero(lost)
    whole: FloatArray = values.copy()
    whole[at] = np.column_stack([np.interp(at / dense, np.arange(len(coarse)), column) for column in coarse.T])
    return whole


def _low_pass_taps(fold: int) -> FloatArray:
    taps: FloatArray = firwin(2 * _HALF_WIDTH * fold + 1, _CUT_OFF / fold, window=("kaiser", _KAISER_BETA))
    return taps


def _low_passed(fine: FloatArray, taps: FloatArray, fold: int) -> FloatArray:
    """Return every `fold`-th sample of (n, c) behind the low pass, without delay."""
    if fold == 1:
        return fine
    kept: FloatArray = upfirdn(taps, _padded(fine, len(taps) // 2), down=fold, axis=0)
    first = (len(taps) - 1) // fold
    return kept[first : first - (-len(fine) // fold)]


def _padded(values: FloatArray, count: int) -> FloatArray:
    """Return the values with the first and the last repeated `count` times."""
    return np.pad(values, ((count, count), (0, 0)), mode="edge")


def _dilated(flags: BoolArray, by: int) -> BoolArray:
    wide: BoolArray = binary_dilation(flags, np.ones((2 * by + 1, 1), dtype=bool))
    return wide


def _vec_of_product(q: FloatArray, dq: FloatArray) -> FloatArray:
    """Return the vector part (n, 3) of q* ⊗ dq."""
    vec: FloatArray = q[:, :1] * dq[:, 1:] - dq[:, :1] * q[:, 1:] - np.cross(q[:, 1:], dq[:, 1:])
    return vec


def _matrices(q: FloatArray) -> FloatArray:
    w, x, y, z = q.T
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), 2, 0)

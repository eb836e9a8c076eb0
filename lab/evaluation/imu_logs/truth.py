"""What may be wrong with a log's truth: gaps, glitches, its clock and its vertical.

Clock: the rate w of the cameras and that of the gyroscope tell how much later the IMU's stamps are,

    w_IMU(t) = A w(t) + b − delay · ẇ(t)                                                              (1)

Vertical: over any 2T, the velocities that the truth has before and after differ by what the accelerometer measured,

    p(t+T) − 2 p(t) + p(t−T) = ∫ (T − |s|) (R_WB (sf − a) + g_W) ds,  |g_W| known                      (2)

from which the direction of g_W follows together with the accelerometer's bias a.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from drivers.recording.asl_folder import TruthTrack
from lab.evaluation.imu_logs.log import ImuLog
from messages.arrays import BoolArray, FloatArray, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2
from messages.errors import UserError

_GAP_INTERVALS = 2.1
_AROUND_GAP_S = 0.3
_GLITCH_RADPS = 1.0
_LONGEST_DELAY_S = 0.05
_GRID_HZ = 100.0
_LEVELLED_OVER_S = 0.5
_REWEIGHTINGS = 3
_OUTLIER_DEVIATIONS = 4.0


def sound(log: ImuLog) -> BoolArray:
    """Return for each pose of the truth (m,) whether it is to be believed: 0.3 s from any gap, and turning as the
    gyroscope does, within 1 rad/s."""
    truth = log.truth
    t_s = _seconds(truth.t_ns, log)
    intervals_s = np.diff(t_s)
    rate, at_s = _rates(truth, t_s)
    difference = _at(at_s, log, log.w_B) - rate
    gaps = intervals_s > _GAP_INTERVALS * np.median(intervals_s)
    glitches = ~gaps & (np.linalg.norm(difference - np.median(difference[~gaps], axis=0), axis=1) > _GLITCH_RADPS)
    believed = np.ones(len(t_s), dtype=bool)
    for k in np.flatnonzero(gaps):
        believed &= (t_s < t_s[k] - _AROUND_GAP_S) | (t_s > t_s[k + 1] + _AROUND_GAP_S)
    believed[:-1] &= ~glitches
    believed[1:] &= ~glitches
    return believed


def imu_delay_s(log: ImuLog, believed: BoolArray) -> float:
    """Return how much later than the truth's the IMU's stamps are, by (1): least squares, both rates smoothed alike."""
    t_s = _seconds(log.truth.t_ns, log)
    rate, at_s = _rates(log.truth, t_s)
    grid_s = np.arange(at_s[0], at_s[-1], 1.0 / _GRID_HZ)
    smooth = [
        gaussian_filter1d(np.stack([np.interp(grid_s, x_s, column) for column in values.T], axis=1), 2.0, axis=0)
        for x_s, values in ((at_s, rate), (_seconds(log.t_ns, log), log.w_B))
    ]
    camera, imu = smooth
    change = np.gradient(camera, axis=0) * _GRID_HZ
    kept = np.interp(grid_s, t_s, believed.astype(np.float64)) > 0.999
    design = np.zeros((3 * int(kept.sum()), 13))
    for i in range(3):
        design[i::3, 3 * i : 3 * i + 3] = camera[kept]
        design[i::3, 9 + i] = 1.0
        design[i::3, 12] = -change[kept, i]
    delay_s = float(_robust(design, imu[kept].ravel())[12])
    if not abs(delay_s) <= _LONGEST_DELAY_S:
        raise UserError(
            f"{log.name}: the IMU's stamps are {delay_s:+.3f} s from the truth's, "
            f"allowed {_LONGEST_DELAY_S:g} s either way"
        )
    return delay_s


def true_vertical_W(log: ImuLog, believed: BoolArray) -> FloatArray:
    """Return the true vertical (3,) in the truth's world, by (2)."""
    truth = log.truth
    t_s = _seconds(truth.t_ns, log)
    grid_s = np.arange(t_s[0], t_s[-1], 1.0 / _GRID_HZ)
    R_WB = Slerp(t_s, _rotations(truth.q_WB))(np.clip(grid_s, t_s[0], t_s[-1])).as_matrix()
    p_W = np.stack([np.interp(grid_s, t_s, column) for column in truth.p_WB_m.T], axis=1)
    sf_W = np.einsum("nij,nj->ni", R_WB, _at(grid_s, log, log.sf_B))
    half = round(_LEVELLED_OVER_S * _GRID_HZ)
    dt_s = 1.0 / _GRID_HZ
    weights = (half - np.abs(np.arange(1 - half, half))) * dt_s**2
    middle = np.arange(half, len(grid_s) - half)
    moved = p_W[middle + half] - 2.0 * p_W[middle] + p_W[middle - half]
    measured, of_bias = (
        np.stack([np.convolve(column, weights, "same")[middle] for column in values.T], axis=1)
        for values in (sf_W, R_WB.reshape(-1, 9))
    )
    kept = np.convolve(np.interp(grid_s, t_s, ~believed) > 0.0, np.ones(2 * half + 1), "same")[middle] == 0.0
    if not kept.any():
        raise UserError(f"{log.name}: no second of its truth is without a gap, so that its vertical cannot be checked")
    square_s2 = (half * dt_s) ** 2
    up_W: FloatArray = np.array((0.0, 0.0, 1.0))
    for _ in range(_REWEIGHTINGS):
        across = np.linalg.svd(up_W[np.newaxis])[2][1:].T
        of_tilt = np.broadcast_to(STANDARD_GRAVITY_MPS2 * square_s2 * across, (int(kept.sum()), 3, 2))
        design = np.concatenate((of_bias[kept].reshape(-1, 3, 3), of_tilt), axis=2).reshape(-1, 5)
        excess = measured - moved - STANDARD_GRAVITY_MPS2 * square_s2 * up_W
        leaning = up_W + across @ _robust(design, excess[kept].ravel())[3:]
        up_W = np.asarray(leaning / np.linalg.norm(leaning), dtype=np.float64)
    return up_W


def _robust(design: FloatArray, values: FloatArray) -> FloatArray:
    """Return the least-squares solution without rows that are far off, by the median of their deviations."""
    kept = np.ones(len(values), dtype=bool)
    solution: FloatArray = np.zeros(design.shape[1])
    for _ in range(_REWEIGHTINGS):
        solution = np.asarray(np.linalg.lstsq(design[kept], values[kept], rcond=None)[0], dtype=np.float64)
        left = np.abs(values - design @ solution)
        kept = left <= _OUTLIER_DEVIATIONS * 1.4826 * max(float(np.median(left[kept])), 1e-12)
    return solution


def _rates(truth: TruthTrack, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the truth's rates (m − 1, 3) in B and the middles of its intervals."""
    R_WB = _rotations(truth.q_WB)
    turned: FloatArray = (R_WB[:-1].inv() * R_WB[1:]).as_rotvec()
    return turned / np.diff(t_s)[:, np.newaxis], 0.5 * (t_s[:-1] + t_s[1:])


def _rotations(q_WB: FloatArray) -> Rotation:
    return Rotation.from_quat(q_WB[:, (1, 2, 3, 0)])


def _seconds(t_ns: IntArray, log: ImuLog) -> FloatArray:
    seconds: FloatArray = 1e-9 * (t_ns - log.t_ns[0])
    return seconds


def _at(t_s: FloatArray, log: ImuLog, values: FloatArray) -> FloatArray:
    """Return `values` (n, 3) of the log at other times, interpolated."""
    return np.stack([np.interp(t_s, _seconds(log.t_ns, log), column) for column in values.T], axis=1)

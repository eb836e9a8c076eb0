"""One stretch of motion as the camera saw it beside what the IMU measured meanwhile: how far they are apart, and why.

With ω, v the mean rates of the steps from t to t + Δt that the camera saw, turned into B, and R_SB the attitude that
their rotations make of the first step's B (= S):

    ω_k = (Θ(t + Δt + l) − Θ(t + l)) / Δt + b + e_k,           Θ = ∫ w_measured dt                            (1)
    R_SB ṗ_k = u + g (t + Δt/2) + (P(t + Δt + l) − P(t + l)) / Δt + e_k,   P = ∬ R_SB sf_measured dt²      (2)

Lag l, bias b, initial velocity u and gravity g (a free vector) are those of least squares; what is left is the misfit
e. The gain of an axis of the accelerometer is by how much its share of P must be multiplied for the least e.
Neither (1) nor (2) asks the attitude filter, and (2) does not ask the gyroscope: what is judged is not used to judge.
"""

from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray, column_rms
from perception.so3 import matrices_from_rotvecs


@dataclass(frozen=True)
class CameraMotion:
    """n steps, one after the other, of B as the camera saw it.

    `from_s`, `to_s` (n,) on the IMU's clock; `w_B_radps` and `v_C_B_mps` (n, 3) are the angular rate and the velocity
    of the left optical centre, in B as it was before each step; `p_BC_m` (3,) is where in B that centre is.
    """

    from_s: FloatArray
    to_s: FloatArray
    w_B_radps: FloatArray
    v_C_B_mps: FloatArray
    p_BC_m: FloatArray


@dataclass(frozen=True)
class ImuMotion:
    """m calibrated samples of the IMU: times (m,), specific force and angular rate (m, 3) in B."""

    t_s: FloatArray
    sf_B_mps2: FloatArray
    w_B_radps: FloatArray


@dataclass(frozen=True)
class Lag:
    """How much later than its stamp the IMU measures what the camera sees, and the standard deviation of that."""

    lag_s: float
    deviation_s: float


@dataclass(frozen=True)
class RateMisfit:
    """(3,) on the axes of B: root mean squares of the rates' `swing` about their mean and of e, and b of (1).

    `mount_rad` (3,) is the small turn of the camera on its mount that e = δ × ω tells, with its standard deviation,
    infinite where nothing turns.
    """

    swing_radps: FloatArray
    misfit_radps: FloatArray
    bias_radps: FloatArray
    mount_rad: FloatArray
    mount_deviation_rad: FloatArray


@dataclass(frozen=True)
class VelocityMisfit:
    """(3,) on the axes of B: root mean squares of the velocity's `swing` about a line in time and of e, m/s.

    `gain` (3,) of each axis of the accelerometer if the others are right, with its standard deviation and the root mean
    square of what the axis adds to the velocity's swing; `gravity_mps2` is the length of g of (2).
    """

    swing_mps: FloatArray
    misfit_mps: FloatArray
    gain: FloatArray
    gain_deviation: FloatArray
    gain_swing_mps: FloatArray
    gravity_mps2: float


def lag_of(camera: CameraMotion, imu: ImuMotion, longest_s: float, grid_s: float) -> Lag:
    """Return l of (1): the best of a grid over ± `longest_s`, and the parabola through it and its neighbours.

    `imu` must reach `longest_s` farther than `camera` on both sides. Infinite deviation where nothing moves.
    """
    steps = round(longest_s / grid_s)
    lags_s: FloatArray = grid_s * np.arange(-steps, steps + 1, dtype=np.float64)
    error = camera.w_B_radps - _mean_rates(camera, imu, lags_s[:, None])
    error -= error.mean(axis=1, keepdims=True)
    cost = (error**2).sum(axis=(1, 2))
    best = min(max(int(np.argmin(cost)), 1), 2 * steps - 1)
    before, least, after = cost[best - 1 : best + 2].tolist()
    curvature = (before + after - 2.0 * least) / grid_s**2
    if curvature <= 0.0:
        return Lag(0.0, np.inf)
    lag_s = lags_s[best] - (after - before) / (2.0 * grid_s * curvature)
    freedom = 3 * len(camera.from_s) - 4
    return Lag(float(np.clip(lag_s, -longest_s, longest_s)), float(np.sqrt(2.0 * least / freedom / curvature)))


def rate_misfit(camera: CameraMotion, imu: ImuMotion, lag_s: float) -> RateMisfit:
    """Return how (1) holds."""
    imu_radps = _mean_rates(camera, imu, np.array([[lag_s]]))[0]
    error = imu_radps - camera.w_B_radps
    bias = error.mean(axis=0)
    swing = np.maximum(column_rms(_centred(imu_radps)), column_rms(_centred(camera.w_B_radps)))
    return RateMisfit(swing, column_rms(error - bias), bias, *_mount(error - bias, _centred(camera.w_B_radps)))


def _mount(error: FloatArray, camera_radps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return δ (3,) of e = δ × ω by least squares over (n, 3) rates about their mean, and its standard deviation."""
    information = (camera_radps**2).sum() * np.eye(3) - camera_radps.T @ camera_radps
    values, vectors = np.linalg.eigh(information)
    inverse = (vectors / np.maximum(values, _TINY)) @ vectors.T
    mount = inverse @ np.cross(camera_radps, error).sum(axis=0)
    left = error - np.cross(mount, camera_radps)
    variance = (left**2).sum() / (left.size - 6)
    return mount, np.sqrt(variance * np.diag(inverse))


def velocity_misfit(camera: CameraMotion, imu: ImuMotion, lag_s: float) -> VelocityMisfit:
    """Return how (2) holds."""
    durations_s = (camera.to_s - camera.from_s)[:, None]
    R_SB = _chained(camera)
    R_after = R_SB @ matrices_from_rotvecs(camera.w_B_radps * durations_s)
    camera_S = np.einsum("nij,nj->ni", R_SB, camera.v_C_B_mps) - (R_after - R_SB) @ camera.p_BC_m / durations_s

    lagged_s = imu.t_s - lag_s
    first, last = np.searchsorted(lagged_s, (camera.from_s[0], camera.to_s[-1])).tolist()
    t_s, sf_B = lagged_s[max(0, first - 1) : last + 1], imu.sf_B_mps2[max(0, first - 1) : last + 1]
    step = np.clip(np.searchsorted(camera.from_s, t_s, side="right") - 1, 0, len(R_SB) - 1)
    R_SB_then = R_SB[step] @ matrices_from_rotvecs((t_s - camera.from_s[step])[:, None] * camera.w_B_radps[step])
    by_axis_S = (R_SB_then * sf_B[:, None, :]).reshape(-1, 9)  # what each axis of the accelerometer adds, in S
    travel_S = integral(t_s, integral(t_s, by_axis_S))
    travelled_S = interpolated(camera.to_s, t_s, travel_S) - interpolated(camera.from_s, t_s, travel_S)
    imu_S = (travelled_S / durations_s).reshape(-1, 3, 3)

    middle_s = 0.5 * (camera.from_s + camera.to_s)
    line = np.column_stack((np.ones(len(middle_s)), middle_s - middle_s.mean()))
    fit = np.linalg.pinv(line)
    off_line = np.eye(len(line)) - line @ fit
    error_S = camera_S - imu_S.sum(axis=2)
    swings_S = np.stack((off_line @ camera_S, off_line @ imu_S.sum(axis=2), off_line @ error_S))
    camera_rms, imu_rms, misfit = np.sqrt((np.einsum("nij,kni->knj", R_SB, swings_S) ** 2).mean(axis=1))

    axes = np.einsum("nm,mij->nij", off_line, imu_S).reshape(-1, 3)
    square = (axes**2).sum(axis=0) + _TINY
    left = swings_S[2].reshape(-1)
    gain = 1.0 + axes.T @ left / square
    deviation = np.sqrt(left @ left / (len(left) - 9) / square)
    return VelocityMisfit(
        swing_mps=np.maximum(camera_rms, imu_rms),
        misfit_mps=misfit,
        gain=gain,
        gain_deviation=deviation,
        gain_swing_mps=np.sqrt(square / len(line)),
        gravity_mps2=float(np.linalg.norm((fit @ error_S)[1])),
    )


def _mean_rates(camera: CameraMotion, imu: ImuMotion, lags_s: FloatArray) -> FloatArray:
    """Return the mean rates (lags, n, 3) measured during the steps, moved by `lags_s` (lags, 1)."""
    angle = integral(imu.t_s, imu.w_B_radps)
    turned = interpolated(camera.to_s + lags_s, imu.t_s, angle) - interpolated(camera.from_s + lags_s, imu.t_s, angle)
    rates: FloatArray = turned / (camera.to_s - camera.from_s)[:, None]
    return rates


def _chained(camera: CameraMotion) -> FloatArray:
    """Return R_SB (n, 3, 3) at the beginning of each step; the steps may meet a few milliseconds apart."""
    R_SB = np.empty((len(camera.from_s), 3, 3))
    R_SB[0] = np.eye(3)
    turns = matrices_from_rotvecs(np.diff(camera.from_s)[:, None] * camera.w_B_radps[:-1])
    for k in range(len(turns)):
        R_SB[k + 1] = R_SB[k] @ turns[k]
    return R_SB


def integral(t_s: FloatArray, rates: FloatArray) -> FloatArray:
    """Return ∫ rates dt (m, c) from the first time on, by the trapezoidal rule."""
    total = np.zeros_like(rates)
    np.cumsum(0.5 * np.diff(t_s)[:, None] * (rates[1:] + rates[:-1]), axis=0, out=total[1:])
    return total


def interpolated(times_s: FloatArray, t_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return `values` (m, c), known at `t_s` (m,), at `times_s` (...), between them: (..., c)."""
    after = np.clip(np.searchsorted(t_s, times_s), 1, len(t_s) - 1)
    share = ((times_s - t_s[after - 1]) / (t_s[after] - t_s[after - 1]))[..., None]
    between: FloatArray = values[after - 1] + share * (values[after] - values[after - 1])
    return between


def _centred(values: FloatArray) -> FloatArray:
    centred: FloatArray = values - values.mean(axis=0)
    return centred


_TINY = 1e-12
"""Least square of rates or velocities, (rad/s)² or (m/s)², as a divisor: nothing moves, and the deviation is large."""

"""How a state of the filter begins: at rest, in motion, after a gap, or again after the camera was lost."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from messages import Reason, Vec3
from messages.arrays import FloatArray
from perception import so3, vec3
from perception.attitude.accelerometer import tilt_of_bias
from perception.attitude.error_state import (
    BEGINNING,
    DRIFT,
    GROUND,
    GROUND_TURN,
    GYRO_BIAS,
    GYRO_MATRIX,
    ROTATION,
    SCALE,
    SF_BIAS,
    TRAVEL,
    VELOCITY,
)
from perception.attitude.kalman import RATE_IS_ZERO, AttitudeKalman, fuse, scale_var, specific_force_W
from perception.attitude.state import AttitudeState, GroundMotion, Sample, Step


def after_gap(kalman: AttitudeKalman, state: AttitudeState, gap_s: float) -> AttitudeState:
    """Return the state before the first sample after `gap_s` without: of the motion nothing is left, of the
    sensors' errors and the usual mounting all."""
    settings = kalman.settings
    P = state.covariance + np.diag(kalman.walk_density * gap_s)
    P[SCALE, SCALE] = scale_var(state)
    return AttitudeState(
        P,
        usual_step_s=state.usual_step_s,
        first_degC=state.first_degC,
        most_warming_K=state.most_warming_K,
        granted_mps2=state.granted_mps2,
        gyro_bias=state.gyro_bias,
        sf_bias=state.sf_bias,
        gyro_matrix=state.gyro_matrix,
        without_camera_s=max(state.without_camera_s + gap_s, settings.camera.fresh_s),
        scale=state.scale,
        odometer_scale=state.odometer_scale,
        scale_weight=state.scale_weight,
        distances_are_wrong=state.distances_are_wrong,
        mount_B=state.mount_B,
        lag_s=state.lag_s,
        reason_uncertain=state.reason_uncertain,
        usual_mounting=replace(state.usual_mounting),
    )


def carried_by_gyro(kalman: AttitudeKalman, state: AttitudeState, since: Sequence[Sample]) -> AttitudeState:
    """Return the state after the samples `since` a started one, by the gyroscope alone: (1) of `kalman`.

    Of the motion nothing is known. The tilt's variance grows by that of the bias, the matrix and the noise over all
    that was turned.
    """
    settings, q_WB, w_before, t_ns = kalman.settings, state.q_WB, state.w_measured, state.t_ns
    elapsed_s, path_rad2, net_rad = 0.0, 0.0, vec3.ZERO
    for sample in since:
        dt_s = 0.0 if t_ns is None else 1e-9 * (sample.t_ns - t_ns)
        turned = vec3.scaled(kalman.rate(state, vec3.between(w_before, sample.w_B, 0.5)), dt_s)
        q_WB = so3.multiply(q_WB, so3.quaternion_from_rotvec(turned))
        elapsed_s, net_rad = elapsed_s + dt_s, vec3.plus_scaled(net_rad, turned, 1.0)
        path_rad2 += kalman.turn_var(w_before, sample.w_B, dt_s) if dt_s > 0.0 else 0.0
        t_ns, w_before = sample.t_ns, sample.w_B
    P = state.covariance
    bias_var = float(np.diag(P[GYRO_BIAS, GYRO_BIAS]).max()) * elapsed_s**2
    matrix_var = float(np.diag(P[GYRO_MATRIX, GYRO_MATRIX]).max()) * vec3.square(net_rad)
    noise_var = settings.gyro_noise_radps_rthz**2 * elapsed_s
    tilt_var = max(P[0, 0], P[1, 1]) + bias_var + matrix_var + path_rad2 + noise_var
    after = after_gap(kalman, state, elapsed_s)
    after.t_ns, after.w_measured, after.sf_measured = t_ns, w_before, since[-1].sf_B
    start_in_motion(kalman, after, so3.rows_from_quaternion(q_WB)[6:9], math.sqrt(tilt_var))
    return after


def start_at_rest(kalman: AttitudeKalman, state: AttitudeState) -> None:
    """Level by the mean specific force of the rest, and take its mean rate for the bias."""
    settings = kalman.settings
    up_B = vec3.minus(state.rest.mean_sf_B, state.sf_bias)
    _start(kalman, state, up_B, settings.rest_tilt_rad, settings.sway_mps)
    rate = np.array(kalman.rate(state, state.rest.mean_w_B))
    fuse(state, RATE_IS_ZERO, rate, kalman.rate_density(state) / settings.rest.time_s * np.eye(3))


def start_in_motion(kalman: AttitudeKalman, state: AttitudeState, up_B: Vec3, tilt_rad: float) -> None:
    """Start with the vertical along `up_B`, of any length, known to `tilt_rad` on each axis, at an unknown pace."""
    _start(kalman, state, up_B, tilt_rad, kalman.settings.moving_start_speed_mps)
    _walk_at_some_pace(kalman, state)


def doubt_gyro(kalman: AttitudeKalman, state: AttitudeState, missing_rad: FloatArray) -> None:
    """Let steps of the camera tell what bias, tilt and pace have become since it was lost, or since the gyroscope fell
    short of its turns by `missing_rad` (3,) in W."""
    P, settings = state.covariance, kalman.settings
    tilt_var = min(kalman.unwatched_tilt_var(state), settings.moving_start_tilt_rad**2)
    _forget_motion(state, settings.moving_start_speed_mps)
    _walk_at_some_pace(kalman, state)
    missing_tilt_rad = missing_rad * (1.0, 1.0, 0.0)
    P[ROTATION, ROTATION] += np.diag((1.0, 1.0, 0.0)) * tilt_var + np.outer(missing_tilt_rad, missing_tilt_rad)
    P[GYRO_BIAS, GYRO_BIAS] += np.eye(3) * settings.gyro_bias_radps**2
    state.reason_uncertain = Reason.UNCONFIRMED


def _walk_at_some_pace(kalman: AttitudeKalman, state: AttitudeState) -> None:
    settings, P = kalman.settings, state.covariance
    state.pace_unknown_s = settings.pace_unknown_s
    state.mean_square_swing = settings.moving_start_swing_mps**2
    P[DRIFT, VELOCITY] = P[VELOCITY, DRIFT] = P[DRIFT, DRIFT]
    P[VELOCITY, VELOCITY] += np.eye(3) * settings.moving_start_swing_mps**2


def _start(kalman: AttitudeKalman, state: AttitudeState, up_B: Vec3, tilt_rad: float, speed_mps: float) -> None:
    """Stand `up_B` upright: where the accelerometer's bias leans, so does the vertical."""
    state.started = True
    state.q_WB = so3.quaternion_from_up(up_B)
    _forget_motion(state, speed_mps)
    state.sf_W = specific_force_W(state)
    P = state.covariance
    P[ROTATION, :] = P[:, ROTATION] = 0.0
    leaning = tilt_of_bias(state, kalman.settings)
    P[ROTATION, :] = leaning @ P[SF_BIAS, :]
    P[:, ROTATION] = P[ROTATION, :].T
    P[ROTATION, ROTATION] = leaning @ P[SF_BIAS, SF_BIAS] @ leaning.T + np.diag((1, 1, 0)) * tilt_rad**2


def _forget_motion(state: AttitudeState, speed_mps: float) -> None:
    """Let the velocity be 0, known to `speed_mps`, over a ground at rest, and no step of the camera have begun."""
    state.v_W = state.drift_W = state.smooth_swing_W = vec3.ZERO
    state.pace_unknown_s = state.unwatched_s = 0.0
    state.step = Step()
    state.travel_W, state.q_WB_beginning = vec3.ZERO, None
    P = state.covariance
    P[SCALE, SCALE] = scale_var(state)
    state.ground = GroundMotion()
    for motion in (VELOCITY, DRIFT, TRAVEL, BEGINNING, GROUND, GROUND_TURN):
        P[motion, :] = P[:, motion] = 0.0
    P[VELOCITY, VELOCITY] = P[DRIFT, DRIFT] = np.eye(3) * speed_mps**2

"""The equations of the attitude filter: a complementary filter on SO(3) with optimal gains.

The gyroscope is integrated on SO(3). What pulls the result to the vertical is that a wearer's velocity stays bounded:
the integral of specific force minus gravity cannot run away from the drift of a walk, which turns with the wearer and
changes slowly. An error-state Kalman filter weighs the two. Every sample counts: a gate on the length of the specific
force would spoil the mean of the accelerations, which carries the vertical. How closely the velocity keeps to the
drift follows from its own swing about it, and from rest; how far it drifts, from how fast it has been of late.

Estimates, and their errors (true = estimate ⊕ error), θ, v and u in W and right-invariant, so that (3) holds in any
motion:

    R_WB ← R_WB exp(w dt),  w = (1 − M) w_measured − b                              (1)
    v̇_W = R_WB (sf_measured − a) − g e_z,   u̇_W = w_z e_z × u − u / τ + n_u         (2)
    θ̇ = −R_WB (δb + δM w_measured) + n_w,   δv̇ = g θ × e_z − R_WB δa + n_a          (3)
    v = u + n_v,   at rest also   w = n_r                                           (4)

What the camera sees of the motion measures them as well: (5) to (7) of `camera_step`, for which the displacement p
since a step of the camera began, and the attitude at its beginning, stand in the state:

    ṗ = v,   v̇ of (2) less the ground's own acceleration c where the ground moves

b, M: gyroscope's bias, and scale and misalignment; a: accelerometer's bias; u: drift, or sway at rest. The yaw of W is
arbitrary, and (4) says nothing about it: turning everything about e_z changes no measurement. Invariant error:
Barrau, Bonnabel, IEEE TAC 62(4), 2017.
"""

import math
import operator

import numpy as np

from messages import Residual, Vec3
from messages.arrays import FloatArray
from perception import so3, vec3
from perception.attitude.accelerometer import CROSS_UP, weigh_gravity
from perception.attitude.error_state import (
    BEGINNING,
    DRIFT,
    GROUND,
    GROUND_TURN,
    GYRO_BIAS,
    GYRO_MATRIX,
    LAG,
    MOUNT,
    ROTATION,
    SCALE,
    SF_BIAS,
    SIZE,
    TRAVEL,
    VELOCITY,
)
from perception.attitude.rest import Rest
from perception.attitude.sensor_errors import MountingErrors, SensorErrors
from perception.attitude.state import AttitudeSettings, AttitudeState, GroundMotion, Sample, Step

_I, _I3 = np.eye(SIZE), np.eye(3)
_DIAGONAL = np.diag_indices(SIZE)
RATE_IS_ZERO = _I[GYRO_BIAS]
_SWING_IS_ZERO = _I[VELOCITY] - _I[DRIFT]
_RATE_AND_SWING_ARE_ZERO = np.vstack((RATE_IS_ZERO, _SWING_IS_ZERO))
"""What (4) measures of the error state, each (rows, SIZE)."""

_FAR_SIGMAS = 3.0
"""Standard deviations beyond which a velocity belongs to another motion."""

_STEP_GAIN = 0.05
"""Share by which the usual time between samples follows each one."""


class AttitudeKalman:
    """(1) to (4) on an AttitudeState, which each method brings up to date; nothing is remembered here."""

    def __init__(self, settings: AttitudeSettings, residual: Residual) -> None:
        self.settings = settings
        self._sf_bias_mps2 = math.hypot(residual.specific_force_mps2, residual.scale * settings.gravity_mps2)
        self.sf_per_K_mps2 = residual.sf_per_K_std_mps2
        self._initial_var = np.zeros(SIZE)
        self._initial_var[GYRO_BIAS] = settings.gyro_bias_radps**2
        self._initial_var[SF_BIAS] = self._sf_bias_mps2**2
        self._initial_var[GYRO_MATRIX] = residual.scale**2
        toe_in = settings.camera.range_per_baseline * residual.toe_in_rad
        self.sf_scale = residual.scale
        self.calibrated_scale = math.hypot(toe_in, residual.baseline_std)
        self._initial_var[SCALE] = settings.camera.scale**2 + toe_in**2 + residual.baseline_std**2
        self.mount_rad = math.hypot(settings.camera.mount_rad, residual.camera_to_imu_rad)
        self._initial_var[MOUNT] = self.mount_rad**2
        self._initial_var[LAG] = settings.camera.lag_s**2 + residual.time_s**2
        self.walk_density = np.zeros(SIZE)
        self.walk_density[ROTATION] = settings.gyro_noise_radps_rthz**2
        self.walk_density[GYRO_BIAS] = settings.gyro_bias_walk_radps_rts**2
        self.walk_density[VELOCITY] = settings.sf_noise_mps2_rthz**2
        self.walk_density[SF_BIAS] = settings.sf_bias_walk_mps2_rts**2
        self.walk_density[MOUNT] = settings.camera.mount_walk_rad_rts**2
        self._least_tilt_var = (residual.specific_force_mps2 / settings.gravity_mps2) ** 2
        self._scale_var = residual.scale**2
        self._velocity_per_square_acceleration = self._scale_var * settings.sf_scale_time_s
        self._most_drift_var = settings.moving_start_speed_mps**2
        self._sway_swing_density = settings.sway_swing_mps_rts**2

    def new_state(self, known: SensorErrors | None = None) -> AttitudeState:
        """Return the state before the first sample, from what is `known` of the sensors beyond the calibration."""
        state = AttitudeState(np.diag(self._initial_var))
        if known is not None:
            state.gyro_bias, state.sf_bias, state.scale = known.gyro_bias, known.sf_bias, known.scale
            P = state.covariance
            P[GYRO_BIAS, GYRO_BIAS], P[SF_BIAS, SF_BIAS] = np.diag(known.gyro_var), np.diag(known.sf_var)
            P[SCALE, SCALE] = known.scale_var
        return state

    def sensor_errors(self, state: AttitudeState) -> SensorErrors:
        """Return what the sensors' errors are taken for, with their variances."""
        variances: list[float] = np.diag(state.covariance).tolist()
        gyro_var, sf_var = _vec3(variances, GYRO_BIAS), _vec3(variances, SF_BIAS)
        return SensorErrors(state.gyro_bias, gyro_var, state.sf_bias, sf_var, state.scale, scale_var(state))

    def mounting_errors(self, state: AttitudeState) -> MountingErrors:
        """Return what is known of the camera's place in B, of its clock and of its distances."""
        P = state.covariance
        lag_var = float(P[LAG, LAG][0, 0])
        distances_var = self.scale_deviation(state) ** 2
        return MountingErrors(state.mount_B, P[MOUNT, MOUNT].copy(), state.lag_s, lag_var, state.scale, distances_var)

    def scale_deviation(self, state: AttitudeState) -> float:
        """Return how well the scale of distances is known: with what the odometer errs by, and the accelerometer's own
        scale."""
        return math.hypot(math.sqrt(scale_var(state)), self.sf_scale, state.odometer_scale)

    def rate(self, state: AttitudeState, w_measured: Vec3) -> Vec3:
        """Return w of (1) in rad/s."""
        return vec3.minus(vec3.minus(w_measured, so3.transform(state.gyro_matrix, w_measured)), state.gyro_bias)

    def turn_var(self, w_before: Vec3, w_after: Vec3, dt_s: float) -> float:
        """Return the variance, rad² on each axis, of a turn between two samples by scale errors that no constant matrix
        explains: σ² τ (w² + τ² ẇ²) dt."""
        time_s, w = self.settings.gyro_scale_time_s, vec3.between(w_before, w_after, 0.5)
        changed = vec3.scaled(vec3.minus(w_after, w_before), time_s / dt_s)
        return self._scale_var * time_s * (vec3.square(w) + vec3.square(changed)) * dt_s

    def rotation_cov_W(self, state: AttitudeState) -> FloatArray:
        """Return the covariance (3, 3), rad², of θ: the tilt's no less than the accelerometer's residual allows, with
        what the gyroscope may have done since the camera was lost, and by how much steps of the camera lean that alone
        hold the vertical on a ground that moves."""
        covariance = np.array(state.covariance[ROTATION, ROTATION])
        leaning_var = (self.settings.camera.lean_radps * state.ground.moving_s) ** 2
        for axis in (0, 1):
            known_var = max(covariance[axis, axis], self._least_tilt_var)
            covariance[axis, axis] = known_var + self.unwatched_tilt_var(state) + leaning_var
        return covariance

    def unwatched_tilt_var(self, state: AttitudeState) -> float:
        """Return by how much, rad², a bias that jumped when the camera was lost may have turned the vertical since."""
        return (self.settings.gyro_bias_radps * state.unwatched_s) ** 2 if self.has_lost_camera(state) else 0.0

    def knows_tilt(self, state: AttitudeState, tilt_rad: float) -> bool:
        """Return whether the tilt is known to `tilt_rad`, 1 σ on each axis."""
        P, unwatched_var = state.covariance, self.unwatched_tilt_var(state)
        return state.started and bool(max(P[0, 0], P[1, 1], self._least_tilt_var) + unwatched_var <= tilt_rad**2)

    def at_rest(self, state: AttitudeState) -> bool:
        """Return whether the IMU has moved no more than a standing wearer does, for a second."""
        settings = self.settings.rest
        if state.rest.quiet_s < settings.time_s:
            return False
        bias_deviation = math.sqrt(state.covariance[GYRO_BIAS, GYRO_BIAS].trace() / 3.0)
        rate_radps = math.hypot(*self.rate(state, state.rest.mean_w_B))
        return rate_radps < settings.deviation_w_radps + 3.0 * bias_deviation

    def follows_camera(self, state: AttitudeState) -> bool:
        """Return whether steps of the camera tell the motion: nothing else need bound the velocity, not even rest."""
        return state.without_camera_s < self.settings.camera.fresh_s

    def has_lost_camera(self, state: AttitudeState) -> bool:
        """Return whether there were steps of the camera, but not now."""
        return self.settings.camera.fresh_s <= state.without_camera_s < math.inf

    def integrate(self, state: AttitudeState, sample: Sample, dt_s: float) -> None:
        """(1) and (2) by the trapezoidal rule."""
        step = state.step
        w_mid, sf_before_W = vec3.between(state.w_measured, sample.w_B, 0.5), state.sf_W
        turn_var = self.turn_var(state.w_measured, sample.w_B, dt_s)
        state.sf_measured, state.w_measured = sample.sf_B, sample.w_B
        turned = vec3.scaled(self.rate(state, w_mid), dt_s)
        state.q_WB = so3.multiply(state.q_WB, so3.quaternion_from_rotvec(turned))
        rows = so3.rows_from_quaternion(state.q_WB)
        state.sf_W = so3.transform(rows, vec3.minus(sample.sf_B, state.sf_bias))
        x, y, z = vec3.minus(vec3.between(sf_before_W, state.sf_W, 0.5), state.ground.acceleration_W)
        acceleration_W = (x, y, z - self.settings.gravity_mps2)
        state.travel_W = vec3.plus_scaled(state.travel_W, state.v_W, dt_s)
        state.travel_W = vec3.plus_scaled(state.travel_W, acceleration_W, 0.5 * dt_s * dt_s)
        state.v_W = vec3.plus_scaled(state.v_W, acceleration_W, dt_s)

        step.elapsed_s += dt_s
        step.rows.append(rows)
        step.rates.append(w_mid)
        step.dts_s.append(dt_s)
        step.yaw_rad += rows[6] * turned[0] + rows[7] * turned[1] + rows[8] * turned[2]
        step.rotation_var += turn_var
        step.velocity_var += self._velocity_per_square_acceleration * vec3.square(acceleration_W) * dt_s
        self._add_unseen_variance(state, dt_s, sample.clipped)
        if step.elapsed_s >= self.settings.correction_s:
            self.correct(state)

    def _add_unseen_variance(self, state: AttitudeState, dt_s: float, clipped: bool) -> None:
        """Add the variance of what the samples did not show: between them, or beyond the range."""
        settings, step = self.settings, state.step
        if dt_s > 1.5 * state.usual_step_s:
            missing_s = dt_s - state.usual_step_s
            step.rotation_var += (settings.unseen_w_radps * missing_s) ** 2
            step.rotation_var += (settings.unseen_swing_radps3 * dt_s**3) ** 2
            step.velocity_var += (settings.unseen_sf_mps2 * missing_s) ** 2
        if clipped:
            step.rotation_var += (settings.clipped_w_radps * dt_s) ** 2
            step.velocity_var += (settings.clipped_sf_mps2 * dt_s) ** 2
        state.usual_step_s += _STEP_GAIN * (min(dt_s, 2.0 * state.usual_step_s) - state.usual_step_s)

    def correct(self, state: AttitudeState) -> None:
        """Kalman filter over the errors, up to the newest sample: predict by (3), measure (4)."""
        if state.step.elapsed_s == 0.0:
            return
        step, state.step = state.step, Step()
        self._predict(state, step, self._detect_rest(state))
        self._measure(state, step.elapsed_s)

    def _detect_rest(self, state: AttitudeState) -> bool:
        """Begin or end a rest; return True where the velocity belongs to none and no walk: a vehicle, or an error."""
        settings = self.settings
        variance = max(state.covariance[6, 6], state.covariance[7, 7]) + settings.sway_mps**2
        stands_still = math.hypot(*state.v_W[:2]) <= _FAR_SIGMAS * math.sqrt(variance)
        at_rest = self.at_rest(state)
        if at_rest and state.started:
            weigh_gravity(state, self.settings, self._sf_bias_mps2, self.sf_per_K_mps2)
        state.resting = at_rest and (state.resting or stands_still)
        return (at_rest and not state.resting) or math.hypot(*state.drift_W[:2]) > settings.drift_limit_mps

    def _predict(self, state: AttitudeState, step: Step, runs_away: bool) -> None:
        settings = self.settings
        T_s, g_mps2, rows, dts_s = step.elapsed_s, settings.gravity_mps2, np.array(step.rows), np.array(step.dts_s)
        sum_R_dt = (dts_s @ rows).reshape(3, 3)
        F = _I.copy()
        F[ROTATION, GYRO_BIAS] = F[VELOCITY, SF_BIAS] = -sum_R_dt
        F[ROTATION, GYRO_MATRIX] = (rows.T @ (-dts_s[:, np.newaxis] * np.array(step.rates))).reshape(3, 9)
        F[VELOCITY, ROTATION] = g_mps2 * T_s * CROSS_UP
        F[TRAVEL, ROTATION] = 0.5 * g_mps2 * T_s**2 * CROSS_UP
        F[TRAVEL, VELOCITY] = T_s * _I3
        F[TRAVEL, SF_BIAS] = -0.5 * T_s * sum_R_dt
        F[VELOCITY, GROUND] = -T_s * _I3
        F[TRAVEL, GROUND] = -0.5 * T_s**2 * _I3
        drift_var, time_s = self._drift_var(state, step.elapsed_s), settings.drift_time_s
        if state.resting:
            drift_var, time_s = settings.sway_mps**2, settings.sway_time_s
        elif state.pace_unknown_s > 0.0:
            time_s = settings.pace_time_s
        state.pace_unknown_s -= step.elapsed_s
        kept = math.exp(-step.elapsed_s / time_s)
        c_yaw, s_yaw = kept * math.cos(step.yaw_rad), kept * math.sin(step.yaw_rad)
        F[DRIFT, DRIFT] = ((c_yaw, -s_yaw, 0.0), (s_yaw, c_yaw, 0.0), (0.0, 0.0, kept))
        x, y, z = state.drift_W
        state.drift_W = (c_yaw * x - s_yaw * y, s_yaw * x + c_yaw * y, kept * z)
        noise = self.walk_density * step.elapsed_s
        noise[ROTATION] += step.rotation_var + (settings.runaway_rad_rts**2 * step.elapsed_s if runs_away else 0.0)
        noise[VELOCITY] += step.velocity_var
        noise[DRIFT] += (1.0 - kept**2) * drift_var
        if self.follows_camera(state):
            by_camera = settings.camera
            walk = by_camera.ground_bias_walk_radps_rts if state.ground.moves else by_camera.bias_walk_radps_rts
            noise[GYRO_BIAS] += walk**2 * step.elapsed_s
        elif self.has_lost_camera(state):
            noise[GYRO_BIAS] += settings.camera.covered_bias_walk_radps_rts**2 * step.elapsed_s
        if state.ground.moves:
            self._predict_ground(state.ground, step.elapsed_s, F, noise)
        state.covariance = F @ state.covariance @ F.T
        state.covariance[_DIAGONAL] += noise

    def _drift_var(self, state: AttitudeState, dt_s: float) -> float:
        """Return the drift's variance, (m/s)² on each axis, from the velocity's mean square, brought up to date, and
        from its square now: as large as a walker's where the pace is not known."""
        square = min(0.5 * (state.v_W[0] ** 2 + state.v_W[1] ** 2), self._most_drift_var)
        if state.resting or state.pace_unknown_s > 0.0:
            state.mean_square_speed = self._most_drift_var
        else:
            gain = dt_s / (dt_s + self.settings.drift_average_s)
            state.mean_square_speed += gain * (square - state.mean_square_speed)
        known_var = self.settings.drift_floor_mps**2 + max(state.mean_square_speed, square)
        return min(known_var, self._most_drift_var)

    def _predict_ground(self, ground: GroundMotion, dt_s: float, F: FloatArray, noise: FloatArray) -> None:
        """Let the ground's acceleration turn with it, and both fade to what is usual of a vehicle."""
        settings = self.settings.camera
        kept = math.exp(-dt_s / settings.ground_time_s)
        c, s = kept * math.cos(ground.turn_radps * dt_s), kept * math.sin(ground.turn_radps * dt_s)
        ground.velocity_W = vec3.plus_scaled(ground.velocity_W, ground.acceleration_W, dt_s)
        x, y, z = ground.acceleration_W
        ground.acceleration_W = (c * x - s * y, s * x + c * y, kept * z)
        ground.turn_radps *= kept
        F[GROUND, GROUND] = ((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, kept))
        F[GROUND, GROUND_TURN] = np.array(((-y,), (x,), (0.0,))) * dt_s
        F[GROUND_TURN, GROUND_TURN] = kept
        gain = dt_s / settings.ground_average_s
        ground.usual_square += gain * (0.5 * (x**2 + y**2) - ground.usual_square)
        ground.usual_square = max(ground.usual_square, settings.ground_least_mps2**2)
        noise[GROUND] += (1.0 - kept**2) * np.diag(ground_var(ground.usual_square))
        noise[GROUND_TURN] += (1.0 - kept**2) * settings.ground_turn_radps**2

    def _measure(self, state: AttitudeState, dt_s: float) -> None:
        state.without_camera_s += dt_s
        state.ground.moving_s = state.ground.moving_s + dt_s if state.ground.moves else 0.0
        state.unwatched_s += 0.0 if state.resting or state.levelling is not None else dt_s
        if self.follows_camera(state):
            return
        swing_W = vec3.minus(state.v_W, state.drift_W)
        if state.resting:
            variance = np.diag(_SWING_IS_ZERO @ state.covariance @ _SWING_IS_ZERO.T) + self._sway_swing_density / dt_s
            if max(map(abs, swing_W)) > _FAR_SIGMAS * math.sqrt(variance.max()):
                state.rest, state.resting = Rest(), False  # a walk begins, before the rest detector knows
        if state.resting:
            innovation = np.array((*self.rate(state, state.rest.mean_w_B), *vec3.scaled(swing_W, -1.0)))
            density = np.repeat((self.rate_density(state), self._sway_swing_density), 3)
            fuse(state, _RATE_AND_SWING_ARE_ZERO, innovation, np.diag(density / dt_s))
        else:
            noise = self._swing_density(state, swing_W, dt_s) / dt_s * np.eye(3)
            fuse(state, _SWING_IS_ZERO, -np.array(swing_W), noise)

    def rate_density(self, state: AttitudeState) -> float:
        """Return n_r's variance density, rad²/s: of one who stands, or what the rate's scatter tells."""
        settings = self.settings
        return max(settings.sway_rate_radps_rts**2, settings.sway_rate_time_s * state.rest.rate_var)

    def _swing_density(self, state: AttitudeState, swing_W: Vec3, dt_s: float) -> float:
        """Return n_v's variance density, m²/s, from the mean square of the smoothed horizontal swing, brought up to
        date, and from its square now."""
        settings = self.settings
        smoothed = vec3.between(state.smooth_swing_W, swing_W, dt_s / (dt_s + settings.swing_smoothing_s))
        # a drifting bias, or a tilt, is not to make room for the velocity that it makes up
        square = min(smoothed[0] ** 2 + smoothed[1] ** 2, settings.most_swing_mps**2)
        state.smooth_swing_W = smoothed
        state.mean_square_swing += dt_s / (dt_s + settings.swing_average_s) * (square - state.mean_square_swing)
        knows_pace = state.pace_unknown_s <= 0.0 and self.knows_tilt(state, settings.usable_tilt_rad)
        time_s = settings.swing_time_s if knows_pace else settings.pace_swing_time_s
        return settings.swing_floor_mps_rts**2 + time_s * max(state.mean_square_swing, square)


def scale_var(state: AttitudeState) -> float:
    """Return the variance of the scale of distances; while the ground moves, that from before."""
    return state.ground.frozen_scale_var if state.ground.moves else float(state.covariance[SCALE, SCALE][0, 0])


def ground_var(usual_square: float) -> FloatArray:
    """Return the covariance (3, 3), (m/s²)², of the acceleration of a ground that moves, in W: half of it upwards."""
    return usual_square * np.diag((1.0, 1.0, 0.5))


def fuse(state: AttitudeState, H: FloatArray, innovation: FloatArray, noise: FloatArray) -> None:
    """Take a measurement H (m, SIZE) of the errors with the covariance `noise` (m, m), and correct the estimates."""
    P = state.covariance
    HP = H @ P
    K = np.linalg.solve(HP @ H.T + noise, HP).T
    P = P - K @ HP
    state.covariance = 0.5 * (P + P.T)
    error: list[float] = (K @ innovation).tolist()
    turn = so3.quaternion_from_rotvec(_vec3(error, ROTATION))
    turn_rows = so3.rows_from_quaternion(turn)
    state.q_WB = so3.normalised(so3.multiply(turn, state.q_WB))
    state.v_W = vec3.plus_scaled(so3.transform(turn_rows, state.v_W), _vec3(error, VELOCITY), 1.0)
    state.drift_W = vec3.plus_scaled(so3.transform(turn_rows, state.drift_W), _vec3(error, DRIFT), 1.0)
    state.gyro_bias = vec3.plus_scaled(state.gyro_bias, _vec3(error, GYRO_BIAS), 1.0)
    state.sf_bias = vec3.plus_scaled(state.sf_bias, _vec3(error, SF_BIAS), 1.0)
    state.gyro_matrix = tuple(map(operator.add, state.gyro_matrix, error[GYRO_MATRIX]))
    state.travel_W = vec3.plus_scaled(so3.transform(turn_rows, state.travel_W), _vec3(error, TRAVEL), 1.0)
    if state.q_WB_beginning is not None:
        turn = so3.quaternion_from_rotvec(_vec3(error, BEGINNING))
        state.q_WB_beginning = so3.normalised(so3.multiply(turn, state.q_WB_beginning))
    state.scale += error[SCALE.start]
    state.mount_B = vec3.plus_scaled(state.mount_B, _vec3(error, MOUNT), 1.0)
    state.ground.acceleration_W = vec3.plus_scaled(state.ground.acceleration_W, _vec3(error, GROUND), 1.0)
    state.ground.turn_radps += error[GROUND_TURN.start]
    state.lag_s += error[LAG.start]
    state.sf_W = specific_force_W(state)


def specific_force_W(state: AttitudeState) -> Vec3:
    """Return the newest sample's specific force in W, m/s², less the accelerometer's bias."""
    rows = so3.rows_from_quaternion(state.q_WB)
    return so3.transform(rows, vec3.minus(state.sf_measured, state.sf_bias))


def _vec3(values: list[float], part: slice) -> Vec3:
    x, y, z = values[part]
    return (x, y, z)

"""The equations of the attitude filter again, slowly: matrices throughout, one prediction a sample, matrix
exponentials, scalar measurements one by one in Joseph's form.

It starts from a state of the fast filter and goes on walking, or standing, as that state does; it knows neither
starts and stops nor gaps and clipping, and no camera: for that see `attitude_batch`.
"""

import numpy as np
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from messages import Residual
from messages.arrays import FloatArray
from perception.attitude.filter import AttitudeSettings, AttitudeState


class ReferenceAttitude:
    """R_WB (3, 3), v_W, u_W, b, a (3,), M (3, 3), and P (24, 24) of the errors θ, b, v, u, a, M."""

    def __init__(self, settings: AttitudeSettings, residual: Residual, start: AttitudeState) -> None:
        w, x, y, z = start.q_WB
        self.R_WB: FloatArray = Rotation.from_quat((x, y, z, w)).as_matrix()
        self.v_W = np.array(start.v_W)
        self.u_W = np.array(start.drift_W)
        self.b = np.array(start.gyro_bias)
        self.a = np.array(start.sf_bias)
        self.M = np.array(start.gyro_matrix).reshape(3, 3)
        self.P = start.covariance[:24, :24].copy()
        self._resting = start.resting
        self._rest = start.rest
        self._w_before = np.array(start.w_measured)
        self._sf_before = np.array(start.sf_measured)
        self._t_ns = start.t_ns or 0
        self._since_correction_s = 0.0
        self._mean_square_swing = start.mean_square_swing
        self._mean_square_speed = start.mean_square_speed
        self._pace_unknown_s = start.pace_unknown_s
        self._smooth_swing = np.array(start.smooth_swing_W)
        self._settings = settings
        self._scale = residual.scale

    def update(self, t_ns: int, sf: FloatArray, w: FloatArray) -> None:
        """Take one sample."""
        dt = 1e-9 * (t_ns - self._t_ns)
        self._t_ns = t_ns
        sf_x, sf_y, sf_z = sf
        w_x, w_y, w_z = w
        self._rest.update(self._settings.rest, (sf_x, sf_y, sf_z), (w_x, w_y, w_z), dt)
        self._predict(sf, w, dt)
        self._since_correction_s += dt
        if self._since_correction_s >= self._settings.correction_s:
            self._measure(self._since_correction_s)
            self._since_correction_s = 0.0

    def _predict(self, sf: FloatArray, w: FloatArray, dt: float) -> None:
        s = self._settings
        w_mid = (self._w_before + w) / 2.0
        sf_W_before = self.R_WB @ (self._sf_before - self.a)
        self.R_WB = self.R_WB @ Rotation.from_rotvec(self._rate(w_mid) * dt).as_matrix()
        acceleration = (sf_W_before + self.R_WB @ (sf - self.a)) / 2.0 - (0.0, 0.0, s.gravity_mps2)
        self.v_W = self.v_W + acceleration * dt
        w_change = s.gyro_scale_time_s * (w - self._w_before) / dt
        self._w_before, self._sf_before = w, sf

        most, time_s = s.moving_start_speed_mps**2, s.drift_time_s
        square = min((self.v_W[0] ** 2 + self.v_W[1] ** 2) / 2.0, most)
        self._mean_square_speed += dt / (dt + s.drift_average_s) * (square - self._mean_square_speed)
        drift_var = min(most, s.drift_floor_mps**2 + max(square, self._mean_square_speed))
        if self._resting:
            drift_var, time_s, self._mean_square_speed = s.sway_mps**2, s.sway_time_s, most
        elif self._pace_unknown_s > 0.0:
            drift_var, time_s, self._mean_square_speed = most, s.pace_time_s, most
        self._pace_unknown_s -= dt
        yaw_rate = self.R_WB[2] @ self._rate(w_mid)
        A = np.zeros((24, 24))
        A[0:3, 3:6] = -self.R_WB
        A[0:3, 15:24] = -np.kron(self.R_WB, w_mid[np.newaxis])
        A[6:9, 0:3] = s.gravity_mps2 * np.cross(np.eye(3), (0.0, 0.0, 1.0)).T  # column i: e_i × e_z
        A[6:9, 12:15] = -self.R_WB
        A[9:12, 9:12] = yaw_rate * np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))) - np.eye(3) / time_s
        F = expm(A * dt)
        self.u_W = F[9:12, 9:12] @ self.u_W
        Q = np.zeros(24)
        squares = w_mid @ w_mid + w_change @ w_change
        Q[0:3] = s.gyro_noise_radps_rthz**2 + self._scale**2 * s.gyro_scale_time_s * squares
        Q[3:6] = s.gyro_bias_walk_radps_rts**2
        Q[6:9] = s.sf_noise_mps2_rthz**2 + self._scale**2 * s.sf_scale_time_s * (acceleration @ acceleration)
        Q[9:12] = 2.0 * drift_var / time_s
        Q[12:15] = s.sf_bias_walk_mps2_rts**2
        self.P = F @ self.P @ F.T + np.diag(Q * dt)

    def _measure(self, dt: float) -> None:
        s = self._settings
        identity = np.eye(24)
        swing = self.v_W - self.u_W
        measurements: list[tuple[FloatArray, float, float]] = []
        if self._resting:
            rate = self._rate(np.array(self._rest.mean_w_B))
            rate_density = max(s.sway_rate_radps_rts**2, s.sway_rate_time_s * self._rest.rate_var)
            measurements += [(identity[3 + i], rate[i], rate_density / dt) for i in range(3)]
            density = s.sway_swing_mps_rts**2
        else:
            self._smooth_swing += dt / (dt + s.swing_smoothing_s) * (swing - self._smooth_swing)
            square = self._smooth_swing[0] ** 2 + self._smooth_swing[1] ** 2
            self._mean_square_swing += dt / (dt + s.swing_average_s) * (square - self._mean_square_swing)
            time_s = s.pace_swing_time_s if self._pace_unknown_s > 0.0 else s.swing_time_s
            density = s.swing_floor_mps_rts**2 + time_s * max(square, self._mean_square_swing)
        measurements += [(identity[6 + i] - identity[9 + i], -swing[i], density / dt) for i in range(3)]
        error = np.zeros(24)
        for h, value, variance in measurements:
            k = self.P @ h / (h @ self.P @ h + variance)
            error += k * (value - h @ error)
            joseph = identity - np.outer(k, h)
            self.P = joseph @ self.P @ joseph.T + variance * np.outer(k, k)
        turn = Rotation.from_rotvec(error[0:3]).as_matrix()
        self.R_WB = turn @ self.R_WB
        self.b = self.b + error[3:6]
        self.v_W = turn @ self.v_W + error[6:9]
        self.u_W = turn @ self.u_W + error[9:12]
        self.a = self.a + error[12:15]
        self.M = self.M + error[15:24].reshape(3, 3)

    def _rate(self, w: FloatArray) -> FloatArray:
        rate: FloatArray = w - self.M @ w - self.b
        return rate

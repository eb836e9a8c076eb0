"""What the camera saw of its own motion, as a measurement of the attitude filter: told late, between two exposures.

Over a step from 0 to 1, T long, the odometer saw the camera turn by φ and travel by d, both in B₀. With p the
displacement of B since 0, l where in B the camera is, q = p + R₁ l, s the error of the scale of its distances, m the
small turn of the camera on its mount, ρ the rate at which the ground turns about the vertical, λ how much later than
stamped the pictures are and κ what samples lose of an acceleration a, by κ ä, in W:

    R₀ (1 + [m]×) d = (1 + s)(q − R₀ l − κ (a₁ − a₀)) + λ (v₁ − v₀) + n_d,
    R₀ exp(φ + m × φ) R₀ᵀ = exp(−ρ T e_z) R₁ R₀ᵀ exp(λ (ω₁ − ω₀) + n_φ)                                        (5)

With invariant errors θ₀, θ₁ of both attitudes and δp, the innovations depend on them by

    y_d = (θ₁ − θ₀) × q + δp + (q − R₀ l) δs + R₀ (d × δm) + (v₁ − v₀) δλ,
    y_φ = θ₁ − θ₀ − T e_z δρ + R₀ (φ × δm) + (ω₁ − ω₀) δλ                                                      (6)
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from messages import Vec3
from messages import vec3 as to_vec3
from messages.arrays import FloatArray
from perception import so3, vec3
from perception.attitude.agreement import Innovation
from perception.attitude.causes import follow_ground, judge_distances, look_for_causes, squares, squares_by_part
from perception.attitude.error_state import BEGINNING, GROUND_TURN, LAG, MOUNT, ROTATION, SCALE, SIZE, TRAVEL
from perception.attitude.history import AttitudeAt
from perception.attitude.kalman import AttitudeKalman, fuse
from perception.attitude.state import AttitudeState, CameraStepSettings

DOUBTFUL_RADPS = 0.05
"""Of a turn that rests on wrong distances: where eyes have slipped, or stand askew, it was off by 0.02 rad/s on tuning
walks, a pair of different instants left out."""


@dataclass(frozen=True)
class CameraStep:
    """The turn (rotation vector, rad) and the travel (m) of the camera between two instants, both (3,) in B as it was
    at the first. `covariance` (6, 6) is that of both, turn first; `p_BC_m` is where in B the camera's centre is. By
    `common_rad` (1 σ) the turns of some steps err alike."""

    t_before_ns: int
    t_after_ns: int
    turn_B: Vec3
    travel_B: Vec3
    covariance: FloatArray
    p_BC_m: Vec3
    common_rad: float = 0.0

    @property
    def duration_s(self) -> float:
        """Return how long the step lasted."""
        return 1e-9 * (self.t_after_ns - self.t_before_ns)

    def turn_alone(self) -> "CameraStep":
        """Return what is left of the step where distances are wrong: a turn at a rate off by `DOUBTFUL_RADPS`."""
        turn_var = (DOUBTFUL_RADPS * self.duration_s) ** 2
        doubtful = np.diag((turn_var, turn_var, turn_var, _NOTHING_M2, _NOTHING_M2, _NOTHING_M2))
        return replace(self, covariance=self.covariance + doubtful)

    def with_velocity(self, attitude: AttitudeAt) -> AttitudeAt:
        """Return `attitude`, that of the step's end, with the mean velocity of B on the way: by (5), without any error,
        p = R₀ (d + l) − R₁ l over T."""
        R1 = attitude.R_WB
        R0 = R1 @ so3.exp(np.array(self.turn_B)).T
        p_W_m = R0 @ np.add(self.travel_B, self.p_BC_m) - R1 @ self.p_BC_m
        return attitude._replace(v_W_mps=to_vec3(p_W_m / self.duration_s))


def begin_step(kalman: AttitudeKalman, state: AttitudeState) -> None:
    """Let a step of the camera begin at the newest sample: p = 0, and the attitude of now, with its error, is R₀."""
    kalman.correct(state)
    state.travel_W, state.q_WB_beginning = vec3.ZERO, state.q_WB
    state.v_W_beginning, state.w_W_beginning, state.sf_W_beginning = state.v_W, _rate_W(kalman, state), state.sf_W
    P = state.covariance
    P[TRAVEL, :] = P[:, TRAVEL] = 0.0
    P[BEGINNING, :] = P[ROTATION, :]
    P[:, BEGINNING] = P[:, ROTATION]


def measure_step(
    kalman: AttitudeKalman, state: AttitudeState, step: CameraStep, *, believed: bool = True
) -> Innovation | None:
    """Take (5) where a step began at its first instant and the newest sample is at its second; look for what
    contradicts it.

    Where the IMU is not `believed`, nothing is corrected. Returns what the step said; None where no step began.
    """
    if state.q_WB_beginning is None:
        return None
    kalman.correct(state)
    settings = kalman.settings.camera
    H, innovation, noise = _measured(kalman, state, step)
    likely = H @ state.covariance @ H.T + noise
    by_part = squares_by_part(innovation, likely)
    explained = believed and look_for_causes(kalman, state, step.duration_s, innovation, likely, by_part, H)
    if explained:
        likely = H @ state.covariance @ H.T + noise
        by_part = squares_by_part(innovation, likely)
    if believed and squares(innovation, likely) <= settings.refused_sigmas**2:
        noise = _robust(noise, by_part, settings)
        if state.ground.moves:  # an error correlated over τ counts as white noise of the density 2 σ² τ
            noise[:3, :3] += np.eye(3) * 2.0 * settings.lean_radps**2 * settings.lean_time_s * step.duration_s
        fuse(state, H, innovation, noise)
        follow_odometer_scale(state, step, settings)
        judge_distances(kalman, state)
        state.without_camera_s = state.unwatched_s = 0.0
    follow_ground(kalman, state, step.duration_s)
    turned_W = so3.transform(so3.rows_from_quaternion(state.q_WB), step.turn_B)
    turn_squares, travel_squares = by_part
    return Innovation(
        step.duration_s,
        np.array(turned_W),
        _weight(step, settings) * innovation[:3],
        turn_squares / 3.0,
        travel_squares / 3.0,
        explained,
    )


def _rate_W(kalman: AttitudeKalman, state: AttitudeState) -> Vec3:
    return so3.transform(so3.rows_from_quaternion(state.q_WB), kalman.rate(state, state.w_measured))


def _measured(
    kalman: AttitudeKalman, state: AttitudeState, step: CameraStep
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return H (6, SIZE) of (6), the innovation (6,) of (5) and the noise's covariance (6, 6), turn first, in W."""
    R0, R1 = so3.matrix_from_quaternion(state.q_WB_beginning or so3.IDENTITY), so3.matrix_from_quaternion(state.q_WB)
    turn_B, travel_B = (_turned(seen, state.mount_B) for seen in (step.turn_B, step.travel_B))
    lever_0_W, lever_1_W = R0 @ step.p_BC_m, R1 @ step.p_BC_m
    q = np.array(state.travel_W) + lever_1_W
    settings = kalman.settings.camera
    lost_W = settings.sf_lost_s2 * np.array(vec3.minus(state.sf_W, state.sf_W_beginning))
    travel_W = q - lever_0_W - lost_W
    H = _CONSTANT_H.copy()
    H[2, GROUND_TURN] = -step.duration_s
    H[:3, MOUNT] = R0 @ so3.skew(turn_B)
    H[3:, BEGINNING] = by_turn = so3.skew(q)
    H[3:, ROTATION] = -by_turn
    H[3:, SCALE.start] = travel_W
    H[3:, MOUNT] = R0 @ so3.skew(travel_B)
    H[:, LAG.start] = by_lag = _by_lag(kalman, state, to_vec3(lever_0_W), to_vec3(lever_1_W))
    ground_turned = so3.exp(np.array((0.0, 0.0, state.ground.turn_radps * step.duration_s)))
    seen_W = ground_turned @ R0 @ so3.exp(turn_B) @ R1.T
    innovation = np.concatenate((so3.log(seen_W), R0 @ travel_B - (1.0 + state.scale) * travel_W))
    innovation -= state.lag_s * by_lag
    return H, innovation, settings.noise_factor**2 * so3.pair_covariance_turned(R0, step.covariance)


def _by_lag(kalman: AttitudeKalman, state: AttitudeState, lever_0_W: Vec3, lever_1_W: Vec3) -> FloatArray:
    """Return how turn and travel (6,) change with the time of a step: (ω₁ − ω₀, v₁ − v₀) of the camera."""
    w_0, w_1 = state.w_W_beginning, _rate_W(kalman, state)
    v_0 = vec3.plus_scaled(state.v_W_beginning, vec3.cross(w_0, lever_0_W), 1.0)
    v_1 = vec3.plus_scaled(state.v_W, vec3.cross(w_1, lever_1_W), 1.0)
    return np.array((*vec3.minus(w_1, w_0), *vec3.minus(v_1, v_0)))


def _weight(step: CameraStep, settings: CameraStepSettings) -> float:
    """Return the weight of a turn in a sum of turns, 1 where steps share no error: one that they share adds up."""
    return 1.0 / (1.0 + (step.common_rad / (settings.doubtful_radps * step.duration_s)) ** 2)


def _robust(noise: FloatArray, by_part: tuple[float, float], settings: CameraStepSettings) -> FloatArray:
    """Return the noise as large as makes a turn or travel, of these squares, count for no more than `usual_sigmas`
    (Huber)."""
    turn, travel = (max(1.0, math.sqrt(square) / settings.usual_sigmas) for square in by_part)
    by = np.array((turn, turn, turn, travel, travel, travel))
    larger: FloatArray = by[:, None] * noise * by
    return larger


def follow_odometer_scale(state: AttitudeState, step: CameraStep, settings: CameraStepSettings) -> None:
    """Bring up to date what the odometer's own scale may err by: each step counts by its travel over its noise, as it
    does for the scale of distances; none while the ground moves."""
    if state.ground.moves:
        return
    noise_var_m2 = float(np.trace(step.covariance[3:, 3:])) / 3.0
    may_err = settings.odometer_scale * math.sqrt(noise_var_m2) / (settings.odometer_noise_mps * step.duration_s)
    weight = vec3.square(step.travel_B) / noise_var_m2
    state.scale_weight += weight
    if weight > 0.0:
        state.odometer_scale += weight / state.scale_weight * (may_err - state.odometer_scale)


def _turned(vector_B: Vec3, mount_B: Vec3) -> FloatArray:
    return np.array(vec3.plus_scaled(vector_B, vec3.cross(mount_B, vector_B), 1.0))


_CONSTANT_H = np.zeros((6, SIZE))
_CONSTANT_H[:3, ROTATION] = _CONSTANT_H[3:, TRAVEL] = np.eye(3)
_CONSTANT_H[:3, BEGINNING] = -np.eye(3)
"""What of H of (6) is the same in every step."""
_NOTHING_M2 = 1e4
"""A variance of the travel that says nothing."""

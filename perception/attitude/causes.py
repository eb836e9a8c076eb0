"""Why steps of the camera contradict the filter: a bias that jumps, a ground that moves, a camera that slips.

Noise of odometry and errors of the filter explain each innovation y of a step of T; that many in a row lean one way,
they do not. With L the innovations' covariance and G what a cause does to them,

    S_k = exp(−T/τ) S_(k−1) + Gᵀ L⁻¹ y_k                                                                       (7)

tells, beyond its own deviation, of a turn (the gyroscope's bias has jumped, or the ground turns), of a travel (the
ground accelerates: a bus, a lift) or of a camera that has slipped on its mount. What the likeliest cause would change
is then let free in the filter, whose next steps say how much it is.

A slip by an angle θ shows as the share θ of each turn. While the wearer stands there is hardly a turn, and that share
is less than what successive steps err by alike, since the same corners are matched alike. Such an error is no evidence
of a slip: its variance is added to L in the sum for one.
"""

import math

import numpy as np

from messages import vec3 as to_vec3
from messages.arrays import FloatArray
from perception import so3, vec3
from perception.attitude.accelerometer import CROSS_UP
from perception.attitude.error_state import (
    BEGINNING,
    GROUND,
    GROUND_TURN,
    GYRO_BIAS,
    MOUNT,
    ROTATION,
    SCALE,
    SF_BIAS,
    VELOCITY,
)
from perception.attitude.kalman import AttitudeKalman, fuse, ground_var, scale_var
from perception.attitude.state import AttitudeState, CameraStepSettings, Contradiction, Contradictions, GroundMotion


def look_for_causes(
    kalman: AttitudeKalman,
    state: AttitudeState,
    duration_s: float,
    innovation: FloatArray,
    likely: FloatArray,
    by_part: tuple[float, float],
    H: FloatArray,
) -> bool:
    """Take an innovation (6,), turn first, of covariance `likely` (6, 6), into (7); let free what explains the sums
    best, if one is unlikely. Returns whether something was let free. `by_part` is what `squares_by_part` returns of
    both, H (6, SIZE) that of the measurement."""
    settings, found = kalman.settings.camera, state.contradictions
    information: FloatArray = np.linalg.inv(likely).astype(np.float64, copy=False)
    shortened = [min(1.0, settings.counted_sigmas / math.sqrt(max(square, 1.0))) for square in by_part]
    bounded = innovation * np.repeat(shortened, 3)
    by_slip = _BY_TURN @ H[:3, MOUNT]  # what it does to the travel, a start does as well
    fade, slow_fade = (math.exp(-duration_s / each_s) for each_s in (settings.memory_s, settings.slip_memory_s))
    state.explained_s += duration_s
    found.missing_rad = fade * found.missing_rad + innovation[:3]
    turn = _unlikely(_add(found.turn, fade, _BY_TURN, information, bounded), settings.far_sigmas)
    travel = _unlikely(_add(found.travel, fade, _BY_TRAVEL, information, bounded), settings.far_sigmas)
    shared_var = np.repeat(((settings.shared_radps * duration_s) ** 2, 0.0), 3)
    beyond_shared: FloatArray = np.linalg.inv(likely + np.diag(shared_var)).astype(np.float64, copy=False)
    slip = _unlikely(_add(found.slip, slow_fade, by_slip, beyond_shared, bounded), settings.slip_sigmas)
    most = max(turn, travel, slip)
    if most == 0.0 or state.explained_s < settings.explain_again_s:
        return False
    if most == turn:
        _doubt_turn(kalman, state, duration_s)
    elif most == travel:
        _doubt_ground(state, settings)
    else:
        state.covariance[MOUNT, MOUNT] += np.eye(3) * settings.slip_rad**2
    state.contradictions, state.explained_s = Contradictions(), 0.0
    return True


def _unlikely(square: float, sigmas: float) -> float:
    """Return the square of a sum over its deviation where that is unlikely, 0 where it is not."""
    return square if square > sigmas**2 else 0.0


def squares(innovation: FloatArray, likely: FloatArray) -> float:
    """Return the square of an innovation (n,) over its covariance `likely` (n, n)."""
    return float(innovation @ np.linalg.solve(likely, innovation))


def squares_by_part(innovation: FloatArray, likely: FloatArray) -> tuple[float, float]:
    """Return the squares of the turn and of the travel in an innovation (6,), each over its own covariance."""
    turn, travel = slice(0, 3), slice(3, 6)
    return squares(innovation[turn], likely[turn, turn]), squares(innovation[travel], likely[travel, travel])


def _add(
    found: Contradiction, fade: float, cause: FloatArray, information: FloatArray, innovation: FloatArray
) -> float:
    """Take one innovation into (7), with G = `cause` (6, 3); return the square of the sum over its deviation."""
    weight = cause.T @ information
    found.total = fade * found.total + weight @ innovation
    found.covariance = fade**2 * found.covariance + weight @ cause
    return float(found.total @ np.linalg.lstsq(found.covariance, found.total, rcond=_RCOND)[0])


def _doubt_turn(kalman: AttitudeKalman, state: AttitudeState, duration_s: float) -> None:
    """Let the gyroscope's bias be unknown, and the tilt that it has made; and the ground turn, where it would do so
    faster than biases jump.

    A ground that had only just begun to move did not, where a tilt that such a bias has made explains its acceleration.
    """
    settings, turn, ground = kalman.settings, state.contradictions.turn, state.ground
    missing_rad, yaw_rate_radps = state.contradictions.missing_rad, turn.total[2] / turn.covariance[2, 2] / duration_s
    if ground.moves and ground.moving_s < settings.camera.ground_doubtful_s:
        by_tilt_W = -settings.gravity_mps2 * CROSS_UP @ missing_rad
        if _is_explained(np.array(ground.acceleration_W), by_tilt_W, settings.camera.ground_at_rest_mps2):
            _rest_ground(kalman, state, 0.0, _MOST_FOLLOWED * math.hypot(missing_rad[0], missing_rad[1]))
    P, tilted_rad = state.covariance, missing_rad * _TILT
    P[GYRO_BIAS, GYRO_BIAS] += np.eye(3) * settings.gyro_bias_radps**2
    _doubt_tilt(P, np.outer(tilted_rad, tilted_rad))
    since_s = min(settings.camera.memory_s, state.explained_s)
    P[VELOCITY, VELOCITY] += (settings.gravity_mps2 * math.hypot(*tilted_rad) * since_s / 2.0) ** 2 * np.diag(_TILT)
    if abs(yaw_rate_radps) > settings.camera.least_ground_turn_radps:
        _doubt_ground(state, settings.camera)


def _is_explained(acceleration_W: FloatArray, by_tilt_W: FloatArray, usual_mps2: float) -> bool:
    """Return whether an acceleration (3,) is no more than `usual_mps2`, or most of it lies along one that a tilt makes
    and is not far larger: the bias has been followed for a while, and what is left of it is less than it was."""
    most = float(by_tilt_W @ by_tilt_W)
    share = float(np.clip(acceleration_W @ by_tilt_W / most, 0.0, _MOST_FOLLOWED)) if most > 0.0 else 0.0
    left_mps2 = math.dist(acceleration_W, share * by_tilt_W)
    return math.hypot(*acceleration_W) < usual_mps2 or left_mps2 < share * math.sqrt(most)


def _doubt_ground(state: AttitudeState, settings: CameraStepSettings) -> None:
    """Let the ground accelerate and turn: velocity tells little of the vertical now, the gyroscope carries it.

    It tells nothing of the scale of distances, which stays as it is.
    """
    P, ground = state.covariance, state.ground
    ground.usual_square = settings.ground_mps2**2
    P[GROUND, GROUND] += ground_var(ground.usual_square)
    P[VELOCITY, VELOCITY] += np.eye(3) * settings.ground_jump_mps**2
    tilted_rad = state.contradictions.missing_rad * _TILT
    _doubt_tilt(P, settings.jump_tilt_rad**2 * np.diag(_TILT) + np.outer(tilted_rad, tilted_rad))
    P[GYRO_BIAS, GYRO_BIAS] += np.eye(3) * settings.ground_jump_radps**2
    if not ground.moves:
        ground.moves, ground.frozen_scale_var = True, float(P[SCALE, SCALE][0, 0])
        P[SCALE, :] = P[:, SCALE] = 0.0
        P[GROUND_TURN, GROUND_TURN] = settings.ground_turn_radps**2
    state.ground.calm_s = 0.0


def _doubt_tilt(P: FloatArray, tilt_var: FloatArray) -> None:
    """Add to the covariance (3, 3) of the attitude, which was as wrong when the step began as it is now."""
    for one in (ROTATION, BEGINNING):
        for other in (ROTATION, BEGINNING):
            P[one, other] += tilt_var


def follow_ground(kalman: AttitudeKalman, state: AttitudeState, duration_s: float) -> None:
    """Count how often the ground's acceleration turns round; let it be at rest again once that is small for long."""
    settings, ground = kalman.settings.camera, state.ground
    if not ground.moves:
        return
    _count_reversals(ground, duration_s, settings)
    _smooth(state, duration_s, settings)
    calm = math.hypot(*ground.smooth_B) < settings.ground_at_rest_mps2
    calm = calm and abs(ground.turn_radps) < settings.ground_at_rest_radps
    ground.calm_s = ground.calm_s + duration_s if calm else 0.0
    if ground.calm_s > settings.ground_at_rest_s or _is_bias(ground, settings):
        _rest_ground(kalman, state, math.hypot(*ground.acceleration_W), settings.lean_radps * ground.moving_s)


def _smooth(state: AttitudeState, duration_s: float, settings: CameraStepSettings) -> None:
    """Smooth the ground's acceleration, in B, and count for how long it has been about the same there."""
    ground, R_WB = state.ground, so3.matrix_from_quaternion(state.q_WB)
    gain = min(1.0, duration_s / settings.ground_smoothing_s)
    ground.smooth_B = vec3.between(ground.smooth_B, to_vec3(R_WB.T @ ground.acceleration_W), gain)
    ground.steady_s += duration_s
    ground.steady_gain_B = vec3.plus_scaled(ground.steady_gain_B, ground.smooth_B, duration_s)
    if math.dist(ground.smooth_B, ground.steady_B) > settings.ground_steady_mps2:
        ground.steady_B, ground.steady_s, ground.steady_gain_B = ground.smooth_B, 0.0, vec3.ZERO


def _is_bias(ground: GroundMotion, settings: CameraStepSettings) -> bool:
    """Return whether the acceleration has been the same in B for longer, and up to a higher speed, than any vehicle's:
    the accelerometer's bias has jumped."""
    speed_mps = math.hypot(*ground.steady_gain_B)
    return ground.steady_s > settings.ground_steady_s and speed_mps > settings.ground_steady_mps


def _rest_ground(kalman: AttitudeKalman, state: AttitudeState, bias_mps2: float, tilt_rad: float) -> None:
    """Let the ground be at rest: what was taken for its acceleration c was the accelerometer's bias and a tilt, each as
    large as these, 1 σ. By (3) δc = g θ × e_z − R_WB δa."""
    settings, ground, P = kalman.settings, state.ground, state.covariance
    possible = np.zeros((len(P), 6))
    possible[SF_BIAS, :3] = bias_mps2 * np.eye(3)
    possible[GROUND, :3] = -bias_mps2 * so3.matrix_from_quaternion(state.q_WB)
    possible[ROTATION, 3:] = tilt_rad * np.diag((1.0, 1.0, 0.0))
    possible[GROUND, 3:] = settings.gravity_mps2 * tilt_rad * CROSS_UP
    state.covariance = P + possible @ possible.T
    at_rest = np.eye(len(P))[GROUND]
    fuse(state, at_rest, -np.array(ground.acceleration_W), settings.camera.ground_rest_mps2**2 * np.eye(3))
    state.covariance[SCALE, SCALE] = scale_var(state)
    for part in (GROUND, GROUND_TURN):
        state.covariance[part, :] = state.covariance[:, part] = 0.0
    state.ground, state.contradictions = GroundMotion(), Contradictions()


def _count_reversals(ground: GroundMotion, duration_s: float, settings: CameraStepSettings) -> None:
    ground.reversals *= math.exp(-duration_s / settings.reversal_memory_s)
    along = vec3.dot(ground.acceleration_W, ground.extreme_W)
    if along < -settings.reversal_mps2 * math.hypot(*ground.extreme_W):
        ground.reversals += 1.0
        ground.extreme_W = ground.acceleration_W
    elif vec3.square(ground.acceleration_W) > vec3.square(ground.extreme_W):
        ground.extreme_W = ground.acceleration_W
    most = settings.few_reversals if ground.goes_to_and_fro else settings.most_reversals
    ground.goes_to_and_fro = ground.reversals > most


def ground_is_plausible(kalman: AttitudeKalman, state: AttitudeState) -> bool:
    """Return whether the ground moves as one may: if not, the accelerometer is wrong."""
    settings, ground = kalman.settings.camera, state.ground
    if ground.goes_to_and_fro:
        return False
    deviations = np.sqrt(np.diag(state.covariance[GROUND, GROUND])).tolist()
    known = [abs(a) - _FAR_SIGMAS * sigma for a, sigma in zip(ground.acceleration_W, deviations, strict=True)]
    drives = zip(known, settings.most_ground_mps2, strict=True)
    speeds = zip(ground.velocity_W, settings.most_ground_mps, strict=True)
    return all(abs(value) <= most for value, most in (*drives, *speeds))


def has_slipped(kalman: AttitudeKalman, state: AttitudeState) -> bool:
    """Return whether the camera is known to have turned on its mount by more than the calibration allows: by the
    deviation of what it is known of along the turn."""
    settings, turned_rad = kalman.settings.camera, math.hypot(*state.mount_B)
    if turned_rad <= settings.most_slip_rad:
        return False
    along_B = np.array(state.mount_B) / turned_rad
    deviation_rad = math.sqrt(along_B @ state.covariance[MOUNT, MOUNT] @ along_B)
    return turned_rad > settings.most_slip_rad + _FAR_SIGMAS * math.hypot(kalman.mount_rad, deviation_rad)


def judge_distances(kalman: AttitudeKalman, state: AttitudeState) -> None:
    """Hold the camera's distances for wrong from where their scale is beyond what the calibration leaves, as well as
    it is known, until it is known and well within."""
    settings, deviation = kalman.settings.camera, kalman.scale_deviation(state)
    were_wrong = state.distances_are_wrong
    sigmas = settings.right_scale_sigmas if were_wrong else settings.wrong_scale_sigmas
    beyond = abs(state.scale) > sigmas * math.hypot(kalman.calibrated_scale, deviation)
    state.distances_are_wrong = beyond or (were_wrong and deviation > settings.known_scale)


def doubt_distances(settings: CameraStepSettings, state: AttitudeState) -> None:
    """Let the scale of the camera's distances be unknown, and hold them for wrong until it is known."""
    state.distances_are_wrong = True
    if state.ground.moves:
        state.ground.frozen_scale_var += settings.doubtful_scale**2
    else:
        state.covariance[SCALE, SCALE] += settings.doubtful_scale**2


def distance_scale(kalman: AttitudeKalman, state: AttitudeState) -> float:
    """Return by what share the camera's distances are likely too long: what was found, by its weight beside what the
    calibration leaves."""
    calibrated_var, found_var = kalman.calibrated_scale**2, kalman.scale_deviation(state) ** 2
    return calibrated_var / (calibrated_var + found_var) * state.scale


_FAR_SIGMAS = 3.0
"""Standard deviations that an error of the calibration, or of an estimate, may have."""
_TILT = np.array((1.0, 1.0, 0.0))
"""What of a small rotation in W is tilt, by component."""
_BY_TURN, _BY_TRAVEL = np.eye(6)[:, :3], np.eye(6)[:, 3:]
"""G of (7) for a turn and a travel in W, each (6, 3)."""
_MOST_FOLLOWED = 2.0
"""So many times what is left of a jump it may have been."""
_RCOND = 1e-9
"""Below this share of the largest, a direction of a cause has not shown at all."""

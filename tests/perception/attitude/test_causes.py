"""Why steps of the camera contradict: a bias that jumps, a ground that moves, a camera that slips, a wrong scale."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from messages import Reason, Residual, vec3
from perception import so3
from perception.attitude.beginning import after_gap
from perception.attitude.causes import (
    _doubt_ground,
    distance_scale,
    doubt_distances,
    follow_ground,
    has_slipped,
    judge_distances,
    look_for_causes,
    squares_by_part,
)
from perception.attitude.error_state import MOUNT, SCALE, SIZE
from perception.attitude.kalman import AttitudeKalman
from perception.attitude.state import AttitudeSettings, AttitudeState, GroundMotion
from perception.motion.ego_motion import EgoMotion
from sim_rig.unit import RESIDUAL
from tests.bench.seen_motion import R_BC, WALKING_NS, SampleAt, gait
from tests.bench.told_track import Alter, Followed, follow

S = 1_000_000_000
WALK = gait(5)


def _since_walking_s(t_ns: int) -> float:
    return 1e-9 * (t_ns - WALKING_NS)


def rated(w_B_radps: tuple[float, float, float]) -> Alter:
    """Return samples whose gyroscope's bias has jumped a second after full pace."""

    def alter(arrival: SampleAt | EgoMotion) -> SampleAt | EgoMotion:
        if isinstance(arrival, EgoMotion) or _since_walking_s(arrival.t_ns) < 1.0:
            return arrival
        return replace(arrival, w_B_radps=vec3(np.add(arrival.w_B_radps, w_B_radps)))

    return alter


def riding(acceleration_W: Callable[[float], np.ndarray], turn_radps: Callable[[float], float]) -> Alter:
    """Return samples as on a ground that accelerates and turns about the vertical, by the seconds since full pace."""

    def alter(arrival: SampleAt | EgoMotion) -> SampleAt | EgoMotion:
        if isinstance(arrival, EgoMotion):
            return arrival
        t_s, R_BW = _since_walking_s(arrival.t_ns), WALK.at(np.array([arrival.t_ns])).R_WB[0].T
        return replace(
            arrival,
            sf_B_mps2=vec3(arrival.sf_B_mps2 + R_BW @ acceleration_W(t_s)),
            w_B_radps=vec3(arrival.w_B_radps + R_BW @ (0.0, 0.0, turn_radps(t_s))),
        )

    return alter


def remounted(angle_rad: float, axis_B: tuple[float, float, float]) -> Alter:
    """Return what is seen by a camera that turns on its mount, about the IMU, a second after full pace."""
    x, y, z = angle_rad * np.array(axis_B)
    turn = np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
    R = R_BC.T @ turn.T @ R_BC

    def alter(arrival: SampleAt | EgoMotion) -> SampleAt | EgoMotion:
        if isinstance(arrival, SampleAt) or _since_walking_s(arrival.t_before_ns) < 1.0:
            return arrival
        return replace(arrival, w_C_radps=R @ arrival.w_C_radps, v_C_mps=R @ arrival.v_C_mps)

    return alter


def pulse(t_s: float, from_s: float, to_s: float) -> float:
    """Return 1 between two instants, reached within 0.5 s."""
    return float(np.clip((t_s - from_s) / 0.5, 0.0, 1.0) - np.clip((t_s - to_s) / 0.5, 0.0, 1.0))


def worst(followed: list[Followed], since_s: float = 0.0) -> float:
    return max(step.tilt_deg for step in followed if _since_walking_s(step.t_ns) > since_s)


@pytest.mark.parametrize("jump_degps", [(1.5, 0.0, 0.0), (0.0, -1.0, 0.0), (-1.0, 1.0, 1.0)])
def test_a_bias_that_jumps_is_followed_without_an_alarm(jump_degps: tuple[float, float, float]) -> None:
    x, y, z = np.radians(jump_degps)
    followed = follow(WALKING_NS + 6 * S, rated((x, y, z)))
    assert {step.reason for step in followed} == {Reason.NONE}
    assert worst(followed) < 1.2
    assert worst(followed, since_s=4.5) < 0.5


@pytest.mark.parametrize(
    "jump_degps", [(5.0, 0.0, 0.0), (0.0, 5.0, 0.0), (0.0, 3.0, 0.0), (3.0, 3.0, 0.0), (1.5, 1.5, 0.0)]
)
def test_the_tilt_that_a_bias_has_made_is_corrected_once_the_bias_is_found(
    jump_degps: tuple[float, float, float],
) -> None:
    """Neither a ground that moves nor a camera that has slipped is named instead."""
    x, y, z = np.radians(jump_degps)
    followed = follow(WALKING_NS + 5 * S, rated((x, y, z)))
    assert worst(followed, since_s=2.0) < 0.5
    assert followed[-1].reason is Reason.NONE
    assert not followed[-1].ground_moves


@pytest.mark.parametrize(
    ("acceleration", "turn_degps"),
    [((1.2, 0.0, 0.0), 0.0), ((0.0, 0.3, 0.0), 0.0), ((0.0, 0.0, 1.0), 0.0), ((0.0, 1.5, 0.0), 20.0)],
    ids=["bus", "slow bus", "lift", "bus that turns"],
)
def test_a_ground_that_moves_is_noticed_and_the_gyroscope_carries_the_vertical(
    acceleration: tuple[float, float, float], turn_degps: float
) -> None:
    a_W, w = np.array(acceleration), np.radians(turn_degps)
    ride = riding(lambda t_s: a_W * pulse(t_s, 1.0, 4.0), lambda t_s: w * pulse(t_s, 1.0, 4.0))
    followed = follow(WALKING_NS + 6 * S, ride)
    assert sum(step.reason is not Reason.NONE for step in followed) < 0.1 * len(followed)
    assert any(step.ground_moves for step in followed)
    assert worst(followed) < 1.0


@pytest.mark.parametrize(
    ("bias_mps2", "since_s", "rate_degps"),
    [(0.6, 1.8, (2.0, 0.0, 0.0)), (1.0, 1.8, (2.0, 0.0, 0.0)), (1.0, 1.5, (0.0, 1.5, 0.0))],
    ids=["another direction", "another direction, twice as large", "too small"],
)
def test_a_turn_that_made_no_such_tilt_leaves_the_ground_moving(
    bias_mps2: float, since_s: float, rate_degps: tuple[float, float, float]
) -> None:
    """A bias of the accelerometer that jumps looks like a ground that moves; a bias of the gyroscope after it has not
    made the tilt of 3 to 6° that would explain that acceleration as well."""

    def jumped(arrival: SampleAt | EgoMotion) -> SampleAt | EgoMotion:
        if isinstance(arrival, EgoMotion) or _since_walking_s(arrival.t_ns) < 1.0:
            return arrival
        rate_radps = np.radians(rate_degps) * (_since_walking_s(arrival.t_ns) > since_s)
        return replace(
            arrival,
            sf_B_mps2=vec3(np.add(arrival.sf_B_mps2, (bias_mps2, 0.0, 0.0))),
            w_B_radps=vec3(np.add(arrival.w_B_radps, rate_radps)),
        )

    followed = follow(WALKING_NS + 5 * S, jumped)
    assert any(step.ground_moves for step in followed)
    assert worst(followed) < 1.3


@pytest.mark.parametrize("axis_B", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_a_camera_that_slips_by_three_degrees_is_noticed_in_three_seconds(axis_B: tuple[float, float, float]) -> None:
    followed = follow(WALKING_NS + 5 * S, remounted(np.radians(3.0), axis_B))
    flagged = [_since_walking_s(step.t_ns) for step in followed if step.reason is not Reason.NONE]
    assert 1.0 < flagged[0] < 4.0
    assert followed[-1].reason is Reason.CAMERA_SLIPPED


@pytest.mark.parametrize(
    ("turn_degps", "slip_deg", "let_free"), [(0.5, 25.0, False), (40.0, 0.5, True)], ids=["stands", "walks"]
)
def test_what_successive_steps_err_by_alike_tells_of_no_slip(
    turn_degps: float, slip_deg: float, let_free: bool
) -> None:
    """A wearer who stands turns by half a degree a second, and by less than half of that what a slip would show."""
    kalman, step_s = AttitudeKalman(AttitudeSettings(), Residual()), 0.05
    state = kalman.new_state()
    likely = np.diag([math.radians(0.1 * step_s) ** 2] * 3 + [(0.005 * step_s) ** 2] * 3)
    for k in range(60):
        turn_rad = math.radians(turn_degps) * step_s * math.sin(2.0 * math.pi * k * step_s)
        H = np.zeros((6, SIZE))
        H[:3, MOUNT] = so3.skew(np.array([turn_rad, 0.0, 0.0]))
        innovation = H[:, MOUNT] @ np.radians((0.0, slip_deg, 0.0))
        look_for_causes(kalman, state, step_s, innovation, likely, squares_by_part(innovation, likely), H)
    assert bool(state.covariance[MOUNT, MOUNT].max() > math.radians(1.0) ** 2) is let_free


@pytest.mark.parametrize(("along_deg", "across_deg", "slipped"), [(0.1, 0.3, True), (0.3, 0.1, False)])
def test_how_well_a_slip_is_known_is_how_well_it_is_along_its_own_axis(
    along_deg: float, across_deg: float, slipped: bool
) -> None:
    kalman = AttitudeKalman(AttitudeSettings(), Residual(camera_to_imu_rad=math.radians(0.05)))
    state = kalman.new_state()
    state.mount_B = (0.0, math.radians(0.8), 0.0)
    state.covariance[MOUNT, MOUNT] = np.diag(np.radians((across_deg, along_deg, across_deg)) ** 2)
    assert has_slipped(kalman, state) is slipped


def test_distances_that_are_too_long_are_found_out() -> None:
    def longer(arrival: SampleAt | EgoMotion) -> SampleAt | EgoMotion:
        return arrival if isinstance(arrival, SampleAt) else replace(arrival, v_C_mps=1.03 * arrival.v_C_mps)

    found, usual = follow(WALKING_NS + 6 * S, longer)[-1], follow(WALKING_NS + 6 * S)[-1]
    assert found.scale > usual.scale + 0.0002


def with_scale(scale: float, std: float) -> tuple[AttitudeKalman, AttitudeState]:
    """Return a filter of a unit as the rig calibrates them that has found this scale of the camera's distances."""
    kalman = AttitudeKalman(AttitudeSettings(), RESIDUAL)
    state = kalman.new_state()
    state.scale = scale
    state.covariance[SCALE, SCALE] = std**2
    return kalman, state


@pytest.mark.parametrize(
    ("scale", "std", "wrong"),
    [(0.0087, 0.0008, True), (-0.0087, 0.0008, True), (0.0045, 0.0008, False), (0.0087, 0.003, False)],
    ids=["a toe-in off by 0.05 degrees", "the other way", "within what the calibration leaves", "not known yet"],
)
def test_distances_are_wrong_beyond_what_the_calibration_leaves(scale: float, std: float, wrong: bool) -> None:
    kalman, state = with_scale(scale, std)
    judge_distances(kalman, state)
    assert state.distances_are_wrong is wrong


def test_wrong_distances_stay_wrong_until_their_scale_is_well_within_what_the_calibration_leaves() -> None:
    kalman, state = with_scale(0.0087, 0.0008)
    said = []
    for scale in (0.0087, 0.005, 0.0035, 0.005):
        state.scale = scale
        judge_distances(kalman, state)
        said.append(state.distances_are_wrong)
    assert said == [True, True, False, False]


def test_distances_in_doubt_are_wrong_until_their_scale_is_known_again_on_a_ground_that_moves_too() -> None:
    kalman, state = with_scale(0.001, 0.0008)
    doubt_distances(AttitudeSettings().camera, state)
    said = []
    for std in (0.05, 0.01, 0.004):
        assert state.distances_are_wrong
        state.covariance[SCALE, SCALE] = std**2
        judge_distances(kalman, state)
        said.append(state.distances_are_wrong)
    assert said == [True, True, False]
    _doubt_ground(state, AttitudeSettings().camera)
    doubt_distances(AttitudeSettings().camera, state)
    judge_distances(kalman, state)
    assert state.distances_are_wrong


def test_most_of_a_scale_within_what_the_calibration_leaves_is_corrected_once_it_is_known() -> None:
    height_m = 0.9
    assert abs(0.005 - distance_scale(*with_scale(0.005, 0.0008))) * height_m < 0.002
    assert distance_scale(*with_scale(0.005, 0.004)) < 0.001


def test_what_is_told_of_a_scale_includes_what_odometer_and_accelerometer_err_by() -> None:
    kalman = AttitudeKalman(AttitudeSettings(), RESIDUAL)
    state = kalman.new_state()
    state.scale, state.odometer_scale = 0.004, 3e-3
    state.covariance[SCALE, SCALE] = 2e-3**2
    told = kalman.mounting_errors(state)
    assert (told.scale, told.scale_var) == pytest.approx((0.004, 2e-3**2 + 3e-3**2 + RESIDUAL.scale**2))


def test_on_a_ground_that_moves_distances_are_known_as_well_as_before() -> None:
    kalman, state = with_scale(0.007, 0.003)
    before = distance_scale(kalman, state)
    _doubt_ground(state, AttitudeSettings().camera)
    assert state.covariance[SCALE, SCALE][0, 0] == 0.0
    judge_distances(kalman, state)
    assert not state.distances_are_wrong
    assert distance_scale(kalman, state) == before
    assert after_gap(kalman, state, 1.0).covariance[SCALE, SCALE][0, 0] == pytest.approx(0.003**2)


def test_an_accelerometer_that_drives_as_no_ground_does_is_wrong() -> None:
    followed = follow(WALKING_NS + 4 * S, riding(lambda t_s: np.array((8.0, 0.0, 0.0)) * (t_s > 1.0), lambda _: 0.0))
    assert followed[-1].reason is Reason.IMU_INCONSISTENT


def moving(acceleration_W: tuple[float, float, float], moving_s: float = 0.0) -> tuple[AttitudeKalman, AttitudeState]:
    """Return a filter that holds the ground to accelerate so, for so long already."""
    kalman = AttitudeKalman(AttitudeSettings(), Residual())
    state = kalman.new_state()
    state.q_WB = so3.IDENTITY
    state.ground = GroundMotion(moves=True, acceleration_W=acceleration_W, moving_s=moving_s)
    return kalman, state


@pytest.mark.parametrize(("acceleration_mps2", "rests"), [(0.1, True), (0.3, False)])
def test_a_little_acceleration_of_the_ground_is_taken_for_tilt_and_bias_in_the_end(
    acceleration_mps2: float, rests: bool
) -> None:
    tilt_rad = acceleration_mps2 / AttitudeSettings().gravity_mps2
    kalman, state = moving((acceleration_mps2, 0.0, 0.0), tilt_rad / AttitudeSettings().camera.lean_radps)
    for _ in range(100):
        follow_ground(kalman, state, 0.05)
    assert state.ground.moves is not rests
    likely_rad = tilt_rad / math.sqrt(2.0) if rests else 0.0  # as likely tilt as bias: half is either's
    assert np.sqrt(state.covariance[1, 1]) == pytest.approx(likely_rad, rel=0.1)
    up_x, _, _ = so3.rows_from_quaternion(state.q_WB)[6:9]
    assert abs(up_x) == pytest.approx(tilt_rad / 2.0 if rests else 0.0, rel=0.1)
    assert state.sf_bias[0] == pytest.approx(acceleration_mps2 / 2.0 if rests else 0.0, rel=0.1)


@pytest.mark.parametrize(
    ("acceleration_mps2", "duration_s", "is_bias"),
    [(0.5, 25.0, True), (0.5, 15.0, False), (0.3, 20.5, False), (1.2, 19.0, False)],
    ids=["a bias that jumped", "not yet", "a slow bus", "a train"],
)
def test_an_acceleration_that_lasts_longer_than_any_vehicles_is_the_accelerometers(
    acceleration_mps2: float, duration_s: float, is_bias: bool
) -> None:
    kalman, state = moving((0.0, acceleration_mps2, 0.0))
    for _ in range(round(duration_s / 0.05)):
        follow_ground(kalman, state, 0.05)
    assert state.ground.moves is not is_bias
    assert state.sf_bias == pytest.approx((0.0, acceleration_mps2 if is_bias else 0.0, 0.0), abs=1e-3)


def test_a_bus_that_brakes_after_a_long_slow_drive_is_no_bias() -> None:
    kalman, state = moving((0.3, 0.0, 0.0))
    for acceleration_mps2, duration_s in ((0.25, 28.0), (-1.2, 5.0)):
        state.ground.acceleration_W = (acceleration_mps2, 0.0, 0.0)
        for _ in range(round(duration_s / 0.05)):
            follow_ground(kalman, state, 0.05)
            assert state.ground.moves


def test_a_vehicle_that_turns_under_its_wearer_is_no_bias() -> None:
    kalman, state = moving((0.5, 0.0, 0.0))
    for step in range(1000):
        state.ground.acceleration_W = (0.5 * math.cos(0.004 * step), 0.5 * math.sin(0.004 * step), 0.0)
        follow_ground(kalman, state, 0.05)
    assert state.ground.moves


def test_the_longer_a_ground_moves_the_wider_the_vertical_is_stated() -> None:
    settings = AttitudeSettings()
    kalman = AttitudeKalman(settings, Residual())
    state = kalman.new_state()
    at_once_var = kalman.rotation_cov_W(state)[0, 0]
    state.ground = GroundMotion(moves=True, moving_s=25.0)
    leaning_rad = 25.0 * settings.camera.lean_radps
    assert kalman.rotation_cov_W(state)[0, 0] == pytest.approx(at_once_var + leaning_rad**2)
    assert math.degrees(leaning_rad) == pytest.approx(1.0, abs=0.2)

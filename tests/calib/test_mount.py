"""The camera's place: what the filter found goes into the file with the right signs; what is wide is refused."""

import msgspec
import numpy as np
import pytest

from calib.mount import BEGINNINGS_S, PATIENCE_S, RIGID, Course, Found, brought_near, doubted, measured, mounted
from calib.strict_yaml import CalibrationError
from lab.evaluation.mounting import Trial
from messages import Calibration, vec3
from perception import so3
from perception.attitude.causes import look_for_causes
from perception.attitude.error_state import MOUNT, SIZE
from perception.attitude.kalman import AttitudeKalman
from perception.attitude.sensor_errors import MountingErrors, SensorErrors
from perception.attitude.state import AttitudeSettings, AttitudeState, Contradiction
from sim_rig.unit import RESIDUAL, draw_unit

KNOWN = msgspec.structs.replace(draw_unit(7).exact_calibration(), residual=RESIDUAL)
TURN = np.radians((0.4, -0.3, 0.2))
SENSORS = SensorErrors((0.002, -0.001, 0.003), (1e-8,) * 3, (0.02, -0.01, 0.0), (1e-6,) * 3, 0.004, 1e-6)


def told(
    turn: np.ndarray = TURN,
    std_rad: float = np.radians(0.02),
    lag_s: float = 1.5e-3,
    lag_std_s: float = 2e-4,
    scale: float = 0.0,
) -> MountingErrors:
    return MountingErrors(vec3(turn), np.eye(3) * std_rad**2, lag_s, lag_std_s**2, scale, 1e-3**2)


def found(std_rad: float = np.radians(0.02), lag_std_s: float = 2e-4, scale: float = 0.0) -> Found:
    mounting = told(std_rad=std_rad, lag_std_s=lag_std_s, scale=scale)
    return Found(mounting, SENSORS, mounting, 33.0)


def test_what_was_found_is_taken_over() -> None:
    near = brought_near(KNOWN, told(np.array((0.01, 0.0, 0.0)), lag_s=0.0))
    made = mounted(KNOWN, near, found(), "walk")
    calibration = made.calibration
    expected = so3.exp(TURN) @ so3.exp(np.array((0.01, 0.0, 0.0))) @ np.array(KNOWN.X_BL.R)
    assert np.array(calibration.X_BL.R) == pytest.approx(expected)
    assert calibration.stereo.stamp_to_mid_exposure_s == pytest.approx(KNOWN.stereo.stamp_to_mid_exposure_s + 1.5e-3)
    for matrix, before, after, error in (
        (KNOWN.imu.w_matrix, KNOWN.imu.w_bias_radps, calibration.imu.w_bias_radps, SENSORS.gyro_bias),
        (KNOWN.imu.sf_matrix, KNOWN.imu.sf_bias_mps2, calibration.imu.sf_bias_mps2, SENSORS.sf_bias),
    ):
        assert np.array(matrix) @ np.subtract(after, before) == pytest.approx(error)
    assert calibration.imu.temperature_degC == 33.0
    assert np.radians(0.02) < calibration.residual.camera_to_imu_rad < np.radians(0.06)  # pictures leave more
    assert 2e-4 < calibration.residual.time_s < 3e-4
    assert so3.exp(made.turn_B) @ np.array(KNOWN.X_BL.R) == pytest.approx(np.array(calibration.X_BL.R))


def test_the_scale_of_distances_is_taken_over_with_what_is_left_of_it() -> None:
    made = mounted(KNOWN, KNOWN, found(scale=0.003), "walk")
    assert made.pair is not None
    before, after = KNOWN.stereo.X_RL, made.calibration.stereo.X_RL
    assert np.linalg.norm(after.p_m) == pytest.approx(np.linalg.norm(before.p_m) / (1.0 + made.pair.baseline))
    assert made.pair.toe_in_rad < 0.0
    assert np.linalg.norm(so3.log(np.array(after.R) @ np.array(before.R).T)) == pytest.approx(-made.pair.toe_in_rad)
    residual = made.calibration.residual
    assert (residual.baseline, residual.toe_in_rad) == (made.pair.baseline_std, made.pair.toe_in_std_rad)
    assert residual.toe_in_rad < RESIDUAL.toe_in_rad


def test_distances_farther_off_than_the_file_says_stay_as_they_are() -> None:
    made = mounted(KNOWN, KNOWN, found(scale=0.03), "walk")
    assert made.pair is None
    assert made.calibration.stereo.X_RL == KNOWN.stereo.X_RL
    assert made.calibration.residual.toe_in_rad == RESIDUAL.toe_in_rad
    assert made.calibration.residual.baseline_std == RESIDUAL.baseline_std


def test_a_camera_that_turns_on_its_mount_during_the_walk_is_refused() -> None:
    halfway = told(TURN - np.radians((0.0, 0.5, 0.0)), std_rad=np.radians(0.03))
    with pytest.raises(CalibrationError, match=r"walk: refused: .* \+0\.50, \+0\.00° from those that the first half"):
        mounted(KNOWN, KNOWN, found()._replace(halfway=halfway), "walk")


class Told:
    """A walk that tells, pass after pass, what it is to; and with which calibrations it was gone through."""

    def __init__(self, *passes: MountingErrors | None) -> None:
        self._passes = list(passes)
        self.begun: list[Calibration] = []

    def __call__(self, calibration: Calibration, _: str) -> Found | None:
        self.begun.append(calibration)
        mounting = self._passes.pop(0)
        return None if mounting is None else Found(mounting, SENSORS, mounting, 33.0)


def test_a_walk_is_gone_through_again_from_where_a_pass_ends_far_away() -> None:
    far = told(np.radians((1.5, 0.0, 0.0)))
    walk = Told(far, far, told())
    made = measured(KNOWN, walk, "walk")
    expected = so3.exp(TURN) @ so3.exp(np.radians((3.0, 0.0, 0.0))) @ np.array(KNOWN.X_BL.R)
    assert np.array(made.calibration.X_BL.R) == pytest.approx(expected)
    with pytest.raises(CalibrationError, match="walk: refused: at its end camera and IMU do not agree"):
        measured(KNOWN, Told(*[told(lag_s=3e-3)] * 9), "walk")


def test_stamps_that_are_far_off_are_looked_for_earlier_and_later() -> None:
    walk = Told(None, None, told(lag_s=0.0), told(lag_s=0.0))
    made = measured(KNOWN, walk, "walk")
    stamps_s = [begun.stereo.stamp_to_mid_exposure_s - KNOWN.stereo.stamp_to_mid_exposure_s for begun in walk.begun]
    assert stamps_s == pytest.approx([*BEGINNINGS_S[:3], BEGINNINGS_S[2]])
    assert made.lag_s == pytest.approx(BEGINNINGS_S[2])
    with pytest.raises(CalibrationError, match="walk: refused: at its end camera and IMU do not agree"):
        measured(KNOWN, Told(*[None] * len(BEGINNINGS_S)), "walk")


def test_a_pass_is_given_up_once_camera_and_imu_have_contradicted_each_other_for_long() -> None:
    course, second_ns = Course(), 1_000_000_000
    times = range(second_ns, 60 * second_ns, second_ns)
    first, later = told(lag_s=1.0), told(lag_s=2.0)
    assert all(course.add(t_ns, first if t_ns < 20 * second_ns else later) for t_ns in times)
    assert course.halfway == later
    silent_s = [s for s in range(60, 80) if course.add(s * second_ns, None)]
    assert len(silent_s) == PATIENCE_S


@pytest.mark.parametrize(("settings", "forgets"), [(AttitudeSettings(), True), (RIGID, False)])
def test_pictures_that_lean_for_some_steps_are_no_slip_in_a_calibration(
    settings: AttitudeSettings, forgets: bool
) -> None:
    kalman = AttitudeKalman(settings, RESIDUAL)
    state = AttitudeState(1e-6 * np.eye(SIZE))
    state.contradictions.slip = Contradiction(np.array((0.0, 5.0, 0.0)), np.eye(3))  # five deviations
    H = np.zeros((6, SIZE))
    H[:3, MOUNT] = np.eye(3)
    assert look_for_causes(kalman, state, 0.05, np.zeros(6), 1e3 * np.eye(6), (0.0, 0.0), H) is forgets
    assert bool(state.covariance[MOUNT, MOUNT].max() > 1e-4) is forgets


@pytest.mark.parametrize(("std_rad", "lag_std_s"), [(np.radians(0.2), 1e-4), (np.radians(0.02), 2e-3)])
def test_what_a_walk_does_not_tell_is_refused(std_rad: float, lag_std_s: float) -> None:
    with pytest.raises(CalibrationError, match=r"walk: refused: .* allowed 0\.1° and 1 ms"):
        mounted(KNOWN, KNOWN, found(std_rad, lag_std_s), "walk")


@pytest.mark.long
def test_a_minute_of_walking_tells_a_camera_that_is_degrees_off() -> None:
    trial = Trial(1001)
    before = trial.errors(trial.given)
    made = trial.found()
    turn, lag_s = trial.errors(made.calibration)
    assert np.abs(before[0]).max() > np.radians(0.5)
    assert np.abs(turn).max() < np.radians(0.1)
    assert (np.abs(turn) < 3.0 * made.turn_std).all()
    assert abs(lag_s) < 1e-3


def test_a_pass_doubts_the_camera_and_nothing_else() -> None:
    first, second = (doubted(KNOWN, first=each) for each in (True, False))
    assert first.residual.camera_to_imu_rad == pytest.approx(np.radians(3.0))
    assert second.residual.camera_to_imu_rad == pytest.approx(np.radians(0.5))
    assert first.residual.baseline_std == second.residual.baseline_std == 0.01  # seems wrong until the camera is right
    assert first.residual.scale == KNOWN.residual.scale
    assert first.imu == KNOWN.imu

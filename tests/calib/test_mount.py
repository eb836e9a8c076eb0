"""The camera's place: what the filter found goes into the file with the right signs; what is wide is refused."""

import msgspec
import numpy as np
import pytest

from calib.mount import Found, brought_near, doubted, mounted
from calib.strict_yaml import CalibrationError
from lab.evaluation.mounting import Trial
from messages import vec3
from perception import so3
from perception.attitude.sensor_errors import MountingErrors, SensorErrors
from sim_rig.unit import RESIDUAL, draw_unit

KNOWN = msgspec.structs.replace(draw_unit(7).exact_calibration(), residual=RESIDUAL)
TURN = np.radians((0.4, -0.3, 0.2))
SENSORS = SensorErrors((0.002, -0.001, 0.003), (1e-8,) * 3, (0.02, -0.01, 0.0), (1e-6,) * 3, 0.004, 1e-6)


def found(std_rad: float = np.radians(0.02), lag_std_s: float = 2e-4) -> Found:
    mounting = MountingErrors(vec3(TURN), np.eye(3) * std_rad**2, 1.5e-3, lag_std_s**2)
    return Found(mounting, SENSORS, 33.0)


def test_what_was_found_is_taken_over() -> None:
    near = brought_near(KNOWN, MountingErrors((0.01, 0.0, 0.0), np.eye(3), 0.0, 1.0))
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
    assert calibration.stereo.X_RL == KNOWN.stereo.X_RL
    assert so3.exp(made.turn_B) @ np.array(KNOWN.X_BL.R) == pytest.approx(np.array(calibration.X_BL.R))


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

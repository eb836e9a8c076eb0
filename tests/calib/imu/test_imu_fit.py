"""Whole logs: rests are found, both sensors fitted, the file changes only where the poses support it."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from calib.files import load_calibration, save_calibration
from calib.imu.fit import ImuFit, fit_imu, with_imu
from calib.imu.log import ImuLog, Units, read_logs
from calib.strict_yaml import CalibrationError
from cli.main import app
from lab.evaluation.calibration_trials import FACES, POSES, drawn_log, drawn_values
from messages import UserError
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.unit import draw_unit
from tests.bench.data_folder import shared_data

VALUES = drawn_values(np.random.default_rng(5))
GYRO = np.eye(3) + np.random.default_rng(6).normal(0.0, 0.008, (3, 3))
W_BIAS = np.radians((1.5, -0.7, 0.4))
KNOWN = draw_unit(3).exact_calibration()


@pytest.fixture(scope="module")
def log() -> ImuLog:
    return drawn_log(np.random.default_rng(7), VALUES, GYRO, W_BIAS, POSES)


@pytest.fixture(scope="module")
def fit(log: ImuLog) -> ImuFit:
    return fit_imu([log], "bench", gravity_mps2=STANDARD_GRAVITY_MPS2)


def write_csv(path: Path, log: ImuLog) -> Path:
    names = "t_s,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps"
    np.savetxt(path, np.column_stack((log.t_s, log.sf, log.w)), delimiter=",", header=names, comments="")
    return path


def test_a_log_of_poses_tells_both_sensors(fit: ImuFit) -> None:
    assert len(fit.rests) == len(POSES)
    assert fit.unsupported == []
    assert fit.accelerometer.values[:3] == pytest.approx(VALUES[:3], abs=2e-3)
    assert fit.accelerometer.values[3:] == pytest.approx(VALUES[3:], abs=1e-3)
    assert fit.gyroscope is not None
    assert fit.gyroscope.bias == pytest.approx(W_BIAS, abs=np.radians(0.05))
    assert fit.gyroscope.matrix == pytest.approx(GYRO, abs=4.0 * float(fit.gyroscope.matrix_std.max()))
    assert fit.gyroscope.matrix_std.max() < 0.004


def test_mirrored_axes_are_named(log: ImuLog) -> None:
    mirrored = ImuLog("bench", log.t_s, log.sf * np.array((1.0, 1.0, -1.0)), log.w, log.temperature_degC)
    found = fit_imu([mirrored], "bench")
    assert any("--acc-axes x,y,-z" in note for note in found.notes)
    assert found.gyroscope is not None
    assert not found.gyroscope.supported.any()


def test_the_file_takes_what_is_supported_and_keeps_the_rest(fit: ImuFit) -> None:
    imu, residual = with_imu(KNOWN.imu, KNOWN.residual, fit, "bench")
    assert np.array(imu.sf_bias_mps2) == pytest.approx(fit.accelerometer.bias)
    assert np.array(imu.w_matrix) == pytest.approx(fit.gyroscope.matrix if fit.gyroscope else None)
    assert imu.temperature_degC == 31.0
    assert residual.specific_force_mps2 < 2e-3 * STANDARD_GRAVITY_MPS2

    rng = np.random.default_rng(8)
    without_z = fit_imu([drawn_log(rng, VALUES, GYRO, W_BIAS, FACES[[0, 1, 3, 4, 2]])], "bench")
    kept, wide = with_imu(
        KNOWN.imu, msgspec.structs.replace(KNOWN.residual, specific_force_mps2=0.6), without_z, "bench"
    )
    assert kept.sf_bias_mps2[2] == KNOWN.imu.sf_bias_mps2[2]
    assert kept.sf_matrix[2][2] == KNOWN.imu.sf_matrix[2][2]
    assert kept.sf_bias_mps2[0] == pytest.approx(STANDARD_GRAVITY_MPS2 * VALUES[0], abs=0.02)
    assert wide.specific_force_mps2 == 0.6
    assert any(line.startswith("accelerometer z") for line in without_z.unsupported)


def test_poses_that_tell_no_axis_are_refused_and_the_file_stays(tmp_path: Path) -> None:
    file = tmp_path / "unit.yaml"
    save_calibration(file, KNOWN)
    log = drawn_log(np.random.default_rng(9), VALUES, GYRO, W_BIAS, FACES[[0, 1, 2]])
    csv = write_csv(tmp_path / "log.csv", log)
    with pytest.raises(CalibrationError, match=r"log\.csv: refused: the rests tell no axis's bias and scale apart"):
        app(["calibrate", "imu", str(file), "--from", str(csv)], standalone_mode=False)
    assert load_calibration(file) == KNOWN


def test_the_command_writes_the_file_and_the_facts(tmp_path: Path, log: ImuLog) -> None:
    file, facts = tmp_path / "unit.yaml", tmp_path / "facts.json"
    save_calibration(file, KNOWN)
    csv = write_csv(tmp_path / "log.csv", log)
    app(["calibrate", "imu", str(file), "--from", str(csv), "--json", str(facts)], standalone_mode=False)
    made = load_calibration(file)
    told = msgspec.json.decode(facts.read_bytes())
    assert told["id"] == made.id
    assert told["not_told"] == []
    assert list(made.imu.w_bias_radps) == pytest.approx(told["w_bias_radps"])


def test_bad_logs_are_one_line(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    for text, problem in (
        ("t_s,ax,ay,gz\n0,1,2,3\n", "columns ax, ay, az are missing"),
        ("ax,ay,az,gx\n1,2,3,4\n", "column t_s is missing"),
        ("t_s,ax,ay,az\n0,1,2,x\n", "no table of numbers"),
        ("t_s,ax,ay,az\n0,1,2,3\n", "holds 1 samples, allowed from 100"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(UserError, match=problem):
            read_logs([path], Units())


@pytest.mark.long
def test_a_real_mpu6050_in_three_poses_is_flagged_and_fits_where_it_lay() -> None:
    units = Units(acc_per_g=4096.0, gyro_per_dps=131.0, signs=(1.0, 1.0, -1.0))
    fit = fit_imu(read_logs([shared_data("mpu6050_sunsided")], units), "mpu6050")
    acc = fit.accelerometer
    assert not acc.axes_supported.any()  # one side of each axis only
    assert np.abs(acc.norm_before).max() > 0.03
    assert np.abs(acc.norm).max() < 0.005
    assert fit.gyroscope is not None
    assert np.degrees(fit.gyroscope.bias) == pytest.approx((4.53, 0.05, 1.12), abs=0.06)


@pytest.mark.long
def test_a_real_imu_in_many_poses_keeps_gravity_and_carries_it() -> None:
    units = Units(acc_zero=32768.0, gyro_per_dps=6258.0 * np.pi / 180.0)
    fit = fit_imu(read_logs([shared_data("xsens_multiposition_imutk")], units), "xsens")
    acc = fit.accelerometer
    assert fit.unsupported == []
    assert np.sqrt(np.mean(acc.norm_left_out**2)) < 0.0005
    assert np.abs(acc.norm).max() < 0.005
    assert fit.gyroscope is not None
    assert np.degrees(np.sqrt(np.mean(fit.gyroscope.carried_rad**2))) < 0.5
    assert np.degrees(np.sqrt(np.mean(fit.gyroscope.before_rad**2))) > 20.0

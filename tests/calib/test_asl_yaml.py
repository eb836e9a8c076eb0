from pathlib import Path

import numpy as np
import pytest

from calib.asl_yaml import ASL_RESIDUAL, load_asl_calibration
from calib.files import CalibrationError, format_calibration, parse_calibration
from messages import Calibration
from tests.bench.asl import camera_yaml
from tests.bench.data_folder import shared_data

IMU_YAML = """%YAML:1.0
sensor_type: imu
T_BS: {rows: 4, cols: 4, data: [0, -1, 0, 0.1, 1, 0, 0, 0.2, 0, 0, 1, 0.3, 0, 0, 0, 1]}
"""


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    found = {camera: tmp_path / f"{camera}_sensor.yaml" for camera in ("cam0", "cam1")}
    found["cam0"].write_text(camera_yaml(752, 480, 0.06))
    found["cam1"].write_text(camera_yaml(752, 480, -0.06))
    return found


def complaint(files: dict[str, Path]) -> str:
    with pytest.raises(CalibrationError) as raised:
        load_asl_calibration(files, "asl-test")
    line = str(raised.value)
    assert "\n" not in line
    return line


def test_the_body_frame_is_the_imu_where_no_file_says_otherwise(files: dict[str, Path]) -> None:
    calibration = load_asl_calibration(files, "asl-test")
    assert calibration.unit == "asl-test"
    assert calibration.residual == ASL_RESIDUAL
    assert np.array_equal(calibration.imu.sf_matrix, np.eye(3))
    assert np.array_equal(calibration.X_BL.p_m, (0.02, 0.06, 0.01))
    assert np.array_equal(calibration.X_BL.R, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    np.testing.assert_allclose(calibration.stereo.X_RL.p_m, (-0.12, 0, 0), atol=1e-15)
    lens = calibration.stereo.left
    assert (lens.width_px, lens.height_px, lens.cx_px, lens.cy_px) == (752, 480, 376.0, 240.0)
    assert lens.distortion == (-0.28, 0.07, 1e-4, 1.76e-05)
    assert parse_calibration(format_calibration(calibration), "memory") == calibration


def test_the_imus_own_pose_in_the_body_is_taken_out(files: dict[str, Path], tmp_path: Path) -> None:
    imu = tmp_path / "imu0_sensor.yaml"
    imu.write_text(IMU_YAML)
    moved = load_asl_calibration(files | {"imu0": imu}, "asl-test")
    plain = load_asl_calibration(files, "asl-test")
    R_SB, p_SB_m = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(R_SB @ moved.X_BL.R, plain.X_BL.R, atol=1e-15)
    np.testing.assert_allclose(R_SB @ moved.X_BL.p_m + p_SB_m, plain.X_BL.p_m, atol=1e-15)
    assert moved.stereo == plain.stereo


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("pinhole", "omni", "camera_model is 'omni', allowed 'pinhole'"),
        ("radial-tangential", "equidistant", "distortion_model is 'equidistant', allowed radial-tangential, radtan, "),
        ("resolution: [752, 480]", "resolution: [752]", "resolution must be a list of 2 numbers"),
        ("intrinsics: [451.2,", "intrinsics: [.nan,", "intrinsics holds a number that is not finite"),
        ("intrinsics: [451.2,", "intrinsics: [wide,", "intrinsics is not a list of numbers"),
        ("-0.28, 0.07", "{a: 1}, 0.07", "distortion_coefficients is not a list of numbers"),
        ("rate_hz", "T_BX: 0\nrate_hz", ""),
        ("T_BS", "T_SB", "T_BS is missing"),
        ("data", "dota", "data is missing"),
        ("0.0, 0.0, 0.0, 1.0]", "0.0, 0.0, 0.0, 2.0]", "the last row of T_BS must be 0, 0, 0, 1"),
        ("0.0, 0.0, 0.0, 1.0]", "1.0]", "T_BS must hold 16 numbers, 4 rows of 4"),
        ("data: [0.0, 0.0, 1.0,", "data: [0.0, 0.1, 1.0,", "T_BS holds no rotation: off orthonormal by 0.05"),
        ("data: [0.0, 0.0, 1.0,", "data: [0.0, 0.0, -1.0,", "T_BS holds no rotation: off orthonormal by "),
        ("resolution: [", "resolution: [[", "line "),
    ],
)
def test_what_is_wrong_is_named_with_its_file(files: dict[str, Path], old: str, new: str, line: str) -> None:
    text = files["cam0"].read_text()
    assert old in text
    files["cam0"].write_text(text.replace(old, new))
    if not line:
        assert isinstance(load_asl_calibration(files, "asl-test"), Calibration)
    else:
        assert complaint(files).startswith(f"{files['cam0']}: {line}")


def test_a_rotation_printed_with_few_digits_is_made_exact(files: dict[str, Path]) -> None:
    text = files["cam0"].read_text()
    files["cam0"].write_text(text.replace("data: [0.0, 0.0, 1.0,", "data: [0.0, 0.00002, 1.0,"))
    R = np.array(load_asl_calibration(files, "asl-test").X_BL.R)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-15)


def test_swapped_cameras_are_named(files: dict[str, Path]) -> None:
    swapped = {"cam0": files["cam1"], "cam1": files["cam0"]}
    line = complaint(swapped)
    assert line.startswith("cam1_sensor.yaml with cam0_sensor.yaml: stereo.X_RL.p_m[0] is 0.12 m")
    assert "left and right are swapped" in line


def test_cameras_of_two_sizes_and_absent_files_are_named(files: dict[str, Path]) -> None:
    files["cam1"].write_text(camera_yaml(640, 480, -0.06))
    assert complaint(files).endswith("stereo.right is 640x480 px, stereo.left 752x480 px: both must be equal")
    del files["cam1"]
    assert complaint(files).startswith("no cam1_sensor.yaml or cam1/sensor.yaml in the folder")


def test_the_real_files() -> None:
    folder = shared_data("euroc_v1_01_easy")
    files = {sensor: folder / f"{sensor}_sensor.yaml" for sensor in ("cam0", "cam1", "imu0")}
    calibration = load_asl_calibration(files, "asl-euroc")
    assert np.linalg.norm(calibration.stereo.X_RL.p_m) == pytest.approx(0.11008, abs=1e-5)
    assert calibration.X_BL.p_m == pytest.approx((-0.0216401454975, -0.064676986768, 0.00981073058949))
    assert calibration.stereo.right.fx_px == 457.587

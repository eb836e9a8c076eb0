"""Calibration files of a unit with a depth camera."""

from pathlib import Path

import pytest

from calib.files import CalibrationError, check_frame_size, load_calibration, parse_calibration, save_calibration
from messages import DepthUnitCalibration, UserError
from sim_rig.camera.depth_unit import draw_depth_unit

DOCUMENT = """
unit: bench-8
imu:
  sf_matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
  sf_bias_mps2: [0, 0, 0]
  w_matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
  w_bias_radps: [0, 0, 0]
depth:
  lens: {width_px: 848, height_px: 480, fx_px: 424, fy_px: 424, cx_px: 423.5, cy_px: 239.5, distortion: [0, 0, 0, 0]}
  baseline_m: 0.05
  scale_residual: 0.003
X_BD: {R: [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], p_m: [0, 0.0175, 0]}
residual: {toe_in_rad: 2e-4}
"""


def complaint(old: str, new: str) -> str:
    assert old in DOCUMENT
    with pytest.raises(UserError) as raised:
        parse_calibration(DOCUMENT.replace(old, new), "unit.yaml")
    line = str(raised.value)
    assert line.startswith("unit.yaml: ")
    assert "\n" not in line
    return line.removeprefix("unit.yaml: ")


def test_a_file_as_people_write_it_is_read_with_its_defaults() -> None:
    calibration = parse_calibration(DOCUMENT, "unit.yaml")
    assert isinstance(calibration, DepthUnitCalibration)
    assert (calibration.depth.step_m, calibration.depth.row_time_s) == (0.001, 0.0)
    assert calibration.camera.lens.fx_px == 424.0
    assert calibration.X_BE.p_m == (0.0, 0.0175, 0.0)


def test_a_written_file_reads_back_equal_under_the_same_id(tmp_path: Path) -> None:
    _, calibration = draw_depth_unit(5, perfect_calibration=False)
    save_calibration(tmp_path / "unit.yaml", calibration)
    again = load_calibration(tmp_path / "unit.yaml")
    assert again == calibration
    assert again.id == calibration.id
    assert calibration.id != draw_depth_unit(6, perfect_calibration=False)[1].id


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("baseline_m: 0.05", "baseline_m: 50", "depth.baseline_m is 50, allowed 0.02 to 0.5"),
        ("baseline_m: 0.05", "step_m: 1.0", "depth.step_m is 1, allowed 1e-05 to 0.01"),
        ("scale_residual: 0.003", "scale_residual: 0.3", "depth.scale_residual is 0.3, allowed 0 to 0.1"),
        ("  baseline_m: 0.05\n", "", "depth.baseline_m is missing"),
        ("baseline_m", "basline_m", "depth.basline_m is not a known field; did you mean 'baseline_m'?"),
        ("X_BD", "X_BL", "X_BL is not a known field; did you mean 'X_BD'?"),
        ("cx_px: 423.5", "cx_px: 900", "depth.lens.cx_px is 900, allowed 254.4 to 593.6 of 848 px"),
        ("[0, -1, 0]]", "[0, -2, 0]]", "X_BD.R is no rotation: off orthonormal by 3, allowed up to 1e-06"),
        ("distortion: [0, 0, 0, 0]", "distortion: [0]", "depth.lens.distortion has 1 terms, allowed 4, 5, 8, 12, 14"),
        (
            "depth:\n",
            "stereo: {}\ndepth:\n",
            "stereo is not a known field; allowed: unit, imu, depth, X_BD, residual, wearer",
        ),
    ],
)
def test_a_mistake_is_one_line_with_field_and_range(old: str, new: str, line: str) -> None:
    assert complaint(old, new) == line


def test_frames_of_another_size_are_refused() -> None:
    calibration = parse_calibration(DOCUMENT, "unit.yaml")
    with pytest.raises(CalibrationError, match="'bench-8' is for 848x480 px, /dev/video0 delivers 640x480 px"):
        check_frame_size(calibration, 640, 480, "/dev/video0")

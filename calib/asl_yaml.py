"""The sensor files of a EuRoC/ASL folder as a calibration.

Each `sensor.yaml` holds T_BS, the 4×4 pose of the sensor in the body frame (Burri et al., "The EuRoC micro aerial
vehicle datasets", IJRR 2016); a camera's also its size, its pinhole and its radial-tangential lens. The body frame
need not be the IMU's: X_BL = T_BS(imu)⁻¹ · T_BS(cam0), X_RL = T_BS(cam1)⁻¹ · T_BS(cam0).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from calib.files import CalibrationError, check_calibration
from calib.strict_yaml import parse_yaml
from messages import Calibration, ImuCalibration, Lens, Pose, Residual, StereoCalibration, matrix3, vec3
from messages.arrays import FloatArray
from messages.text_files import read_text

ASL_RESIDUAL = Residual(
    specific_force_mps2=0.1,
    scale=0.005,
    toe_in_rad=float(np.deg2rad(0.02)),
    rows_rad=3.5e-4,
    camera_to_imu_rad=float(np.deg2rad(0.1)),
    time_s=1e-3,
)
"""Assumed, because the sensor files hold no calibration of the IMU: 10 mg of accelerometer bias leads. EuRoC's rows
differ by a sixth of a pixel here and there (RMS over tiles of its first ten floor frames)."""

_ROTATION_TOLERANCE = 1e-4
"""Files print T_BS with few digits; a rotation off by no more than this is replaced by the nearest exact one."""

_LENS_MODELS = ("radial-tangential", "radtan", "plumb_bob")

_Fields = Mapping[str, object]


def load_asl_calibration(sensor_files: Mapping[str, Path], unit: str) -> Calibration:
    """Return the calibration that the sensor files of `cam0` (left), `cam1` (right) and `imu0` describe.

    The IMU is taken as calibrated (identity, no bias) with `ASL_RESIDUAL`; without a file for `imu0` it is the body
    frame. Stamps are taken as mid-exposure, shutters as global. Raises UserError naming file and field.
    """
    left_file, right_file = (_file_of(camera, sensor_files) for camera in ("cam0", "cam1"))
    left, right = _read(left_file), _read(right_file)
    X_SL, X_SR = _pose(left, left_file), _pose(right, right_file)
    imu_file = sensor_files.get("imu0")
    X_SB = np.eye(4) if imu_file is None else _pose(_read(imu_file), imu_file)
    identity, zero = matrix3(np.eye(3)), vec3(np.zeros(3))
    calibration = Calibration(
        unit=unit,
        imu=ImuCalibration(sf_matrix=identity, sf_bias_mps2=zero, w_matrix=identity, w_bias_radps=zero),
        stereo=StereoCalibration(
            left=_lens(left, left_file),
            right=_lens(right, right_file),
            X_RL=_relative(X_SR, X_SL),
        ),
        X_BL=_relative(X_SB, X_SL),
        residual=ASL_RESIDUAL,
    )
    check_calibration(calibration, f"{left_file.name} with {right_file.name}")
    return calibration


def _file_of(camera: str, sensor_files: Mapping[str, Path]) -> Path:
    if camera not in sensor_files:
        raise CalibrationError(f"no {camera}_sensor.yaml or {camera}/sensor.yaml in the folder: its lens is unknown")
    return sensor_files[camera]


def _read(path: Path) -> _Fields:
    text = read_text(path)
    if text.startswith("%YAML:"):  # OpenCV's header, which YAML does not know; the line stays so that numbers hold
        text = "#" + text
    document = parse_yaml(text, str(path))
    if not isinstance(document, dict):
        raise CalibrationError(f"{path}: expected the fields of an ASL sensor file, such as T_BS")
    return document


def _field(fields: _Fields, name: str, path: Path) -> object:
    if name not in fields:
        raise CalibrationError(f"{path}: {name} is missing")
    return fields[name]


def _numbers(value: object, name: str, path: Path) -> FloatArray:
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"{path}: {name} is not a list of numbers") from error
    if not np.isfinite(numbers).all():
        raise CalibrationError(f"{path}: {name} holds a number that is not finite")
    return numbers


def _list_of(count: int, fields: _Fields, name: str, path: Path) -> FloatArray:
    numbers = _numbers(_field(fields, name, path), name, path)
    if numbers.shape != (count,):
        raise CalibrationError(f"{path}: {name} must be a list of {count} numbers")
    return numbers


def _pose(fields: _Fields, path: Path) -> FloatArray:
    value = _field(fields, "T_BS", path)
    numbers = _numbers(_field(value, "data", path) if isinstance(value, dict) else value, "T_BS", path)
    if numbers.size != 16:
        raise CalibrationError(f"{path}: T_BS must hold 16 numbers, 4 rows of 4")
    X = numbers.reshape(4, 4)
    if not np.array_equal(X[3], (0.0, 0.0, 0.0, 1.0)):
        raise CalibrationError(f"{path}: the last row of T_BS must be 0, 0, 0, 1")
    U, _, Vt = np.linalg.svd(X[:3, :3])
    R = U @ Vt
    error = float(np.abs(R - X[:3, :3]).max())
    if error > _ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise CalibrationError(
            f"{path}: T_BS holds no rotation: off orthonormal by {error:.2g}, "
            f"allowed up to {_ROTATION_TOLERANCE:g}, determinant +1"
        )
    X[:3, :3] = R
    return X


def _relative(X_SA: FloatArray, X_SB: FloatArray) -> Pose:
    """Return X_AB = X_SA⁻¹ · X_SB."""
    R_AS = X_SA[:3, :3].T
    return Pose(R=matrix3(R_AS @ X_SB[:3, :3]), p_m=vec3(R_AS @ (X_SB[:3, 3] - X_SA[:3, 3])))


def _lens(fields: _Fields, path: Path) -> Lens:
    camera_model = _field(fields, "camera_model", path)
    if camera_model != "pinhole":
        raise CalibrationError(f"{path}: camera_model is {camera_model!r}, allowed 'pinhole'")
    lens_model = _field(fields, "distortion_model", path)
    if lens_model not in _LENS_MODELS:
        raise CalibrationError(f"{path}: distortion_model is {lens_model!r}, allowed {', '.join(_LENS_MODELS)}")
    width_px, height_px = (round(size_px) for size_px in _list_of(2, fields, "resolution", path).tolist())
    fx_px, fy_px, cx_px, cy_px = _list_of(4, fields, "intrinsics", path).tolist()
    distortion = _numbers(_field(fields, "distortion_coefficients", path), "distortion_coefficients", path)
    return Lens(
        width_px=width_px,
        height_px=height_px,
        fx_px=fx_px,
        fy_px=fy_px,
        cx_px=cx_px,
        cy_px=cy_px,
        distortion=tuple(distortion.ravel().tolist()),
    )

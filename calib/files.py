"""Calibration files: YAML in the spirit of Kalibr's, one unit each, sealed, checked on reading and on writing.

The file has the keys of `messages.Calibration` or, for a depth camera, of `messages.DepthUnitCalibration`, no others;
matrices are nested lists, frames stand in the names. Its last line is its seal (`calib.seal`).
Whatever is wrong with one is one line, `file: field …`, with the allowed range.
"""

import math
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np

from calib.seal import check_seal, sealed
from calib.strict_yaml import CalibrationError, format_yaml, parse_yaml
from messages import (
    CAMERA_HEIGHTS_M,
    Calibration,
    DepthUnitCalibration,
    Lens,
    Matrix3,
    Pose,
    StereoCalibration,
    UnitCalibration,
)
from messages.checked import checked
from messages.text_files import read_text

__all__ = [
    "CalibrationError",
    "check_calibration",
    "check_frame_size",
    "format_calibration",
    "load_calibration",
    "parse_calibration",
    "save_calibration",
    "seal_file",
]

ROTATION_TOLERANCE = 1e-6
DISTORTION_TERMS = (4, 5, 8, 12, 14)
BASELINE_M = (0.02, 0.5)
FOCAL_LENGTH_WIDTHS = (0.2, 3.0)
"""A focal length in widths of the picture: 136° to 19° of view across."""
EQUAL_FOCAL_LENGTHS = (0.9, 1.1)
"""fy over fx, because pixels are square, and the right eye's over the left's, because the lenses are of one kind."""
PRINCIPAL_POINT = (0.3, 0.7)
"""In widths and heights of the picture."""
CORNER_SCALE = (0.4, 2.5)
"""By what a lens's distortion may stretch or shrink the distance of the picture's corner from its principal point."""
LARGEST_TANGENTIAL_TERM = 0.1
LARGEST_TOE_IN_RAD = 0.2
LONGEST_UNIT_NAME = 64

_SIDE_BY_SIDE = 0.8
"""The least share of the baseline that lies along the right camera's x axis."""

_LIMITS: dict[str, tuple[float, float]] = {
    "stereo.left.width_px": (16, 8192),
    "stereo.left.height_px": (16, 8192),
    "stereo.left.distortion": (-100.0, 100.0),
    "stereo.right.width_px": (16, 8192),
    "stereo.right.height_px": (16, 8192),
    "stereo.right.distortion": (-100.0, 100.0),
    "stereo.row_time_s": (0.0, 1e-4),
    "stereo.stamp_to_mid_exposure_s": (-0.1, 0.1),
    "depth.lens.width_px": (16, 8192),
    "depth.lens.height_px": (16, 8192),
    "depth.lens.distortion": (-100.0, 100.0),
    "depth.baseline_m": BASELINE_M,
    "depth.step_m": (1e-5, 0.01),
    "depth.scale_residual": (0.0, 0.1),
    "depth.row_time_s": (0.0, 1e-4),
    "depth.stamp_to_mid_exposure_s": (-0.1, 0.1),
    "imu.sf_bias_mps2": (-2.0, 2.0),
    "imu.w_bias_radps": (-1.0, 1.0),
    "imu.temperature_degC": (-40.0, 85.0),
    "X_BL.p_m": (-0.5, 0.5),
    "X_BD.p_m": (-0.5, 0.5),
    "residual.specific_force_mps2": (0.0, 1.0),
    "residual.scale": (0.0, 0.1),
    "residual.toe_in_rad": (0.0, 0.1),
    "residual.rows_rad": (0.0, 0.01),
    "residual.focal_length": (0.0, 0.02),
    "residual.baseline": (0.0, 0.05),
    "residual.specific_force_mps2_per_K": (0.0, 0.05),
    "residual.camera_to_imu_rad": (0.0, 0.1),
    "residual.time_s": (0.0, 0.1),
    "wearer.camera_height_m": CAMERA_HEIGHTS_M,
    "wearer.std_m": (1e-4, 0.1),
}

_FINITE = (-sys.float_info.max, sys.float_info.max)

_NEAR_IDENTITY = ("imu.sf_matrix", "imu.w_matrix")
_MATRIX_TOLERANCE = 0.1
"""±10 % of scale, 0.1 rad of misalignment: three times the MPU-6050's datasheet limits."""

_HEADING = """\
# GaitEyes calibration. SI units and pixels. X_AB takes points from frame B to frame A.
# Frames: B the IMU; L, R the raw left and right cameras, D a depth camera (x right, y down, z forward).
"""

_INDEX = re.compile(r"\[(\d+)\]")


def load_calibration(path: Path) -> UnitCalibration:
    """Return the calibration that the sealed file holds; raises UserError, one line, where it cannot be used."""
    if not path.exists():
        raise CalibrationError(f"{path}: No such file or directory; `gaiteyes init` makes a nominal one, to begin with")
    text = read_text(path)
    check_seal(text, str(path))
    return parse_calibration(text, str(path))


def seal_file(path: Path) -> UnitCalibration:
    """Seal a file that a person has edited, or that is older than seals, and return what it holds.

    All but the seal stays as it stands. Raises UserError, one line, where `load_calibration` would refuse its values,
    and where it cannot be written.
    """
    text = read_text(path)
    calibration = parse_calibration(text, str(path))
    _write(path, sealed(text))
    return calibration


def parse_calibration(text: str, where: str) -> UnitCalibration:
    """Return the calibration that `text` holds, sealed or not: that inside a recording has the recording's checksum.

    Raises UserError whose line begins with `where`; CalibrationError is one.
    """
    document = parse_yaml(text, where)
    _check_ranges(document, where)
    kind: type[UnitCalibration] = Calibration
    if isinstance(document, Mapping) and "depth" in document:
        kind = DepthUnitCalibration
    calibration = checked(document, kind, where)
    _check_geometry(calibration, where)
    return calibration


def save_calibration(path: Path, calibration: UnitCalibration) -> None:
    """Write the file, sealed, in one step, so that a reader finds the old one or the new one whole.

    `load_calibration` returns an equal calibration. Raises CalibrationError for values that it would refuse, and
    where the file cannot be written.
    """
    check_calibration(calibration, str(path))
    _write(path, sealed(format_calibration(calibration)))


def _write(path: Path, text: str) -> None:
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        os.replace(part, path)
    except OSError as error:
        raise CalibrationError(f"{path}: {error.strerror}") from error


def format_calibration(calibration: UnitCalibration) -> str:
    """Return the text of the file but for its seal."""
    return _HEADING + format_yaml(msgspec.to_builtins(calibration))


def check_calibration(calibration: UnitCalibration, where: str) -> None:
    """Raise CalibrationError, its line beginning with `where`, if any value is impossible or out of its range."""
    _check_ranges(msgspec.to_builtins(calibration), where)
    _check_geometry(calibration, where)


def check_frame_size(calibration: UnitCalibration, width_px: int, height_px: int, camera: str) -> None:
    """Raise CalibrationError unless the calibration is for frames of this size; `camera` names where they come from."""
    lens = calibration.camera.lens
    if (lens.width_px, lens.height_px) != (width_px, height_px):
        raise CalibrationError(
            f"calibration '{calibration.unit}' is for {lens.width_px}x{lens.height_px} px, "
            f"{camera} delivers {width_px}x{height_px} px"
        )


def _numbers(value: object, field: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _numbers(item, f"{field}.{key}" if field else str(key))
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        for index, item in enumerate(value):
            yield from _numbers(item, f"{field}[{index}]")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield field, value


def _check_ranges(document: object, where: str) -> None:
    for field, value in _numbers(document, ""):
        low, high = _allowed(field)
        if not low <= value <= high:
            allowed = "any finite number" if (low, high) == _FINITE else f"{low:g} to {high:g}"
            raise CalibrationError(f"{where}: {field} is {_shown(value)}, allowed {allowed}")


def _allowed(field: str) -> tuple[float, float]:
    name, *indices = _INDEX.split(field)[0], *_INDEX.findall(field)
    if name in _NEAR_IDENTITY and len(indices) == 2:
        ideal = float(indices[0] == indices[1])
        return ideal - _MATRIX_TOLERANCE, ideal + _MATRIX_TOLERANCE
    return _LIMITS.get(name, _FINITE)


def _shown(value: float) -> str:
    return f"{value:.9g}" if isinstance(value, float) else f"{value}"


def _check_geometry(calibration: UnitCalibration, where: str) -> None:
    problem = next(_problems(calibration), None)
    if problem is not None:
        raise CalibrationError(f"{where}: {problem}")


def _problems(calibration: UnitCalibration) -> Iterator[str]:
    unit = calibration.unit
    if not (0 < len(unit) <= LONGEST_UNIT_NAME and unit.isprintable()):
        yield f"unit is {unit!r}, allowed 1 to {LONGEST_UNIT_NAME} printable characters"
    if isinstance(calibration, DepthUnitCalibration):
        yield from _lens_problems(calibration.depth.lens, "depth.lens")
        yield from _rotation_problems(calibration.X_BD.R, "X_BD.R")
    else:
        yield from _stereo_problems(calibration.stereo)
        yield from _rotation_problems(calibration.X_BL.R, "X_BL.R")


def _stereo_problems(stereo: StereoCalibration) -> Iterator[str]:
    yield from _lens_problems(stereo.left, "stereo.left")
    yield from _lens_problems(stereo.right, "stereo.right")
    left_size, right_size = ((lens.width_px, lens.height_px) for lens in (stereo.left, stereo.right))
    if left_size != right_size:
        yield "stereo.right is {}x{} px, stereo.left {}x{} px: both must be equal".format(*right_size, *left_size)
    ratio, (low, high) = stereo.right.fx_px / stereo.left.fx_px, EQUAL_FOCAL_LENGTHS
    if not low <= ratio <= high:
        yield f"stereo.right.fx_px is {ratio:.3g} times stereo.left.fx_px, allowed {low:g} to {high:g} times"
    yield from _rotation_problems(stereo.X_RL.R, "stereo.X_RL.R")
    yield from _toe_in_problems(stereo.X_RL.R)
    yield from _baseline_problems(stereo.X_RL)


def _lens_problems(lens: Lens, field: str) -> Iterator[str]:
    if len(lens.distortion) not in DISTORTION_TERMS:
        allowed = ", ".join(str(count) for count in DISTORTION_TERMS)
        yield f"{field}.distortion has {len(lens.distortion)} terms, allowed {allowed}"
    for name, value in (("fx_px", lens.fx_px), ("fy_px", lens.fy_px)):
        low, high = (widths * lens.width_px for widths in FOCAL_LENGTH_WIDTHS)
        if not low <= value <= high:
            yield f"{field}.{name} is {value:.9g}, allowed {low:g} to {high:g} for pictures {lens.width_px} px wide"
    ratio, (low, high) = lens.fy_px / lens.fx_px, EQUAL_FOCAL_LENGTHS
    if not low <= ratio <= high:
        yield f"{field}.fy_px is {ratio:.3g} times fx_px, allowed {low:g} to {high:g} times"
    for name, value, size_px in (("cx_px", lens.cx_px, lens.width_px), ("cy_px", lens.cy_px, lens.height_px)):
        low, high = (share * size_px for share in PRINCIPAL_POINT)
        if not low <= value <= high:
            yield f"{field}.{name} is {value:.9g}, allowed {low:g} to {high:g} of {size_px} px"
    for k, term in enumerate(lens.distortion[2:4], start=2):
        if abs(term) > LARGEST_TANGENTIAL_TERM:
            yield f"{field}.distortion[{k}] is {term:.9g}, allowed up to ±{LARGEST_TANGENTIAL_TERM:g}: tangential"
    scale, (low, high) = _corner_scale(lens), CORNER_SCALE
    if not low <= scale <= high:
        yield f"{field}.distortion scales the picture's corner by {scale:.3g}, allowed {low:g} to {high:g}"


def _corner_scale(lens: Lens) -> float:
    """Return (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶) [OpenCV, calib3d] at the picture's corner."""
    k1, k2, _, _, k3, k4, k5, k6 = (*lens.distortion, 0.0, 0.0, 0.0, 0.0)[:8]
    r2 = (0.5 * lens.width_px / lens.fx_px) ** 2 + (0.5 * lens.height_px / lens.fy_px) ** 2
    below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
    return (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / below if below > 0.0 else math.inf


def _rotation_problems(rows: Matrix3, field: str) -> Iterator[str]:
    R = np.array(rows)
    with np.errstate(over="ignore", invalid="ignore"):
        error = float(np.abs(R.T @ R - np.eye(3)).max())
    if not error <= ROTATION_TOLERANCE:
        yield f"{field} is no rotation: off orthonormal by {error:.2g}, allowed up to {ROTATION_TOLERANCE:g}"
    elif np.linalg.det(R) < 0:
        yield f"{field} mirrors: its determinant is -1, allowed +1"


def _toe_in_problems(R_RL: Matrix3) -> Iterator[str]:
    angle_rad = math.acos(min(1.0, max(-1.0, 0.5 * (R_RL[0][0] + R_RL[1][1] + R_RL[2][2] - 1.0))))
    if angle_rad > LARGEST_TOE_IN_RAD:
        yield f"stereo.X_RL.R turns by {angle_rad:.3g} rad, allowed up to {LARGEST_TOE_IN_RAD:g}: the eyes look one way"


def _baseline_problems(X_RL: Pose) -> Iterator[str]:
    field, baseline_m = "stereo.X_RL.p_m", math.hypot(*X_RL.p_m)
    low_m, high_m = BASELINE_M
    if not low_m <= baseline_m <= high_m:
        yield f"{field} has the length {baseline_m:.4g} m, allowed {low_m:g} to {high_m:g} m: the baseline"
    elif X_RL.p_m[0] > 0:
        yield (
            f"{field}[0] is {X_RL.p_m[0]:.4g} m, allowed below 0: left and right are swapped "
            "(the left camera must lie at negative x of the right one)"
        )
    elif -X_RL.p_m[0] < _SIDE_BY_SIDE * baseline_m:
        yield f"{field}[0] is {X_RL.p_m[0]:.4g} m of a baseline of {baseline_m:.4g} m: the cameras must be side by side"

"""A unit as it was meant to be built, until somebody calibrates it; its residual says how far off that may be."""

import math
from typing import NamedTuple

import msgspec
import numpy as np

from messages import (
    Calibration,
    DepthCalibration,
    DepthUnitCalibration,
    ImuCalibration,
    Lens,
    Pose,
    Residual,
    StereoCalibration,
    matrix3,
    vec3,
)

R_BL_NOMINAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""B: x along the cameras' optical axes, y to the wearer's left, z out of the camera's top. L: x right, y down, z ahead.
"""

NOMINAL_RESIDUAL = Residual(
    specific_force_mps2=0.6,
    scale=0.03,
    toe_in_rad=float(np.deg2rad(0.05)),
    rows_rad=3e-4,
    camera_to_imu_rad=float(np.deg2rad(3.0)),
    time_s=0.01,
)
"""MPU-6050 datasheet (zero-g ±50 and ±80 mg, sensitivity ±3 %); mounting by eye; stamps by their usual delay. That the
pair's optical axes have kept the maker's calibration to 0.05°, and its rows to a fifth of a pixel, is assumed."""

_NOMINAL_IMU = ImuCalibration(
    sf_matrix=matrix3(np.eye(3)),
    sf_bias_mps2=vec3(np.zeros(3)),
    w_matrix=matrix3(np.eye(3)),
    w_bias_radps=vec3(np.zeros(3)),
)

NOMINAL_LENS_RESIDUAL = msgspec.structs.replace(
    NOMINAL_RESIDUAL, toe_in_rad=float(np.deg2rad(1.0)), rows_rad=0.01, focal_length=0.02, baseline=0.05
)
"""The same of a pair of which only the data sheet is known: how its lenses were mounted is anybody's guess."""
NOMINAL_DEPTH_SCALE_RESIDUAL = 0.02
"""What the makers of depth cameras promise: 2 % of the distance."""


class NominalOptics(NamedTuple):
    """What a camera's data sheet says: the distance of its eyes, and the angle that a picture shows across."""

    baseline_m: float
    view_rad: float


_KNOWN_OPTICS = {
    "ZED 2": NominalOptics(0.120, 2.0 * math.atan(640.0 / 530.0)),
    "ZED-M": NominalOptics(0.063, 2.0 * math.atan(640.0 / 700.0)),
    "ZED": NominalOptics(0.120, 2.0 * math.atan(640.0 / 700.0)),
}
"""By how a camera's name begins. Focal lengths at 1280 px: 700 px in makers' files of the ZED and the ZED Mini, 530 px
as is told of the ZED 2, whose lenses are wider."""


def known_optics(card: str) -> NominalOptics | None:
    """Return the nominal optics of a camera by the name that V4L2 gives it; None for one that is not known."""
    return next((optics for name, optics in _KNOWN_OPTICS.items() if card.startswith(name)), None)


def nominal_lens(width_px: int, height_px: int, view_rad: float) -> Lens:
    """Return a lens without distortion whose picture shows `view_rad` across, from its middle."""
    f_px = 0.5 * width_px / math.tan(0.5 * view_rad)
    return Lens(
        width_px=width_px,
        height_px=height_px,
        fx_px=f_px,
        fy_px=f_px,
        cx_px=0.5 * (width_px - 1),
        cy_px=0.5 * (height_px - 1),
        distortion=(0.0, 0.0, 0.0, 0.0),
    )


def nominal_stereo(lens: Lens, baseline_m: float) -> StereoCalibration:
    """Return two eyes of this lens side by side, with parallel axes."""
    return StereoCalibration(left=lens, right=lens, X_RL=Pose(R=matrix3(np.eye(3)), p_m=(-baseline_m, 0.0, 0.0)))


def nominal_pair(width_px: int = 1280, height_px: int = 720) -> StereoCalibration:
    """Return a ZED's pair as it was meant to be built, at another size with the same view."""
    zed = _KNOWN_OPTICS["ZED"]
    return nominal_stereo(nominal_lens(width_px, height_px, zed.view_rad), zed.baseline_m)


def uncalibrated_depth_unit(unit: str, lens: Lens, baseline_m: float) -> DepthUnitCalibration:
    """Return a unit with a depth camera that is known by its drawings only: the IMU at the camera's lens."""
    return DepthUnitCalibration(
        unit=unit,
        imu=_NOMINAL_IMU,
        depth=DepthCalibration(lens=lens, baseline_m=baseline_m, scale_residual=NOMINAL_DEPTH_SCALE_RESIDUAL),
        X_BD=Pose(R=matrix3(R_BL_NOMINAL), p_m=(0.0, 0.0, 0.0)),
        residual=msgspec.structs.replace(NOMINAL_RESIDUAL, toe_in_rad=0.0, rows_rad=0.0),
    )


def uncalibrated_unit(unit: str, stereo: StereoCalibration, residual: Residual = NOMINAL_RESIDUAL) -> Calibration:
    """Return a unit that is known but for `stereo` by its drawings only: the IMU midway between the cameras."""
    half_baseline_m = float(np.linalg.norm(stereo.X_RL.p_m)) / 2
    return Calibration(
        unit=unit,
        imu=_NOMINAL_IMU,
        stereo=stereo,
        X_BL=Pose(R=matrix3(R_BL_NOMINAL), p_m=(0.0, half_baseline_m, 0.0)),
        residual=residual,
    )

"""A unit as it was meant to be built, until somebody calibrates it; its residual says how far off that may be."""

import numpy as np

from messages import Calibration, ImuCalibration, Lens, Pose, Residual, StereoCalibration, matrix3, vec3

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

_ZED_FOCAL_WIDTHS = 700.0 / 1280.0


def nominal_pair(width_px: int = 1280, height_px: int = 720) -> StereoCalibration:
    """Return a ZED's pair as it was meant to be built, at another size with the same view."""
    lens = Lens(
        width_px=width_px,
        height_px=height_px,
        fx_px=_ZED_FOCAL_WIDTHS * width_px,
        fy_px=_ZED_FOCAL_WIDTHS * width_px,
        cx_px=(width_px - 1) / 2,
        cy_px=(height_px - 1) / 2,
        distortion=(0.0, 0.0, 0.0, 0.0),
    )
    return StereoCalibration(left=lens, right=lens, X_RL=Pose(R=matrix3(np.eye(3)), p_m=(-0.12, 0.0, 0.0)))


def uncalibrated_unit(unit: str, stereo: StereoCalibration) -> Calibration:
    """Return a unit that is known but for `stereo` by its drawings only: the IMU midway between the cameras."""
    identity, zero = matrix3(np.eye(3)), vec3(np.zeros(3))
    half_baseline_m = float(np.linalg.norm(stereo.X_RL.p_m)) / 2
    return Calibration(
        unit=unit,
        imu=ImuCalibration(sf_matrix=identity, sf_bias_mps2=zero, w_matrix=identity, w_bias_radps=zero),
        stereo=stereo,
        X_BL=Pose(R=matrix3(R_BL_NOMINAL), p_m=(0.0, half_baseline_m, 0.0)),
        residual=NOMINAL_RESIDUAL,
    )

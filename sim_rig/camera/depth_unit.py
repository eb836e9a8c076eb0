"""One GaitEyes unit that wears a depth camera in place of the stereo pair, as it was built and as it was calibrated.

The camera is in the manner of an Intel RealSense D435: an active stereo pair, 50 mm apart behind global shutters, whose
848×480 depth image comes rectified, in millimetres. Its chip and IMU calibration are those of the stereo unit that the
same seed draws.
"""

from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from calib.nominal import R_BL_NOMINAL
from messages import NO_RESIDUAL, DepthCalibration, DepthUnitCalibration, Lens, Pose, matrix3
from sim_rig.imu.chip_unit import ChipUnit
from sim_rig.unit import RESIDUAL, draw_unit

DEPTH_WIDTH_PX, DEPTH_HEIGHT_PX = 848, 480
SCALE_RESIDUAL = 0.003

_FOCAL_PX = 424.0
_BASELINE_M = 0.050


@dataclass(frozen=True)
class DepthUnit:
    """The true values of one unit, and how its depths err: by a toe-in of the inner pair and by their scale."""

    name: str
    chip: ChipUnit
    depth: DepthCalibration
    X_BD: Pose
    toe_in_rad: float
    scale_error: float


def draw_depth_unit(seed: int, *, perfect_calibration: bool) -> tuple[DepthUnit, DepthUnitCalibration]:
    """Return the unit that `seed` stands for and its calibration file.

    The file holds the true values and one draw of the residual it states; with `perfect_calibration` the true values
    alone, of a camera whose depths have no common error.
    """
    rng = np.random.default_rng([seed, 8])

    def within(limit: float) -> float:
        return float(np.clip(rng.normal(0.0, limit / 2), -limit, limit))

    def turned(R_BD: np.ndarray[tuple[int, int], np.dtype[np.float64]], sigma_rad: float) -> Pose:
        tilt = Rotation.from_rotvec(rng.normal(0.0, sigma_rad, 3)).as_matrix()
        return Pose(R=matrix3(tilt @ R_BD), p_m=p_BD_m)

    worn = draw_unit(seed)
    f_px = _FOCAL_PX + within(3.0)
    lens = Lens(
        width_px=DEPTH_WIDTH_PX,
        height_px=DEPTH_HEIGHT_PX,
        fx_px=f_px,
        fy_px=f_px,
        cx_px=(DEPTH_WIDTH_PX - 1) / 2 + within(5.0),
        cy_px=(DEPTH_HEIGHT_PX - 1) / 2 + within(5.0),
        distortion=(0.0, 0.0, 0.0, 0.0),
    )
    depth = DepthCalibration(
        lens=lens, baseline_m=_BASELINE_M + within(0.0002), stamp_to_mid_exposure_s=-0.012 + within(0.004)
    )
    p_BD_m = (within(0.003), 0.0175 + within(0.003), within(0.003))
    X_BD = turned(R_BL_NOMINAL, np.deg2rad(0.75))
    toe_in_rad, scale_error = rng.normal(0.0, (RESIDUAL.toe_in_rad, SCALE_RESIDUAL)).tolist()
    mounting, late_s = turned(np.array(X_BD.R), RESIDUAL.camera_to_imu_rad), rng.normal(0.0, RESIDUAL.time_s)

    name = f"rig-depth-{seed}"
    if perfect_calibration:
        exact = worn.exact_calibration().imu
        unit = DepthUnit(name, worn.chip, depth, X_BD, toe_in_rad=0.0, scale_error=0.0)
        return unit, DepthUnitCalibration(unit=name, imu=exact, depth=depth, X_BD=X_BD, residual=NO_RESIDUAL)
    stated = msgspec.structs.replace(
        depth, scale_residual=SCALE_RESIDUAL, stamp_to_mid_exposure_s=depth.stamp_to_mid_exposure_s + late_s
    )
    imu = worn.calibration(np.random.default_rng([seed, 6])).imu
    unit = DepthUnit(name, worn.chip, depth, X_BD, toe_in_rad, scale_error)
    return unit, DepthUnitCalibration(unit=name, imu=imu, depth=stated, X_BD=mounting, residual=RESIDUAL)

"""Is a calibration fit to be worn? Its own residual says, held against what an error of it does to the ground ahead."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from messages import DepthUnitCalibration, UnitCalibration
from messages.constants import STANDARD_GRAVITY_MPS2

LINE_OF_SIGHT_M = 1.35
"""From a camera at 0.95 m, pitched 45° down, to the ground."""


class Limits(NamedTuple):
    """From where on one standard deviation is told, and from where on it is a fault."""

    told: float
    fault: float


TILT_DEG = Limits(0.3, 1.0)
"""Of what turns the whole ground: camera to IMU, and the accelerometer by the angle of its error."""
DISTANCE_SHARE = Limits(0.011, 0.03)
"""1 % is a centimetre of the camera's height, 3 % a bad step."""
ROWS_PX = Limits(0.5, 2.0)
"""By how much the eyes' rows differ. The matcher compares windows of some pixels, row by row."""
TIME_S = Limits(0.005, 0.025)
"""A hip turns by 60 °/s while walking: 1.5° in 25 ms."""
SCALE_SHARE = Limits(0.01, 0.05)
"""Of the IMU; a turn by 90° is then off by 4.5°, until the camera sees it."""


class Shortcoming(NamedTuple):
    """What a calibration does not know well enough, in words, whether that is a fault, and what mends it."""

    what: str
    is_fault: bool
    cure: str


def shortcomings(calibration: UnitCalibration) -> Iterator[Shortcoming]:
    """Yield what of a calibration is too uncertain; nothing for one that is fit to be worn."""
    residual = calibration.residual
    camera_deg = math.degrees(residual.camera_to_imu_rad)
    sf_share = residual.specific_force_mps2 / STANDARD_GRAVITY_MPS2
    tilt_deg = math.degrees(math.atan(sf_share))
    distance = _distance_share(calibration)
    rows_px = residual.rows_rad * calibration.camera.lens.fx_px
    mount, imu = "gaiteyes calibrate mount", "gaiteyes calibrate imu"
    eyes = "gaiteyes calibrate stereo"
    if isinstance(calibration, DepthUnitCalibration):
        eyes = "the camera maker's own calibration"
    for what, value, limits, cure in (
        (f"camera to IMU ± {camera_deg:.1f}°", camera_deg, TILT_DEG, mount),
        (f"accelerometer ± {1e3 * sf_share:.0f} mg, {tilt_deg:.1f}° of tilt", tilt_deg, TILT_DEG, imu),
        (f"scale of the IMU ± {100 * residual.scale:.1f} %", residual.scale, SCALE_SHARE, imu),
        (f"distances ± {100 * distance:.1f} %", distance, DISTANCE_SHARE, eyes),
        (f"rows of the eyes ± {rows_px:.1f} px", rows_px, ROWS_PX, eyes),
        (f"time of the pictures ± {1e3 * residual.time_s:.0f} ms", residual.time_s, TIME_S, mount),
    ):
        if value > limits.told:
            yield Shortcoming(what, value > limits.fault, cure)


def _distance_share(calibration: UnitCalibration) -> float:
    """Return one standard deviation of a distance on the ground: by toe-in, z/b δ, by focal length and by baseline."""
    residual = calibration.residual
    if isinstance(calibration, DepthUnitCalibration):
        baseline_m, scale = calibration.depth.baseline_m, calibration.depth.scale_residual
    else:
        baseline_m, scale = math.hypot(*calibration.stereo.X_RL.p_m), residual.baseline_std
    return math.hypot(LINE_OF_SIGHT_M / baseline_m * residual.toe_in_rad, residual.focal_length_std, scale)

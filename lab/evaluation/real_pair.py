"""A real stereo photograph with a concrete floor in view, its calibration and its true disparity.

The Middlebury 2014 "Motorcycle" pair at 741×500 as scikit-image ships it (Scharstein et al., "High-resolution
stereo datasets with subpixel-accurate ground truth", GCPR 2014); the calibration is that of its docstring.
"""

from dataclasses import dataclass

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from messages import Lens, Pose, Residual, StereoCalibration, matrix3
from messages.arrays import FloatArray, GreyImage
from perception.ground.foothold import FootholdSettings
from perception.ground.meter import GroundMeter
from perception.ground.plane import Plane, PlaneFitter

F_PX, CX_LEFT_PX, CX_RIGHT_PX, CY_PX, BASELINE_M = 994.978, 311.193, 311.193 + 31.086, 254.877, 0.193001
NOMINAL_PITCH_RAD = float(np.radians(15.0))
FLOOR = FootholdSettings(ahead_m=2.9, half_length_m=0.9, half_width_m=1.2, nominal_height_m=1.1).region


@dataclass(frozen=True)
class RealPair:
    """`left`, `right` (500, 741) uint8; `disparity_px` (500, 741), NaN where unknown, principal points included."""

    left: GreyImage
    right: GreyImage
    disparity_px: FloatArray
    calibration: StereoCalibration


class FloorComparison(msgspec.Struct, frozen=True, kw_only=True):
    """The floor as matched beside the floor as fitted to the true disparity, both in the same H."""

    pitch_deg: float
    true_pitch_deg: float
    height_m: float
    true_height_m: float
    angle_error_deg: float
    matched_share: float

    @property
    def pitch_error_deg(self) -> float:
        """Return matched minus true."""
        return self.pitch_deg - self.true_pitch_deg

    @property
    def height_error_mm(self) -> float:
        """Return matched minus true."""
        return 1e3 * (self.height_m - self.true_height_m)


def load() -> RealPair:
    """Return the pair; it is part of scikit-image's wheel, nothing is downloaded."""
    from skimage.data import stereo_motorcycle

    left, right, disparity_px = stereo_motorcycle()
    height_px, width_px = disparity_px.shape

    def lens(cx_px: float) -> Lens:
        return Lens(
            width_px=width_px,
            height_px=height_px,
            fx_px=F_PX,
            fy_px=F_PX,
            cx_px=cx_px,
            cy_px=CY_PX,
            distortion=(0.0, 0.0, 0.0, 0.0),
        )

    calibration = StereoCalibration(
        left=lens(CX_LEFT_PX),
        right=lens(CX_RIGHT_PX),
        X_RL=Pose(R=matrix3(np.eye(3)), p_m=(-BASELINE_M, 0.0, 0.0)),
    )
    known = np.where(np.isfinite(disparity_px), disparity_px + (CX_RIGHT_PX - CX_LEFT_PX), np.nan)
    return RealPair(_grey(left), _grey(right), known.astype(np.float64), calibration)


def _grey(image: NDArray[np.uint8]) -> GreyImage:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def compare_floor(pair: RealPair) -> FloorComparison:
    """Return the floor's plane as the daemon measures it beside the one through the true disparity.

    Raises ValueError if no floor is found.
    """
    s, c = np.sin(NOMINAL_PITCH_RAD), np.cos(NOMINAL_PITCH_RAD)
    R_HC = np.array([[0.0, -s, c], [-1.0, 0.0, 0.0], [0.0, -c, -s]])
    meter = GroundMeter(pair.calibration, Residual())
    measured = meter.measure((pair.left, pair.right), R_HC, np.zeros(3), 0.0, FLOOR, None)
    if measured.fit is None:
        raise ValueError(f"no floor in the pair: {measured.reason.value}")
    true = _true_floor(pair, R_HC)
    return FloorComparison(
        pitch_deg=_slope_deg(measured.fit.plane),
        true_pitch_deg=_slope_deg(true),
        height_m=measured.fit.plane.height_m,
        true_height_m=true.height_m,
        angle_error_deg=_angle_deg(measured.fit.plane, true),
        matched_share=measured.matched_share,
    )


def _true_floor(pair: RealPair, R_HC: FloatArray) -> Plane:
    v, u = np.nonzero(np.isfinite(pair.disparity_px))
    rays_C = np.stack(((u - CX_LEFT_PX) / F_PX, (v - CY_PX) / F_PX, np.ones(len(u))), axis=-1)
    rays_H, disparity_px = rays_C @ R_HC.T, pair.disparity_px[v, u]
    points_H = rays_H * (F_PX * BASELINE_M / disparity_px)[:, None]
    inside = FLOOR.contains(points_H)
    fit = PlaneFitter(fB_px_m=F_PX * BASELINE_M).fit(
        rays_H[inside], disparity_px[inside], FLOOR.weights(points_H[inside])
    )
    if fit is None:
        raise ValueError("no floor in the true disparity")
    return fit.plane


def _slope_deg(plane: Plane) -> float:
    return float(np.degrees(np.arctan(plane.gradient[0])))


def _angle_deg(one: Plane, other: Plane) -> float:
    n, m = (np.array([*plane.gradient, -1.0]) for plane in (one, other))
    return float(np.degrees(np.arccos(np.clip(n @ m / np.linalg.norm(n) / np.linalg.norm(m), -1.0, 1.0))))

"""What the daemon should have said: the ground at the next foothold, from the world and the wearer's true pose."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from messages import GroundTruth, Pose, StereoCalibration
from messages.arrays import FloatArray
from perception.depth.rectify import intrinsics
from sim_rig.walk.footholds import Footholds
from sim_rig.walk.gait import Gait, Motion
from sim_rig.walk.world import World


@dataclass(frozen=True)
class FootholdTruth:
    """Where and when, seen from H at one instant, the next foot lands, and on what.

    `ahead_m` and `left_m` are along x and y of H from its origin, `below_m` how far down along gravity. `rise_m` is how
    much higher than the last landing's its ground is, NaN before the first step. Slopes are those of `GroundTruth`.
    """

    t_land_ns: int
    left_foot: bool
    ahead_m: float
    left_m: float
    below_m: float
    rise_m: float
    slope_sagittal_rad: float
    slope_frontal_rad: float
    kind: str


class TruthSource:
    """Truth for one unit on one walk; where the ground moves, all of it is over that ground.

    `X_BE` is the true pose of the camera E whose optical centre is the origin of H; H's x is the horizontal
    projection of the axis `axis_E` (3,).
    """

    def __init__(self, X_BE: Pose, axis_E: FloatArray, world: World, gait: Gait, footholds: Footholds) -> None:
        self._world = world
        self._gait = gait
        self._footholds = footholds
        self._p_BE_m = np.array(X_BE.p_m)
        self._axis_B = np.array(X_BE.R) @ axis_E

    def at(self, t_ns: int, stamp_ns: int, ahead_m: float, half_length_m: float, left_m: float = 0.0) -> GroundTruth:
        """Return the truth at the true instant `t_ns`, under the name `stamp_ns` that the frame goes by.

        The foothold is `ahead_m` along x of H and `left_m` along y, its region reaches `half_length_m` before and
        behind. The plane is the one under the foothold, on rough ground that of least squares through a square region;
        `height_m` is that plane's distance straight below the optical centre.
        """
        motion = self._gait.at(np.array([t_ns]))
        p_WE, (cos_heading, sin_heading) = self._origin_and_heading(motion)
        foothold_x_m = p_WE[0] + ahead_m * cos_heading - left_m * sin_heading
        reach_m = half_length_m * abs(cos_heading)
        ground = self._world.segment_at(foothold_x_m)
        slope_sagittal_rad, slope_frontal_rad = _slopes(ground.slope_rad, cos_heading, sin_heading)
        height_m = float(p_WE[2] - ground.height_at(p_WE[0]))
        if self._world.relief is not None:
            x_H, y_H = region_H(ahead_m, half_length_m, half_length_m)
            y_H = y_H + left_m
            ahead, left = np.array((cos_heading, sin_heading)), np.array((-sin_heading, cos_heading))
            x_W, y_W = (p_WE[:2] + np.outer(x_H, ahead) + np.outer(y_H, left)).T
            a, b, c = np.linalg.lstsq(
                np.column_stack((x_H, y_H, np.ones_like(x_H))), self._world.relief.heights(x_W, y_W)
            )[0]
            slope_sagittal_rad, slope_frontal_rad, height_m = math.atan(a), math.atan(b), height_m - float(c)
        w, x, y, z = (float(q) for q in Rotation.from_matrix(motion.R_WB[0]).as_quat(canonical=True, scalar_first=True))
        return GroundTruth(
            t_exposure_ns=stamp_ns,
            slope_sagittal_rad=slope_sagittal_rad,
            slope_frontal_rad=slope_frontal_rad,
            height_m=height_m,
            q_WB=(w, x, y, z),
            kind=ground.kind,
            transition=self._world.has_edge(foothold_x_m - reach_m, foothold_x_m + reach_m),
            standing=bool(motion.standing[0]),
        )

    def next_foothold(self, t_ns: int, left: bool | None = None) -> FootholdTruth | None:
        """Return the next landing after the true instant `t_ns`, of the left or the right foot where one is named, or
        None for a wearer who never walks."""
        landing, stance = self._footholds.next_after(t_ns, left), self._footholds.last_before(t_ns)
        if landing is None:
            return None
        p_WE, (cos_heading, sin_heading) = self._origin_and_heading(self._gait.at(np.array([t_ns])))
        x_m, y_m, z_m = (float(each) for each in landing.p_WF_m - p_WE)
        slope_sagittal_rad, slope_frontal_rad = _slopes(landing.slope_rad, cos_heading, sin_heading)
        return FootholdTruth(
            t_land_ns=landing.t_land_ns,
            left_foot=landing.left,
            ahead_m=cos_heading * x_m + sin_heading * y_m,
            left_m=cos_heading * y_m - sin_heading * x_m,
            below_m=-z_m,
            rise_m=math.nan if stance is None else float(landing.p_WF_m[2] - stance.p_WF_m[2]),
            slope_sagittal_rad=slope_sagittal_rad,
            slope_frontal_rad=slope_frontal_rad,
            kind=landing.kind,
        )

    def _origin_and_heading(self, motion: Motion) -> tuple[FloatArray, tuple[float, float]]:
        """Return p_WE (3,), and cosine and sine of the heading."""
        R_WB = motion.R_WB[0]
        p_WE: FloatArray = motion.p_WB_m[0] + R_WB @ self._p_BE_m
        x, y, _ = R_WB @ self._axis_B
        length = math.hypot(x, y)
        return p_WE, (float(x) / length, float(y) / length)


def _slopes(slope_rad: float, cos_heading: float, sin_heading: float) -> tuple[float, float]:
    """Return the slopes ahead and across of ground that has this one along x of W."""
    gradient = math.tan(slope_rad)
    return math.atan(gradient * cos_heading), math.atan(-gradient * sin_heading)


def region_H(ahead_m: float, half_length_m: float, half_width_m: float) -> tuple[FloatArray, FloatArray]:
    """Return x and y (n,) in H of points evenly over a foothold region."""
    across = (np.arange(_REGION_POINTS) + 0.5) / _REGION_POINTS * 2 - 1
    x, y = np.meshgrid(ahead_m + half_length_m * across, half_width_m * across)
    return x.ravel(), y.ravel()


_REGION_POINTS = 24


def rectified_axis_L(stereo: StereoCalibration) -> FloatArray:
    """Return the optical axis of the rectified left camera, (3,), in the raw left camera.

    Rectification is that of cv2.stereoRectify: zero disparity at infinity, alpha 0.
    """
    R_CL = cv2.stereoRectify(
        intrinsics(stereo.left),
        np.array(stereo.left.distortion),
        intrinsics(stereo.right),
        np.array(stereo.right.distortion),
        (stereo.left.width_px, stereo.left.height_px),
        np.array(stereo.X_RL.R),
        np.array(stereo.X_RL.p_m).reshape(3, 1),
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )[0]
    axis_L: FloatArray = R_CL[2]
    return axis_L

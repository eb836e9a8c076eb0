"""What the daemon should have said: the ground at the next foothold, from the world and the wearer's true pose."""

import math

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from messages import GroundTruth, Pose, StereoCalibration
from messages.arrays import FloatArray
from perception.depth.rectify import intrinsics
from sim_rig.walk.gait import Gait
from sim_rig.walk.world import World


class TruthSource:
    """Truth for one unit on one walk.

    `X_BE` is the true pose of the camera E whose optical centre is the origin of H; H's x is the horizontal
    projection of the axis `axis_E` (3,).
    """

    def __init__(self, X_BE: Pose, axis_E: FloatArray, world: World, gait: Gait) -> None:
        self._world = world
        self._gait = gait
        self._p_BE_m = np.array(X_BE.p_m)
        self._axis_B = np.array(X_BE.R) @ axis_E

    def at(self, t_ns: int, stamp_ns: int, ahead_m: float, half_length_m: float) -> GroundTruth:
        """Return the truth at the true instant `t_ns`, under the name `stamp_ns` that the frame goes by.

        The foothold is `ahead_m` along x of H, its region reaches `half_length_m` before and behind. The plane is
        the one under the foothold, `height_m` that plane's distance straight below the optical centre.
        """
        motion = self._gait.at(np.array([t_ns]))
        R_WB = motion.R_WB[0]
        p_WE = motion.p_WB_m[0] + R_WB @ self._p_BE_m
        axis_W = R_WB @ self._axis_B
        cos_heading, sin_heading = axis_W[:2] / np.hypot(axis_W[0], axis_W[1])
        foothold_x_m = p_WE[0] + ahead_m * cos_heading
        reach_m = half_length_m * abs(cos_heading)
        ground = self._world.segment_at(foothold_x_m)
        gradient = math.tan(ground.slope_rad)
        w, x, y, z = (float(q) for q in Rotation.from_matrix(R_WB).as_quat(canonical=True, scalar_first=True))
        return GroundTruth(
            t_exposure_ns=stamp_ns,
            slope_sagittal_rad=math.atan(gradient * cos_heading),
            slope_frontal_rad=math.atan(-gradient * sin_heading),
            height_m=float(p_WE[2] - ground.height_at(p_WE[0])),
            q_WB=(w, x, y, z),
            kind=ground.kind,
            transition=self._world.has_edge(foothold_x_m - reach_m, foothold_x_m + reach_m),
            standing=bool(motion.standing[0]),
        )


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

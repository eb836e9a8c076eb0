"""What the simple estimators of the ground ahead begin with: each frame's points on the path, by the service's
disparities, attitude and velocity."""

from typing import NamedTuple

import numpy as np

from messages import Calibration, ImuSample, Input, StereoFrame
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.track import AttitudeTrack
from perception.depth.disparity import OutOfRangeError
from perception.depth.stereo_camera import StereoCamera
from perception.heading import heading
from perception.motion.watch import MotionWatch

FROM_M, TO_M, HALF_WIDTH_M = 0.3, 2.5, 0.15
"""The part of the path that is looked at, along x and to either side of H."""
_BELOW_M = (0.3, 1.6)  # the camera, where ground is looked for
_LEAST_DEPTH_M = 0.1
_NOISE_PX = 0.1


class PathSeen(NamedTuple):
    """A frame's points (n, 3) on the path in H, how far the matcher's noise moves each (n,), the axes of H in W (3, 3)
    and the camera's velocity in W (3,), m/s."""

    t_exposure_ns: int
    points_H_m: FloatArray
    deviation_m: FloatArray
    R_WH: FloatArray
    v_W_mps: FloatArray


class PathView:
    """Takes what the pipeline takes, and tells what each frame shows of the path."""

    def __init__(self, calibration: Calibration) -> None:
        self._track, self._watch = AttitudeTrack(calibration), MotionWatch(calibration)
        self._camera = StereoCamera(calibration.stereo)
        self._R_BC = np.array(calibration.X_BL.R) @ self._camera.R_EC
        self._p_BC_m = np.array(calibration.X_BE.p_m)

    def step(self, message: Input) -> PathSeen | None:
        """Take one input and return what is seen in a frame whose attitude is known."""
        if isinstance(message, ImuSample):
            self._watch.add_sample(message)
            self._track.add_sample(message)
            return None
        if not isinstance(message, StereoFrame):
            return None
        motion = self._watch.add_frame(message, self._track.foretold)
        if motion is not None and self._watch.step_is_sound:
            self._track.add_camera_step(motion)
        seen = self._seen(message)
        self._watch.finish_frame()
        return seen

    def _seen(self, frame: StereoFrame) -> PathSeen | None:
        placed = self._track.at(frame.header.t_exposure_ns)
        if placed is None:
            return None
        w_B = np.array(placed.w_WB_B)
        R_WB = so3.matrix_from_quaternion(placed.q_WB)
        R_WC = R_WB @ self._R_BC
        R_WH = heading(R_WC)
        if R_WH is None:
            return None
        R_HC = R_WH.T @ R_WC
        x, y, z = np.meshgrid((FROM_M, TO_M), (-HALF_WIDTH_M, HALF_WIDTH_M), -np.array(_BELOW_M))
        corners_C = np.column_stack((x.ravel(), y.ravel(), z.ravel())) @ R_HC
        middle_C = np.array([[0.5 * (FROM_M + TO_M), 0.0, -np.mean(_BELOW_M)]]) @ R_HC
        corners_C = np.vstack((corners_C[corners_C[:, 2] > _LEAST_DEPTH_M], middle_C))
        try:
            patch = self._camera.find_disparities(frame.images, corners_C)
        except OutOfRangeError:
            return None
        if patch is None:
            return None
        rays_H = patch.rays_H(R_HC, self._R_BC.T @ w_B, 0.0)
        depth_m = self._camera.f_px * self._camera.baseline_m / patch.disparity_px
        points_H = rays_H * depth_m[..., None]
        with np.errstate(invalid="ignore"):
            on_path = np.abs(points_H[..., 1]) < HALF_WIDTH_M
        deviation_m = _NOISE_PX / patch.disparity_px[on_path] * np.abs(points_H[on_path][:, 2])
        v_C_W = np.array(placed.v_W_mps) + R_WB @ so3.skew(w_B) @ self._p_BC_m
        return PathSeen(frame.header.t_exposure_ns, points_H[on_path], deviation_m, R_WH, v_C_W)

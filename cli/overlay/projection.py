"""Where points of H show in the raw picture of the left eye, or of a depth camera, row by row of a rolling shutter."""

from dataclasses import dataclass

import cv2
import numpy as np

from messages import DepthCalibration, Lens, StereoCalibration, UnitCalibration
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.history import AttitudeAt
from perception.depth.rectify import Rectifier, intrinsics, undistorted_rays
from perception.heading import heading


@dataclass(frozen=True)
class Sight:
    """How the camera stood in W and H at mid-exposure, `R_WE` and `R_EH` (3, 3), and how it moved: turn and travel of
    E, in E."""

    lens: Lens
    row_time_s: float
    R_WE: FloatArray
    R_EH: FloatArray
    w_E_radps: FloatArray
    v_E_mps: FloatArray
    widest: FloatArray

    def pixels(self, points_H: FloatArray) -> FloatArray:
        """Return the pixels (n, 2) of points (n, 3) in H; NaN for those beside or behind the picture.

        A row exposed τ later than the middle one is seen from a camera that has turned by τ ω and moved by τ v:
        p(τ) = p − τ (ω × p + v). The row depends on τ and τ on the row; a row is some microseconds.
        """
        still_E = points_H @ self.R_EH.T
        moving = still_E @ so3.skew(self.w_E_radps).T + self.v_E_mps
        pixels = np.full((len(points_H), 2), (self.lens.height_px - 1) / 2)
        for _ in range(_ROUNDS):
            late_s = (pixels[:, 1:] - (self.lens.height_px - 1) / 2) * self.row_time_s
            pixels = self._still(still_E - np.nan_to_num(late_s) * moving)
        return pixels

    def _still(self, points_E: FloatArray) -> FloatArray:
        before = points_E[:, 2] > _NEAREST_M
        rays = points_E / np.where(before, points_E[:, 2], 1.0)[:, None]
        within = before & (np.abs(rays[:, :2]) < self.widest).all(axis=1)  # a lens's polynomial folds back beyond
        pixels = np.full((len(points_E), 2), np.nan)
        if within.any():
            K, distortion, none = intrinsics(self.lens), np.array(self.lens.distortion), np.zeros(3)
            pixels[within] = cv2.projectPoints(rays[within], none, none, K, distortion)[0].reshape(-1, 2)
        return pixels


class Projection:
    """Tells of each frame how its camera stood."""

    def __init__(self, calibration: UnitCalibration) -> None:
        camera: StereoCalibration | DepthCalibration = calibration.camera
        self._lens, self._row_time_s = camera.lens, camera.row_time_s
        self._R_EC = np.eye(3) if isinstance(camera, DepthCalibration) else Rectifier(camera, 1).R_LC
        self._R_BE = np.array(calibration.X_BE.R)
        columns, rows = np.arange(float(self._lens.width_px)), np.arange(float(self._lens.height_px))
        rays = undistorted_rays(self._lens, columns, rows)
        self._widest: FloatArray = np.abs(rays[..., :2]).max(axis=(0, 1)) * _BEYOND

    def sight(self, attitude: AttitudeAt, v_H_mps: FloatArray) -> Sight | None:
        """Return how a frame is seen, of the `attitude` at its mid-exposure; None where it looks straight down.

        `v_H_mps` (3,) is the velocity of the optical centre.
        """
        R_WE = attitude.R_WB @ self._R_BE
        R_WH = heading(R_WE @ self._R_EC)
        if R_WH is None:
            return None
        R_EH = R_WE.T @ R_WH
        w_E = self._R_BE.T @ np.array(attitude.w_WB_B)
        return Sight(self._lens, self._row_time_s, R_WE, R_EH, w_E, R_EH @ v_H_mps, self._widest)


_ROUNDS = 3
_NEAREST_M = 0.05
_BEYOND = 1.05

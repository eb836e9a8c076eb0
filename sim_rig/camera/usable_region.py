"""Which part of the foothold region a frame shows so that it can be measured: not hidden, textured, not saturated.

Geometry is computed point by point of the region, ray by ray, and not taken from the picture. A point is textured
where a window of N pixels around it tells its shift between the eyes to `MOST_SHIFT_PX`: by the bound of Cramér and
Rao that shift's variance is 2σ² / (N g²), with the noise's variance σ² and the mean square g² of the gradient along
the rows, both of a picture without noise.
"""

from typing import NamedTuple

import cv2
import numpy as np

from messages.arrays import BoolArray, FloatArray, FloatImage
from perception.depth.rectify import intrinsics
from sim_rig.camera.raw_camera import Camera
from sim_rig.camera.rendered_frames import Scene
from sim_rig.camera.renderer import noise_variance
from sim_rig.unit import HEIGHT_PX, WIDTH_PX
from sim_rig.walk.gait import Motion
from sim_rig.walk.things import Walker
from sim_rig.walk.truth import rectified_axis_L, region_H

WINDOW_PX = 31
MOST_SHIFT_PX = 0.5
_BRIGHTEST, _DARKEST = 254.5, 0.5


class RegionSeen(NamedTuple):
    """Shares of the foothold region: usable; and hidden or out of the picture, saturated, without texture."""

    usable: float
    hidden: float
    saturated: float
    plain: float


class UsableRegion:
    """Tells of the frames of one scene how much of the foothold region can be measured."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._walker = Walker(scene.gait(), scene.scenario.world, scene.seed)
        self._renderer = scene.renderer()
        self._axis_B = np.array(scene.unit.X_BL.R) @ rectified_axis_L(scene.unit.stereo)

    def seen(
        self, t_ns: int, exposure_s: float, ahead_m: float, half_length_m: float, half_width_m: float
    ) -> RegionSeen:
        """Return the shares of the region, as in FootholdSettings, of the frame at the true mid-exposure `t_ns`."""
        points_W = self._region(t_ns, ahead_m, half_length_m, half_width_m)
        hidden, saturated = np.zeros((2, len(points_W)), np.bool_)
        light = self._renderer.light(t_ns, exposure_s)
        plain_left = np.zeros(len(points_W), np.bool_)
        for eye, (camera, picture) in enumerate(zip(self._renderer.cameras, light, strict=True)):
            pixels, free = self._projected(camera, t_ns, points_W)
            column, row = np.clip(np.rint(pixels).astype(int), 0, (WIDTH_PX - 1, HEIGHT_PX - 1)).T
            hidden |= ~free
            saturated |= (picture[row, column] >= _BRIGHTEST) | (picture[row, column] <= _DARKEST)
            if eye == 0:
                plain_left = ~_textured(picture)[row, column]
        saturated &= ~hidden
        plain = plain_left & ~hidden & ~saturated
        shares = (float(part.mean()) for part in (~(hidden | saturated | plain), hidden, saturated, plain))
        return RegionSeen(*shares)

    def _region(self, t_ns: int, ahead_m: float, half_length_m: float, half_width_m: float) -> FloatArray:
        """Return points (n, 3) in W, evenly over the region on the ground."""
        motion = self._walker.gait.at(np.array([t_ns]))
        axis_W = motion.R_WB[0] @ self._axis_B
        forward = axis_W[:2] / np.hypot(*axis_W[:2])
        origin_W = motion.p_WB_m[0] + motion.R_WB[0] @ np.array(self._scene.unit.X_BL.p_m)
        x, y = region_H(ahead_m, half_length_m, half_width_m)
        xy_W = origin_W[:2] + np.outer(x, forward) + np.outer(y, (-forward[1], forward[0]))
        z_W, relief = self._walker.world.heights(xy_W[:, 0]), self._walker.world.relief
        return np.column_stack((xy_W, z_W if relief is None else z_W + relief.heights(xy_W[:, 0], xy_W[:, 1])))

    def _projected(self, camera: Camera, t_ns: int, points_W: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the pixels (n, 2) of points (n, 3), each at the instant of its own row, and whether they show (n,)."""
        instants_ns = np.full(len(points_W), t_ns)
        row_ns = self._scene.unit.stereo.row_time_s * 1e9
        for _ in range(3):  # the row depends on the instant and the instant on the row; a row is 22 µs
            motion = self._walker.gait.at(instants_ns)
            pixels, depth_m = _pixels(camera, motion, points_W)
            instants_ns = t_ns + np.rint((pixels[:, 1] - (HEIGHT_PX - 1) / 2) * row_ns).astype(np.int64)
        free = (depth_m > 0) & (pixels >= 0).all(axis=1) & (pixels <= (WIDTH_PX - 1, HEIGHT_PX - 1)).all(axis=1)
        eye_W = motion.p_WB_m + motion.R_WB @ camera.p_BE_m
        for thing in self._scene.scenario.things:
            for placed in thing.placed(self._walker, instants_ns, motion):
                free &= ~placed.hides(eye_W, points_W)
        return pixels, free


def _pixels(camera: Camera, motion: Motion, points_W: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pixels (n, 2) and depths (n,) of points (n, 3), each seen at its own instant of `motion`."""
    R_WE = motion.R_WB @ camera.R_BE
    points_E = np.einsum("nij,ni->nj", R_WE, points_W - motion.p_WB_m - motion.R_WB @ camera.p_BE_m)
    none, lens = np.zeros(3), camera.lens
    pixels, _ = cv2.projectPoints(points_E, none, none, intrinsics(lens), np.array(lens.distortion))
    return pixels.reshape(-1, 2).astype(np.float64), points_E[:, 2]


def _textured(light: FloatImage) -> BoolArray:
    """Return (height, width) where the window around a pixel of a picture without noise tells its shift."""
    gradient = cv2.Scharr(light, cv2.CV_32F, 1, 0, scale=1 / 32)
    energy = WINDOW_PX**2 * cv2.blur(gradient * gradient, (WINDOW_PX, WINDOW_PX))
    textured: BoolArray = 2 * noise_variance(light) <= MOST_SHIFT_PX**2 * energy
    return textured

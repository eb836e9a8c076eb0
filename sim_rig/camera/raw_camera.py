"""One eye of the rig as its lens is: where it sits, what its pixels see, how it darkens towards the corners."""

import numpy as np

from messages import Lens
from messages.arrays import FloatArray, GreyImage, IntArray
from perception.depth.rectify import undistorted_rays
from sim_rig.camera.grid import CELL, COLUMNS, ROWS, node_pixels
from sim_rig.camera.things_layer import Eye
from sim_rig.unit import HEIGHT_PX, WIDTH_PX
from sim_rig.walk.gait import Motion


class Camera:
    """One raw camera E: its pose in B, its rays at the nodes (rows, columns, 3) with z = 1, its shading."""

    def __init__(self, lens: Lens, R_BE: FloatArray, p_BE_m: FloatArray, gain: float) -> None:
        self.R_BE, self.p_BE_m, self.gain, self.lens = R_BE, p_BE_m, gain, lens
        self.rays_E = undistorted_rays(lens, node_pixels(COLUMNS), node_pixels(ROWS))
        u, v = np.arange(WIDTH_PX) - lens.cx_px, np.arange(HEIGHT_PX) - lens.cy_px
        radius2 = (u[None] ** 2 + v[:, None] ** 2) / (WIDTH_PX / 2) ** 2
        self.shade: GreyImage = np.rint(255 * (1 - _VIGNETTING * radius2 / radius2.max())).astype(np.uint8)

    def eye(self, motion: Motion) -> Eye:
        """Return where this camera is at the instants of `motion`."""
        return Eye(self.lens, self.rays_E, motion.R_WB @ self.R_BE, motion.p_WB_m + motion.R_WB @ self.p_BE_m)

    def px_per_ray(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """Return (…, 2, 2): how far a pixel moves for a small change of its ray's x and y, at these nodes."""
        across = self.rays_E[rows, columns + 1] - self.rays_E[rows, columns - 1]
        down = self.rays_E[rows + 1, columns] - self.rays_E[rows - 1, columns]
        ray_per_px = np.stack((across, down), axis=-1)[..., :2, :] / (2 * CELL)
        return np.linalg.inv(ray_per_px).astype(np.float64)


_VIGNETTING = 0.28

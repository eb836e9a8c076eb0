"""A depth camera that Linux shows as one V4L2 node delivering Z16, as UVC depth cameras do.

Z16 (the kernel's "Z16, 16-bit depth data"): little-endian, 0 where there is no depth; the step, usually 1 mm, is the
camera's own and stands in its calibration.
"""

import math

import numpy as np

from drivers.camera import v4l2_abi as v4l2
from drivers.camera.frame_pool import PixelPool
from drivers.camera.one_node import V4l2Capture
from drivers.camera.v4l2_device import Kernel
from drivers.camera.v4l2_formats import Pixels, WantedFormat
from messages import DepthFrame, FrameHeader


class V4l2DepthCamera(V4l2Capture[DepthFrame]):
    """A Z16 camera as a FrameSource of depth frames (see V4l2Capture).

    `width_px` × `height_px` is the size of the calibration, which the camera must offer. `rate_hz` suits the 50 ms grid
    best as a multiple of 20; most depth cameras have 30, 60 and 90. `pool_frames` bounds how many frames may be held.
    """

    def __init__(
        self,
        path: str,
        width_px: int,
        height_px: int,
        *,
        pool_frames: int,
        stamp_to_mid_exposure_s: float = 0.0,
        exposure_s: float = math.nan,
        rate_hz: int = 60,
        kernel: Kernel | None = None,
    ) -> None:
        need = f"a depth image of {width_px}x{height_px}, the calibration's size, needs"
        self._pool = PixelPool(pool_frames, (height_px, width_px), np.uint16)
        super().__init__(
            path,
            WantedFormat((v4l2.V4L2_PIX_FMT_Z16,), width_px, height_px, need),
            width_px,
            height_px,
            stamp_to_mid_exposure_s=stamp_to_mid_exposure_s,
            exposure_s=exposure_s,
            rate_hz=rate_hz,
            kernel=kernel,
        )

    def _copied(self, pixels: Pixels, header: FrameHeader) -> DepthFrame | None:
        depth = self._pool.lend()
        if depth is None:
            return None
        np.copyto(depth, pixels)
        depth.flags.writeable = False
        return DepthFrame(header=header, depth=depth)

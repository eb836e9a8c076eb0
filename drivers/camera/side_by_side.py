"""A stereo camera that Linux shows as one V4L2 node delivering both eyes side by side, as a StereoLabs ZED does."""

import math

import numpy as np

from drivers.camera.frame_pool import FramePair, FramePool
from drivers.camera.one_node import V4l2Capture
from drivers.camera.v4l2_device import Kernel
from drivers.camera.v4l2_formats import GREY_FORMATS, Pixels, WantedFormat
from messages import FrameHeader, StereoFrame


class V4l2StereoCamera(V4l2Capture[StereoFrame]):
    """A side-by-side camera, GREY or YUYV, as a StereoSource (see V4l2Capture).

    `width_px` × `height_px` is the size of one eye, that of the calibration; the camera must deliver exactly twice
    the width. A ZED belongs at 60 Hz: at its lower rates frames arrive 30 to 60 ms older; it shows its exposure in no
    V4L2 control, but see drivers.camera.zed. `pool_frames` bounds how many frames may be held at once.
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
        need = f"two eyes of {width_px}x{height_px}, the calibration's size, need"
        self._pool = FramePool(pool_frames, width_px, height_px)
        super().__init__(
            path,
            WantedFormat(GREY_FORMATS, 2 * width_px, height_px, need),
            width_px,
            height_px,
            stamp_to_mid_exposure_s=stamp_to_mid_exposure_s,
            exposure_s=exposure_s,
            rate_hz=rate_hz,
            kernel=kernel,
        )

    def _copied(self, pixels: Pixels, header: FrameHeader) -> StereoFrame | None:
        pair = self._pool.take()
        if pair is None:
            return None
        split_eyes(pixels, pair)
        return pair.frame(header)


def split_eyes(frame: Pixels, pair: FramePair) -> None:
    """Copy the luminance of both eyes, the bytes or low bytes of `frame`, into `pair`, in one pass.

    Cutting 16-bit numbers down to their low byte is a vector loop over contiguous memory, about twice as fast as
    picking every second byte (`python -m benchmarks.capture`).
    """
    width_px = pair.left.shape[1]
    np.copyto(pair.left, frame[:, :width_px], casting="unsafe")
    np.copyto(pair.right, frame[:, width_px:], casting="unsafe")

"""The rig's pictures behind a real V4L2 node: what is shown here, a driver captures there, by way of v4l2loopback."""

import contextlib
import ctypes
import fcntl
import os

import numpy as np

from drivers.camera import v4l2_abi as v4l2
from messages import UserError
from messages.arrays import GreyImage

_V4L2_BUF_TYPE_VIDEO_OUTPUT = 2
_GREY_CHROMA = 128 << 8  # the high byte of a YUYV pixel, U or V


class LoopbackCamera:
    """Two images side by side, in YUYV, as a ZED delivers them. The size of one is `width_px` × `height_px`.

    Raises UserError if `path` is no node of v4l2loopback or is fed by another program.
    """

    def __init__(self, path: str, width_px: int, height_px: int) -> None:
        self._frame = np.full((height_px, 2 * width_px), _GREY_CHROMA, dtype="<u2")
        wanted = v4l2.Format(type=_V4L2_BUF_TYPE_VIDEO_OUTPUT)
        pix = wanted.fmt.pix
        pix.width, pix.height = 2 * width_px, height_px
        pix.pixelformat = v4l2.V4L2_PIX_FMT_YUYV
        pix.field = v4l2.V4L2_FIELD_NONE
        pix.bytesperline, pix.sizeimage = 4 * width_px, self._frame.nbytes
        with contextlib.ExitStack() as on_failure:
            try:
                self._fd = os.open(path, os.O_RDWR | os.O_CLOEXEC)
                on_failure.callback(os.close, self._fd)
                # The loopback makes up its mind whether it can be fed only when it is asked, and lets the next one feed
                # it only after one that began with STREAMON.
                fcntl.ioctl(self._fd, v4l2.VIDIOC_QUERYCAP, v4l2.Capability(), True)
                fcntl.ioctl(self._fd, v4l2.VIDIOC_S_FMT, wanted, True)
                fcntl.ioctl(self._fd, v4l2.VIDIOC_STREAMON, ctypes.c_int(_V4L2_BUF_TYPE_VIDEO_OUTPUT))
            except OSError as error:
                raise UserError(f"{path}: cannot be fed with pictures: {error.strerror}") from error
            on_failure.pop_all()

    def show(self, left: GreyImage, right: GreyImage) -> None:
        """Hand on the left and right picture (height_px, width_px); the kernel stamps them now."""
        width_px = left.shape[1]
        np.bitwise_or(left, _GREY_CHROMA, out=self._frame[:, :width_px], dtype=np.uint16)
        np.bitwise_or(right, _GREY_CHROMA, out=self._frame[:, width_px:], dtype=np.uint16)
        os.write(self._fd, self._frame.data)

    def close(self) -> None:
        """Stop; whoever captures sees no further pictures."""
        os.close(self._fd)

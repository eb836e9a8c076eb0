"""What every frame source on V4L2 nodes does: it waits, stamps, counts, and comes back after a failure."""

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence
from typing import Generic, TypeVar

from drivers.camera.v4l2_device import Kernel, LinuxKernel
from drivers.camera.v4l2_stream import Arrived, V4l2Stream
from drivers.protocols import DeviceError
from messages import DropCause, Frame, FrameHeader

FrameT = TypeVar("FrameT", bound=Frame)

_RETRY_S = 0.5


class V4l2Source(ABC, Generic[FrameT]):
    """A FrameSource on one or more V4L2 nodes, called `name`, whose frames' headers tell `width_px` × `height_px`.

    A frame's `t_exposure_ns` is the kernel's stamp plus `stamp_to_mid_exposure_s`, a calibration item, because
    uvcvideo stamps the first USB payload of a frame whatever its flags say. A rolling shutter reads a row out when its
    exposure ends, so mid-exposure lies half an exposure before a read-out that starts with the stamp: the item falls by
    half of what the exposure grows, and holds for the exposure it was found with. `exposure_s` is handed on as given.
    `seq` is the kernel's 32-bit sequence, which starts anew when a node is reopened.

    Raises DeviceError, one line naming the device, if a path is no such camera, is in use, or delivers another size.
    When a camera fails later (unplugged, silent, stamps of another clock), `read` closes what is open and raises
    DeviceError; later calls wait, within their timeout, and try to open it again twice a second. A camera that is
    plugged in again may be another /dev/videoN: give its lasting name of /dev/v4l/by-id or /dev/v4l/by-path.
    """

    def __init__(
        self,
        name: str,
        width_px: int,
        height_px: int,
        *,
        stamp_to_mid_exposure_s: float,
        exposure_s: float,
        kernel: Kernel | None,
    ) -> None:
        self._name = name
        self._width_px = width_px
        self._height_px = height_px
        self._stamp_to_exposure_ns = round(stamp_to_mid_exposure_s * 1e9)
        self._exposure_s = exposure_s
        self._exposure_since_ns = 0
        self._kernel: Kernel = LinuxKernel() if kernel is None else kernel
        self._dropped: Counter[DropCause] = Counter()
        self._closed = False
        self._failure = ""
        self._retry_at_ns = 0
        self._streams: Sequence[V4l2Stream] = self._open()

    @property
    def dropped(self) -> dict[DropCause, int]:
        """Return the frames lost in the camera or here, by cause, since the start."""
        return dict(self._dropped)

    def read(self, timeout_s: float) -> FrameT | None:
        """Return the newest frame not yet returned, or None if none came within `timeout_s`.

        Raises DeviceError while the camera is gone; a later call may succeed again.
        """
        deadline_ns = self._kernel.monotonic_ns() + round(timeout_s * 1e9)
        if not self._streams:
            self._reopen(timeout_s)
        try:
            while True:
                frame = self._newest()
                remaining_s = (deadline_ns - self._kernel.monotonic_ns()) * 1e-9
                if frame is not None or remaining_s <= 0.0:
                    return frame
                self._stream_to_wait_for().device.wait(remaining_s)
        except DeviceError as error:
            self._shut()
            self._retry_later(error)
            raise

    def close(self) -> None:
        """Release the camera for good."""
        self._closed = True
        self._shut()

    @abstractmethod
    def _open(self) -> Sequence[V4l2Stream]:
        """Open all nodes and let them stream; raises DeviceError, and leaves none open, if one of them fails."""

    @abstractmethod
    def _newest(self) -> FrameT | None:
        """Empty the kernel's queues and return a copy of the last frame chosen from them."""

    @abstractmethod
    def _stream_to_wait_for(self) -> V4l2Stream:
        """Return the stream whose next frame is needed first."""

    def _header(self, frame: Arrived) -> FrameHeader:
        """Return the header of a frame; its exposure is unknown before `_exposure_since_ns`."""
        return FrameHeader(
            seq=frame.buffer.sequence,
            t_exposure_ns=frame.stamp_ns + self._stamp_to_exposure_ns,
            t_arrival_ns=frame.arrival_ns,
            exposure_s=self._exposure_s if frame.stamp_ns >= self._exposure_since_ns else math.nan,
            width_px=self._width_px,
            height_px=self._height_px,
        )

    def _shut(self) -> None:
        streams, self._streams = self._streams, ()
        for stream in streams:
            stream.device.close()

    def _reopen(self, timeout_s: float) -> None:
        if self._closed:
            raise DeviceError(f"{self._name}: closed")
        wait_s = (self._retry_at_ns - self._kernel.monotonic_ns()) * 1e-9
        if wait_s > 0.0:
            self._kernel.sleep(min(wait_s, timeout_s))
            if wait_s > timeout_s:
                raise DeviceError(self._failure)
        try:
            self._streams = self._open()
        except DeviceError as error:
            self._retry_later(error)
            raise

    def _retry_later(self, error: DeviceError) -> None:
        self._failure = str(error)
        self._retry_at_ns = self._kernel.monotonic_ns() + round(_RETRY_S * 1e9)

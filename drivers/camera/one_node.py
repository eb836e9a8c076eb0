"""Frames of one V4L2 node on the 50 ms grid: what side-by-side stereo and depth cameras have in common.

The kernel fills a few mapped buffers in turn. The frame chosen for a point of the 50 ms grid is copied once, into a
pool; every buffer goes back to the kernel at once.
"""

import math
from abc import abstractmethod
from collections.abc import Sequence

from drivers.camera.frame_grid import GridPicker
from drivers.camera.v4l2_device import Kernel, V4l2Device
from drivers.camera.v4l2_formats import Pixels, WantedFormat
from drivers.camera.v4l2_source import FrameT, V4l2Source
from drivers.camera.v4l2_stream import Arrived, V4l2Stream
from messages import DropCause, FrameHeader


class V4l2Capture(V4l2Source[FrameT]):
    """A camera as a FrameSource: frames on the 50 ms grid (see GridPicker), the newest wins. See V4l2Source, too.

    `wanted` is what the camera must deliver, `width_px` × `height_px` the size its frames' headers tell. `rate_hz` is
    preferred among the camera's rates, `camera_rate_hz` is what it answered.

    Drops are counted per frame of the camera: those of V4l2Stream and, among frames chosen for the grid, `SUPERSEDED`
    and `POOL_EXHAUSTED`. Frames between the grid's points are no drops.
    """

    def __init__(
        self,
        path: str,
        wanted: WantedFormat,
        width_px: int,
        height_px: int,
        *,
        stamp_to_mid_exposure_s: float,
        exposure_s: float,
        rate_hz: int,
        kernel: Kernel | None,
    ) -> None:
        self._wanted = wanted
        self._rate_hz = rate_hz
        self._camera_rate_hz = math.nan
        self._latest_stamp_ns = -1
        super().__init__(
            path,
            width_px,
            height_px,
            stamp_to_mid_exposure_s=stamp_to_mid_exposure_s,
            exposure_s=exposure_s,
            kernel=kernel,
        )
        self._picker = GridPicker(1.0 / (rate_hz if math.isnan(self._camera_rate_hz) else self._camera_rate_hz))

    @property
    def camera_rate_hz(self) -> float:
        """Return the rate the camera answered when last opened; NaN if it does not tell."""
        return self._camera_rate_hz

    @abstractmethod
    def _copied(self, pixels: Pixels, header: FrameHeader) -> FrameT | None:
        """Return a frame with a copy of `pixels`, or None while the pool is exhausted."""

    def _open(self) -> Sequence[V4l2Stream]:
        device = V4l2Device(self._kernel, self._name, self._wanted, self._rate_hz)
        self._camera_rate_hz = device.rate_hz
        return (V4l2Stream(device, self._kernel, self._dropped, self._latest_stamp_ns),)

    def _stream_to_wait_for(self) -> V4l2Stream:
        return self._streams[0]

    def _newest(self) -> FrameT | None:
        (stream,) = self._streams
        chosen: Arrived | None = None
        while (frame := stream.next()) is not None:
            self._latest_stamp_ns = frame.stamp_ns
            if not self._picker.pick(frame.stamp_ns):
                stream.device.requeue(frame.buffer)
                continue
            if chosen is not None:
                self._dropped[DropCause.SUPERSEDED] += 1
                stream.device.requeue(chosen.buffer)
            chosen = frame
        return None if chosen is None else self._copy(stream.device, chosen)

    def _copy(self, device: V4l2Device, chosen: Arrived) -> FrameT | None:
        """Copy a frame into the pool and give its buffer back."""
        frame = self._copied(device.pixels(chosen.buffer), self._header(chosen))
        device.requeue(chosen.buffer)
        if frame is None:
            self._dropped[DropCause.POOL_EXHAUSTED] += 1
        return frame

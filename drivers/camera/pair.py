"""Two separate V4L2 cameras, side by side, as one stereo camera.

Nothing but their stamps ties the eyes together, and a skew between them is an error of the plane: at 60°/s of yaw and a
focal length of 700 px each millisecond shifts the disparity by 0.7 px, of about 100 at 1 m. Cameras with a common
trigger have a skew of microseconds. Free-running cameras keep a phase of any size up to half a period, which drifts
with their clocks (0.1 ms a second at 100 ppm); where exposure begins with streaming the phase can be chosen anew.
"""

import math
from collections.abc import Sequence

import numpy as np

from drivers.camera.frame_grid import GridPicker
from drivers.camera.frame_pool import FramePool
from drivers.camera.v4l2_device import Kernel, V4l2Device
from drivers.camera.v4l2_formats import GREY_FORMATS, WantedFormat
from drivers.camera.v4l2_source import V4l2Source
from drivers.camera.v4l2_stream import Arrived, V4l2Stream
from drivers.protocols import DeviceError
from messages import DropCause, StereoFrame

EYES = ("left", "right")

_LONGEST_WITHOUT_PAIR_S = 1.0
_SAME_RATE = 0.01

_Pair = tuple[Arrived, Arrived]
"""A frame of the left and one of the right camera."""


class V4l2CameraPair(V4l2Source[StereoFrame]):
    """A left and a right camera, GREY or YUYV, as a StereoSource (see V4l2Source).

    `width_px` × `height_px` is the size of each eye, that of the calibration. Frames of both eyes whose stamps lie
    within half a period of each other are partners; a pair is used if its skew is `max_skew_s` at most. Of the pairs
    those on the 50 ms grid are returned (see GridPicker), the newest wins. Header and `t_exposure_ns` are the left
    eye's, whose pose the plane is seen from.

    Drops are counted per frame of either camera as V4l2Stream says, once a frame without a partner and once a pair of
    too large a skew as `UNPAIRED`, and per pair `SUPERSEDED` and `POOL_EXHAUSTED`.

    When for 1 s no pair had a skew small enough, `read` raises DeviceError and both cameras start anew, the right one
    later by what the skew calls for: cameras that begin to expose when they begin to stream come together so. Others
    need a trigger or, at the price said above, a larger bound: half a period refuses none.
    """

    def __init__(
        self,
        left_path: str,
        right_path: str,
        width_px: int,
        height_px: int,
        *,
        pool_frames: int,
        max_skew_s: float,
        stamp_to_mid_exposure_s: float = 0.0,
        exposure_s: float = math.nan,
        rate_hz: int = 60,
        kernel: Kernel | None = None,
    ) -> None:
        self._paths = left_path, right_path
        self._wanted = WantedFormat(
            GREY_FORMATS, width_px, height_px, f"an eye of {width_px}x{height_px}, the calibration's size, needs"
        )
        self._pool = FramePool(pool_frames, width_px, height_px)
        self._max_skew_ns = round(max_skew_s * 1e9)
        self._rate_hz = rate_hz
        self._period_ns = round(1e9 / rate_hz)
        self._latest_stamps_ns = [-1, -1]
        self._unpaired: list[Arrived | None] = [None, None]
        self._refused = 0
        self._skew_ns = 0
        self._right_later_ns = 0
        self._last_pair_ns = 0
        super().__init__(
            f"left {left_path}, right {right_path}",
            width_px,
            height_px,
            stamp_to_mid_exposure_s=stamp_to_mid_exposure_s,
            exposure_s=exposure_s,
            kernel=kernel,
        )
        self._picker = GridPicker(self._period_ns * 1e-9)

    @property
    def skew_s(self) -> float:
        """Return how much later than the left eye the right one began, of the latest frames compared."""
        return self._skew_ns * 1e-9

    def _open(self) -> Sequence[V4l2Stream]:
        streams: list[V4l2Stream] = []
        try:
            for eye, path, after_ns in zip(EYES, self._paths, self._latest_stamps_ns, strict=True):
                if streams:
                    self._kernel.sleep(self._right_later_ns * 1e-9)
                device = V4l2Device(self._kernel, path, self._wanted, self._rate_hz, role=f"{eye} camera")
                streams.append(V4l2Stream(device, self._kernel, self._dropped, after_ns))
            rate_hz = _common_rate_hz(streams, self._rate_hz)
        except DeviceError:
            for stream in streams:
                stream.device.close()
            raise
        self._period_ns = round(1e9 / rate_hz)
        self._unpaired = [None, None]
        self._last_pair_ns, self._refused = self._kernel.monotonic_ns(), 0
        return streams

    def _stream_to_wait_for(self) -> V4l2Stream:
        """Return the eye that is behind: its next frame may complete a pair."""
        return self._streams[0 if self._unpaired[0] is None else 1]

    def _newest(self) -> StereoFrame | None:
        chosen: _Pair | None = None
        while (pair := self._next_pair()) is not None:
            if not self._picker.pick(pair[0].stamp_ns):
                self._requeue(pair)
                continue
            if chosen is not None:
                self._dropped[DropCause.SUPERSEDED] += 1
                self._requeue(chosen)
            chosen = pair
        if chosen is not None:
            return self._copy(chosen)
        if self._refused and self._kernel.monotonic_ns() - self._last_pair_ns > _LONGEST_WITHOUT_PAIR_S * 1e9:
            raise self._realign()
        return None

    def _next_pair(self) -> _Pair | None:
        """Return the oldest pair of small skew, or None once a frame of either eye is awaited."""
        while True:
            left, right = (self._oldest_unpaired(eye) for eye in range(len(EYES)))
            if left is None or right is None:
                return None
            skew_ns = self._skew_ns = right.stamp_ns - left.stamp_ns
            if 2 * abs(skew_ns) > self._period_ns:
                self._drop(0 if skew_ns > 0 else 1)
                continue
            self._unpaired = [None, None]
            if abs(skew_ns) <= self._max_skew_ns:
                self._last_pair_ns, self._refused = self._kernel.monotonic_ns(), 0
                return left, right
            self._refused += 1
            self._dropped[DropCause.UNPAIRED] += 1
            self._requeue((left, right))

    def _oldest_unpaired(self, eye: int) -> Arrived | None:
        """Return the oldest frame of an eye that has no partner yet; those behind it stay in the kernel's queue."""
        head = self._unpaired[eye]
        if head is None:
            head = self._unpaired[eye] = self._streams[eye].next()
            self._latest_stamps_ns[eye] = self._streams[eye].latest_stamp_ns
        return head

    def _drop(self, eye: int) -> None:
        head, self._unpaired[eye] = self._unpaired[eye], None
        if head is not None:
            self._refused += 1
            self._dropped[DropCause.UNPAIRED] += 1
            self._streams[eye].device.requeue(head.buffer)

    def _requeue(self, pair: _Pair) -> None:
        for stream, frame in zip(self._streams, pair, strict=True):
            stream.device.requeue(frame.buffer)

    def _copy(self, pair: _Pair) -> StereoFrame | None:
        """Copy a pair into the pool and give its buffers back."""
        images = self._pool.take()
        if images is not None:
            for stream, frame, image in zip(self._streams, pair, images, strict=True):
                np.copyto(image, stream.device.pixels(frame.buffer), casting="unsafe")
        self._requeue(pair)
        if images is None:
            self._dropped[DropCause.POOL_EXHAUSTED] += 1
            return None
        left, right = pair
        return images.frame(self._header(left._replace(arrival_ns=max(left.arrival_ns, right.arrival_ns))))

    def _realign(self) -> DeviceError:
        """Let the right camera start later next time, by what brings it beside the left one."""
        self._right_later_ns = (self._right_later_ns - self._skew_ns) % self._period_ns
        left, right = (stream.device.name for stream in self._streams)
        return DeviceError(
            f"{left} and {right} expose {abs(self._skew_ns) * 1e-6:.1f} ms apart, "
            f"camera.max_skew_s allows {self._max_skew_ns * 1e-6:g} ms; both start anew"
        )


def _common_rate_hz(streams: Sequence[V4l2Stream], asked_hz: int) -> float:
    """Return the rate of both cameras; raises DeviceError if they differ."""
    told_hz = [stream.device.rate_hz for stream in streams if not math.isnan(stream.device.rate_hz)]
    if told_hz and max(told_hz) > min(told_hz) * (1.0 + _SAME_RATE):
        told = " and ".join(f"{stream.device.name} {stream.device.rate_hz:g} Hz" for stream in streams)
        raise DeviceError(f"{told}: both cameras must have one rate")
    return told_hz[0] if told_hz else asked_hz

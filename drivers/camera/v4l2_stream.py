"""The frames of one open V4L2 node that are sound, in order, and the count of those that are not."""

from collections import Counter
from typing import NamedTuple

from drivers.camera import v4l2_abi as v4l2
from drivers.camera.v4l2_device import Kernel, V4l2Device
from drivers.protocols import DeviceError
from messages import DropCause

_SILENCE_S = 3.0
_STAMP_AHEAD_S = 0.1
_SEQUENCES = 1 << 32


class Arrived(NamedTuple):
    """A frame taken from the kernel, the kernel's stamp of it, and when it was taken."""

    buffer: v4l2.Buffer
    stamp_ns: int
    arrival_ns: int


class V4l2Stream:
    """What `device` delivers from now on. Losses are counted in `dropped`.

    `CAMERA_GAP` counts missing sequence numbers; `CORRUPT` frames with the error flag, in a short buffer, or stamped
    no later than the one before or than `after_ns`.
    """

    def __init__(self, device: V4l2Device, kernel: Kernel, dropped: Counter[DropCause], after_ns: int = -1) -> None:
        self.device = device
        self.latest_stamp_ns = after_ns
        self._kernel = kernel
        self._dropped = dropped
        self._latest_seq: int | None = None
        self._last_image_ns = kernel.monotonic_ns()

    def next(self) -> Arrived | None:
        """Return the next sound frame, which is the caller's to requeue, or None if no more is there.

        Raises DeviceError when the camera is gone, was silent for 3 s, or stamps by another clock.
        """
        while (buffer := self.device.dequeue()) is not None:
            self._last_image_ns = self._kernel.monotonic_ns()
            frame = Arrived(buffer, _stamp_ns(buffer), self._last_image_ns)
            if self._is_sound(frame):
                return frame
            self.device.requeue(buffer)
        if self._kernel.monotonic_ns() - self._last_image_ns > _SILENCE_S * 1e9:
            raise DeviceError(f"{self.device.name}: no image for {_SILENCE_S:.0f} s")
        return None

    def _is_sound(self, frame: Arrived) -> bool:
        buffer = frame.buffer
        if self._latest_seq is not None:
            # Modulo 2³²; half of that or more is a counter set back, not a gap.
            lost = (buffer.sequence - self._latest_seq - 1) % _SEQUENCES
            if 0 < lost < _SEQUENCES // 2:
                self._dropped[DropCause.CAMERA_GAP] += lost
        self._latest_seq = buffer.sequence

        self._check_clock(frame)
        is_broken = buffer.flags & v4l2.V4L2_BUF_FLAG_ERROR or buffer.bytesused < self.device.frame_bytes
        if is_broken or frame.stamp_ns <= self.latest_stamp_ns:
            self._dropped[DropCause.CORRUPT] += 1
            return False
        self.latest_stamp_ns = frame.stamp_ns
        return True

    def _check_clock(self, frame: Arrived) -> None:
        """Raise DeviceError unless the stamp is of CLOCK_MONOTONIC.

        uvcvideo calls its stamps monotonic even when its parameter `clock` makes them CLOCK_REALTIME, decades ahead.
        """
        flag = frame.buffer.flags & v4l2.V4L2_BUF_FLAG_TIMESTAMP_MASK
        ahead_s = (frame.stamp_ns - frame.arrival_ns) * 1e-9
        if flag == v4l2.V4L2_BUF_FLAG_TIMESTAMP_COPY:
            found = "copied from the program that feeds it"
        elif flag != v4l2.V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC:
            found = "of an unknown clock"
        elif ahead_s > _STAMP_AHEAD_S:
            found = f"{ahead_s:.3g} s in the future (uvcvideo's parameter `clock` must be CLOCK_MONOTONIC)"
        else:
            return
        raise DeviceError(f"{self.device.name}: frame stamps must be of CLOCK_MONOTONIC, these are {found}")


def _stamp_ns(buffer: v4l2.Buffer) -> int:
    return buffer.timestamp.tv_sec * 1_000_000_000 + buffer.timestamp.tv_usec * 1000

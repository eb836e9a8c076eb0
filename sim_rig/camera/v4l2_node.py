"""A stereo camera as a kernel shows it: open, ioctl, mmap and poll of one V4L2 node, answered without a kernel.

It behaves as videobuf2 and uvcvideo do, errno for errno, and is stricter where hardware is merely unpredictable: a
buffer given back to it is overwritten at once, and a mapping left open keeps the node busy.
"""

import ctypes
import enum
import errno
import mmap
import os
import select
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from drivers import v4l2_abi as v4l2
from drivers.v4l2_device import IoctlArgument
from messages import GreyImage

Scene = Callable[[int], tuple[GreyImage, GreyImage]]
"""The left and right picture of a frame, by its number since the node was made."""


class Clock(Protocol):
    """The time the camera runs in; `drivers.v4l2_device.LinuxKernel` is the real one."""

    def monotonic_ns(self) -> int:
        """Return the time."""

    def sleep(self, duration_s: float) -> None:
        """Let time pass."""


class ManualClock:
    """A clock that moves only while somebody sleeps."""

    def __init__(self, now_ns: int = 1_000_000_000_000) -> None:
        self.now_ns = now_ns

    def monotonic_ns(self) -> int:
        """Return the time."""
        return self.now_ns

    def sleep(self, duration_s: float) -> None:
        """Let time pass at once."""
        self.now_ns += round(duration_s * 1e9)


class Fault(enum.Enum):
    """What happens to one frame."""

    LOST = enum.auto()  # never arrives; its sequence number is missing
    ERROR = enum.auto()  # delivered with the error flag and a torn picture
    SHORT = enum.auto()  # delivered with a third of its bytes
    OLD_STAMP = enum.auto()  # stamped a second before it was taken
    REALTIME_STAMP = enum.auto()  # stamped with seconds since 1970
    UNPLUG = enum.auto()  # the cable comes out


class Mode(NamedTuple):
    """One pixel format and size, both eyes together."""

    code: str
    width: int
    height: int


ZED_MODES = tuple(Mode("YUYV", *size) for size in ((4416, 1242), (3840, 1080), (2560, 720), (1344, 376)))
ZED_RATES_HZ = (15, 30, 60, 100)


def stepping_card(width_px: int, height_px: int) -> Scene:
    """Return a scene of two different patterns whose grey values all step by one from frame to frame."""
    left = (np.arange(height_px)[:, None] * 3 + np.arange(width_px)).astype(np.uint8)
    right = (np.arange(height_px)[:, None] + np.arange(width_px) * 5 + 7).astype(np.uint8)

    def picture(frame: int) -> tuple[GreyImage, GreyImage]:
        step = np.uint8(frame % 256)
        return left + step, right + step

    return picture


class _State(enum.Enum):
    DEQUEUED = enum.auto()
    QUEUED = enum.auto()
    DONE = enum.auto()


class _Slot:
    """One frame buffer of the node."""

    def __init__(self, index: int, length: int) -> None:
        self.memory = mmap.mmap(-1, length)
        self.state = _State.DEQUEUED
        self.info = v4l2.Buffer(
            index=index, type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE, memory=v4l2.V4L2_MEMORY_MMAP, length=length
        )
        self.info.m.offset = index * length


@dataclass(eq=False)
class V4l2Node:
    """A Kernel (see `drivers.v4l2_device`) that has one camera and nothing else.

    Frames are exposed on `clock` at the rate set, or every `slow_period_s` if that is longer, as when a camera exposes
    longer in poor light; they become ready `transfer_s` after their stamp. `faults` and `stamp_jitter_s` go by the
    frame's number since the node was made. `held` says that another program streams.
    """

    scene: Scene
    clock: Clock
    path: str = "/dev/video0"
    modes: Sequence[Mode] = ZED_MODES
    rates_hz: Sequence[int] = ZED_RATES_HZ
    device_caps: int = v4l2.V4L2_CAP_VIDEO_CAPTURE | v4l2.V4L2_CAP_STREAMING
    timestamp_flags: int = v4l2.V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | v4l2.V4L2_BUF_FLAG_TSTAMP_SRC_SOE
    row_padding: int = 0
    most_buffers: int = 32
    startup_s: float = 0.1
    transfer_s: float = 0.015
    slow_period_s: float = 0.0
    stamp_jitter_s: Callable[[int], float] = lambda _frame: 0.0
    faults: Mapping[int, Fault] = field(default_factory=dict)
    held: bool = False
    frames_exposed: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._plugged = True
        self._descriptors: set[int] = set()
        self._latest_descriptor = 2
        self._mode = self.modes[0]
        self._rate_hz = 60
        self._sequence = 0
        self._next_frame_ns = 0
        self._streaming = False
        self._owner: int | None = None
        self._slots: list[_Slot] = []
        self._queued: deque[_Slot] = deque()
        self._done: deque[_Slot] = deque()

    def unplug(self) -> None:
        """Pull the cable: whatever is open is dead from now on."""
        self._plugged = False
        self._descriptors.clear()
        self._release()

    def plug_in(self) -> None:
        """Put the cable back: the node can be opened anew."""
        self._plugged = True

    # The system calls.

    def monotonic_ns(self) -> int:
        """Return the time."""
        return self.clock.monotonic_ns()

    def sleep(self, duration_s: float) -> None:
        """Let time pass."""
        self.clock.sleep(duration_s)

    def open(self, path: str) -> int:
        """Open the node."""
        if path != self.path or not self._plugged:
            raise _os_error(errno.ENOENT)
        self._latest_descriptor += 1
        self._descriptors.add(self._latest_descriptor)
        return self._latest_descriptor

    def close(self, fd: int) -> None:
        """Close the node; what its owner mapped must be unmapped too before another can stream."""
        self._descriptors.discard(fd)

    def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
        """Map a buffer."""
        self._check_alive(fd)
        for slot in self._slots:
            if slot.info.m.offset == offset and slot.info.length == length and fd == self._owner:
                return slot.memory
        raise _os_error(errno.EINVAL)

    def poll(self, fd: int, timeout_s: float) -> int:
        """Let time pass until a frame is ready, the cable comes out, or the time-out."""
        deadline_ns = self.monotonic_ns() + round(timeout_s * 1e9)
        while True:
            self._expose()
            now_ns = self.monotonic_ns()
            if fd not in self._descriptors:
                return select.POLLERR | select.POLLHUP
            if not self._streaming or fd != self._owner:
                return select.POLLERR
            if self._done:
                return select.POLLIN | select.POLLRDNORM
            if now_ns >= deadline_ns:
                return 0
            self.sleep(max(0, min(deadline_ns, self._next_ready_ns) - now_ns) * 1e-9)

    def ioctl(self, fd: int, request: int, argument: IoctlArgument) -> None:
        """Answer a request; ENOTTY for those a camera's driver does not know."""
        self._expose()
        self._check_alive(fd)
        match argument:
            case v4l2.Capability() if request == v4l2.VIDIOC_QUERYCAP:
                self._querycap(argument)
            case v4l2.FmtDesc() if request == v4l2.VIDIOC_ENUM_FMT:
                self._enum_fmt(argument)
            case v4l2.FrmSizeEnum() if request == v4l2.VIDIOC_ENUM_FRAMESIZES:
                self._enum_framesizes(argument)
            case v4l2.Format() if request == v4l2.VIDIOC_S_FMT:
                self._s_fmt(argument)
            case v4l2.StreamParm() if request == v4l2.VIDIOC_S_PARM:
                self._s_parm(argument)
            case v4l2.RequestBuffers() if request == v4l2.VIDIOC_REQBUFS:
                self._reqbufs(fd, argument)
            case v4l2.Buffer() if request == v4l2.VIDIOC_QUERYBUF:
                ctypes.pointer(argument)[0] = self._slot(fd, argument).info
            case v4l2.Buffer() if request == v4l2.VIDIOC_QBUF:
                self._qbuf(self._slot(fd, argument))
            case v4l2.Buffer() if request == v4l2.VIDIOC_DQBUF:
                self._dqbuf(fd, argument)
            case _ if request == v4l2.VIDIOC_STREAMON:
                self._streamon(fd)
            case _:
                raise _os_error(errno.ENOTTY)

    # The requests.

    def _querycap(self, capability: v4l2.Capability) -> None:
        capability.driver, capability.card, capability.bus_info = b"uvcvideo", b"ZED 2: ZED 2", b"usb-0000:00:14.0-1"
        capability.device_caps = self.device_caps
        whole_camera = v4l2.V4L2_CAP_VIDEO_CAPTURE | v4l2.V4L2_CAP_STREAMING
        capability.capabilities = whole_camera | v4l2.V4L2_CAP_DEVICE_CAPS

    def _enum_fmt(self, description: v4l2.FmtDesc) -> None:
        codes = list(dict.fromkeys(mode.code for mode in self.modes))
        _check(description.index < len(codes))
        description.pixelformat = v4l2.fourcc(codes[description.index])

    def _enum_framesizes(self, size: v4l2.FrmSizeEnum) -> None:
        modes = [mode for mode in self.modes if v4l2.fourcc(mode.code) == size.pixel_format]
        _check(size.index < len(modes))
        size.type = v4l2.V4L2_FRMSIZE_TYPE_DISCRETE
        size.discrete.width, size.discrete.height = modes[size.index].width, modes[size.index].height

    def _s_fmt(self, wanted: v4l2.Format) -> None:
        _check(wanted.type == v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE)
        self._check_free()
        pix = wanted.fmt.pix

        def unlikeness(mode: Mode) -> tuple[bool, int]:
            return v4l2.fourcc(mode.code) != pix.pixelformat, abs(mode.width * mode.height - pix.width * pix.height)

        self._mode = min(self.modes, key=unlikeness)
        pix.pixelformat, pix.width, pix.height = v4l2.fourcc(self._mode.code), self._mode.width, self._mode.height
        pix.field = v4l2.V4L2_FIELD_NONE
        pix.bytesperline, pix.sizeimage = self._pitch, self._frame_bytes

    def _s_parm(self, wanted: v4l2.StreamParm) -> None:
        capture = wanted.parm.capture
        asked_hz = capture.timeperframe.denominator / capture.timeperframe.numerator
        self._rate_hz = min(self.rates_hz, key=lambda rate_hz: abs(rate_hz - asked_hz))
        capture.capability = v4l2.V4L2_CAP_TIMEPERFRAME
        capture.timeperframe.numerator, capture.timeperframe.denominator = 1, self._rate_hz

    def _reqbufs(self, fd: int, request: v4l2.RequestBuffers) -> None:
        _check(request.type == v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE and request.memory == v4l2.V4L2_MEMORY_MMAP)
        self._check_free()
        request.count = min(request.count, self.most_buffers)
        length = -(-self._frame_bytes // mmap.PAGESIZE) * mmap.PAGESIZE
        self._owner = fd
        self._slots = [_Slot(index, length) for index in range(request.count)]

    def _qbuf(self, slot: _Slot) -> None:
        _check(slot.state is _State.DEQUEUED)
        slot.state = _State.QUEUED
        self._queued.append(slot)
        np.frombuffer(slot.memory, np.uint8)[:] = 0xA5

    def _dqbuf(self, fd: int, buffer: v4l2.Buffer) -> None:
        _check(self._streaming and fd == self._owner and buffer.memory == v4l2.V4L2_MEMORY_MMAP)
        if not self._done:
            raise _os_error(errno.EAGAIN)
        slot = self._done.popleft()
        slot.state = _State.DEQUEUED
        ctypes.pointer(buffer)[0] = slot.info

    def _streamon(self, fd: int) -> None:
        _check(bool(self._slots) and fd == self._owner)
        self._streaming = True
        self._sequence = 0
        self._next_frame_ns = self.monotonic_ns() + round(self.startup_s * 1e9)

    # The camera.

    @property
    def _pitch(self) -> int:
        return 2 * self._mode.width + self.row_padding

    @property
    def _frame_bytes(self) -> int:
        return self._pitch * self._mode.height

    @property
    def _next_ready_ns(self) -> int:
        return self._next_frame_ns + round(self.transfer_s * 1e9)

    def _expose(self) -> None:
        """Stop if the owner has let go of everything; else take every frame that is due by now."""
        if self._owner not in self._descriptors and all(slot.memory.closed for slot in self._slots):
            self._release()
        while self._streaming and self._next_ready_ns <= self.monotonic_ns():
            frame, sequence, start_ns = self.frames_exposed, self._sequence, self._next_frame_ns
            self.frames_exposed += 1
            self._sequence += 1
            self._next_frame_ns += round(max(1.0 / self._rate_hz, self.slow_period_s) * 1e9)
            fault = self.faults.get(frame)
            if fault is Fault.UNPLUG:
                self.unplug()
            elif fault is not Fault.LOST and self._queued:  # a frame without a buffer to go to is lost as well
                self._deliver(self._queued.popleft(), frame, sequence, start_ns, fault)

    def _deliver(self, slot: _Slot, frame: int, sequence: int, start_ns: int, fault: Fault | None) -> None:
        height, width = self._mode.height, self._mode.width
        yuyv = np.ndarray((height, width, 2), np.uint8, buffer=slot.memory, strides=(self._pitch, 2, 1))
        rows = slice(height // 3) if fault in (Fault.SHORT, Fault.ERROR) else slice(None)
        left, right = self.scene(frame)
        yuyv[rows, : width // 2, 0] = left[rows]
        yuyv[rows, width // 2 :, 0] = right[rows]
        yuyv[rows, 0::2, 1] = 90
        yuyv[rows, 1::2, 1] = 200

        stamp_ns = start_ns + round(self.stamp_jitter_s(frame) * 1e9)
        if fault is Fault.OLD_STAMP:
            stamp_ns -= 1_000_000_000
        if fault is Fault.REALTIME_STAMP:
            stamp_ns += 1_700_000_000_000_000_000
        info = slot.info
        info.sequence = sequence
        info.timestamp.tv_sec, info.timestamp.tv_usec = stamp_ns // 1_000_000_000, stamp_ns % 1_000_000_000 // 1000
        info.bytesused = self._frame_bytes // 3 if fault is Fault.SHORT else self._frame_bytes
        info.flags = self.timestamp_flags | (v4l2.V4L2_BUF_FLAG_ERROR if fault is Fault.ERROR else 0)
        slot.state = _State.DONE
        self._done.append(slot)

    # The rules.

    def _slot(self, fd: int, buffer: v4l2.Buffer) -> _Slot:
        _check(buffer.type == v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE and buffer.memory == v4l2.V4L2_MEMORY_MMAP)
        _check(fd == self._owner and buffer.index < len(self._slots))
        return self._slots[buffer.index]

    def _check_alive(self, fd: int) -> None:
        if fd not in self._descriptors:
            raise _os_error(errno.ENODEV)

    def _check_free(self) -> None:
        if self.held or self._owner is not None:
            raise _os_error(errno.EBUSY)

    def _release(self) -> None:
        self._streaming = False
        self._owner = None
        self._slots = []
        self._queued.clear()
        self._done.clear()


def _check(allowed: bool) -> None:
    if not allowed:
        raise _os_error(errno.EINVAL)


def _os_error(number: int) -> OSError:
    return OSError(number, os.strerror(number))

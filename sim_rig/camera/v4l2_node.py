"""A camera as a kernel shows it: open, ioctl, mmap and poll of one V4L2 node, answered without a kernel.

It behaves as videobuf2 (see v4l2_buffers) and uvcvideo do, errno for errno.
"""

import enum
import errno
import mmap
import select
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from drivers.camera import uvc_abi as uvc
from drivers.camera import v4l2_abi as v4l2
from drivers.camera.v4l2_device import IoctlArgument
from messages.arrays import DepthImage, GreyImage
from sim_rig.camera.v4l2_buffers import Buffers, Slot, check, os_error
from sim_rig.camera.v4l2_pixels import PIXEL_BYTES, write_pixels
from sim_rig.camera.zed_unit import ZedUnit

Scene = Callable[[int], tuple[GreyImage, GreyImage]]
"""The left and right picture of a frame, by its number since the node was made."""

EyeScene = Callable[[int], tuple[GreyImage]]
"""The picture of a frame of a single camera."""

DepthScene = Callable[[int], tuple[DepthImage]]
"""The depth image of a frame."""


class Clock(Protocol):
    """The time the camera runs in; `drivers.camera.v4l2_device.LinuxKernel` is the real one."""

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
    """One pixel format and size, YUYV or GREY with all images side by side, or Z16, and its frame rates."""

    code: str
    width: int
    height: int
    rates_hz: Sequence[int] = (15, 30, 60, 100)


ZED_MODES = (
    Mode("YUYV", 4416, 1242, (15,)),
    Mode("YUYV", 3840, 1080, (15, 30)),
    Mode("YUYV", 2560, 720, (15, 30, 60)),
    Mode("YUYV", 1344, 376, (15, 30, 60, 100)),
)


def stepping_card(width_px: int, height_px: int) -> Scene:
    """Return a scene of two different patterns whose grey values all step by one from frame to frame."""
    left = (np.arange(height_px)[:, None] * 3 + np.arange(width_px)).astype(np.uint8)
    right = (np.arange(height_px)[:, None] + np.arange(width_px) * 5 + 7).astype(np.uint8)

    def picture(frame: int) -> tuple[GreyImage, GreyImage]:
        step = np.uint8(frame % 256)
        return left + step, right + step

    return picture


@dataclass(eq=False)
class V4l2Node:
    """A Kernel (see `drivers.camera.v4l2_device`) that has one camera and nothing else.

    Frames are exposed on `clock` at the rate set, or every `slow_period_s` if that is longer, as when a camera exposes
    longer in poor light; they become ready `transfer_s` after their stamp. `faults` and `stamp_jitter_s` go by the
    frame's number since the node was made. `held` says that another program streams. With `phase_ns` the camera runs
    freely: exposures start at whole periods from there, whenever streaming was switched on. `frame_start_ns` tells the
    scene and the faults when the frame they are asked for began. `rates_hz`, if given, are those of all modes. `link`
    is a lasting name of the node, whatever its number. `zed` is its extension unit, if it has one.
    """

    scene: Scene | EyeScene | DepthScene
    clock: Clock
    path: str = "/dev/video0"
    link: str = ""
    card: str = "ZED 2: ZED 2"
    modes: Sequence[Mode] = ZED_MODES
    rates_hz: Sequence[int] = ()
    zed: ZedUnit | None = None
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
    phase_ns: int | None = None
    frames_exposed: int = field(default=0, init=False)
    frame_start_ns: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._plugged = True
        self._descriptors: set[int] = set()
        self._latest_descriptor = 2
        self._mode = self.modes[0]
        self._rate_hz = 60
        self._sequence = 0
        self._next_frame_ns = 0
        self._buffers = Buffers(self.most_buffers)

    def unplug(self) -> None:
        """Pull the cable: whatever is open is dead from now on."""
        self._plugged = False
        self._descriptors.clear()
        self._buffers.release()

    def plug_in(self, path: str | None = None) -> None:
        """Put the cable back: the node can be opened anew, now by `path` if that is given."""
        self._plugged = True
        self.path = path or self.path

    # The system calls.

    def monotonic_ns(self) -> int:
        """Return the time."""
        return self.clock.monotonic_ns()

    def sleep(self, duration_s: float) -> None:
        """Let time pass."""
        self.clock.sleep(duration_s)

    def open(self, path: str) -> int:
        """Open the node."""
        if path not in (self.path, self.link) or not self._plugged:
            raise os_error(errno.ENOENT)
        self._latest_descriptor += 1
        self._descriptors.add(self._latest_descriptor)
        return self._latest_descriptor

    def close(self, fd: int) -> None:
        """Close the node; what its owner mapped must be unmapped too before another can stream."""
        self._descriptors.discard(fd)

    def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
        """Map a buffer."""
        self._check_alive(fd)
        return self._buffers.mapping(fd, length, offset)

    def poll(self, fd: int, timeout_s: float) -> int:
        """Let time pass until a frame is ready, the cable comes out, or the time-out."""
        deadline_ns = self.monotonic_ns() + round(timeout_s * 1e9)
        while True:
            self._expose()
            now_ns = self.monotonic_ns()
            if fd not in self._descriptors:
                return select.POLLERR | select.POLLHUP
            if not self._buffers.streaming or fd != self._buffers.owner:
                return select.POLLERR
            if self._buffers.ready:
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
            case v4l2.FrmIvalEnum() if request == v4l2.VIDIOC_ENUM_FRAMEINTERVALS:
                self._enum_frameintervals(argument)
            case v4l2.Format() if request == v4l2.VIDIOC_S_FMT:
                self._s_fmt(argument)
            case v4l2.StreamParm() if request == v4l2.VIDIOC_S_PARM:
                self._s_parm(argument)
            case v4l2.RequestBuffers() if request == v4l2.VIDIOC_REQBUFS:
                self._check_free()
                self._buffers.request(fd, argument, self._frame_bytes)
            case v4l2.Buffer() if request == v4l2.VIDIOC_QUERYBUF:
                self._buffers.describe(fd, argument)
            case v4l2.Buffer() if request == v4l2.VIDIOC_QBUF:
                self._buffers.queue(fd, argument)
            case v4l2.Buffer() if request == v4l2.VIDIOC_DQBUF:
                self._buffers.dequeue(fd, argument)
            case uvc.XuControlQuery() if request == uvc.UVCIOC_CTRL_QUERY and self.zed is not None:
                self.zed.ask(argument)
            case uvc.XuControlQuery() if request == uvc.UVCIOC_CTRL_QUERY:
                raise os_error(errno.ENOENT)
            case _ if request == v4l2.VIDIOC_STREAMON:
                self._streamon(fd)
            case _:
                raise os_error(errno.ENOTTY)

    # The requests.

    def _querycap(self, capability: v4l2.Capability) -> None:
        capability.driver, capability.card, capability.bus_info = b"uvcvideo", self.card.encode(), b"usb-0000:00:14.0-1"
        capability.device_caps = self.device_caps
        whole_camera = v4l2.V4L2_CAP_VIDEO_CAPTURE | v4l2.V4L2_CAP_STREAMING
        capability.capabilities = whole_camera | v4l2.V4L2_CAP_DEVICE_CAPS

    def _enum_fmt(self, description: v4l2.FmtDesc) -> None:
        codes = list(dict.fromkeys(mode.code for mode in self.modes))
        check(description.index < len(codes))
        description.pixelformat = v4l2.fourcc(codes[description.index])

    def _enum_framesizes(self, size: v4l2.FrmSizeEnum) -> None:
        modes = [mode for mode in self.modes if v4l2.fourcc(mode.code) == size.pixel_format]
        check(size.index < len(modes))
        size.type = v4l2.V4L2_FRMSIZE_TYPE_DISCRETE
        size.discrete.width, size.discrete.height = modes[size.index].width, modes[size.index].height

    def _enum_frameintervals(self, interval: v4l2.FrmIvalEnum) -> None:
        size = interval.width, interval.height
        fitting = [m for m in self.modes if v4l2.fourcc(m.code) == interval.pixel_format and m[1:3] == size]
        check(bool(fitting))
        rates_hz = self._rates_of(fitting[0])
        check(interval.index < len(rates_hz))
        interval.type = v4l2.V4L2_FRMIVAL_TYPE_DISCRETE
        # in units of 100 ns, as UVC has them
        interval.discrete.numerator, interval.discrete.denominator = 10_000_000 // rates_hz[interval.index], 10_000_000

    def _s_fmt(self, wanted: v4l2.Format) -> None:
        check(wanted.type == v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE)
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
        self._rate_hz = min(self._rates_of(self._mode), key=lambda rate_hz: abs(rate_hz - asked_hz))
        capture.capability = v4l2.V4L2_CAP_TIMEPERFRAME
        capture.timeperframe.numerator, capture.timeperframe.denominator = 1, self._rate_hz

    def _streamon(self, fd: int) -> None:
        self._buffers.stream(fd)
        self._sequence = 0
        self._next_frame_ns = self.monotonic_ns() + round(self.startup_s * 1e9)
        if self.phase_ns is not None:
            self._next_frame_ns += (self.phase_ns - self._next_frame_ns) % round(1e9 / self._rate_hz)

    # The camera.

    def _rates_of(self, mode: Mode) -> Sequence[int]:
        return self.rates_hz or mode.rates_hz

    @property
    def _pitch(self) -> int:
        return PIXEL_BYTES[self._mode.code] * self._mode.width + self.row_padding

    @property
    def _frame_bytes(self) -> int:
        return self._pitch * self._mode.height

    @property
    def _next_ready_ns(self) -> int:
        return self._next_frame_ns + round(self.transfer_s * 1e9)

    def _expose(self) -> None:
        """Stop if the owner has let go of everything; else take every frame that is due by now."""
        self._buffers.release_if_abandoned(self._descriptors)
        while self._buffers.streaming and self._next_ready_ns <= self.monotonic_ns():
            frame, sequence, start_ns = self.frames_exposed, self._sequence, self._next_frame_ns
            self.frame_start_ns = start_ns
            self.frames_exposed += 1
            self._sequence += 1
            self._next_frame_ns += round(max(1.0 / self._rate_hz, self.slow_period_s) * 1e9)
            fault = self.faults.get(frame)
            if fault is Fault.UNPLUG:
                self.unplug()
            elif fault is not Fault.LOST and (slot := self._buffers.to_fill()) is not None:
                self._deliver(slot, frame, sequence, start_ns, fault)

    def _deliver(self, slot: Slot, frame: int, sequence: int, start_ns: int, fault: Fault | None) -> None:
        rows = slice(self._mode.height // 3) if fault in (Fault.SHORT, Fault.ERROR) else slice(None)
        size = self._mode.width, self._mode.height
        write_pixels(slot.memory, self._mode.code, size, self._pitch, self.scene(frame), rows)

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
        self._buffers.filled(slot)

    # The rules.

    def _check_alive(self, fd: int) -> None:
        if fd not in self._descriptors:
            raise os_error(errno.ENODEV)

    def _check_free(self) -> None:
        if self.held:
            raise os_error(errno.EBUSY)
        self._buffers.check_free()

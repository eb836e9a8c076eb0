"""One V4L2 capture node streaming YUYV into mapped buffers, and the system calls it takes.

Reference: Linux Media Infrastructure userspace API, "Streaming I/O (Memory Mapping)" and part I's ioctl pages.
"""

import ctypes
import errno
import fcntl
import math
import mmap
import os
import select
import time
from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers import v4l2_abi as v4l2
from drivers.protocols import DeviceError
from drivers.stereo_source import FramePair

Yuyv = NDArray[np.uint16]
"""Two eyes side by side, (height_px, 2 · width_px): Y in the low byte, U and V by turns in the high one."""

IoctlArgument = ctypes.Structure | ctypes.c_int

_BUFFERS = 6  # 100 ms at 60 fps: as long as a reader may be away without losing a frame
_NOT_OFFERED = (errno.EINVAL, errno.ENOTTY)  # the end of a list, or a request the device does not know
_UNPLUGGED = (errno.ENODEV, errno.ENXIO)
_FAILED_EVENTS = select.POLLERR | select.POLLHUP | select.POLLNVAL


class Kernel(Protocol):
    """The system calls of a capture. They raise OSError with the kernel's errno."""

    def monotonic_ns(self) -> int:
        """Return CLOCK_MONOTONIC."""

    def sleep(self, duration_s: float) -> None:
        """Wait."""

    def open(self, path: str) -> int:
        """Open a device for reading and writing, non-blocking; return its descriptor."""

    def ioctl(self, fd: int, request: int, argument: IoctlArgument) -> None:
        """Carry out a request; `argument` is changed in place."""

    def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
        """Map a buffer of the device."""

    def poll(self, fd: int, timeout_s: float) -> int:
        """Wait for a full buffer; return poll(2)'s events, 0 after `timeout_s`."""

    def close(self, fd: int) -> None:
        """Close a descriptor."""


class LinuxKernel:
    """The running kernel."""

    def monotonic_ns(self) -> int:
        """Return CLOCK_MONOTONIC."""
        return time.monotonic_ns()

    def sleep(self, duration_s: float) -> None:
        """Wait."""
        time.sleep(duration_s)

    def open(self, path: str) -> int:
        """Open a device for reading and writing, non-blocking."""
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def ioctl(self, fd: int, request: int, argument: IoctlArgument) -> None:
        """Carry out a request, again if a signal interrupted it, as Python itself does for most other calls."""
        try:
            fcntl.ioctl(fd, request, argument, True)
        except InterruptedError:
            self.ioctl(fd, request, argument)

    def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
        """Map a buffer of the device; Python's mmap keeps a descriptor of its own open until it is closed."""
        return mmap.mmap(fd, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset)

    def poll(self, fd: int, timeout_s: float) -> int:
        """Wait for a full buffer."""
        poller = select.poll()
        poller.register(fd, select.POLLIN)
        events = poller.poll(timeout_s * 1e3)
        return events[0][1] if events else 0

    def close(self, fd: int) -> None:
        """Close a descriptor."""
        os.close(fd)


def split_eyes(frame: Yuyv, pair: FramePair) -> None:
    """Copy the luminance of both eyes into `pair`, in one pass.

    Cutting 16-bit numbers down to their low byte is a vector loop over contiguous memory, about twice as fast as
    picking every second byte (`python -m benchmarks.capture`).
    """
    width_px = pair.left.shape[1]
    np.copyto(pair.left, frame[:, :width_px], casting="unsafe")
    np.copyto(pair.right, frame[:, width_px:], casting="unsafe")


class V4l2Device:
    """One open node that streams YUYV of `width` × `height` pixels. Every error is a DeviceError naming the device.

    `rate_hz` is what the device answered to the rate asked for, NaN if it does not tell. `frame_bytes` is a whole
    image, row padding included.
    """

    def __init__(self, kernel: Kernel, path: str, width: int, height: int, rate_hz: int) -> None:
        self._kernel = kernel
        self._mappings: list[mmap.mmap] = []
        self._images: list[Yuyv] = []
        self.name = path
        try:
            self._fd = kernel.open(path)
        except OSError as error:
            raise DeviceError(f"{path}: {_why_not_open(error)}") from error
        try:
            self._identify()
            pix = self._set_format(width, height)
            self.frame_bytes = pix.bytesperline * pix.height
            self.rate_hz = self._set_rate(rate_hz)
            self._map_buffers(pix)
            self._control(v4l2.VIDIOC_STREAMON, ctypes.c_int(v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE), "starting to stream")
        except DeviceError:
            self.close()
            raise

    def close(self) -> None:
        """Release buffers and device; the kernel stops streaming when the last mapping and descriptor are gone."""
        self._images.clear()
        for mapping in self._mappings:
            mapping.close()
        self._kernel.close(self._fd)

    def wait(self, timeout_s: float) -> None:
        """Wait until a buffer is ready or `timeout_s` has passed."""
        if self._kernel.poll(self._fd, timeout_s) & _FAILED_EVENTS:
            raise DeviceError(f"{self.name}: the camera was unplugged or stopped streaming")

    def dequeue(self) -> v4l2.Buffer | None:
        """Return the oldest buffer the kernel has filled, or None."""
        buffer = self._new_buffer()
        try:
            self._kernel.ioctl(self._fd, v4l2.VIDIOC_DQBUF, buffer)
        except BlockingIOError:
            return None
        except OSError as error:
            raise self._failure("reading a frame", error) from error
        return buffer

    def requeue(self, buffer: v4l2.Buffer) -> None:
        """Give a buffer back to the kernel, which overwrites it from now on."""
        self._control(v4l2.VIDIOC_QBUF, self._new_buffer(buffer.index), "returning a buffer")

    def copy(self, buffer: v4l2.Buffer, pair: FramePair) -> None:
        """Copy the pixels of a dequeued buffer."""
        split_eyes(self._images[buffer.index], pair)

    def _identify(self) -> None:
        capability = v4l2.Capability()
        self._control(v4l2.VIDIOC_QUERYCAP, capability, "asking for its capabilities")
        self.name = f"{self.name} ({capability.card.decode(errors='replace')})"
        # `capabilities` speaks of all nodes of the physical device together, `device_caps` of this one.
        caps = capability.capabilities
        if caps & v4l2.V4L2_CAP_DEVICE_CAPS:
            caps = capability.device_caps
        if not caps & v4l2.V4L2_CAP_VIDEO_CAPTURE:
            raise DeviceError(f"{self.name}: captures no images; a camera's images are on another of its nodes")
        if not caps & v4l2.V4L2_CAP_STREAMING:
            raise DeviceError(f"{self.name}: cannot stream into mapped buffers")

    def _set_format(self, width: int, height: int) -> v4l2.PixFormat:
        wanted = v4l2.Format(type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE)
        pix = wanted.fmt.pix
        pix.width, pix.height = width, height
        pix.pixelformat = v4l2.V4L2_PIX_FMT_YUYV
        pix.field = v4l2.V4L2_FIELD_NONE
        self._control(v4l2.VIDIOC_S_FMT, wanted, "setting the image format")
        if (pix.pixelformat, pix.width, pix.height) != (v4l2.V4L2_PIX_FMT_YUYV, width, height):
            raise DeviceError(
                f"{self.name}: two eyes of {width // 2}x{height}, the calibration's size, need YUYV {width}x{height}; "
                f"the camera answers {v4l2.fourcc_name(pix.pixelformat)} {pix.width}x{pix.height} "
                f"and offers {', '.join(self._offers()) or 'no list of formats'}"
            )
        return pix

    def _offers(self) -> Iterator[str]:
        description = v4l2.FmtDesc(type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE)
        while self._exists(v4l2.VIDIOC_ENUM_FMT, description):
            name = v4l2.fourcc_name(description.pixelformat)
            size = v4l2.FrmSizeEnum(pixel_format=description.pixelformat)
            while self._exists(v4l2.VIDIOC_ENUM_FRAMESIZES, size):
                if size.type != v4l2.V4L2_FRMSIZE_TYPE_DISCRETE:
                    sizes = size.stepwise
                    yield f"{name} {sizes.min_width}x{sizes.min_height} to {sizes.max_width}x{sizes.max_height}"
                    break
                yield f"{name} {size.discrete.width}x{size.discrete.height}"
                size.index += 1
            description.index += 1

    def _exists(self, request: int, argument: v4l2.FmtDesc | v4l2.FrmSizeEnum) -> bool:
        try:
            self._kernel.ioctl(self._fd, request, argument)
        except OSError as error:
            if error.errno in _NOT_OFFERED:
                return False
            raise self._failure("listing its formats", error) from error
        return True

    def _set_rate(self, rate_hz: int) -> float:
        wanted = v4l2.StreamParm(type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE)
        capture = wanted.parm.capture
        capture.timeperframe.numerator, capture.timeperframe.denominator = 1, rate_hz
        try:
            self._kernel.ioctl(self._fd, v4l2.VIDIOC_S_PARM, wanted)
        except OSError as error:
            if error.errno in _NOT_OFFERED:
                return math.nan
            raise self._failure("setting the frame rate", error) from error
        if not capture.capability & v4l2.V4L2_CAP_TIMEPERFRAME or capture.timeperframe.numerator == 0:
            return math.nan
        return capture.timeperframe.denominator / capture.timeperframe.numerator

    def _map_buffers(self, pix: v4l2.PixFormat) -> None:
        request = v4l2.RequestBuffers(
            count=_BUFFERS, type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE, memory=v4l2.V4L2_MEMORY_MMAP
        )
        self._control(v4l2.VIDIOC_REQBUFS, request, "asking for buffers")
        if request.count < 2:
            raise DeviceError(f"{self.name}: grants {request.count} frame buffers, at least 2 are needed")
        for index in range(request.count):
            buffer = self._new_buffer(index)
            self._control(v4l2.VIDIOC_QUERYBUF, buffer, "asking for a buffer")
            if pix.bytesperline < 2 * pix.width or buffer.length < self.frame_bytes:
                raise DeviceError(
                    f"{self.name}: buffers of {buffer.length} bytes with rows of {pix.bytesperline} "
                    f"cannot hold YUYV {pix.width}x{pix.height}"
                )
            try:
                mapping = self._kernel.mmap(self._fd, buffer.length, buffer.m.offset)
            except OSError as error:
                raise self._failure("mapping a buffer", error) from error
            self._mappings.append(mapping)
            strides = (pix.bytesperline, 2)
            self._images.append(np.ndarray((pix.height, pix.width), "<u2", buffer=mapping, strides=strides))
            self._control(v4l2.VIDIOC_QBUF, buffer, "queueing a buffer")

    def _new_buffer(self, index: int = 0) -> v4l2.Buffer:
        return v4l2.Buffer(index=index, type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE, memory=v4l2.V4L2_MEMORY_MMAP)

    def _control(self, request: int, argument: IoctlArgument, what: str) -> None:
        try:
            self._kernel.ioctl(self._fd, request, argument)
        except OSError as error:
            raise self._failure(what, error) from error

    def _failure(self, what: str, error: OSError) -> DeviceError:
        if error.errno in _UNPLUGGED:
            return DeviceError(f"{self.name}: the camera was unplugged")
        if error.errno == errno.EBUSY:
            return DeviceError(f"{self.name}: in use by another program")
        if error.errno == errno.ENOTTY:
            return DeviceError(f"{self.name}: no V4L2 camera ({what}: {error.strerror})")
        return DeviceError(f"{self.name}: {what} failed: {error.strerror}")


def _why_not_open(error: OSError) -> str:
    if error.errno == errno.ENOENT:
        return "no such device; cameras are /dev/video*, or by a lasting name /dev/v4l/by-id/*"
    if error.errno in _UNPLUGGED:
        return "no camera behind this node"
    if error.errno in (errno.EACCES, errno.EPERM):
        return "permission denied; the user must be in the group that owns the node, usually 'video'"
    if error.errno == errno.EBUSY:
        return "in use by another program"
    return f"cannot be opened: {error.strerror}"

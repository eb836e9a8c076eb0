"""One V4L2 capture node streaming into mapped buffers, and the system calls it takes.

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
from fractions import Fraction
from typing import Protocol

import numpy as np

from drivers.camera import uvc_abi as uvc
from drivers.camera import v4l2_abi as v4l2
from drivers.camera.v4l2_formats import PIXEL_TYPES, ListedStruct, Pixels, WantedFormat, format_name, listed
from drivers.protocols import DeviceError

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


class V4l2Device:
    """One open node that streams images of `wanted`. Every error is a DeviceError naming the device.

    Of what the camera lists, the pixel format and the rate that suit the 50 ms grid best are asked for (see
    drivers.camera.v4l2_formats), `rate_hz` rather than others. `rate_hz` is what it answered, NaN if it does not tell.
    `frame_bytes` is a whole image, row padding included; `name` its path and what it calls itself, behind `role`.
    """

    def __init__(self, kernel: Kernel, path: str, wanted: WantedFormat, rate_hz: int, role: str = "") -> None:
        self._kernel = kernel
        self._mappings: list[mmap.mmap] = []
        self._images: list[Pixels] = []
        self.name = f"{role} {path}".lstrip()
        self.card = ""
        try:
            self._fd = kernel.open(path)
        except OSError as error:
            raise DeviceError(f"{self.name}: {_why_not_open(error)}") from error
        try:
            self._identify()
            pix, chosen_hz = self._set_format(wanted, rate_hz)
            self.frame_bytes = pix.bytesperline * pix.height
            self.rate_hz = self._set_rate(chosen_hz)
            self._map_buffers(pix)
            self._start_stream()
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

    def pixels(self, buffer: v4l2.Buffer) -> Pixels:
        """Return the pixels of a dequeued buffer, to be copied before it is given back."""
        return self._images[buffer.index]

    def query_unit(self, unit: int, selector: int, query: int, data: bytearray) -> None:
        """Carry out a request to a UVC camera's extension unit; `data`, of the control's size, is sent or filled."""
        octets = (ctypes.c_uint8 * len(data)).from_buffer(data)
        request = uvc.XuControlQuery(
            unit=unit,
            selector=selector,
            query=query,
            size=len(data),
            data=ctypes.cast(octets, ctypes.POINTER(ctypes.c_uint8)),
        )
        try:
            self._kernel.ioctl(self._fd, uvc.UVCIOC_CTRL_QUERY, request)
        except OSError as error:
            if error.errno in (errno.ENOENT, errno.ENOTTY):
                raise DeviceError(f"{self.name}: has no control {selector} in an extension unit {unit}") from error
            raise self._failure(f"speaking to extension unit {unit}", error) from error

    def _identify(self) -> None:
        capability = v4l2.Capability()
        self._control(v4l2.VIDIOC_QUERYCAP, capability, "asking for its capabilities")
        self.card = capability.card.decode(errors="replace")
        self.name = f"{self.name} ({self.card})"
        # `capabilities` speaks of all nodes of the physical device together, `device_caps` of this one.
        caps = capability.capabilities
        if caps & v4l2.V4L2_CAP_DEVICE_CAPS:
            caps = capability.device_caps
        if not caps & v4l2.V4L2_CAP_VIDEO_CAPTURE:
            raise DeviceError(
                f"{self.name}: captures no images: a node of metadata, say; a camera's images are on another of its "
                "nodes, usually the one before"
            )
        if not caps & v4l2.V4L2_CAP_STREAMING:
            raise DeviceError(f"{self.name}: cannot stream into mapped buffers")

    def _set_format(self, wanted: WantedFormat, rate_hz: int) -> tuple[v4l2.PixFormat, Fraction]:
        offered = listed(self._exists, wanted)
        request = v4l2.Format(type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE)
        pix = request.fmt.pix
        for fourcc, chosen_hz in offered.choices(wanted, rate_hz):
            pix.width, pix.height, pix.pixelformat = wanted.width, wanted.height, fourcc
            pix.field = v4l2.V4L2_FIELD_NONE
            self._control(v4l2.VIDIOC_S_FMT, request, "setting the image format")
            if (pix.pixelformat, pix.width, pix.height) == (fourcc, wanted.width, wanted.height):
                return pix, chosen_hz
        raise DeviceError(f"{self.name}: {wanted}; the camera answers {format_name(pix)} and offers {offered}")

    def _exists(self, request: int, argument: ListedStruct) -> bool:
        try:
            self._kernel.ioctl(self._fd, request, argument)
        except OSError as error:
            if error.errno in _NOT_OFFERED:
                return False
            raise self._failure("listing its formats", error) from error
        return True

    def _set_rate(self, rate_hz: Fraction) -> float:
        wanted = v4l2.StreamParm(type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE)
        capture = wanted.parm.capture
        capture.timeperframe.numerator, capture.timeperframe.denominator = rate_hz.denominator, rate_hz.numerator
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
        pixel = np.dtype(PIXEL_TYPES[pix.pixelformat])
        for index in range(request.count):
            buffer = self._new_buffer(index)
            self._control(v4l2.VIDIOC_QUERYBUF, buffer, "asking for a buffer")
            if pix.bytesperline < pixel.itemsize * pix.width or buffer.length < self.frame_bytes:
                raise DeviceError(
                    f"{self.name}: buffers of {buffer.length} bytes with rows of {pix.bytesperline} "
                    f"cannot hold {format_name(pix)}"
                )
            try:
                mapping = self._kernel.mmap(self._fd, buffer.length, buffer.m.offset)
            except OSError as error:
                raise self._failure("mapping a buffer", error) from error
            self._mappings.append(mapping)
            strides = (pix.bytesperline, pixel.itemsize)
            self._images.append(np.ndarray((pix.height, pix.width), pixel, buffer=mapping, strides=strides))
            self._control(v4l2.VIDIOC_QBUF, buffer, "queueing a buffer")

    def _start_stream(self) -> None:
        kind = ctypes.c_int(v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE)
        try:
            self._kernel.ioctl(self._fd, v4l2.VIDIOC_STREAMON, kind)
        except OSError as error:
            if error.errno == errno.ENOSPC:
                raise DeviceError(
                    f"{self.name}: the USB bus has no bandwidth left for its images; give the camera a bus of its own, "
                    "USB 3 for a ZED, or a smaller size or rate"
                ) from error
            raise self._failure("starting to stream", error) from error

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
        if error.errno == errno.EPIPE:
            return DeviceError(f"{self.name}: {what} failed: the camera refused the request or stopped its stream")
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

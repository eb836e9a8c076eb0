"""The part of Linux's <linux/videodev2.h> that a capture by mmap needs, as data with the header's own names.

The layouts hold for 64-bit Linux (x86-64, aarch64); a test compiles a program against the header of the machine and
compares every number, size and offset. Reference: the kernel's "Linux Media Infrastructure userspace API", part I.
"""

import ctypes
from ctypes import Structure, Union, c_long, c_uint8, c_uint32, c_ulong

V4L2_BUF_TYPE_VIDEO_CAPTURE = 1
V4L2_MEMORY_MMAP = 1
V4L2_FIELD_NONE = 1

V4L2_CAP_VIDEO_CAPTURE = 0x0000_0001
V4L2_CAP_STREAMING = 0x0400_0000
V4L2_CAP_DEVICE_CAPS = 0x8000_0000
V4L2_CAP_TIMEPERFRAME = 0x1000

V4L2_BUF_FLAG_ERROR = 0x0040
V4L2_BUF_FLAG_TIMESTAMP_MASK = 0xE000
V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN = 0x0000
V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC = 0x2000
V4L2_BUF_FLAG_TIMESTAMP_COPY = 0x4000
V4L2_BUF_FLAG_TSTAMP_SRC_SOE = 0x1_0000

V4L2_FRMSIZE_TYPE_DISCRETE = 1
V4L2_FRMIVAL_TYPE_DISCRETE = 1


def fourcc(code: str) -> int:
    """Return the number of a four-character pixel format (the header's v4l2_fourcc)."""
    return int.from_bytes(code.encode("ascii"), "little")


def fourcc_name(number: int) -> str:
    """Return the four characters of a pixel format."""
    return number.to_bytes(4, "little").decode("latin-1")


V4L2_PIX_FMT_YUYV = fourcc("YUYV")
V4L2_PIX_FMT_GREY = fourcc("GREY")
V4L2_PIX_FMT_MJPEG = fourcc("MJPG")
V4L2_PIX_FMT_Z16 = fourcc("Z16 ")


class Capability(Structure):
    """Struct v4l2_capability: who the device is and what it can do."""

    driver: bytes
    card: bytes
    bus_info: bytes
    version: int
    capabilities: int
    device_caps: int
    _fields_ = (
        ("driver", ctypes.c_char * 16),
        ("card", ctypes.c_char * 32),
        ("bus_info", ctypes.c_char * 32),
        ("version", c_uint32),
        ("capabilities", c_uint32),
        ("device_caps", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class FmtDesc(Structure):
    """Struct v4l2_fmtdesc: one pixel format on offer."""

    index: int
    type: int
    description: bytes
    pixelformat: int
    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("flags", c_uint32),
        ("description", ctypes.c_char * 32),
        ("pixelformat", c_uint32),
        ("mbus_code", c_uint32),
        ("reserved", c_uint32 * 3),
    )


class FrmSizeDiscrete(Structure):
    """Struct v4l2_frmsize_discrete: one size, px."""

    width: int
    height: int
    _fields_ = (("width", c_uint32), ("height", c_uint32))


class FrmSizeStepwise(Structure):
    """Struct v4l2_frmsize_stepwise: a range of sizes, px."""

    min_width: int
    max_width: int
    min_height: int
    max_height: int
    _fields_ = tuple(
        (name, c_uint32) for name in ("min_width", "max_width", "step_width", "min_height", "max_height", "step_height")
    )


class _FrmSizeUnion(Union):
    discrete: FrmSizeDiscrete
    stepwise: FrmSizeStepwise
    _fields_ = (("discrete", FrmSizeDiscrete), ("stepwise", FrmSizeStepwise))


class FrmSizeEnum(Structure):
    """Struct v4l2_frmsizeenum: one frame size on offer for a pixel format."""

    index: int
    pixel_format: int
    type: int
    discrete: FrmSizeDiscrete
    stepwise: FrmSizeStepwise
    _anonymous_ = ("_size",)
    _fields_ = (
        ("index", c_uint32),
        ("pixel_format", c_uint32),
        ("type", c_uint32),
        ("_size", _FrmSizeUnion),
        ("reserved", c_uint32 * 2),
    )


class Fract(Structure):
    """Struct v4l2_fract."""

    numerator: int
    denominator: int
    _fields_ = (("numerator", c_uint32), ("denominator", c_uint32))


class FrmIvalStepwise(Structure):
    """Struct v4l2_frmival_stepwise: a range of times from frame to frame, s."""

    min: Fract
    max: Fract
    step: Fract
    _fields_ = (("min", Fract), ("max", Fract), ("step", Fract))


class _FrmIvalUnion(Union):
    discrete: Fract
    stepwise: FrmIvalStepwise
    _fields_ = (("discrete", Fract), ("stepwise", FrmIvalStepwise))


class FrmIvalEnum(Structure):
    """Struct v4l2_frmivalenum: one time from frame to frame on offer for a pixel format and size."""

    index: int
    pixel_format: int
    width: int
    height: int
    type: int
    discrete: Fract
    stepwise: FrmIvalStepwise
    _anonymous_ = ("_interval",)
    _fields_ = (
        ("index", c_uint32),
        ("pixel_format", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("type", c_uint32),
        ("_interval", _FrmIvalUnion),
        ("reserved", c_uint32 * 2),
    )


class PixFormat(Structure):
    """Struct v4l2_pix_format: size (px), pixel format and row pitch (bytes) of a single-plane image."""

    width: int
    height: int
    pixelformat: int
    field: int
    bytesperline: int
    sizeimage: int
    _fields_ = tuple(
        (name, c_uint32)
        for name in (
            "width",
            "height",
            "pixelformat",
            "field",
            "bytesperline",
            "sizeimage",
            "colorspace",
            "priv",
            "flags",
            "ycbcr_enc",
            "quantization",
            "xfer_func",
        )
    )


class _FormatUnion(Union):
    pix: PixFormat
    # v4l2_window, the widest-aligned member, holds pointers and so aligns the union to 8 bytes.
    _fields_ = (("pix", PixFormat), ("raw_data", c_uint8 * 200), ("_alignment", c_ulong))


class Format(Structure):
    """Struct v4l2_format."""

    type: int
    fmt: _FormatUnion
    _fields_ = (("type", c_uint32), ("fmt", _FormatUnion))


class CaptureParm(Structure):
    """Struct v4l2_captureparm: `timeperframe` in seconds."""

    capability: int
    timeperframe: Fract
    _fields_ = (
        ("capability", c_uint32),
        ("capturemode", c_uint32),
        ("timeperframe", Fract),
        ("extendedmode", c_uint32),
        ("readbuffers", c_uint32),
        ("reserved", c_uint32 * 4),
    )


class _ParmUnion(Union):
    capture: CaptureParm
    _fields_ = (("capture", CaptureParm), ("raw_data", c_uint8 * 200))


class StreamParm(Structure):
    """Struct v4l2_streamparm."""

    type: int
    parm: _ParmUnion
    _fields_ = (("type", c_uint32), ("parm", _ParmUnion))


class RequestBuffers(Structure):
    """Struct v4l2_requestbuffers."""

    count: int
    type: int
    memory: int
    _fields_ = (
        ("count", c_uint32),
        ("type", c_uint32),
        ("memory", c_uint32),
        ("capabilities", c_uint32),
        ("flags", c_uint8),
        ("reserved", c_uint8 * 3),
    )


class Timeval(Structure):
    """Struct timeval of the C library, s and µs."""

    tv_sec: int
    tv_usec: int
    _fields_ = (("tv_sec", c_long), ("tv_usec", c_long))


class Timecode(Structure):
    """Struct v4l2_timecode; unused by cameras."""

    _fields_ = (
        ("type", c_uint32),
        ("flags", c_uint32),
        ("frames", c_uint8),
        ("seconds", c_uint8),
        ("minutes", c_uint8),
        ("hours", c_uint8),
        ("userbits", c_uint8 * 4),
    )


class _BufferMemory(Union):
    offset: int
    _fields_ = (("offset", c_uint32), ("userptr", c_ulong))


class Buffer(Structure):
    """Struct v4l2_buffer: one frame buffer on its way between the driver and the program."""

    index: int
    type: int
    bytesused: int
    flags: int
    field: int
    timestamp: Timeval
    sequence: int
    memory: int
    m: _BufferMemory
    length: int
    _fields_ = (
        ("index", c_uint32),
        ("type", c_uint32),
        ("bytesused", c_uint32),
        ("flags", c_uint32),
        ("field", c_uint32),
        ("timestamp", Timeval),
        ("timecode", Timecode),
        ("sequence", c_uint32),
        ("memory", c_uint32),
        ("m", _BufferMemory),
        ("length", c_uint32),
        ("reserved2", c_uint32),
        ("request_fd", ctypes.c_int32),
    )


IOC_WRITE, IOC_READ = 1, 2


def ioc(direction: int, kind: str, number: int, argument: type[Structure | ctypes.c_int]) -> int:
    """Return the header's _IOR, _IOW or _IOWR of type `kind` (asm-generic/ioctl.h, as on x86 and arm)."""
    return direction << 30 | ctypes.sizeof(argument) << 16 | ord(kind) << 8 | number


VIDIOC_QUERYCAP = ioc(IOC_READ, "V", 0, Capability)
VIDIOC_ENUM_FMT = ioc(IOC_READ | IOC_WRITE, "V", 2, FmtDesc)
VIDIOC_S_FMT = ioc(IOC_READ | IOC_WRITE, "V", 5, Format)
VIDIOC_REQBUFS = ioc(IOC_READ | IOC_WRITE, "V", 8, RequestBuffers)
VIDIOC_QUERYBUF = ioc(IOC_READ | IOC_WRITE, "V", 9, Buffer)
VIDIOC_QBUF = ioc(IOC_READ | IOC_WRITE, "V", 15, Buffer)
VIDIOC_DQBUF = ioc(IOC_READ | IOC_WRITE, "V", 17, Buffer)
VIDIOC_STREAMON = ioc(IOC_WRITE, "V", 18, ctypes.c_int)
VIDIOC_S_PARM = ioc(IOC_READ | IOC_WRITE, "V", 22, StreamParm)
VIDIOC_ENUM_FRAMESIZES = ioc(IOC_READ | IOC_WRITE, "V", 74, FrmSizeEnum)
VIDIOC_ENUM_FRAMEINTERVALS = ioc(IOC_READ | IOC_WRITE, "V", 75, FrmIvalEnum)

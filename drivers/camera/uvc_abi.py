"""The part of Linux's <linux/uvcvideo.h> and <linux/usb/video.h> that speaks to a UVC camera's extension units.

Names and layout as in drivers.camera.v4l2_abi. Reference: the kernel's "The Linux USB Video Class (UVC) driver";
UVC 1.5 specification, A.8 "Video Class-Specific Request Codes".
"""

import ctypes
from ctypes import Structure, c_uint8, c_uint16

from drivers.camera.v4l2_abi import IOC_READ, IOC_WRITE, ioc

UVC_SET_CUR = 0x01
UVC_GET_CUR = 0x81
UVC_GET_LEN = 0x85


class XuControlQuery(Structure):
    """Struct uvc_xu_control_query: one request to control `selector` of extension unit `unit`."""

    unit: int
    selector: int
    query: int
    size: int
    data: "ctypes._Pointer[c_uint8]"
    _fields_ = (
        ("unit", c_uint8),
        ("selector", c_uint8),
        ("query", c_uint8),
        ("size", c_uint16),
        ("data", ctypes.POINTER(c_uint8)),
    )


UVCIOC_CTRL_QUERY = ioc(IOC_READ | IOC_WRITE, "u", 0x21, XuControlQuery)

"""The kernel's own test camera and the mishaps it can be told to have.

Reference: Linux `Documentation/admin-guide/media/vivid.rst` (error injection), userspace API "Extended controls".
"""

import ctypes
import fcntl
import os
from pathlib import Path

from drivers.camera.side_by_side import V4l2StereoCamera
from tests.kernel.modules import load_module, unload_module

NUMBER = 30
NODE = f"/dev/video{NUMBER}"
EYE_PX = (160, 180)
"""Two of them side by side are the smallest picture of vivid's webcam."""

_NEXT_CONTROL = 0x8000_0000


class _QueryControl(ctypes.Structure):
    _fields_ = (
        ("id", ctypes.c_uint32),
        ("type", ctypes.c_uint32),
        ("name", ctypes.c_char * 32),
        ("range", ctypes.c_int32 * 4),
        ("flags", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32 * 2),
    )


class _Control(ctypes.Structure):
    _fields_ = (("id", ctypes.c_uint32), ("value", ctypes.c_int32))


_VIDIOC_S_CTRL = 0xC008_561C
_VIDIOC_QUERYCTRL = 0xC044_5624


class Vivid:
    """One vivid webcam, loaded anew."""

    def __init__(self) -> None:
        if Path("/sys/module/vivid").exists():
            unload_module("vivid")
        load_module("vivid", "n_devs=1", "node_types=0x1", "num_inputs=1", "input_types=0", f"vid_cap_nr={NUMBER}")
        self._holder: int | None = None
        self.set("Timestamp Source", 1)  # start of exposure: stamps of the frame's end lie ahead of its arrival

    def camera(self, eye_px: tuple[int, int] = EYE_PX, *, pool_frames: int = 4) -> V4l2StereoCamera:
        """Return the project's driver on it."""
        return V4l2StereoCamera(NODE, *eye_px, pool_frames=pool_frames)

    def set(self, name: str, value: int = 1) -> None:
        """Set the control of this name; a button is pushed by any value."""
        fd = os.open(NODE, os.O_RDWR)
        try:
            fcntl.ioctl(fd, _VIDIOC_S_CTRL, _Control(_control_id(fd, name), value))
        finally:
            os.close(fd)

    def unplug(self) -> None:
        """Disconnect. vivid comes back when nobody has it open, hence the holder."""
        self._holder = os.open(NODE, os.O_RDWR)
        self.set("Disconnect")

    def plug_in(self) -> None:
        """Let it come back."""
        if self._holder is not None:
            os.close(self._holder)
            self._holder = None


def _control_id(fd: int, name: str) -> int:
    found = []
    query = _QueryControl(id=_NEXT_CONTROL)
    while True:
        try:
            fcntl.ioctl(fd, _VIDIOC_QUERYCTRL, query, True)
        except OSError:
            break
        found.append(query.name.decode())
        if found[-1] == name:
            return int(query.id)
        query.id |= _NEXT_CONTROL
    raise AssertionError(f"vivid has no control {name!r}, but {found}")

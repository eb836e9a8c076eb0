"""Extension unit 4 of a ZED behind UVCIOC_CTRL_QUERY: the registers of its image processor and its two sensors.

It answers as uvcvideo does, errno for errno (the kernel's uvc_ctrl.c, `uvc_xu_ctrl_query`), and as drivers.camera.zed
describes the unit. While the automatic of an eye is on, it rules that eye's exposure and gain: what is written to them
does not last.
"""

import ctypes
import errno
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.camera import uvc_abi as uvc
from sim_rig.camera.v4l2_buffers import os_error

UNIT, SELECTOR = 4, 2
USB3_BYTES, USB2_BYTES = 384, 64

_SET, _GET = 0x50, 0x51
_PROCESSOR = 0xA2
_SENSORS = {0xA3: "left", 0xA5: "right"}
_SENSOR_DEVICE = 0x6C
_AUTOMATIC = {"left": 0x80181033, "right": 0x80181833}
_AUTOMATIC_BIT = 0x02
_RULED = {0x3500: 0x00, 0x3501: 0x20, 0x3502: 0x00, 0x3507: 0x00, 0x3508: 0x01, 0x3509: 0x90}
"""The sensor's exposure and gain as the automatic has set them."""


@dataclass(eq=False)
class ZedUnit:
    """One camera's unit. `stuck` holds registers ("left", address) that take nothing; `rows` the rows of a frame."""

    length: int = USB3_BYTES
    rows: int = 890
    stuck: Mapping[tuple[str, int], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.registers: dict[tuple[str, int], int] = {}
        for eye in _AUTOMATIC:
            self.registers |= {(eye, address): value for address, value in _RULED.items()}
            self.registers[eye, 0x380E], self.registers[eye, 0x380F] = divmod(self.rows, 256)
            self.registers["processor", _AUTOMATIC[eye]] = 0x42 | _AUTOMATIC_BIT
        self._answer = bytes(self.length)

    def ask(self, request: uvc.XuControlQuery) -> None:
        """Carry out one UVCIOC_CTRL_QUERY."""
        if (request.unit, request.selector) != (UNIT, SELECTOR):
            raise os_error(errno.ENOENT)
        sizes = {uvc.UVC_GET_LEN: 2, uvc.UVC_SET_CUR: self.length, uvc.UVC_GET_CUR: self.length}
        if request.query not in sizes:
            raise os_error(errno.EINVAL)
        if request.size != sizes[request.query]:
            raise os_error(errno.ENOBUFS)
        if request.query == uvc.UVC_SET_CUR:
            self._command(bytes(request.data[: request.size]))
            return
        answer = self.length.to_bytes(2, "little") if request.query == uvc.UVC_GET_LEN else self._answer
        ctypes.memmove(request.data, answer, len(answer))

    def _command(self, packet: bytes) -> None:
        task, bus, device, address_bytes, value_bytes = packet[:5]
        address = int.from_bytes(packet[5:9], "big")
        if task not in (_SET, _GET) or value_bytes != 1:
            raise os_error(errno.EPIPE)
        if bus == _PROCESSOR and (device, address_bytes, packet[9:13]) == (0, 4, bytes((0, 1, 0, 1))):
            place = "processor", address
        elif bus in _SENSORS and (device, address_bytes, packet[9:13]) == (_SENSOR_DEVICE, 2, bytes((0x90, 1, 0, 1))):
            place = _SENSORS[bus], address
        else:
            raise os_error(errno.EPIPE)
        if task == _SET:
            self._write(place, packet[16])
        answer = bytearray(self.length)
        answer[17] = self.registers.get(place, 0)
        self._answer = bytes(answer)

    def _write(self, place: tuple[str, int], value: int) -> None:
        where, address = place
        is_ruled = address in _RULED and self.registers["processor", _AUTOMATIC[where]] & _AUTOMATIC_BIT
        if not is_ruled:
            self.registers[place] = self.stuck.get(place, value)

"""Exposure and gain of a StereoLabs ZED, which are no V4L2 controls but registers behind UVC extension unit 4.

A packet to control 2 of the unit reads or writes one register of the image processor (OmniVision OV580) or of either
sensor (OV4689); its length, 384 bytes on USB 3 and 64 on USB 2, is what the control tells. Sources, as facts: the
maker's zed-open-capture (src/videocapture.cpp) for packets, addresses and gain steps; the kernel's
drivers/media/i2c/ov4689.c for what exposure and frame length count. Tried on the rig's camera only, on no ZED yet:
every value is read back, and a camera that answers otherwise is refused in one line.
"""

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

from drivers.camera import uvc_abi as uvc
from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.camera.v4l2_device import Kernel, V4l2Device
from drivers.camera.v4l2_stream import V4l2Stream
from drivers.protocols import DeviceError

_UNIT, _SELECTOR = 4, 2
_SET, _GET = 0x50, 0x51
_SETTLE_S = 300e-6
_VALUE_OUT, _VALUE_BACK = 16, 17
"""Where a packet holds the register's value, on its way to the camera and back."""

_FRAMES_TO_TAKE_EFFECT = 3

EYES = ("left", "right")
_AUTOMATIC = {"left": 0x8018_1033, "right": 0x8018_1833}
_AUTOMATIC_BIT = 0x02
_EXPOSURE_ROWS = (0x3500, 0x3501, 0x3502)
"""Rows of exposure in sixteenths, the highest byte first (ov4689.c: OV4689_REG_EXPOSURE)."""
_GAIN = (0x3507, 0x3508, 0x3509)
_FRAME_ROWS = (0x380E, 0x380F)
"""Rows from frame to frame, blanking included (ov4689.c: OV4689_REG_VTS)."""

_FEWEST_EXPOSURE_ROWS = 2
_ROWS_NOT_EXPOSED = 4
_GAIN_ZONES = ((0, 255), (378, 511), (890, 1023), (1914, 2047))
"""First and last raw gain of the four zones in which it is continuous."""


class _Bus(NamedTuple):
    """How a packet reaches one chip: constants of its address field (bytes 1 to 3) and of its transfer (byte 9)."""

    number: int
    device: int
    address_bytes: int
    transfer: int


_PROCESSOR = _Bus(0xA2, 0x00, 4, 0x00)
_SENSORS = {"left": _Bus(0xA3, 0x6C, 2, 0x90), "right": _Bus(0xA5, 0x6C, 2, 0x90)}


class ZedRegisters:
    """The registers behind the extension unit of an open camera."""

    def __init__(self, device: V4l2Device, kernel: Kernel) -> None:
        self._device = device
        self._kernel = kernel
        length = bytearray(2)
        device.query_unit(_UNIT, _SELECTOR, uvc.UVC_GET_LEN, length)
        self._length = int.from_bytes(length, "little")
        if self._length <= _VALUE_BACK:
            raise DeviceError(f"{device.name}: its extension unit {_UNIT} takes {self._length} bytes, no ZED's does")

    def automatic(self, eye: str) -> bool:
        """Return whether the camera itself sets exposure and gain of an eye."""
        return bool(self._read(_PROCESSOR, _AUTOMATIC[eye]) & _AUTOMATIC_BIT)

    def end_automatic(self, eye: str) -> None:
        """Let exposure and gain of an eye be as they are set from now on."""
        value = self._read(_PROCESSOR, _AUTOMATIC[eye])
        self._write(_PROCESSOR, _AUTOMATIC[eye], value & ~_AUTOMATIC_BIT)
        if self.automatic(eye):
            raise DeviceError(f"{self._device.name}: the {eye} eye keeps its automatic exposure")

    def read_sensor(self, eye: str, addresses: Sequence[int]) -> int:
        """Return the number that lies in registers of an eye's sensor, the highest byte first."""
        return int.from_bytes(bytes(self._read(_SENSORS[eye], address) for address in addresses), "big")

    def write_sensor(self, eye: str, addresses: Sequence[int], value: int) -> None:
        """Write a number into registers of an eye's sensor, and read it back."""
        for address, octet in zip(addresses, value.to_bytes(len(addresses), "big"), strict=True):
            self._write(_SENSORS[eye], address, octet)
        found = self.read_sensor(eye, addresses)
        if found != value:
            raise DeviceError(
                f"{self._device.name}: register 0x{addresses[0]:04X} of the {eye} eye reads {found}, not {value} as set"
            )

    def _read(self, bus: _Bus, address: int) -> int:
        self._send(self._packet(_GET, bus, address))
        answer = bytearray(self._length)
        self._device.query_unit(_UNIT, _SELECTOR, uvc.UVC_GET_CUR, answer)
        return answer[_VALUE_BACK]

    def _write(self, bus: _Bus, address: int, value: int) -> None:
        packet = self._packet(_SET, bus, address)
        packet[_VALUE_OUT] = value
        self._send(packet)

    def _send(self, packet: bytearray) -> None:
        self._device.query_unit(_UNIT, _SELECTOR, uvc.UVC_SET_CUR, packet)
        self._kernel.sleep(_SETTLE_S)

    def _packet(self, task: int, bus: _Bus, address: int) -> bytearray:
        """Return a packet about one register of one byte."""
        head = bytes((task, bus.number, bus.device, bus.address_bytes, 1))
        return bytearray(
            (head + address.to_bytes(4, "big") + bytes((bus.transfer, 1, 0, 1))).ljust(self._length, b"\0")
        )


def fix_exposure(
    registers: ZedRegisters, exposure_s: float, gain_percent: float, rate_hz: float, height_px: int, name: str
) -> float:
    """End the automatic of both eyes and set exposure and gain; return the exposure in effect, s, in whole rows.

    A row lasts 1/(rate · rows from frame to frame). Raises DeviceError, beginning with `name`, where the camera cannot
    expose that long at this rate, or takes the values otherwise.
    """
    exposures_s = []
    for eye in EYES:
        rows_per_frame = registers.read_sensor(eye, _FRAME_ROWS)
        if not rows_per_frame > height_px:
            raise DeviceError(f"{name}: the {eye} eye tells {rows_per_frame} rows a frame, images have {height_px}")
        row_s = 1.0 / (rate_hz * rows_per_frame)
        rows, most_rows = round(exposure_s / row_s), rows_per_frame - _ROWS_NOT_EXPOSED
        if not _FEWEST_EXPOSURE_ROWS <= rows <= most_rows:
            raise DeviceError(
                f"{name}: camera.exposure_s is {exposure_s:g}, allowed at {rate_hz:.3g} Hz "
                f"{_FEWEST_EXPOSURE_ROWS * row_s:.2g} to {most_rows * row_s:.3g}"
            )
        registers.end_automatic(eye)
        registers.write_sensor(eye, _EXPOSURE_ROWS, rows << 4)
        registers.write_sensor(eye, _GAIN, raw_gain(gain_percent))
        exposures_s.append(rows * row_s)
    return statistics.fmean(exposures_s)


def raw_gain(percent: float) -> int:
    """Return the sensor's gain register for the maker's scale of 0 to 100, which runs evenly through the zones."""
    widths = [last - first for first, last in _GAIN_ZONES]
    step = round(sum(widths) * percent / 100.0)
    for (first, _), width in zip(_GAIN_ZONES, widths, strict=True):
        if step <= width:
            return first + step
        step -= width
    return _GAIN_ZONES[-1][1]


class ZedCamera(V4l2StereoCamera):
    """A ZED whose exposure and gain are fixed each time it is opened (see V4l2StereoCamera).

    `gain_percent` is on the maker's scale of 0 to 100. `exposure_s` of a frame is what the sensor took, NaN for the
    first frames, on which it may not have taken effect. The setting outlives this program: the automatic comes back
    when the camera is plugged in anew.
    """

    def __init__(
        self,
        path: str,
        width_px: int,
        height_px: int,
        *,
        exposure_s: float,
        gain_percent: float,
        pool_frames: int,
        stamp_to_mid_exposure_s: float = 0.0,
        rate_hz: int = 60,
        kernel: Kernel | None = None,
    ) -> None:
        self._wanted_exposure_s, self._gain_percent = exposure_s, gain_percent
        super().__init__(
            path,
            width_px,
            height_px,
            pool_frames=pool_frames,
            stamp_to_mid_exposure_s=stamp_to_mid_exposure_s,
            rate_hz=rate_hz,
            kernel=kernel,
        )

    def _open(self) -> Sequence[V4l2Stream]:
        streams = super()._open()
        (stream,) = streams
        try:
            self._exposure_s = self._fixed(stream.device)
        except DeviceError:
            stream.device.close()
            raise
        periods_ns = round(_FRAMES_TO_TAKE_EFFECT * 1e9 / stream.device.rate_hz)
        self._exposure_since_ns = self._kernel.monotonic_ns() + periods_ns
        return streams

    def _fixed(self, device: V4l2Device) -> float:
        """Set exposure and gain while it streams: a sensor is set up anew when a stream starts."""
        if "ZED" not in device.card:
            raise DeviceError(f"{device.name}: camera.exposure_s and gain_percent are for a ZED, this is none")
        if math.isnan(device.rate_hz):
            raise DeviceError(f"{device.name}: tells no frame rate, so camera.exposure_s cannot be counted in rows")
        registers = ZedRegisters(device, self._kernel)
        return fix_exposure(
            registers,
            self._wanted_exposure_s,
            self._gain_percent,
            device.rate_hz,
            self._height_px,
            device.name,
        )

"""The rig's I2C wires and chip behind a real kernel's adapter, through the module `gaiteyes_rig`.

A driver that opens /dev/i2c-N and a line of /dev/gpiochipM then talks, by way of the kernel, to `I2cWires` and
`Mpu6050Chip`, whose faults work as ever. The records exchanged with the module are described in its source,
`module/gaiteyes_rig.c`.
"""

import errno
import math
import os
import select
import struct
import threading
from collections.abc import Callable
from pathlib import Path

from smbus2 import i2c_msg

from messages import UserError
from sim_rig.imu.i2c_bus import I2cWires
from sim_rig.imu.mpu6050_chip import Mpu6050Chip

DEVICE = Path("/dev/gaiteyes-rig")
_CHILDREN = Path("/sys/class/misc/gaiteyes-rig")
INTERRUPT_LINE = 0

_REQUEST = struct.Struct("=II")  # id, messages
_MESSAGE = struct.Struct("=HHHH")  # address, flags, length, 0
_COMMAND = struct.Struct("=IIi")  # kind, id or line, errno or level
_ANSWER, _LEVEL = 0, 1
_LONGEST_REQUEST = 1 << 16
_READ_FLAG = 0x0001  # I2C_M_RD


def i2c_bus_number() -> int:
    """Return N of the adapter's /dev/i2c-N. Raises UserError if the module is not loaded."""
    return int(_child("i2c-").removeprefix("i2c-"))


def gpio_chip_path() -> str:
    """Return the path of the GPIO chip on whose line 0 the chip's INT pin is. Raises UserError as above."""
    return f"/dev/{_child('gpiochip')}"


def _child(prefix: str) -> str:
    found = sorted(path.name for path in _CHILDREN.glob(f"{prefix}*"))
    if not found:
        raise UserError(f"{DEVICE}: no such device; `modprobe gaiteyes_rig` makes it")
    return found[0]


class ChipServer:
    """Answers the adapter's transfers with the chips on `wires` and passes on the INT edges of `chip`.

    `serve` is called over and over by one thread; whoever else touches wires or chip meanwhile holds `lock`.
    While `mute`, transfers are taken and not answered, so that the kernel itself times them out; `late_answers` counts
    the answers that came after the kernel had done so.
    Raises UserError if the module is not loaded or is served already.
    """

    def __init__(self, wires: I2cWires, chip: Mpu6050Chip, clock: Callable[[], int]) -> None:
        self._wires = wires
        self._chip = chip
        self._clock = clock
        self.lock = threading.Lock()
        self.mute = False
        self.late_answers = 0
        try:
            self._fd = os.open(DEVICE, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise UserError(f"{DEVICE}: {error.strerror}") from error
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)

    def serve(self, timeout_s: float) -> None:
        """Answer one transfer, or return after `timeout_s` or at the chip's next edge."""
        ready = self._poll.poll(1e3 * min(timeout_s, self._until_edge_s()))
        with self.lock:
            if ready:
                self._answer_next()
            edges = self._chip.take_edges()
        for _ in edges:
            self.pulse()

    def pulse(self) -> None:
        """Raise the INT pin and let it fall, now."""
        for level in (1, 0):
            os.write(self._fd, _COMMAND.pack(_LEVEL, INTERRUPT_LINE, level))

    def close(self) -> None:
        """Take the chips off the kernel's bus; a transfer under way fails with ENXIO."""
        os.close(self._fd)

    def _until_edge_s(self) -> float:
        with self.lock:
            edge_ns = self._chip.next_edge_ns()
        return math.inf if edge_ns is None else max(0.0, 1e-9 * (edge_ns - self._clock()))

    def _answer_next(self) -> None:
        try:
            request = os.read(self._fd, _LONGEST_REQUEST)
        except BlockingIOError:
            return  # whoever asked was killed, or the kernel gave up, since the poll
        if self.mute:
            return
        number, messages = _parsed(request)
        try:
            self._wires.transfer(*messages)
        except OSError as error:
            answer = _COMMAND.pack(_ANSWER, number, error.errno or 0)
        else:
            read = (bytes(message) for message in messages if message.flags & _READ_FLAG)
            answer = _COMMAND.pack(_ANSWER, number, 0) + b"".join(read)
        try:
            os.write(self._fd, answer)
        except OSError as error:
            if error.errno != errno.ESTALE:
                raise
            self.late_answers += 1


def _parsed(request: bytes) -> tuple[int, list[i2c_msg]]:
    number, count = _REQUEST.unpack_from(request)
    offset = _REQUEST.size
    messages = []
    for _ in range(count):
        address, flags, length, _ = _MESSAGE.unpack_from(request, offset)
        offset += _MESSAGE.size
        if flags & _READ_FLAG:
            messages.append(i2c_msg.read(address, length))
        else:
            messages.append(i2c_msg.write(address, request[offset : offset + length]))
            offset += length
    return number, messages

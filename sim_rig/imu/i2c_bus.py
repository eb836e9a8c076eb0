"""Simulated I2C wires with smbus2's interface: chips by address, and the faults of a real bus on demand."""

import ctypes
import errno
import os
from collections import deque
from collections.abc import Callable, Mapping
from typing import Protocol

from smbus2 import i2c_msg

_BLOCK_MAX = 32
_READ_FLAG = 0x0001  # I2C_M_RD
_BITS_PER_BYTE = 9
_FAST_MODE_HZ = 400_000


class I2cChip(Protocol):
    """A chip as the wires see it."""

    def write(self, data: bytes) -> None:
        """Take one write transfer, register address first."""

    def read(self, length: int) -> bytes:
        """Answer one read transfer from where the register pointer stands."""


class I2cWires:
    """The two wires, the chips on them and their faults. `open` is what a driver calls.

    `elapse` is called with how long each part of a transfer takes on the wires, in seconds (`time.sleep` for real time;
    a simulated clock's own; nothing by default). `smbus_only` refuses combined transfers as i2c-stub does.
    """

    def __init__(
        self,
        chips: Mapping[int, I2cChip],
        *,
        smbus_only: bool = False,
        elapse: Callable[[float], None] = lambda _: None,
    ) -> None:
        self._chips = dict(chips)
        self._smbus_only = smbus_only
        self._elapse = elapse
        self._failures: deque[tuple[int, int]] = deque()
        self._lasting_error = 0
        self._freed_by_opening = False
        self.transfers = 0

    def open(self) -> "SimulatedI2cBus":
        """Return a new handle; a bus stuck until re-opened is free again."""
        if self._freed_by_opening:
            self.release()
        return SimulatedI2cBus(self)

    def fail(self, error: int, times: int = 1, *, bytes_lost: int = 0) -> None:
        """Make the next `times` transfers fail with this errno.

        121 EREMOTEIO, 6 ENXIO and 5 EIO are a missing acknowledge, 11 EAGAIN a lost arbitration. `bytes_lost` of a
        read have left the chip before the fault.
        """
        self._failures.extend((error, bytes_lost) for _ in range(times))

    def stick(self, error: int = errno.ETIMEDOUT, *, until_opened: bool = False) -> None:
        """Make every transfer fail until `release`, or until the next `open`; 110 ETIMEDOUT is a line held low."""
        self._lasting_error = error
        self._freed_by_opening = until_opened

    def release(self) -> None:
        """Let a stuck bus go."""
        self._lasting_error = 0
        self._freed_by_opening = False

    def transfer(self, *messages: i2c_msg) -> None:
        """Run the messages in order as one transfer; those that read are filled in place.

        Raises OSError with the kernel's errno where a fault is due or no chip answers.
        """
        self.transfers += 1
        if self._lasting_error:
            raise _os_error(self._lasting_error)
        error, bytes_lost = self._failures.popleft() if self._failures else (0, 0)
        if error and not bytes_lost:
            raise _os_error(error)
        for message in messages:
            chip = self._chips.get(message.addr)
            if chip is None:
                raise _os_error(errno.EREMOTEIO)
            if message.flags & _READ_FLAG:
                self._pass_bytes(1)
                data = chip.read(bytes_lost if error else message.len)
                self._pass_bytes(len(data))
                if error:
                    raise _os_error(error)
                ctypes.memmove(message.buf, data, len(data))
            else:
                self._pass_bytes(1 + message.len)
                chip.write(bytes(message))

    def transfer_combined(self, *messages: i2c_msg) -> None:
        """Run a transfer that needs a true I2C adapter; raises OSError (EOPNOTSUPP) where there is none."""
        if self._smbus_only:
            raise _os_error(errno.EOPNOTSUPP)
        self.transfer(*messages)

    def _pass_bytes(self, count: int) -> None:
        self._elapse(count * _BITS_PER_BYTE / _FAST_MODE_HZ)


class SimulatedI2cBus:
    """One handle with the methods of smbus2.SMBus that `drivers.imu.register_access.RegisterBus` names."""

    def __init__(self, wires: I2cWires) -> None:
        self._wires: I2cWires | None = wires

    def read_byte_data(self, i2c_addr: int, register: int) -> int:
        """Read one register."""
        return self.read_i2c_block_data(i2c_addr, register, 1)[0]

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        """Write one register."""
        self._on_wires().transfer(i2c_msg.write(i2c_addr, [register, value]))

    def read_i2c_block_data(self, i2c_addr: int, register: int, length: int) -> list[int]:
        """Read up to 32 consecutive registers; raises ValueError beyond."""
        if length > _BLOCK_MAX:
            raise ValueError(f"block of {length} bytes: SMBus reads {_BLOCK_MAX} at most")
        block = i2c_msg.read(i2c_addr, length)
        self._on_wires().transfer(i2c_msg.write(i2c_addr, [register]), block)
        return list(bytes(block))

    def i2c_rdwr(self, *i2c_msgs: i2c_msg) -> None:
        """Run the messages in order as one transfer; those that read are filled in place."""
        self._on_wires().transfer_combined(*i2c_msgs)

    def close(self) -> None:
        """Release the handle; any further use raises OSError (EBADF)."""
        self._wires = None

    def _on_wires(self) -> I2cWires:
        if self._wires is None:
            raise _os_error(errno.EBADF)
        return self._wires


def _os_error(error: int) -> OSError:
    return OSError(error, os.strerror(error))

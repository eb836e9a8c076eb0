"""Registers of one I2C chip over any smbus2 bus, with bounded retries."""

import errno
import fcntl
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar, cast

from smbus2 import SMBus, i2c_msg

from drivers.protocols import ImuCounters

T = TypeVar("T")

ATTEMPTS = 3
_PAUSE_S = 0.0005  # between attempts: longer than the disturbance of one transfer
_I2C_TIMEOUT = 0x0702  # of linux/i2c-dev.h, in units of 10 ms
_LONGEST_TRANSFER_10MS = 12  # 4096 bytes at 400 kHz take 92 ms


class RegisterBus(Protocol):
    """The part of smbus2.SMBus that the drivers use. Faults are raised as OSError with the kernel's errno."""

    def read_byte_data(self, i2c_addr: int, register: int) -> int:
        """Read one register."""

    def write_byte_data(self, i2c_addr: int, register: int, value: int) -> None:
        """Write one register."""

    def read_i2c_block_data(self, i2c_addr: int, register: int, length: int) -> list[int]:
        """Read up to 32 consecutive registers."""

    def i2c_rdwr(self, *i2c_msgs: i2c_msg) -> None:
        """Run a combined transfer; the messages to read are filled in place."""

    def close(self) -> None:
        """Release the bus."""


def open_i2c(number: int) -> RegisterBus:
    """Return /dev/i2c-`number`, told to give up a transfer on a stuck bus after 0.12 s; many adapters take a second.

    Raises OSError if there is no such bus.
    """
    bus = SMBus(number)
    fcntl.ioctl(cast(int, bus.fd), _I2C_TIMEOUT, _LONGEST_TRANSFER_10MS)
    return bus


class RegisterAccess:
    """One chip's registers. Every failed transfer is counted in `counters.bus_errors`.

    Reading and writing registers is tried ATTEMPTS times, unless it timed out: a bus that is held low stays so, and
    each attempt would take long. Then the last OSError passes on. Without an open bus every call raises OSError
    (ENODEV).
    """

    def __init__(
        self,
        open_bus: Callable[[], RegisterBus],
        address: int,
        counters: ImuCounters,
        sleep: Callable[[float], None],
    ) -> None:
        self._open_bus = open_bus
        self._address = address
        self._counters = counters
        self._sleep = sleep
        self._bus: RegisterBus | None = None
        self._combined = False

    @property
    def is_open(self) -> bool:
        """Return whether there is a bus to use."""
        return self._bus is not None

    @property
    def has_combined_transfers(self) -> bool:
        """Return whether the adapter knows true I2C transfers of any length, and not SMBus ones only."""
        return self._combined

    def reopen(self, probe_register: int) -> None:
        """Open the bus anew and find out, by reading `probe_register`, what the adapter can do."""
        self.close()
        self._bus = self._counted(self._open_bus)
        self._combined = self._retried(lambda: self._probe(probe_register))

    def close(self) -> None:
        """Release the bus, if it is open."""
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.close()

    def read(self, register: int, length: int) -> bytes:
        """Return up to 32 consecutive registers."""
        return self._retried(lambda: bytes(self._opened().read_i2c_block_data(self._address, register, length)))

    def read_byte(self, register: int) -> int:
        """Return one register."""
        return self._retried(lambda: self._opened().read_byte_data(self._address, register))

    def read_each(self, registers: Sequence[int]) -> dict[int, int]:
        """Return the values of `registers`, given in rising order; neighbours are read together."""
        values: dict[int, int] = {}
        for first in (register for register in registers if register - 1 not in registers):
            last = next(register for register in registers if register >= first and register + 1 not in registers)
            values.update(zip(range(first, last + 1), self.read(first, last - first + 1), strict=True))
        return values

    def read_word(self, register: int) -> int:
        """Return two registers, the high byte first."""
        return int.from_bytes(self.read(register, 2), "big")

    def write_byte(self, register: int, value: int) -> None:
        """Write one register."""
        self._retried(lambda: self._opened().write_byte_data(self._address, register, value))

    def burst(self, register: int, length: int) -> bytes:
        """Return `length` bytes from `register` in one combined transfer, tried once: a FIFO forgets what it gave."""
        return self._counted(lambda: self._combined_read(register, length))

    def _combined_read(self, register: int, length: int) -> bytes:
        data = i2c_msg.read(self._address, length)
        self._opened().i2c_rdwr(i2c_msg.write(self._address, [register]), data)
        return bytes(data)

    def _probe(self, register: int) -> bool:
        try:
            self._combined_read(register, 1)
        except OSError as error:
            if error.errno != errno.EOPNOTSUPP:
                raise
            return False
        return True

    def _opened(self) -> RegisterBus:
        if self._bus is None:
            raise OSError(errno.ENODEV, "bus not open")
        return self._bus

    def _counted(self, transfer: Callable[[], T]) -> T:
        try:
            return transfer()
        except OSError:
            self._counters.bus_errors += 1
            raise

    def _retried(self, transfer: Callable[[], T], attempts: int = ATTEMPTS) -> T:
        try:
            return self._counted(transfer)
        except OSError as error:
            if attempts == 1 or error.errno == errno.ETIMEDOUT:
                raise
        self._sleep(_PAUSE_S)
        return self._retried(transfer, attempts - 1)

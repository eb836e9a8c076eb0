"""Registers of one I2C chip over any smbus2 bus, with bounded retries."""

import errno
from collections.abc import Callable
from typing import TypeVar

from smbus2 import i2c_msg

from drivers.protocols import ImuCounters, RegisterBus

T = TypeVar("T")

ATTEMPTS = 3
_PAUSE_S = 0.0005  # between attempts: longer than the disturbance of one transfer


class RegisterAccess:
    """One chip's registers. Every failed transfer is counted in `counters.bus_errors`.

    Reading and writing registers is tried ATTEMPTS times; then the last OSError passes on. Without an open bus every
    call raises OSError (ENODEV).
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
        except OSError:
            if attempts == 1:
                raise
        self._sleep(_PAUSE_S)
        return self._retried(transfer, attempts - 1)

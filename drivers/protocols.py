"""What the daemon asks of a device. Hardware, the rig and a recording answer alike and pass one contract test."""

from collections.abc import Sequence
from typing import Protocol

from smbus2 import i2c_msg

from messages import AnkleState, CanBusHealth, DropCause, ImuSample, StereoFrame, UserError


class DeviceError(UserError):
    """A device is absent, is another one than expected, or failed beyond repair. One clear line for a person."""


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


class ImuCounters(Protocol):
    """What an IMU driver counts since it was made."""

    lost: int
    bus_errors: int
    fifo_overflows: int
    resets: int


class ImuSource(Protocol):
    """A stream of IMU samples."""

    @property
    def counters(self) -> ImuCounters:
        """Return the counters since the start."""

    def read(self) -> Sequence[ImuSample]:
        """Return all samples taken since the last call, oldest first; empty if there are none.

        Raises DeviceError when the device is gone for now; a later call may succeed again.
        """

    def close(self) -> None:
        """Release the device."""


class StereoSource(Protocol):
    """A stream of stereo frames on the 50 ms grid."""

    @property
    def dropped(self) -> dict[DropCause, int]:
        """Return the frames lost inside the device or the driver, by cause, since the start."""

    def read(self, timeout_s: float) -> StereoFrame | None:
        """Return the newest frame not yet returned, or None if none came within `timeout_s`.

        Raises DeviceError when the device is gone for now; a later call may succeed again.
        """

    def close(self) -> None:
        """Release the device."""


class AnkleSource(Protocol):
    """A stream of the prosthesis's own state, and the bus it comes on."""

    @property
    def bus_health(self) -> CanBusHealth:
        """Return the state of the bus and what was lost on it since the start."""

    def receive(self, timeout_s: float) -> AnkleState | None:
        """Return the next valid state, or None if none came within `timeout_s`."""

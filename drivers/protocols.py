"""What the daemon asks of a device. Hardware, the rig and a recording answer alike and pass one contract test."""

from collections.abc import Sequence
from typing import Protocol

from messages import AnkleState, CanBusHealth, DropCause, Frame, ImuSample, StereoFrame, UserError


class DeviceError(UserError):
    """A device is absent, is another one than expected, or failed beyond repair. One clear line for a person."""


class DataReadyLine(Protocol):
    """A pin on which each sample of a chip shows as one rising edge."""

    def wait(self, timeout_s: float) -> Sequence[int]:
        """Return the instants of all waiting edges, CLOCK_MONOTONIC ns, oldest first; empty if none came in time.

        Raises DeviceError or OSError when the line is gone.
        """

    def close(self) -> None:
        """Release the line."""


class ImuCounters(Protocol):
    """What an IMU driver counts since it was made.

    Samples lost, transfers failed, FIFOs flushed because they overflowed or were misaligned, frames refused because
    they were all zeros or all ones, chips reset to mend, samples whose data-ready edge was missed.
    """

    lost: int
    bus_errors: int
    fifo_overflows: int
    frames_refused: int
    resets: int
    edges_missed: int


class ImuSource(Protocol):
    """A stream of IMU samples."""

    @property
    def counters(self) -> ImuCounters:
        """Return the counters since the start."""

    @property
    def filter_delay_s(self) -> float:
        """Return what `t_sample_ns` is earlier than the instant at which the sample was ready to be read."""

    def read(self, timeout_s: float) -> Sequence[ImuSample]:
        """Return all samples taken since the last call, oldest first; empty if none came within `timeout_s`.

        Raises DeviceError when the device is gone for now; a later call may succeed again.
        """

    def close(self) -> None:
        """Release the device."""


class FrameSource(Protocol):
    """A stream of frames on the 50 ms grid, stereo pairs or depth images."""

    @property
    def dropped(self) -> dict[DropCause, int]:
        """Return the frames lost inside the device or the driver, by cause, since the start."""

    def read(self, timeout_s: float) -> Frame | None:
        """Return the newest frame not yet returned, or None if none came within `timeout_s`.

        Raises DeviceError when the device is gone for now; a later call may succeed again.
        """

    def close(self) -> None:
        """Release the device."""


class StereoSource(FrameSource, Protocol):
    """A stream of stereo pairs."""

    def read(self, timeout_s: float) -> StereoFrame | None:
        """Return the newest pair, as FrameSource says."""


class AnkleSource(Protocol):
    """A stream of the prosthesis's own state, and the bus it comes on."""

    @property
    def bus_health(self) -> CanBusHealth:
        """Return the state of the bus and what was lost on it since the start."""

    def receive(self, timeout_s: float) -> AnkleState | None:
        """Return the next valid state, or None if none came within `timeout_s`."""

"""A chip's data-ready pin on a line of the host's GPIO chip: edges stamped by the kernel's interrupt handler.

Source: libgpiod 2, and Documentation/userspace-api/gpio/chardev.rst of the kernel for what it says of event buffers.
"""

import re
from collections.abc import Sequence

import gpiod
from gpiod.line import Clock, Direction, Edge

from drivers.protocols import DeviceError

_BUFFERED_EDGES = 512  # the kernel drops the oldest beyond; five seconds at 100 Hz
_SEAT = re.compile(r"(/[^:]+):([0-9]{1,3})")


class GpiodDataReady:
    """Line number `line` of the GPIO chip at `chip_path`, as a DataReadyLine.

    `dropped` counts the edges that left the kernel's buffer unread. Raises DeviceError, one line naming chip and line,
    if it cannot be had: no such chip or line, in use, no permission.
    """

    def __init__(self, chip_path: str, line: int) -> None:
        self._name = f"data-ready line {line} of {chip_path}"
        self._sequence: int | None = None
        self.dropped = 0
        settings = gpiod.LineSettings(
            direction=Direction.INPUT, edge_detection=Edge.RISING, event_clock=Clock.MONOTONIC
        )
        try:
            self._request = gpiod.request_lines(
                chip_path, consumer="gaiteyes-imu", config={line: settings}, event_buffer_size=_BUFFERED_EDGES
            )
        except (OSError, ValueError) as error:
            why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise DeviceError(f"{self._name}: {why}") from error

    def wait(self, timeout_s: float) -> Sequence[int]:
        """Return the instants of all waiting edges, CLOCK_MONOTONIC ns, oldest first; empty if none came in time.

        Raises DeviceError when the line is gone or was closed.
        """
        edges: list[int] = []
        try:
            while self._request.wait_edge_events(0.0 if edges else max(0.0, timeout_s)):
                for event in self._request.read_edge_events(_BUFFERED_EDGES):
                    self._count_dropped(event.line_seqno)
                    edges.append(event.timestamp_ns)
        except (OSError, gpiod.RequestReleasedError) as error:
            raise DeviceError(f"{self._name}: {error}") from error
        return edges

    def close(self) -> None:
        """Release the line; may be called again."""
        if self._request:
            self._request.release()

    def _count_dropped(self, sequence: int) -> None:
        if self._sequence is not None:
            self.dropped += sequence - self._sequence - 1
        self._sequence = sequence


def parse_data_ready(text: str) -> tuple[str, int]:
    """Return the GPIO chip's path and the line's number from "PATH:LINE". Raises ValueError if it is not that."""
    seat = _SEAT.fullmatch(text)
    if seat is None:
        raise ValueError(f"{text!r} is no data-ready line, expected PATH:LINE, for instance /dev/gpiochip0:17")
    return seat[1], int(seat[2])

"""Waiting for a chip's next sample: for its data-ready edge where a line shows it, else from poll to poll."""

from collections.abc import Callable, Sequence

from drivers.protocols import DataReadyLine, DeviceError

POLL_PERIODS = 0.47
"""From poll to poll, in sample periods: off any simple ratio, so that polls fall at all phases of the chip's period.
The sample clock lives on that where it has no edges."""

_OVERDUE_PERIODS = 1.5
_LINE_RETRY_NS = 1_000_000_000


class SampleWait:
    """Waits on the line that `open_line` opens, or without one on an absolute grid of polls.

    A line that fails is closed and tried again once a second.
    """

    def __init__(
        self,
        open_line: Callable[[], DataReadyLine] | None,
        period_s: float,
        clock: Callable[[], int],
        sleep: Callable[[float], None],
    ) -> None:
        self._open_line = open_line
        self._line: DataReadyLine | None = None
        self._line_due_ns = 0
        self._clock = clock
        self._sleep = sleep
        self._poll_ns = round(POLL_PERIODS * period_s * 1e9)
        self._overdue_ns = round(_OVERDUE_PERIODS * period_s * 1e9)
        self._grid_ns = clock()
        self._looked_ns = self._grid_ns

    def open(self) -> None:
        """Open the line, if there is to be one. Raises DeviceError if it cannot be had."""
        self.close()
        if self._open_line is not None:
            self._line = self._open_line()

    def close(self) -> None:
        """Release the line."""
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def waiting(self) -> Sequence[int]:
        """Return the instants of the edges that have come by now."""
        return self._edges_within(0.0)

    def until(self, end_ns: int, *, edges_expected: bool) -> Sequence[int]:
        """Wait for an edge, for the time to look without one, or for `end_ns`; return the instants of the edges.

        Where edges are expected, because those before were seen, that time is when one is overdue; else it is the next
        poll.
        """
        self._reopen_line()
        due_ns = (
            self._looked_ns + self._overdue_ns if edges_expected and self._line is not None else self._poll_due_ns()
        )
        edges = self._edges_within(max(0, min(due_ns, end_ns) - self._clock()) * 1e-9)
        self._looked_ns = self._clock()
        return edges

    def _poll_due_ns(self) -> int:
        beat = (self._looked_ns - self._grid_ns) // self._poll_ns
        return self._grid_ns + (beat + 1) * self._poll_ns

    def _edges_within(self, seconds: float) -> Sequence[int]:
        if self._line is None:
            if seconds > 0.0:
                self._sleep(seconds)
            return ()
        try:
            return self._line.wait(seconds)
        except (DeviceError, OSError):
            self._lose_line()
            return ()

    def _lose_line(self) -> None:
        self._line_due_ns = self._clock() + _LINE_RETRY_NS
        self.close()

    def _reopen_line(self) -> None:
        if self._open_line is None or self._line is not None or self._clock() < self._line_due_ns:
            return
        try:
            self._line = self._open_line()
        except (DeviceError, OSError):
            self._lose_line()

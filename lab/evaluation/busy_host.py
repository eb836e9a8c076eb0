"""Whether the host had the processor time that a measurement in real time needs; where not, its figures are void."""

import math
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec

MOST_WAITING = 0.6
"""For this share of the time at most some program may wait for a processor; rig and service are a part of it."""
MOST_LATE = 0.02
"""Of the frames, this share at most may be rendered too late."""
MOST_HELD_UP = 0.05
"""Of the messages, this share at most may come while who judges them is held up."""

_PRESSURE = Path("/proc/pressure/cpu")


class Burden(msgspec.Struct, frozen=True, kw_only=True):
    """What a stretch of real time showed of the host.

    `waiting` is the share of the time in which some program waited for a processor, None where the kernel is silent.
    Of the `frames` due, `frames_late` were not rendered in time; of the messages `heard`, `held_up` came while the
    listener itself was late.
    """

    waiting: float | None
    frames: int = 0
    frames_late: int = 0
    heard: int = 0
    held_up: int = 0

    @property
    def too_much(self) -> str:
        """Return what makes figures void, in one line, or nothing."""
        return ", ".join(self._complaints())

    def _complaints(self) -> Iterator[str]:
        if self.waiting is not None and self.waiting > MOST_WAITING:
            yield f"programs waited for a processor {100 * self.waiting:.0f} % of the time"
        if self.frames_late > MOST_LATE * self.frames:
            yield f"{self.frames_late} of {self.frames} frames were rendered too late"
        if self.held_up > MOST_HELD_UP * self.heard:
            yield f"{self.held_up} of {self.heard} messages came while the listener was held up"


class ProcessorPressure:
    """Tells for which share of the time since it was made programs have waited for a processor."""

    def __init__(self) -> None:
        self._from_s, self._waited_s = time.monotonic(), waited_s()

    def share(self) -> float | None:
        """Return the share, 0 to 1, or None where the kernel does not tell."""
        passed_s, more_s = time.monotonic() - self._from_s, waited_s() - self._waited_s
        return None if math.isnan(more_s) or passed_s <= 0.0 else more_s / passed_s


def waited_s() -> float:
    """Return for how long since the start some program has waited for a processor; NaN where the kernel does not tell.

    Source: the kernel's pressure stall information, `total` of the line `some`, in µs.
    """
    try:
        words = _PRESSURE.read_text(encoding="ascii").split()
    except OSError:  # no such file, or pressure accounting is switched off
        return math.nan
    return 1e-6 * int(words[words.index("some") + 4].removeprefix("total="))

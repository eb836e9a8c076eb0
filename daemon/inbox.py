"""The one queue between the device threads and the pipeline: every input in the order of its arrival.

Bounded. Of frames at most one waits: a newer one takes its turn and the older becomes a `DroppedFrame`
(superseded). Of everything else the oldest goes when the inbox is full, counted in `dropped`; but never a decision
that holds until the next one, for there are few of them.
"""

import threading
from collections import deque

from messages import DropCause, DroppedFrame, Frame, ImuSample, Input, LastingInput, Tick


class Inbox:
    """Many producers, one consumer. No call blocks longer than it takes to move one message."""

    def __init__(self, capacity: int = 512) -> None:
        self._capacity = capacity
        self._waiting: deque[Input] = deque()
        self._arrived = threading.Condition()
        self.dropped = 0
        self.frames_superseded = 0

    def put(self, message: Input) -> None:
        """Append `message`; make room by the drop rule if needed."""
        with self._arrived:
            if isinstance(message, Frame):
                self._supersede_waiting_frame()
            if len(self._waiting) >= self._capacity:
                self._make_room()
            self._waiting.append(message)
            self._arrived.notify()

    def get(self, timeout_s: float) -> Input | None:
        """Return the oldest message, or None if none came within `timeout_s`."""
        with self._arrived:
            if not self._waiting:
                self._arrived.wait(timeout_s)
            return self._waiting.popleft() if self._waiting else None

    def get_sample_or_tick(self) -> ImuSample | Tick | None:
        """Return the oldest message if it is one of these, without waiting; else leave it and return None."""
        with self._arrived:
            oldest = self._waiting[0] if self._waiting else None
            if not isinstance(oldest, ImuSample | Tick):
                return None
            self._waiting.popleft()
            return oldest

    def _make_room(self) -> None:
        for place, waiting in enumerate(self._waiting):
            if not isinstance(waiting, LastingInput):
                del self._waiting[place]
                break
        else:
            self._waiting.popleft()
        self.dropped += 1

    def _supersede_waiting_frame(self) -> None:
        for place, waiting in enumerate(self._waiting):
            if isinstance(waiting, Frame):
                self._waiting[place] = DroppedFrame(header=waiting.header, cause=DropCause.SUPERSEDED)
                self.frames_superseded += 1
                return

"""Records everything that goes into the pipeline and comes out of it, or keeps its newest seconds at hand.

`offer` is for the pipeline's thread and never waits; `drain` is called again and again by a thread of the service and
does all the work: encoding, copying the pixels, writing. Memory is bounded:

- waiting for `drain`: at most `queue_frames` frames, whose pixel buffers stay in use meanwhile (a pool needs as many
  more), and `queue_messages` messages (about 8 s without frames);
- in the ring: `last_s` seconds of packed copies, which hold no pixel buffers; about 19 MB a second at 1280×720 and
  20 fps (`daemon.recording_ring`). Beyond `ring_bytes` the oldest messages leave early.

With `outputs_only` no input is kept, above all no picture: only estimates, and a rig's truth. Recording stops where
less than `reserve_bytes` are left on the disk: the unit's state and the system's log are kept there too.

When the queue is full the newcomer goes: a frame is recorded as a `DroppedFrame` (not_recorded) in its place, anything
else is lost. Both are counted.
"""

import threading
from collections import Counter, deque
from pathlib import Path

from daemon.recording_file import RESERVE_BYTES, Recordable, RecordingError, RecordingFile, RecordingInfo, entries_of
from daemon.recording_ring import RecordingRing
from messages import (
    TOPIC_OF,
    AnkleState,
    DeviceCounters,
    DropCause,
    DroppedFrame,
    Estimate,
    Frame,
    GroundTruth,
    ImuSample,
    LoadLevel,
    Reconfigured,
    RecordingState,
    Tick,
)

__all__ = ["Recorder", "RecordingError", "RecordingInfo"]


class Recorder:
    """Writes to `path` as messages come; with `last_s` keeps the newest `last_s` seconds and writes them at `close`.

    Raises RecordingError, in either case at once, if the file cannot be created or `last_s` is not above 0. Without
    `close` a file written as messages come lacks its index and its end but can be read; of a ring nothing is left.
    """

    def __init__(
        self,
        path: Path,
        info: RecordingInfo,
        *,
        last_s: float | None = None,
        outputs_only: bool = False,
        reserve_bytes: int = RESERVE_BYTES,
        queue_frames: int = 8,
        queue_messages: int = 4096,
        ring_bytes: int = 640 << 20,
    ) -> None:
        if last_s is not None and not last_s > 0.0:
            raise RecordingError(f"the newest {last_s:g} s cannot be kept, allowed above 0 s")
        self._file = RecordingFile(path, info, outputs_only=outputs_only, reserve_bytes=reserve_bytes)
        self._ring = None if last_s is None else RecordingRing(last_s, ring_bytes)
        self._outputs_only = outputs_only
        self._queue_frames = queue_frames
        self._queue_messages = queue_messages
        self._arrived = threading.Condition()
        self._waiting: deque[tuple[Recordable, int]] = deque()
        self._frames_held = 0
        self._now_ns = 0
        self._closed = False
        self.dropped = 0
        """How many messages were not recorded since the start, for want of room in the queue or on the disk."""
        self.dropped_by_kind: Counter[str] = Counter()
        """The same by topic."""

    @property
    def failed(self) -> str | None:
        """Return one line telling why recording stopped, or None while all is well."""
        return self._file.failed

    @property
    def state(self) -> RecordingState:
        """Return whether it records, or which kind of reason stopped it."""
        return self._file.state

    @property
    def idle(self) -> bool:
        """Return whether nothing waits for `drain`."""
        return not self._waiting

    @property
    def ring_s(self) -> float:
        """Return how many seconds the ring holds; 0 without a ring."""
        return 0.0 if self._ring is None else self._ring.span_s

    def offer(self, message: Recordable) -> None:
        """Queue `message`, or drop it by the rule. Waits for no disk and copies nothing."""
        with self._arrived:
            self._now_ns = max(self._now_ns, _arrival_ns(message))
            if self._outputs_only and not isinstance(message, Estimate | GroundTruth):
                return
            kept = message
            if isinstance(message, Frame) and self._frames_held >= self._queue_frames:
                kept = DroppedFrame(header=message.header, cause=DropCause.NOT_RECORDED)
            no_room = len(self._waiting) >= self._queue_messages or self._closed
            if no_room or kept is not message:
                self._drop(type(message))
            if no_room:
                return
            self._frames_held += isinstance(kept, Frame)
            self._waiting.append((kept, self._now_ns))
            self._arrived.notify()

    def drain(self, timeout_s: float) -> None:
        """Record what waits, or wait up to `timeout_s` for something to come. For one thread at a time."""
        with self._arrived:
            if not self._waiting:
                self._arrived.wait(timeout_s)
            count = len(self._waiting)
        for _ in range(count):
            message, log_time_ns = self._waiting.popleft()
            kind, recorded = type(message), self._record(message, log_time_ns)
            del message  # a frame's buffers are free before another frame may take its place
            with self._arrived:
                self._frames_held -= issubclass(kind, Frame)
                if not recorded:
                    self._drop(kind)

    def close(self) -> None:
        """Record what waits, write the ring if there is one, and finish the file; once `drain` is called no more."""
        with self._arrived:
            if self._closed:
                return
            self._closed = True
        self.drain(timeout_s=0.0)
        if self._ring is not None:
            for kind, entries in self._ring.emptied():
                if self._file.failed is not None or not self._file.write(entries):
                    self._drop(kind)
        self._file.close()

    def _drop(self, kind: type[Recordable]) -> None:
        self.dropped += 1
        self.dropped_by_kind[TOPIC_OF[kind].name] += 1

    def _record(self, message: Recordable, log_time_ns: int) -> bool:
        """Write or keep `message`; return False if it could not be written."""
        if self._file.failed is not None:
            return False
        entries = entries_of(message, log_time_ns)
        if self._ring is None:
            return self._file.write(entries)
        self._ring.append(type(message), entries)
        return True


def _arrival_ns(message: Recordable) -> int:
    """Return when an input came; 0 for outputs and truth, which are shown at the time of the latest input."""
    if isinstance(message, Frame | DroppedFrame):
        return message.header.t_arrival_ns
    if isinstance(message, ImuSample):
        return message.t_arrival_ns
    if isinstance(message, AnkleState):
        return message.t_sample_ns
    if isinstance(message, Tick | LoadLevel | Reconfigured | DeviceCounters):
        return message.t_ns
    return 0

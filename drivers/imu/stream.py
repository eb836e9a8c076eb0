"""From frames to samples: numbers them, dates them, counts what is missing between them. No bus, no waiting."""

from collections.abc import Callable, Sequence
from typing import Protocol

from drivers.imu.frames import FreezeDetector, decode, refuse_without_data
from drivers.imu.sample_clock import SampleClock
from drivers.imu.settings import Configuration
from messages import ImuSample

_EDGES_KEPT = 512


class StreamCounters(Protocol):
    """What the stream counts, of `drivers.protocols.ImuCounters`."""

    lost: int
    frames_refused: int
    edges_missed: int


class SampleStream:
    """The samples of one chip, numbered from 1 since its first start, through restarts and flushes.

    `configuration` may be exchanged before the first sample. `has_edges` is whether each sample should show on a
    data-ready line; then `edges_are_seen` says whether those of the newest samples were.
    """

    def __init__(
        self, configuration: Configuration, counters: StreamCounters, clock: Callable[[], int], *, has_edges: bool
    ) -> None:
        self.configuration = configuration
        self._counters = counters
        self._clock = clock
        self._has_edges = has_edges
        self._sample_clock = SampleClock(configuration.period_s)
        self._freeze_detector = FreezeDetector(configuration.frozen_frames)
        self._taken = 0  # the newest sample taken from the chip, discarded ones included
        self._delivered = 0  # the newest sample returned
        self._edged = 0  # the newest sample whose edge was seen, or given up
        self._edges: list[int] = []  # not yet assigned to a sample
        self.last_sample_ns = 0
        """When there was last a sample, a start or a flush."""
        self.works = False
        """Whether there was a sample since the last start."""
        self.edges_are_seen = False

    @property
    def period_s(self) -> float:
        """Return the chip's true sample period as estimated so far."""
        return self._sample_clock.period_s

    @property
    def is_frozen(self) -> bool:
        """Return whether the newest frames are the same over and over."""
        return self._freeze_detector.is_frozen

    def silent_periods(self, t_ns: int) -> float:
        """Return how many periods there has been no sample."""
        return (t_ns - self.last_sample_ns) / (self.configuration.period_s * 1e9)

    def ambiguous_s(self, t_ns: int) -> float:
        """Return how long after `t_ns` it is sure how many samples beyond the next one are complete."""
        return self._sample_clock.ambiguous_s(self._taken + 1, t_ns)

    def until_mid_period_s(self) -> float:
        """Return the time to the next instant halfway between two samples."""
        return self._sample_clock.until_mid_period_s(self._clock())

    def lacks_edges(self, frames: int) -> bool:
        """Return whether there should be an edge for each of `frames` new frames, and there are fewer so far."""
        return self._has_edges and len(self._edges) < frames

    def add_edges(self, edges: Sequence[int]) -> None:
        """Take the instants of data-ready edges, ns, oldest first."""
        self._edges += edges
        del self._edges[:-_EDGES_KEPT]

    def discarded_at(self, t_ns: int) -> None:
        """Note that whatever was complete at `t_ns` was discarded unseen."""
        self._taken = self._edged = self._sample_clock.completed_at(t_ns)
        self._sample_clock.skip_to(self._taken)
        self._edges.clear()
        self.edges_are_seen = False
        self.last_sample_ns = t_ns

    def restarted_at(self, t_ns: int) -> None:
        """Note that the chip was started anew and gave nothing up to `t_ns`; tell first what was discarded."""
        self._sample_clock.restart(self._taken, t_ns)
        self._freeze_detector.reset()
        self.last_sample_ns = t_ns
        self.works = False

    def none_new_at(self, t_ns: int) -> None:
        """Note that no new sample was complete at `t_ns`."""
        self._sample_clock.pending_at(self._taken + 1, t_ns)
        self.edges_are_seen = False

    def add_frames(self, frames: Sequence[bytes], t_before_ns: int, t_after_ns: int) -> list[ImuSample]:
        """Return the samples that `frames` hold, which were all that was new at an instant between the two times.

        Frames that have not changed since the chip's restart, and all if `is_frozen`, are left out.
        Raises OSError (EIO), taking none, if a frame is none of a chip at work.
        """
        try:
            refuse_without_data(frames)
        except OSError:
            self._counters.frames_refused += len(frames)
            raise
        changing = self._freeze_detector.changing(frames)
        if self._freeze_detector.is_frozen:
            return []
        newest = self._taken + len(frames)
        newest += self._sample_clock.missed(newest, t_before_ns)
        self._assign_edges(len(frames), newest)
        self._sample_clock.pending_at(newest + 1, t_before_ns)
        self._sample_clock.completed_by(newest, t_after_ns)
        self._taken = newest
        self.last_sample_ns = t_after_ns
        self.works = self.works or any(changing)
        t_arrival_ns = self._clock()
        first = newest - len(frames) + 1
        return [
            self._sample(frame, index, t_arrival_ns)
            for index, (frame, changes) in enumerate(zip(frames, changing, strict=True), first)
            if changes
        ]

    def _assign_edges(self, new_frames: int, newest: int) -> None:
        """Tell the sample clock whose the waiting edges are: by their time, or in turn if there is one per frame."""
        one_each = len(self._edges) == new_frames
        early: list[int] = []
        for back, t_ns in zip(range(len(self._edges))[::-1], self._edges, strict=True):
            index = self._sample_clock.edge_index(t_ns)
            if index is None and one_each:
                index = newest - back
            if index is not None and index > newest:
                early.append(t_ns)
            elif index is not None and index > self._edged:
                self._counters.edges_missed += index - self._edged - 1
                self._edged = index
                self._sample_clock.edge_at(index, t_ns)
        self._edges = early
        if self._has_edges:
            overdue = max(0, newest - 1 - self._edged)  # the newest one's may still be on its way
            self.edges_are_seen = overdue == 0
            self._counters.edges_missed += overdue
            self._edged += overdue

    def _sample(self, frame: bytes, index: int, t_arrival_ns: int) -> ImuSample:
        lost = index - self._delivered - 1
        self._delivered = index
        self._counters.lost += lost
        return decode(
            frame,
            self.configuration,
            seq=index,
            t_ready_ns=self._sample_clock.stamp(index),
            t_arrival_ns=t_arrival_ns,
            lost_before=lost,
        )

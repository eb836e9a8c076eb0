"""What an estimate meets on its way out, in the pipeline's thread: is it too old, its stamp, publishers, recorder."""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Protocol

from daemon.latency import FrameTimes, LatencyLog
from daemon.recorder import Recorder
from daemon.stamping import Stamper
from daemon.watch import SETPOINT_IN_WORDS, ReasonWatch
from messages import (
    Estimate,
    FrameHeader,
    GroundPlane,
    Health,
    PropagatedGround,
    Reason,
    Setpoint,
    Stamp,
    Status,
    capture_ns,
)
from perception.ground.propagation import OLDEST_PICTURE_NS

STALE_NS = 140_000_000
"""From exposure, or sample, to here. What took longer is published as late, not valid: the wearer has moved on.

A consumer that takes nothing older than 150 ms still has 10 ms for the way to it."""

_MOST_HEADERS = 4


class Publisher(Protocol):
    """Sends estimates away without ever blocking or raising into the pipeline's thread."""

    @property
    def name(self) -> str:
        """Return what is published on."""

    @property
    def errors(self) -> int:
        """Return how many estimates or frames did not get away."""

    def publish(self, estimate: Estimate, stamp: Stamp) -> None:
        """Send one estimate."""

    def close(self) -> None:
        """Stop sending."""


Observer = Callable[[Estimate, FrameHeader | None], None]
"""Told of every estimate in the pipeline's thread, with the header of its frame if it is a ground estimate."""


class Outgoing:
    """Hands every estimate to all who are to have it. The clock is the caller's.

    The recorder gets what the pipeline gave, so that a replay gives the same; all others get what was published.
    """

    def __init__(
        self,
        publishers: Sequence[Publisher],
        stamper: Stamper,
        recorder: Recorder | None,
        observers: Sequence[Observer],
    ) -> None:
        self._publishers = tuple(publishers)
        self._stamper = stamper
        self._recorder = recorder
        self._observers = tuple(observers)
        self._headers: OrderedDict[int, FrameHeader] = OrderedDict()
        self._ground_watch = ReasonWatch()
        self._setpoint_watch = ReasonWatch("set-point", SETPOINT_IN_WORDS, "there are set-points again")
        self.withdrawn = 0
        """How many valid estimates were published as late instead."""

    def errors(self, name: str) -> int:
        """Return what did not get away on the publishers of this name since the start."""
        return sum(p.errors for p in self._publishers if p.name == name)

    def expect_ground_of(self, header: FrameHeader) -> None:
        """Keep the header of a frame until its ground estimate is sent."""
        self._headers[header.seq] = header
        while len(self._headers) > _MOST_HEADERS:
            self._headers.popitem(last=False)

    def send(self, estimate: Estimate, taken_ns: int, clock: Callable[[], int], latency: LatencyLog) -> None:
        """Hand out what the pipeline made of the input taken at `taken_ns`."""
        computed_ns = clock()
        published = withdrawn_if_late(estimate, computed_ns)
        self.withdrawn += published is not estimate
        stamp = self._stamper.stamp(published, computed_ns)
        for publisher in self._publishers:
            publisher.publish(published, stamp)
        header = None
        if isinstance(published, GroundPlane):
            header = self._headers.pop(published.frame_seq, None)
            self._ground_watch.add_reason(published.reason)
        elif isinstance(published, Setpoint):
            self._setpoint_watch.add_reason(published.reason)
        if header is not None:
            latency.add(
                FrameTimes(
                    t_exposure_ns=header.t_exposure_ns,
                    t_arrival_ns=header.t_arrival_ns,
                    t_taken_ns=taken_ns,
                    t_computed_ns=computed_ns,
                    t_published_ns=clock(),
                )
            )
        if self._recorder is not None:
            self._recorder.offer(estimate)
        for observe in self._observers:
            observe(published, header)

    def close(self) -> None:
        """Close the publishers in order."""
        for publisher in self._publishers:
            publisher.close()


def withdrawn_if_late(estimate: Estimate, now_ns: int) -> Estimate:
    """Return `estimate`, or what is left of a valid one that is older than `STALE_NS`: no numbers, reason LATE."""
    if isinstance(estimate, Health) or estimate.status is not Status.VALID:
        return estimate
    if isinstance(estimate, PropagatedGround):
        too_old = now_ns - estimate.t_sample_ns + 1e9 * estimate.picture_age_s > OLDEST_PICTURE_NS
    else:
        too_old = now_ns - capture_ns(estimate) > STALE_NS
    if not too_old:
        return estimate
    return estimate.without_numbers(Reason.LATE)

"""Estimates on CAN: the pipeline's thread leaves them here without waiting, another thread brings them to the bus.

Even a send that is said not to wait may wait inside a driver, and opening a lost link does; so the bus has a thread of
its own, as the recorder has, which calls `drain`. Each kind of estimate has one place: a newer one replaces one that
still waits (the drop rule of its topic), so that nothing old is ever sent late.
"""

import threading
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

from daemon.outgoing import withdrawn_if_late
from drivers.can.link import SendResult
from messages import TOPIC_OF, Estimate, GroundPlane, Health, PropagatedGround, Setpoint, Stamp, Terrain
from messages.can_encoder import CanEncoder
from messages.can_frames import CanFrame

CARRIED_SPACING_NS = TOPIC_OF[PropagatedGround].period_ns // 2
"""From one carried ground on the bus to the next, at least."""

REPEAT_NS = TOPIC_OF[Setpoint].period_ns // 3
"""From a set-point on the bus to the same once more: of its frames one is easily lost, and the foot lands once.

Receivers refuse what comes within a quarter of a cycle: neither this, nor a next one that is early."""


class _Waiting(NamedTuple):
    """An estimate that is to be sent, or sent `again`."""

    estimate: Estimate
    stamp: Stamp
    again: bool = False


class FrameSender(Protocol):
    """The part of drivers.can.link.CanLink that sends."""

    def send(self, frame: CanFrame) -> SendResult:
        """Hand one frame to the bus, or drop it and say why."""

    def close(self) -> None:
        """Release the bus."""


class CanPublisher:
    """Sends ground, the ground carried to now, the ankle's set-point, terrain with the next foothold, and health;
    nothing else goes on CAN. On a bus of CAN FD (`fd`) a set-point is one frame.

    `errors` counts what never reached the bus: frames by `failures`, and estimates by `superseded` and by `late`, those
    that waited for longer than the deadline of their topic, or until they were too old (`daemon.outgoing`).

    Samples that waited for a frame are worked on one right after the other, so carried grounds come in bursts. They are
    sent half a cycle apart, the newest each time, because receivers refuse what comes on the heels of another; one that
    a newer one replaces is no error. Each set-point is sent twice, unless a newer one comes first.
    """

    name = "can"

    def __init__(self, link: FrameSender, *, fd: bool = False, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.fd = fd
        self.errors = 0
        self.sent = 0
        self.superseded = 0
        self.late = 0
        self.failures: dict[SendResult, int] = {result: 0 for result in SendResult if result is not SendResult.SENT}
        self._link = link
        self._now_ns = now_ns
        self._encoder = CanEncoder()
        self._waiting: dict[type[Estimate], _Waiting] = {}
        self._not_before_ns: dict[type[Estimate], int] = {}
        self._filled = threading.Condition()

    def publish(self, estimate: Estimate, stamp: Stamp) -> None:
        """Leave `estimate` to be sent; never waits for the bus."""
        if not isinstance(estimate, GroundPlane | PropagatedGround | Setpoint | Terrain | Health):
            return
        with self._filled:
            replaced = self._waiting.get(type(estimate))
            if replaced is not None and not replaced.again:
                self.superseded += 1
                self.errors += not isinstance(estimate, PropagatedGround)
            self._waiting[type(estimate)] = _Waiting(estimate, stamp)
            if isinstance(estimate, Setpoint):
                self._not_before_ns.pop(Setpoint, None)
            self._filled.notify()

    def drain(self, timeout_s: float) -> None:
        """Send what waits, or return after `timeout_s` without anything. Called by the bus's own thread."""
        with self._filled:
            if not self._due():
                self._filled.wait(self._pause_s(timeout_s))
            due = self._due()
            for kind in due:
                del self._waiting[kind]
        for each in due.values():
            if isinstance(each.estimate, PropagatedGround):
                self._not_before_ns[PropagatedGround] = self._now_ns() + CARRIED_SPACING_NS
            if self._is_late(each.estimate, each.stamp):
                self._count_late(each)
            elif self._send(each.estimate, each.stamp) and isinstance(each.estimate, Setpoint) and not each.again:
                self._send_again(each)

    def close(self) -> None:
        """Release the bus; what still waits is not sent."""
        self._link.close()

    def _due(self) -> dict[type[Estimate], _Waiting]:
        now_ns = self._now_ns()
        return {kind: each for kind, each in self._waiting.items() if self._not_before_ns.get(kind, 0) <= now_ns}

    def _pause_s(self, timeout_s: float) -> float:
        """Return for how long to wait for something new: no longer than until what waits is due."""
        due_ns = (self._not_before_ns.get(kind, 0) for kind in self._waiting)
        return min((timeout_s, *(max(0.0, 1e-9 * (each_ns - self._now_ns())) for each_ns in due_ns)))

    def _send(self, estimate: Estimate, stamp: Stamp) -> bool:
        """Send all frames of an estimate; return whether the bus took them."""
        for frame in self._frames(estimate, stamp):
            result = self._link.send(frame)
            if result is not SendResult.SENT:
                self._count_failure(result)
                return False  # half an estimate is of no use, and the bus takes no more
            self.sent += 1
        return True

    def _send_again(self, sent: _Waiting) -> None:
        with self._filled:
            if Setpoint not in self._waiting:
                self._waiting[Setpoint] = sent._replace(again=True)
                self._not_before_ns[Setpoint] = self._now_ns() + REPEAT_NS

    def _is_late(self, estimate: Estimate, stamp: Stamp) -> bool:
        now_ns = self._now_ns()
        waited_s = 1e-9 * (now_ns - stamp.t_publish_ns)
        return waited_s > TOPIC_OF[type(estimate)].deadline_s or withdrawn_if_late(estimate, now_ns) is not estimate

    def _count_late(self, each: _Waiting) -> None:
        if not each.again:
            with self._filled:
                self.late += 1
                self.errors += 1

    def _count_failure(self, result: SendResult) -> None:
        with self._filled:
            self.failures[result] += 1
            self.errors += 1

    def _frames(self, estimate: Estimate, stamp: Stamp) -> tuple[CanFrame, ...]:
        # The stamp's age ends when the estimate was handed out; the frame tells the age at transmission.
        age_s = stamp.age_s + 1e-9 * (self._now_ns() - stamp.t_publish_ns)
        if isinstance(estimate, GroundPlane):
            return self._encoder.ground(estimate, stamp, age_s)
        if isinstance(estimate, PropagatedGround):
            return self._encoder.propagated_ground(estimate, stamp, age_s)
        if isinstance(estimate, Setpoint):
            if self.fd:
                return (self._encoder.setpoint_fd(estimate, stamp, age_s),)
            return self._encoder.setpoint(estimate, stamp, age_s)
        if isinstance(estimate, Terrain):
            return (*self._encoder.foothold(estimate, stamp, age_s), *self._encoder.terrain(estimate, stamp, age_s))
        if isinstance(estimate, Health):
            return (self._encoder.health(estimate, stamp),)
        return ()

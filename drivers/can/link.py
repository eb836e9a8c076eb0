"""The CAN link: sends frames without ever waiting for the bus, receives the ankle's state, mends itself.

A lost link is opened again with a growing pause. A controller that went off the bus is left alone but for one frame a
second, so that nothing old waits in its queue when it comes back.
"""

import enum
import errno
import logging
import threading
import time
from collections.abc import Callable

import can
import msgspec

from drivers.can.bus import Send, close_bus, discard_input, innermost, open_bus
from drivers.can.settings import CanSettings
from drivers.can.state import CanStateWatch
from drivers.protocols import DeviceError
from messages import AnkleState, CanBusHealth, CanState
from messages.can_frames import CanFrame, CanMessage, can_id, decode_ankle, profile
from messages.e2e import E2eCheck, E2eReceiver

log = logging.getLogger("gaiteyes")

FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 1.0
LONGEST_WAIT_IN_QUEUE_S = 1.0


class SendResult(str, enum.Enum):
    """What became of a frame."""

    SENT = "sent"
    QUEUE_FULL = "queue_full"  # the bus takes no more for now: dropped
    LINK_DOWN = "link_down"  # no bus, it is off, or it failed on this frame: dropped


class CanCounters(msgspec.Struct):
    """What the link counts since it was made."""

    ankle_states: int = 0
    ankle_refused: dict[E2eCheck, int] = {}
    bus_errors: int = 0  # error frames of the controller, and input that is no frame
    outages: int = 0


class CanLink:
    """One bus for two threads: one may call `send`, another `receive`. Neither raises once the link is made.

    Raises DeviceError, in one line, if the bus cannot be opened at first; with `retry_opening` that is an outage.
    """

    def __init__(
        self, settings: CanSettings, *, retry_opening: bool = False, now_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.counters = CanCounters()
        self._settings = settings
        self._now_ns = now_ns
        self._check = E2eReceiver(profile(CanMessage.ANKLE_STATE))
        self._watch = CanStateWatch()
        # Each side holds its own lock while it uses the bus; whoever replaces the bus holds both.
        self._sending, self._receiving = threading.Lock(), threading.Lock()
        self._bus: can.BusABC | None = None
        self._send: Send | None = None
        self._failed = False
        self._received_ns = 0
        self._pause_s = FIRST_PAUSE_S
        self._retry_ns = 0
        try:
            self._bus, self._send = open_bus(settings)
        except DeviceError as error:
            if not retry_opening:
                raise
            self._mark_failed(error)

    @property
    def bus_health(self) -> CanBusHealth:
        """Return the controller's state, as far as the backend tells it, and what was lost since the link was made."""
        counters = self.counters
        return CanBusHealth(
            state=self._watch.state,
            outages=counters.outages,
            bus_offs=self._watch.bus_offs,
            bus_errors=counters.bus_errors,
            ankle_refused=sum(counters.ankle_refused.values()),
        )

    def send(self, frame: CanFrame) -> SendResult:
        """Hand one frame to the bus, or drop it. Waits for nothing but an opening of the link under way."""
        with self._sending:
            if not self._ready(self._receiving) or self._send is None or not self._watch.may_send(self._now_ns()):
                return SendResult.LINK_DOWN
            try:
                taken = self._send(frame)
            except (can.CanError, OSError) as error:
                if not _is_outage(error):
                    return SendResult.QUEUE_FULL
                self._mark_failed(error)
                return SendResult.LINK_DOWN
            self._pause_s = FIRST_PAUSE_S
            return SendResult.SENT if taken else SendResult.QUEUE_FULL

    def receive(self, timeout_s: float) -> AnkleState | None:
        """Return the next state of the ankle that passes its protection, or None after `timeout_s`."""
        deadline_ns = self._now_ns() + round(1e9 * timeout_s)
        while True:
            message = self._next(max(0.0, 1e-9 * (deadline_ns - self._now_ns())))
            state = self._ankle_state(message) if message is not None else None
            if state is not None or self._now_ns() >= deadline_ns:
                return state

    def reconfigure(self, settings: CanSettings) -> None:
        """Go over to another bus, opened with the next use of the link."""
        with self._sending, self._receiving:
            self._settings = settings
            self._failed, self._retry_ns, self._pause_s = True, 0, FIRST_PAUSE_S

    def close(self) -> None:
        """Release the bus; the link is of no use afterwards."""
        with self._sending, self._receiving:
            self._release()
            self._failed, self._retry_ns = True, _NEVER_NS

    def _next(self, timeout_s: float) -> can.Message | None:
        with self._receiving:
            if self._ready(self._sending) and self._bus is not None:
                try:
                    message = self._bus.recv(timeout_s)
                except (can.CanError, OSError, ValueError) as error:  # ValueError: an slcan line that is no frame
                    self.counters.bus_errors += 1
                    if _is_outage(error):
                        self._mark_failed(error)
                    else:
                        discard_input(self._bus)
                    return None
                if message is not None:
                    self._pause_s = FIRST_PAUSE_S
                return message
        time.sleep(min(timeout_s, max(0.01, 1e-9 * (self._retry_ns - self._now_ns()))))
        return None

    def _ankle_state(self, message: can.Message) -> AnkleState | None:
        if message.is_error_frame:
            self.counters.bus_errors += 1
            before = self._watch.state
            self._watch.on_error_frame(message, self._now_ns())
            self._log_change(before)
            return None
        self._watch.on_other_frame()
        if message.arbitration_id != can_id(CanMessage.ANKLE_STATE) or message.is_extended_id:
            return None
        # the kernel begins to stamp a while after a socket asks for it: what came before is stamped when it is read
        t_ns = self._received_ns = max(self._received_ns, reception_ns(message.timestamp, time.time(), self._now_ns()))
        data = bytes(message.data)
        check = self._check.check(data, t_ns)
        if check is not E2eCheck.OK:
            refused = self.counters.ankle_refused
            refused[check] = refused.get(check, 0) + 1
            return None
        self.counters.ankle_states += 1
        return decode_ankle(data, t_ns)

    def _log_change(self, before: CanState) -> None:
        now = self._watch.state
        if now is not before and CanState.BUS_OFF in (now, before):
            log.warning("CAN %s: controller is %s", self._settings.name, now.value)

    def _ready(self, other_side: threading.Lock) -> bool:
        """Called with this side's lock held: is there a bus? Replaces a failed one when its pause is over."""
        if not self._failed:
            return True
        if self._now_ns() < self._retry_ns or not other_side.acquire(blocking=False):
            return False
        try:
            self._release()
            self._bus, self._send = open_bus(self._settings)
        except DeviceError as error:
            self._lengthen_pause()
            log.debug("%s", error)
            return False
        finally:
            other_side.release()
        self._failed = False
        self._watch.on_opened()
        log.warning("CAN %s: open again", self._settings.name)
        return True

    def _mark_failed(self, error: Exception) -> None:
        self.counters.outages += 1
        self._failed = True
        self._watch.on_lost()
        self._lengthen_pause()
        log.error("CAN %s lost: %s", self._settings.name, innermost(error))

    def _release(self) -> None:
        """Called with both sides' locks held."""
        bus, self._bus, self._send = self._bus, None, None
        if bus is not None:
            close_bus(bus)

    def _lengthen_pause(self) -> None:
        self._retry_ns = self._now_ns() + round(1e9 * self._pause_s)
        self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)


_NEVER_NS = 2**63


def reception_ns(stamp_s: float, wall_s: float, now_ns: int) -> int:
    """Return on CLOCK_MONOTONIC when a frame came that python-can stamped `stamp_s` on CLOCK_REALTIME.

    Only the wait since then is taken from the wall clock, and only a believable one, lest a step of it does harm.
    """
    waited_s = wall_s - stamp_s
    return now_ns - round(1e9 * waited_s) if 0.0 <= waited_s <= LONGEST_WAIT_IN_QUEUE_S else now_ns


def _is_outage(error: Exception) -> bool:
    """Whether the link is gone, rather than full (sending) or garbled (receiving)."""
    if isinstance(error, can.CanTimeoutError):
        return False
    system = error if isinstance(error, OSError) else error.__cause__  # python-can wraps the system's errors
    return isinstance(system, OSError) and system.errno not in (errno.ENOBUFS, errno.EAGAIN)

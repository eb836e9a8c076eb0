"""The CAN bus through python-can: sends frames without ever waiting for the bus, receives the ankle's state.

Backends: `virtual` (inside one process), `socketcan`, `slcan` (a serial adapter, or `socket://host:port`) and
`udp_multicast` (kept on this host by a hop limit of 0). A lost link is opened again with a growing pause.
"""

import contextlib
import enum
import errno
import logging
import os
import termios
import threading
import time
from collections.abc import Callable
from typing import Annotated

import can
import msgspec
from can.interfaces.slcan import slcanBus

from drivers.protocols import DeviceError
from messages import AnkleState
from messages.can_frames import CanFrame, CanMessage, can_id, decode_ankle, profile
from messages.e2e import E2eCheck, E2eReceiver

log = logging.getLogger("gaiteyes")

FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 5.0
RECEIVE_QUEUE_FRAMES = 64
SERIAL_POLL_S = 0.02
LONGEST_WAIT_IN_QUEUE_S = 1.0


class CanInterface(str, enum.Enum):
    """The backends of python-can that the project is tested with."""

    VIRTUAL = "virtual"
    SOCKETCAN = "socketcan"
    SLCAN = "slcan"
    UDP_MULTICAST = "udp_multicast"


class CanSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Which bus. `bitrate` and `settle_s` are for slcan: other backends take the bit rate the system has set.

    `settle_s`: an adapter that restarts when its port is opened needs about 2 s before it listens.
    """

    interface: CanInterface = CanInterface.VIRTUAL
    channel: str = "gaiteyes"
    bitrate: Annotated[int, msgspec.Meta(ge=10_000, le=1_000_000)] = 500_000
    settle_s: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 2.0


def parse_can(text: str) -> CanSettings:
    """Return the settings that `INTERFACE:CHANNEL` stands for, as in `socketcan:can0`. Raises DeviceError."""
    interface, colon, channel = text.partition(":")
    known = [member.value for member in CanInterface]
    if interface not in known or not colon or not channel:
        raise DeviceError(f"CAN '{text}': expected INTERFACE:CHANNEL with INTERFACE one of {', '.join(known)}")
    return CanSettings(interface=CanInterface(interface), channel=channel)


class SendResult(str, enum.Enum):
    """What became of a frame."""

    SENT = "sent"
    QUEUE_FULL = "queue_full"  # the bus takes no more for now: dropped
    LINK_DOWN = "link_down"  # no bus, or it failed on this frame: dropped


class CanCounters(msgspec.Struct):
    """What the link counts since it was made."""

    ankle_states: int = 0
    ankle_refused: dict[E2eCheck, int] = {}
    bus_errors: int = 0  # error frames of the controller, and input that is no frame
    outages: int = 0


class CanLink:
    """One bus for two threads: one may call `send`, another `receive`. Neither raises once the link is made.

    Raises DeviceError, in one line, if the bus cannot be opened at first.
    """

    def __init__(self, settings: CanSettings, *, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.counters = CanCounters()
        self._settings = settings
        self._now_ns = now_ns
        self._check = E2eReceiver(profile(CanMessage.ANKLE_STATE))
        # Each side holds its own lock while it uses the bus; whoever replaces the bus holds both.
        self._sending, self._receiving = threading.Lock(), threading.Lock()
        self._bus, self._send = _open(settings)
        self._failed = False
        self._pause_s = FIRST_PAUSE_S
        self._retry_ns = 0

    def send(self, frame: CanFrame) -> SendResult:
        """Hand one frame to the bus, or drop it. Waits for nothing but an opening of the link under way."""
        with self._sending:
            if not self._ready(self._receiving):
                return SendResult.LINK_DOWN
            try:
                taken = self._send(frame)
            except (can.CanError, OSError) as error:
                if not _is_outage(error):
                    return SendResult.QUEUE_FULL
                self._lose(error)
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

    def close(self) -> None:
        """Release the bus; the link is of no use afterwards."""
        with self._sending, self._receiving:
            _close(self._bus)
            self._failed, self._retry_ns = True, _NEVER_NS

    def _next(self, timeout_s: float) -> can.Message | None:
        with self._receiving:
            if self._ready(self._sending):
                try:
                    message = self._bus.recv(timeout_s)
                except (can.CanError, OSError, ValueError) as error:  # ValueError: an slcan line that is no frame
                    self.counters.bus_errors += 1
                    if _is_outage(error):
                        self._lose(error)
                    else:
                        _forget_input(self._bus)
                    return None
                if message is not None:
                    self._pause_s = FIRST_PAUSE_S
                return message
        time.sleep(min(timeout_s, max(0.01, 1e-9 * (self._retry_ns - self._now_ns()))))
        return None

    def _ankle_state(self, message: can.Message) -> AnkleState | None:
        if message.is_error_frame:
            self.counters.bus_errors += 1
            return None
        if message.arbitration_id != can_id(CanMessage.ANKLE_STATE) or message.is_extended_id:
            return None
        t_ns = reception_ns(message.timestamp, time.time(), self._now_ns())
        data = bytes(message.data)
        check = self._check.check(data, t_ns)
        if check is not E2eCheck.OK:
            refused = self.counters.ankle_refused
            refused[check] = refused.get(check, 0) + 1
            return None
        self.counters.ankle_states += 1
        return decode_ankle(data, t_ns)

    def _ready(self, other_side: threading.Lock) -> bool:
        """Called with this side's lock held: is there a bus? Replaces a failed one when its pause is over."""
        if not self._failed:
            return True
        if self._now_ns() < self._retry_ns or not other_side.acquire(blocking=False):
            return False
        try:
            _close(self._bus)
            self._bus, self._send = _open(self._settings)
        except DeviceError as error:
            self._lengthen_pause()
            log.debug("%s", error)
            return False
        finally:
            other_side.release()
        self._failed = False
        log.warning("CAN %s: open again", _name(self._settings))
        return True

    def _lose(self, error: Exception) -> None:
        self.counters.outages += 1
        self._failed = True
        self._lengthen_pause()
        log.error("CAN %s lost: %s", _name(self._settings), _detail(error))

    def _lengthen_pause(self) -> None:
        self._retry_ns = self._now_ns() + round(1e9 * self._pause_s)
        self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)


_NEVER_NS = 2**63

_Send = Callable[[CanFrame], bool]
"""Takes a frame without waiting: True if taken, False if there is no room. Raises can.CanError or OSError."""


def reception_ns(stamp_s: float, wall_s: float, now_ns: int) -> int:
    """Return on CLOCK_MONOTONIC when a frame came that python-can stamped `stamp_s` on CLOCK_REALTIME.

    Only the wait since then is taken from the wall clock, and only a believable one, lest a step of it does harm.
    """
    waited_s = wall_s - stamp_s
    return now_ns - round(1e9 * waited_s) if 0.0 <= waited_s <= LONGEST_WAIT_IN_QUEUE_S else now_ns


def _open(settings: CanSettings) -> tuple[can.BusABC, _Send]:
    options: dict[CanInterface, dict[str, int | float | bool]] = {
        CanInterface.VIRTUAL: {"rx_queue_size": RECEIVE_QUEUE_FRAMES},
        CanInterface.SOCKETCAN: {},
        CanInterface.SLCAN: {
            "bitrate": settings.bitrate,
            "sleep_after_open": settings.settle_s,
            "timeout": SERIAL_POLL_S,
        },
        CanInterface.UDP_MULTICAST: {"hop_limit": 0, "fd": False},
    }
    try:
        bus = can.Bus(
            channel=settings.channel,
            interface=settings.interface.value,
            config_context=None,
            ignore_config=True,
            can_filters=[{"can_id": can_id(CanMessage.ANKLE_STATE), "can_mask": 0x7FF, "extended": False}],
            **options[settings.interface],
        )
    except (can.CanError, OSError, ValueError) as error:
        raise DeviceError(f"CAN {_name(settings)}: {_detail(error)}") from error
    if settings.interface is CanInterface.SLCAN:
        return bus, _SerialSender(bus.fileno()).send
    return bus, _BusSender(bus).send


def _forget_input(bus: can.BusABC) -> None:
    """Drop what python-can failed to read: it keeps a line that is no text, and would fail on it for ever."""
    if isinstance(bus, slcanBus):
        with contextlib.suppress(can.CanError):
            bus.flush()


def _close(bus: can.BusABC) -> None:
    # What a lost or stuck bus says on closing helps nobody.
    if isinstance(bus, slcanBus):
        port = bus.serialPortOrig
        # python-can would first wait until the adapter has taken everything, which a stuck one never does.
        with contextlib.suppress(OSError, termios.error):
            port.reset_output_buffer()
        with contextlib.suppress(OSError):
            port.close()
    with contextlib.suppress(can.CanError, OSError):
        bus.shutdown()


class _BusSender:
    """Sends through python-can with a timeout of 0, which these backends honour."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus

    def send(self, frame: CanFrame) -> bool:
        self._bus.send(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False), timeout=0)
        return True


class _SerialSender:
    """Writes slcan lines to the adapter's port itself.

    python-can waits after each line until the adapter has taken it (tcdrain), which never ends while nobody on the
    bus acknowledges, and pyserial spins on a full port when its timeout is 0. The port is open without blocking.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._tail = b""

    def send(self, frame: CanFrame) -> bool:
        self._tail = self._write(self._tail)
        if self._tail:
            return False
        line = f"t{frame.can_id:03X}{len(frame.data)}{frame.data.hex().upper()}\r".encode()
        rest = self._write(line)
        if rest == line:
            return False
        self._tail = rest
        return True

    def _write(self, data: bytes) -> bytes:
        try:
            return data[os.write(self._fd, data) :] if data else data
        except BlockingIOError:
            return data


def _is_outage(error: Exception) -> bool:
    """Whether the link is gone, rather than full (sending) or garbled (receiving)."""
    if isinstance(error, can.CanTimeoutError):
        return False
    system = error if isinstance(error, OSError) else error.__cause__  # python-can wraps the system's errors
    return isinstance(system, OSError) and system.errno not in (errno.ENOBUFS, errno.EAGAIN)


def _name(settings: CanSettings) -> str:
    return f"{settings.interface.value}:{settings.channel}"


def _detail(error: BaseException) -> str:
    """The innermost reason, in one line: python-can wraps the system's own words in vaguer ones."""
    while error.__cause__ is not None:
        error = error.__cause__
    told = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(told.split())

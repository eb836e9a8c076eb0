"""Receives estimates on CAN, on a computer that has python-can: `listen_can`.

An ankle's microcontroller does the same with `messages.can_receiver` as its reference.
"""

import contextlib
import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Any, Generic, Protocol, TypeVar, overload

import can
import msgspec

from drivers.can.bus import check_owner, close_bus, discard_input, innermost
from drivers.can.settings import CanInterface, CanSettings, parse_can
from messages import Refusal, UserError
from messages.can_estimates import CanEstimate, ReceivedGround
from messages.can_receiver import CanReceiver
from messages.can_setpoint import ReceivedSetpoint, SetpointReceiver

OLD_INPUT_S = 0.5
"""What came in while the bus was being opened is old, and its age is not told: it is not listened to for so long."""
REOPEN_PAUSE_S = 0.5
_WAIT_S = 0.1

R = TypeVar("R", bound=CanEstimate)
R_co = TypeVar("R_co", bound=CanEstimate, covariant=True)


class Receiver(Protocol[R_co]):
    """What turns frames into estimates of one kind."""

    @property
    def reason(self) -> str:
        """Return the service's word for why the newest estimate was not valid."""

    @property
    def can_ids(self) -> tuple[int, ...]:
        """Return the identifiers of the frames that are read."""

    def feed(self, frame_id: int, data: bytes, t_ns: int) -> R_co | Refusal:
        """Take one frame received at `t_ns`; return the estimate it completes, or why there is none."""


class CanListener(Generic[R]):
    """The estimates on one bus, to iterate over, each checked as `messages.can_receiver.CanReceiver` says, a set-point
    as `messages.can_setpoint.SetpointReceiver` does.

    Nothing that arrives raises: `refused` counts what was refused, by reason; input that is no frame is MALFORMED. A
    bus that is lost is opened again. An iteration ends when nothing has passed for `timeout_s`; the next one goes on
    listening, until `close`.
    """

    def __init__(self, settings: CanSettings, receivers: Sequence[Receiver[R]], timeout_s: float | None = None) -> None:
        self.refused: Counter[Refusal] = Counter()
        self._settings = settings
        self._receivers = {can_id: receiver for receiver in receivers for can_id in receiver.can_ids}
        self._last = receivers[0]
        self._timeout_s = math.inf if timeout_s is None else timeout_s
        self._bus: can.BusABC | None = self._open()

    @property
    def reason(self) -> str:
        """Return the service's word for why the newest estimate was not valid."""
        return self._last.reason

    def close(self) -> None:
        """Release the bus."""
        bus, self._bus = self._bus, None
        if bus is not None:
            close_bus(bus)

    def __enter__(self) -> "CanListener[R]":
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[R]:
        end_s = time.monotonic() + self._timeout_s
        while time.monotonic() < end_s:
            frame = self._next()
            if frame is None or frame.is_error_frame:
                continue
            receiver = self._receivers.get(frame.arbitration_id)
            if receiver is None:
                continue
            self._last = receiver
            found = receiver.feed(frame.arbitration_id, bytes(frame.data), time.monotonic_ns())
            if not isinstance(found, Refusal):
                yield found
                end_s = time.monotonic() + self._timeout_s
            elif found is not Refusal.FIRST_HALF:
                self.refused[found] += 1

    def _next(self) -> can.Message | None:
        if self._bus is None:
            time.sleep(REOPEN_PAUSE_S)
            with contextlib.suppress(UserError):
                self._bus = self._open()
            return None
        try:
            return self._received(self._bus)
        except (can.CanError, OSError):
            self.close()
            return None

    def _received(self, bus: can.BusABC) -> can.Message | None:
        try:
            return bus.recv(_WAIT_S)
        except ValueError:  # an slcan line that is no frame
            self.refused[Refusal.MALFORMED] += 1
            discard_input(bus)
            return None

    def _open(self) -> can.BusABC:
        interface, channel = self._settings.interface.value, self._settings.channel
        filters: list[can.typechecking.CanFilter] = [
            {"can_id": can_id, "can_mask": 0x7FF, "extended": False} for can_id in self._receivers
        ]
        try:
            bus = can.Bus(channel, interface, ignore_config=True, can_filters=filters, **_options(self._settings))
        except (can.CanError, OSError, ValueError) as error:
            raise UserError(f"CAN {self._settings.name}: {innermost(error)}") from error
        check_owner(bus, self._settings)
        end_s = time.monotonic() + OLD_INPUT_S
        try:
            while time.monotonic() < end_s:
                self._received(bus)
        except (can.CanError, OSError) as error:
            close_bus(bus)
            raise UserError(f"CAN {self._settings.name}: {innermost(error)}") from error
        return bus


@overload
def listen_can(
    bus: str, *, accept_simulated: bool = False, fd: bool = False, timeout_s: float | None = None
) -> CanListener[ReceivedGround]: ...


@overload
def listen_can(
    bus: str, *kinds: type[R], accept_simulated: bool = False, fd: bool = False, timeout_s: float | None = None
) -> CanListener[R]: ...


def listen_can(
    bus: str,
    *kinds: type[CanEstimate],
    accept_simulated: bool = False,
    fd: bool = False,
    timeout_s: float | None = None,
) -> CanListener[Any]:
    """Listen to estimates on the CAN bus `bus`, as in "socketcan:can0": what comes passed every check.

    `kinds` are types such as `ReceivedTerrain`; without one it is `ReceivedGround`. `fd` says that it is a bus of CAN
    FD, where set-points come in other frames. `accept_simulated` takes simulated
    and replayed data too. After `timeout_s` without an estimate that passes, the iteration ends; without a `timeout_s`
    it waits. Counter and checksum (AUTOSAR end-to-end profile 2) reveal errors; whoever may send on the bus can still
    pose as the service.

    Raises UserError, in one line, if the bus cannot be opened, or is one on loopback that another user serves.
    """
    receivers = [_receiver(kind, accept_simulated) for kind in kinds or (ReceivedGround,)]
    return CanListener(msgspec.structs.replace(parse_can(bus), fd=fd), receivers, timeout_s)


def _receiver(kind: type[CanEstimate], accept_simulated: bool) -> Receiver[CanEstimate]:
    if issubclass(kind, ReceivedSetpoint):
        return SetpointReceiver(accept_simulated=accept_simulated)
    return CanReceiver(kind, accept_simulated=accept_simulated)


def _options(settings: CanSettings) -> dict[str, Any]:
    """Return what opens a bus of CAN FD where the settings say that it is one."""
    if not settings.fd:
        return {}
    virtual = settings.interface is CanInterface.VIRTUAL
    return {"protocol": can.CanProtocol.CAN_FD} if virtual else {"fd": True}

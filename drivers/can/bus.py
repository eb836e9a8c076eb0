"""One CAN bus through python-can, opened by its settings, with a way to send that never waits.

Backends: `virtual` (inside one process), `socketcan`, `slcan` (a serial adapter, or `socket://host:port`) and
`udp_multicast` (kept on this host by a hop limit of 0).
"""

import contextlib
import os
import socket
import termios
from collections.abc import Callable, Sequence
from pathlib import Path

import can
from can.interfaces.slcan import slcanBus

from drivers.can.owner import check_server
from drivers.can.settings import CanInterface, CanSettings
from drivers.protocols import DeviceError
from messages import UserError
from messages.can_frames import CanFrame, CanMessage, can_id

RECEIVE_QUEUE_FRAMES = 64
SERIAL_POLL_S = 0.02
IFF_UP = 0x1
_NETWORK = Path("/sys/class/net")


Send = Callable[[CanFrame], bool]
"""Takes a frame without waiting: True if taken, False if there is no room. Raises can.CanError or OSError."""


def open_bus(settings: CanSettings, heard: Sequence[int] | None = None) -> tuple[can.BusABC, Send]:
    """Return the bus, which passes on error frames and the `heard` identifiers, and the way to send on it.

    Without them those of the ankle are heard.

    Raises DeviceError, in one line, if it cannot be opened or its link is down.
    """
    protocol = can.CanProtocol.CAN_FD if settings.fd else can.CanProtocol.CAN_20
    options: dict[CanInterface, dict[str, int | float | bool | can.CanProtocol]] = {
        CanInterface.VIRTUAL: {"rx_queue_size": RECEIVE_QUEUE_FRAMES, "protocol": protocol},
        CanInterface.SOCKETCAN: {"fd": settings.fd},
        CanInterface.SLCAN: {
            "bitrate": settings.bitrate,
            "sleep_after_open": settings.settle_s,
            "timeout": SERIAL_POLL_S,
        },
        CanInterface.UDP_MULTICAST: {"hop_limit": 0, "fd": settings.fd},
    }
    identifiers = (can_id(CanMessage.ANKLE_STATE),) if heard is None else heard
    if settings.interface is CanInterface.SOCKETCAN:
        _check_link_is_up(settings)
    try:
        bus = can.Bus(
            channel=settings.channel,
            interface=settings.interface.value,
            config_context=None,
            ignore_config=True,
            can_filters=[{"can_id": each, "can_mask": 0x7FF, "extended": False} for each in identifiers],
            **options[settings.interface],
        )
    except (can.CanError, OSError, ValueError) as error:
        raise DeviceError(f"CAN {settings.name}: {innermost(error)}") from error
    check_owner(bus, settings)
    if settings.interface is CanInterface.SLCAN:
        return bus, _SerialSender(bus.fileno()).send
    return bus, _BusSender(bus).send


def _check_link_is_up(settings: CanSettings) -> None:
    """A socket on a link that is down opens without a word; only sending would fail."""
    try:
        flags = int((_NETWORK / settings.channel / "flags").read_text(encoding="ascii"), 16)
    except OSError as error:
        raise DeviceError(f"CAN {settings.name}: no such network link") from error
    if not flags & IFF_UP:
        raise DeviceError(f"CAN {settings.name}: the link is down; `ip link set {settings.channel} up` starts it")


def check_owner(bus: can.BusABC, settings: CanSettings) -> None:
    """Raise DeviceError, in one line, and close `bus` if it is one on loopback that another user serves."""
    if settings.interface is not CanInterface.SLCAN or not settings.channel.startswith("socket://"):
        return
    try:
        with socket.socket(fileno=os.dup(bus.fileno())) as connection:
            check_server(connection)
    except (OSError, UserError) as error:  # OSError: hung up on already
        close_bus(bus)
        raise DeviceError(f"CAN {settings.name}: {innermost(error)}") from error


def discard_input(bus: can.BusABC) -> None:
    """Drop what python-can failed to read: it keeps a line that is no text, and would fail on it for ever."""
    if isinstance(bus, slcanBus):
        with contextlib.suppress(can.CanError):
            bus.flush()


def close_bus(bus: can.BusABC) -> None:
    """Release the bus, without waiting for a stuck one."""
    # What a lost or stuck bus says on closing helps nobody.
    if isinstance(bus, slcanBus):
        port = bus.serialPortOrig
        # python-can would first wait until the adapter has taken everything, which a stuck one never does.
        with contextlib.suppress(OSError, termios.error):
            port.reset_output_buffer()
        connection = getattr(port, "_socket", None)  # of socket://
        with contextlib.suppress(OSError):
            port.close()
        if connection is not None:  # pyserial leaves one open that the other end has hung up on
            connection.close()
    with contextlib.suppress(can.CanError, OSError):
        bus.shutdown()


class _BusSender:
    """Sends through python-can with a timeout of 0, which these backends honour."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus

    def send(self, frame: CanFrame) -> bool:
        told = can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False, is_fd=frame.is_fd)
        self._bus.send(told, timeout=0)
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


def innermost(error: BaseException) -> str:
    """Return the innermost reason, in one line: python-can wraps the system's own words in vaguer ones."""
    while error.__cause__ is not None:
        error = error.__cause__
    told = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(told.split())

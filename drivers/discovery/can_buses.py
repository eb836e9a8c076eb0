"""Which CAN buses there are: links of the system, and serial adapters that call themselves CAN.

No serial port is opened: what hangs on it may not like what is said to it.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import msgspec
from serial.tools import list_ports

from drivers.can.bus import IFF_UP
from drivers.can.settings import CanInterface

ARPHRD_CAN = 280
"""Of linux/if_arp.h: what /sys/class/net/LINK/type says of a CAN link."""
_CALLS_ITSELF_CAN = re.compile(r"(?<![a-z])(slcan|can(?![a-z])|canable|cantact|usb2?can)", re.IGNORECASE)
_LASTING = "dev/serial/by-id"

Ports = Callable[[], Iterable[tuple[str, str]]]
"""Returns the serial ports: device, and what the adapter calls itself."""


class FoundCan(msgspec.Struct, frozen=True, kw_only=True):
    """A bus as the configuration names it, what it is, and whether it is up; a serial one is always."""

    interface: CanInterface
    channel: str
    what: str
    is_up: bool = True

    def __str__(self) -> str:
        """Return it as a person reads it."""
        return f"{self.interface.value}:{self.channel} ({self.what})"


def serial_ports() -> Iterator[tuple[str, str]]:
    """Yield the serial ports of this machine and what each calls itself."""
    for port in list_ports.comports():
        yield port.device, " ".join(filter(None, (port.manufacturer, port.product or port.description)))


def find_can(root: Path, ports: Ports) -> Iterator[FoundCan | str]:
    """Yield the CAN links below `root`/sys, then the serial adapters; a remark on each serial port that may be one."""
    for link in sorted((root / "sys" / "class" / "net").glob("*")):
        if _number(link / "type", 10) == ARPHRD_CAN:
            is_up = bool(_number(link / "flags", 16) & IFF_UP)
            what = f"a CAN link, {'up' if is_up else 'down'}"
            yield FoundCan(interface=CanInterface.SOCKETCAN, channel=link.name, what=what, is_up=is_up)
    for device, called in sorted(ports()):
        channel = _lasting(root, device)
        if _CALLS_ITSELF_CAN.search(called):
            yield FoundCan(interface=CanInterface.SLCAN, channel=channel, what=called)
        elif Path(device).name.startswith(("ttyACM", "ttyUSB")):
            yield f"{channel} ({called}) may be an slcan adapter; if it is one: --can slcan:{channel}"


def _number(file: Path, base: int) -> int:
    try:
        return int(file.read_text(encoding="ascii"), base)
    except (OSError, ValueError):
        return 0


def _lasting(root: Path, device: str) -> str:
    links = sorted((root / _LASTING).glob("*"))
    return next((str(link) for link in links if link.resolve() == Path(device).resolve()), device)

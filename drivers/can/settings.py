"""Which CAN bus, apart from the link that is opened by it: reading a configuration needs no CAN library."""

import enum
from typing import Annotated

import msgspec

from drivers.protocols import DeviceError


class CanInterface(str, enum.Enum):
    """The backends of python-can that the project is tested with."""

    VIRTUAL = "virtual"
    SOCKETCAN = "socketcan"
    SLCAN = "slcan"
    UDP_MULTICAST = "udp_multicast"


class CanSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Which bus. `bitrate` and `settle_s` are for slcan: other backends take the bit rate the system has set.

    `settle_s`: an adapter that restarts when its port is opened needs about 2 s before it listens. `fd`: every node of
    the bus takes CAN FD, which set-points then use; slcan has none.
    """

    interface: CanInterface = CanInterface.VIRTUAL
    channel: str = "gaiteyes"
    bitrate: Annotated[int, msgspec.Meta(ge=10_000, le=1_000_000)] = 500_000
    settle_s: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 2.0
    fd: bool = False

    def __post_init__(self) -> None:
        """Refuse what the backend cannot do."""
        if self.fd and self.interface is CanInterface.SLCAN:
            raise ValueError("fd is true, allowed false with interface slcan: it has no CAN FD")

    @property
    def name(self) -> str:
        """Return the bus as `parse_can` reads it."""
        return f"{self.interface.value}:{self.channel}"


def parse_can(text: str) -> CanSettings:
    """Return the settings that `INTERFACE:CHANNEL` stands for, as in `socketcan:can0`. Raises DeviceError."""
    interface, colon, channel = text.partition(":")
    known = [member.value for member in CanInterface]
    if interface not in known or not colon or not channel:
        raise DeviceError(f"CAN '{text}': expected INTERFACE:CHANNEL with INTERFACE one of {', '.join(known)}")
    return CanSettings(interface=CanInterface(interface), channel=channel)

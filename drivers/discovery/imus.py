"""Which MPU-6050 or relative answers on which I2C bus.

Only WHO_AM_I is read, of the two addresses that these chips can have; nothing is written but that register's number.
"""

import errno
import re
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import msgspec

from drivers.imu.chips import CHIPS, REFUSED
from drivers.imu.register_access import RegisterBus
from drivers.imu.registers import Register

ADDRESSES = (0x68, 0x69)
_NOBODY = (errno.ENXIO, errno.EREMOTEIO, errno.EIO)
_NO_PLACE = (
    *("SMBus I801", "SMBus PIIX4", "SMBus CMI", "SMBus nForce"),
    *("i915", "AMDGPU", "NVIDIA", "nvkm", "Radeon", "AUX", "DPDDC", "DPMST", "DP-", "HDMI"),
)
"""Beginnings of the names of a PC's own buses, to its memory and its displays: nothing is asked there."""
_NODE = re.compile(r"i2c-(\d+)")


class FoundImu(msgspec.Struct, frozen=True, kw_only=True):
    """A chip at `address` of /dev/i2c-`bus`; `is_known` if the driver supports it, else `chip` says what answered."""

    bus: int
    address: int
    chip: str
    is_known: bool

    def __str__(self) -> str:
        """Return it as a person reads it."""
        return f"{self.chip} at {self.address:#x} of /dev/i2c-{self.bus}"


def find_imus(root: Path, open_bus: Callable[[int], RegisterBus]) -> Iterator[FoundImu | str]:
    """Yield every chip below `root`/dev, and a remark on each bus that could not be looked at."""
    nodes = ((_NODE.fullmatch(node.name), node) for node in (root / "dev").glob("i2c-*"))
    for number in sorted(int(match[1]) for match, _ in nodes if match is not None):
        if _adapter(root, number).startswith(_NO_PLACE):
            continue
        try:
            with closing(open_bus(number)) as bus:
                for address in ADDRESSES:
                    yield from _answer(bus, number, address)
        except OSError as error:
            denied = error.errno in (errno.EACCES, errno.EPERM)
            cure = "; the user must be in the group that owns it, usually 'i2c'" if denied else ""
            yield f"/dev/i2c-{number}: {error.strerror}{cure}"


def _adapter(root: Path, number: int) -> str:
    try:
        name = root / "sys" / "bus" / "i2c" / "devices" / f"i2c-{number}" / "name"
        return name.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _answer(bus: RegisterBus, number: int, address: int) -> Iterator[FoundImu | str]:
    try:
        who_am_i = bus.read_byte_data(address, Register.WHO_AM_I)
    except OSError as error:
        if error.errno == errno.EBUSY:
            yield f"/dev/i2c-{number}: a driver of the kernel holds address {address:#x}"
        elif error.errno not in _NOBODY:
            yield f"/dev/i2c-{number}, address {address:#x}: {error.strerror}"
        return
    if who_am_i in CHIPS:
        yield FoundImu(bus=number, address=address, chip=CHIPS[who_am_i].name, is_known=True)
    else:
        why = REFUSED.get(who_am_i, "no chip that the driver knows")
        yield FoundImu(bus=number, address=address, chip=f"WHO_AM_I {who_am_i:#04x}, {why},", is_known=False)

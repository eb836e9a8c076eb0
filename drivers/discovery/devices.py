"""What is plugged into this machine of what a unit is made of."""

from collections.abc import Callable
from pathlib import Path

import msgspec

from drivers.camera.v4l2_device import Kernel, LinuxKernel
from drivers.discovery.cameras import CameraKind, FoundCamera, find_cameras
from drivers.discovery.can_buses import FoundCan, Ports, find_can, serial_ports
from drivers.discovery.imus import FoundImu, find_imus
from drivers.imu.register_access import RegisterBus, open_i2c


class FoundDevices(msgspec.Struct, frozen=True, kw_only=True):
    """What was found, and remarks on what could not be looked at. Chips that no driver supports are among the IMUs."""

    imus: list[FoundImu]
    cameras: list[FoundCamera]
    cans: list[FoundCan]
    remarks: list[str]

    @property
    def imu(self) -> FoundImu | None:
        """Return the first IMU that the driver supports."""
        return next((each for each in self.imus if each.is_known), None)

    @property
    def camera(self) -> FoundCamera | None:
        """Return the first camera that is a unit's by itself: two eyes in one picture, or depth."""
        return next((each for each in self.cameras if each.kind is not CameraKind.SINGLE), None)

    def camera_at(self, path: str) -> FoundCamera | None:
        """Return the camera behind a node, whichever of its names `path` is."""
        return next((each for each in self.cameras if Path(each.path).resolve() == Path(path).resolve()), None)

    @property
    def can(self) -> FoundCan | None:
        """Return the first bus, one that is up before one that is down."""
        return min(self.cans, key=lambda each: not each.is_up, default=None)


def find_devices(
    root: Path = Path("/"),
    open_bus: Callable[[int], RegisterBus] = open_i2c,
    kernel: Kernel | None = None,
    ports: Ports = serial_ports,
) -> FoundDevices:
    """Return what is there; nothing is changed, and no device is kept open. `root` has dev/ and sys/."""
    imus = list(find_imus(root, open_bus))
    cameras = list(find_cameras(root, LinuxKernel() if kernel is None else kernel))
    cans = list(find_can(root, ports))
    return FoundDevices(
        imus=[each for each in imus if isinstance(each, FoundImu)],
        cameras=[each for each in cameras if isinstance(each, FoundCamera)],
        cans=[each for each in cans if isinstance(each, FoundCan)],
        remarks=[each for each in (*imus, *cameras, *cans) if isinstance(each, str)],
    )

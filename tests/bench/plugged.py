"""A machine with nothing but what a test plugs in: files below `root`/dev and `root`/sys, and what answers behind."""

import errno
import time
from dataclasses import dataclass, field
from pathlib import Path

from drivers.discovery.devices import FoundDevices, find_devices
from drivers.imu.register_access import RegisterBus
from sim_rig.camera.v4l2_buffers import os_error
from sim_rig.camera.v4l2_machine import V4l2Machine
from sim_rig.camera.v4l2_node import ManualClock, Mode, V4l2Node, stepping_card
from sim_rig.imu.i2c_bus import I2cWires
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from tests.bench.imu_bench import NOISY, still


@dataclass
class Plugged:
    """What is plugged in so far."""

    root: Path
    buses: dict[int, I2cWires | int] = field(default_factory=dict)
    nodes: list[V4l2Node] = field(default_factory=list)
    ports: list[tuple[str, str]] = field(default_factory=list)

    def imu(self, bus: int, address: int = 0x68, who_am_i: int = 0x68, adapter: str = "i2c-gpio") -> None:
        """Put a chip on a bus that calls itself `adapter`."""
        self.bus(
            bus, I2cWires({address: Mpu6050Chip(still, NOISY, time.monotonic_ns, seed=1, who_am_i=who_am_i)}), adapter
        )

    def bus(self, bus: int, wires: I2cWires | int, adapter: str = "i2c-gpio") -> None:
        """Plug in a bus; instead of wires, the errno with which it does not open."""
        self._touch(f"dev/i2c-{bus}")
        self._touch(f"sys/bus/i2c/devices/i2c-{bus}/name", adapter + "\n")
        self.buses[bus] = wires

    def camera(self, card: str = "ZED 2: ZED 2", mode: Mode | None = None, by_id: str = "", **options: object) -> None:
        """Plug in a camera, by default a ZED, with a lasting name if one is given."""
        node = self._touch(f"dev/video{len(self.nodes)}")
        if mode is not None:
            options["modes"] = (mode,)
        if by_id:
            link = self.root / "dev" / "v4l" / "by-id" / by_id
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(node)
        scene = stepping_card(64, 32)
        self.nodes.append(V4l2Node(scene, ManualClock(), path=str(node), card=card, **options))  # type: ignore[arg-type]  # of many types

    def can(self, link: str, *, up: bool, kind: int = 280) -> None:
        """Plug in a link of the system, by default of CAN."""
        self._touch(f"sys/class/net/{link}/type", f"{kind}\n")
        self._touch(f"sys/class/net/{link}/flags", "0xc1\n" if up else "0xc0\n")

    def find(self) -> FoundDevices:
        """Return what is found."""
        return find_devices(self.root, self._open, V4l2Machine(self.nodes), lambda: self.ports)

    def _open(self, number: int) -> RegisterBus:
        wires = self.buses.get(number, errno.ENOENT)
        if isinstance(wires, int):
            raise os_error(wires)
        return wires.open()

    def _touch(self, name: str, text: str = "") -> Path:
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

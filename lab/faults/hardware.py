"""The daemon's simulated hardware, in which a campaign makes faults: one wearer, one camera, one chip, one bus."""

import threading
import time
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lab.faults.faulty_camera import FaultyCamera
from sim_rig.imu.data_ready import SimulatedDataReady
from sim_rig.imu.i2c_bus import I2cWires
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from sim_rig.wearer import SimulatedWearer

IMU_ADDRESS = 0x68
USUAL_LATENESS = (0.01, 0.003)
"""Share of the data-ready interrupts that are served late, and by how much at most, s."""


class FaultyChip:
    """The chip as the wires see it (`sim_rig.imu.i2c_bus.I2cChip`), with actions done to it.

    What `do` is given happens in the bus's own thread, right before the next transfer; what is in `repeated`, before
    every one.
    `answer` takes the place of whatever the chip answers: a data line that is lost reads as ones.
    """

    def __init__(self, chip: Mpu6050Chip) -> None:
        self._chip = chip
        self._due: deque[Callable[[Mpu6050Chip], None]] = deque()
        self.repeated: dict[str, Callable[[Mpu6050Chip], None]] = {}
        self.answer: int | None = None

    @property
    def distortion(self) -> Callable[[NDArray[np.int16]], NDArray[np.int16]] | None:
        """Return what is done to the chip's counts (n, 7), if anything."""
        return self._chip.distortion

    def do(self, action: Callable[[Mpu6050Chip], None]) -> None:
        """Let `action` happen to the chip before the next transfer."""
        self._due.append(action)

    def write(self, data: bytes) -> None:
        """Take one write transfer."""
        while self._due:
            self._due.popleft()(self._chip)
        for action in tuple(self.repeated.values()):
            action(self._chip)
        self._chip.write(data)

    def read(self, length: int) -> bytes:
        """Answer one read transfer."""
        data = self._chip.read(length)
        return data if self.answer is None else bytes([self.answer]) * length


class FaultyHardware:
    """All that a fault in the daemon's process can change."""

    def __init__(self, wearer: SimulatedWearer) -> None:
        chip = Mpu6050Chip(wearer.gait.imu, wearer.unit.chip, time.monotonic_ns, seed=1)
        self.chip = FaultyChip(chip)
        self.wires = I2cWires({IMU_ADDRESS: self.chip}, elapse=time.sleep)
        share, latest_s = USUAL_LATENESS
        self.data_ready = SimulatedDataReady(
            chip, time.monotonic_ns, time.sleep, seed=1, late_share=share, latest_s=latest_s
        )
        self.camera = FaultyCamera(wearer)
        self._busy = threading.Event()
        self._busy_thread: threading.Thread | None = None
        self._true_wall_clock = time.time

    def close(self) -> None:
        """End the rendering process, and the busy thread if it still runs."""
        self.release_interpreter()
        self.camera.close()

    def occupy_interpreter(self) -> None:
        """Keep a thread of pure Python busy, as a careless plug-in would."""
        self._busy.set()
        self._busy_thread = threading.Thread(target=self._spin, name="fault-busy")
        self._busy_thread.start()

    def release_interpreter(self) -> None:
        """Let the busy thread end."""
        self._busy.clear()
        if self._busy_thread is not None:
            self._busy_thread.join()
            self._busy_thread = None

    def shift_wall_clock(self, by_s: float) -> None:
        """Set CLOCK_REALTIME as this process sees it; no namespace of Linux offers that, so `time.time` is replaced."""
        true = self._true_wall_clock
        time.time = (lambda: true() + by_s) if by_s else true

    def _spin(self) -> None:
        count = 0
        while self._busy.is_set():
            count += 1

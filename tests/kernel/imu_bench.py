"""The real MPU-6050 driver on a real adapter, with the rig's chip behind it, in real time."""

import contextlib
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from smbus2 import SMBus

from drivers.imu.data_ready import GpiodDataReady
from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.settings import Mpu6050Settings
from messages import ImuSample
from sim_rig.imu.chip_unit import ChipUnit
from sim_rig.imu.i2c_bus import I2cWires
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from sim_rig.imu.mpu6050_signal import Motion
from sim_rig.kernel.chip_server import DEVICE, INTERRUPT_LINE, ChipServer, gpio_chip_path, i2c_bus_number
from tests.bench.imu_bench import ADDRESS, NOISY, still
from tests.kernel.modules import load_module

READ_S = 0.1
SERVE_S = 0.05


class KernelChip:
    """The chip on the kernel's bus, served by a thread of its own from `plug_in` to `unplug`."""

    def __init__(self, motion: Motion = still, unit: ChipUnit = NOISY) -> None:
        if not Path(DEVICE).exists():
            load_module("gaiteyes_rig")
            load_module("i2c-dev")
        self.chip = Mpu6050Chip(motion, unit, time.monotonic_ns, seed=1)
        self.wires = I2cWires({ADDRESS: self.chip})
        self.bus_number = i2c_bus_number()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self.plug_in()

    def plug_in(self) -> None:
        """Put the chip on the bus."""
        self.server = ChipServer(self.wires, self.chip, time.monotonic_ns)
        self._ended.clear()
        self._thread = threading.Thread(target=self._serve, name="chip", daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Take it off: nobody acknowledges any more."""
        if self._thread is not None:
            self._ended.set()
            self._thread.join()
            self._thread = None
            self.server.close()

    def _serve(self) -> None:
        while not self._ended.is_set():
            self.server.serve(SERVE_S)


class KernelImuBench:
    """An open driver, with or without the data-ready line, and the chip, as the contract's ImuRig."""

    def __init__(self, kernel_chip: KernelChip, *, with_line: bool) -> None:
        self.kernel_chip = kernel_chip
        self.imu = Mpu6050(
            partial(SMBus, kernel_chip.bus_number),
            address=ADDRESS,
            settings=Mpu6050Settings(),
            open_data_ready=partial(GpiodDataReady, gpio_chip_path(), INTERRUPT_LINE) if with_line else None,
        )
        self.imu.open()

    def run(self, duration_s: float) -> list[ImuSample]:
        """Read as the daemon does, for a while."""
        samples: list[ImuSample] = []
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s:
            samples += self.imu.read(READ_S)
        return samples

    def pause(self, duration_s: float) -> None:
        """Do not poll for a while."""
        time.sleep(duration_s)

    def unplug(self) -> None:
        """Hold the bus low."""
        self.kernel_chip.wires.stick()

    def plug_in(self) -> None:
        """Let it go."""
        self.kernel_chip.wires.release()


@contextlib.contextmanager
def kernel_imu(motion: Motion = still, *, with_line: bool = False) -> Iterator[KernelImuBench]:
    """An open IMU on the kernel's bus."""
    kernel_chip = KernelChip(motion)
    try:
        bench = KernelImuBench(kernel_chip, with_line=with_line)
        yield bench
        bench.imu.close()
    finally:
        kernel_chip.unplug()

"""The MPU-6050 driver on the kernel's I2C: long bursts, what a bus does wrong, and chips that are not themselves."""

import errno
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from smbus2 import SMBus, i2c_msg

from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.registers import FIFO_BYTES, Register, UserControl
from drivers.imu.settings import Mpu6050Settings
from drivers.protocols import DeviceError
from messages import UserError
from sim_rig.kernel.chip_server import ChipServer
from tests.bench.imu_bench import ADDRESS
from tests.kernel.i2c_adapter import set_adapter_timeout
from tests.kernel.imu_bench import KernelImuBench, kernel_imu
from tests.kernel.modules import load_module, unload_module


@pytest.fixture
def bench() -> Iterator[KernelImuBench]:
    with kernel_imu() as opened:
        yield opened


def test_half_a_second_of_samples_comes_in_one_burst(bench: KernelImuBench) -> None:
    bench.run(0.5)
    lost = bench.imu.counters.lost
    bench.pause(0.5)
    samples = bench.imu.read(timeout_s=0.0)
    assert len(samples) >= 45
    assert bench.imu.counters.lost == lost
    assert [sample.seq for sample in samples] == list(range(samples[0].seq, samples[0].seq + len(samples)))


def test_a_burst_of_a_whole_fifo_arrives_byte_for_byte(bench: KernelImuBench) -> None:
    bench.pause(1.0)
    with SMBus(bench.kernel_chip.bus_number) as bus:
        bus.write_byte_data(ADDRESS, Register.FIFO_EN, 0)
        data = i2c_msg.read(ADDRESS, FIFO_BYTES)
        bus.i2c_rdwr(i2c_msg.write(ADDRESS, [Register.FIFO_R_W]), data)
        bus.write_byte_data(ADDRESS, Register.USER_CTRL, UserControl.FIFO_EN)
    frames = np.frombuffer(bytes(data)[-14 * (FIFO_BYTES // 14) :], dtype=">i2")
    assert len(np.unique(frames)) > 20


@pytest.mark.parametrize("fault", [errno.EREMOTEIO, errno.ENXIO, errno.EIO, errno.EAGAIN], ids=errno.errorcode.get)
def test_a_disturbed_transfer_is_repeated_and_counted(bench: KernelImuBench, fault: int) -> None:
    bench.run(0.3)
    with bench.kernel_chip.server.lock:
        bench.kernel_chip.wires.fail(fault, times=2)
    samples = bench.run(0.5)
    assert len(samples) >= 30
    assert bench.imu.counters.bus_errors == 2
    assert bench.imu.counters.resets == 0


def test_a_burst_that_breaks_off_is_found_out(bench: KernelImuBench) -> None:
    bench.run(0.3)
    bench.pause(0.3)
    bench.kernel_chip.wires.fail(errno.EREMOTEIO)  # the count, repeated
    with bench.kernel_chip.server.lock:
        bench.kernel_chip.wires.fail(errno.EAGAIN, bytes_lost=101)
    samples = bench.run(1.0)
    assert bench.imu.counters.bus_errors >= 1
    for sample in samples:
        assert np.linalg.norm(sample.sf_B_mps2) == pytest.approx(9.8, rel=0.1)


def test_a_bus_held_low_is_an_error_until_it_is_let_go(bench: KernelImuBench) -> None:
    bench.run(0.3)
    bench.kernel_chip.wires.stick()
    with pytest.raises(DeviceError, match="timed out"):
        bench.run(1.0)
    bench.kernel_chip.wires.release()
    assert len(bench.run(1.5)) > 50


def test_a_transfer_that_nobody_ends_is_timed_out_by_the_kernel(bench: KernelImuBench) -> None:
    bench.run(0.3)
    set_adapter_timeout(bench.kernel_chip.bus_number, 0.05)
    bench.kernel_chip.server.mute = True
    with pytest.raises(DeviceError, match="timed out"):
        bench.run(1.0)
    bench.kernel_chip.server.mute = False
    set_adapter_timeout(bench.kernel_chip.bus_number, 1.0)
    assert len(bench.run(1.5)) > 50


def test_a_chip_unplugged_and_plugged_in_again_goes_on(bench: KernelImuBench) -> None:
    bench.run(0.3)
    bench.kernel_chip.unplug()
    with pytest.raises(DeviceError, match="No such device or address"):
        bench.run(1.0)
    with bench.kernel_chip.server.lock:
        bench.kernel_chip.chip.brown_out()
    bench.kernel_chip.plug_in()
    assert len(bench.run(1.5)) > 50
    assert bench.imu.counters.resets == 1


def test_a_brown_out_is_found_and_mended(bench: KernelImuBench) -> None:
    bench.run(0.3)
    with bench.kernel_chip.server.lock:
        bench.kernel_chip.chip.brown_out()
    samples = bench.run(3.0)
    assert bench.imu.counters.resets == 1
    assert len(samples) > 100
    for sample in samples:
        assert np.linalg.norm(sample.sf_B_mps2) == pytest.approx(9.8, rel=0.1)


def test_a_hung_sensor_is_an_error(bench: KernelImuBench) -> None:
    bench.run(0.3)
    with bench.kernel_chip.server.lock:
        bench.kernel_chip.chip.freeze()
    with pytest.raises(DeviceError, match="never change"):
        bench.run(4.0)


def test_another_chip_is_refused_by_name(bench: KernelImuBench) -> None:
    bench.imu.close()
    bench.kernel_chip.chip.who_am_i = 0x12
    with pytest.raises(DeviceError, match="WHO_AM_I reads 0x12"):
        bench.imu.open()


def test_the_bus_serves_one_rig_at_a_time(bench: KernelImuBench) -> None:
    with pytest.raises(UserError, match="busy"):
        ChipServer(bench.kernel_chip.wires, bench.kernel_chip.chip, time.monotonic_ns)


def test_a_bus_that_does_not_exist_is_one_clear_line() -> None:
    with pytest.raises(DeviceError, match="No such file") as refused:
        Mpu6050(partial(SMBus, 99), settings=Mpu6050Settings()).open()
    assert "\n" not in str(refused.value)


def test_an_adapter_that_knows_smbus_only_is_read_register_by_register() -> None:
    load_module("i2c-stub", f"chip_addr=0x{ADDRESS:02x}")
    try:
        with SMBus(_bus_named("SMBus stub driver")) as stub:
            stub.write_byte_data(ADDRESS, Register.WHO_AM_I, 0x68)
            imu = Mpu6050(partial(SMBus, _bus_named("SMBus stub driver")), address=ADDRESS, settings=Mpu6050Settings())
            imu.open()
            stub.write_i2c_block_data(ADDRESS, Register.ACCEL_XOUT_H + 4, [0x10, 0x00])
            stub.write_byte_data(ADDRESS, Register.INT_STATUS, 0x01)
            samples = [sample for _ in range(3) for sample in imu.read(timeout_s=0.0)]
            imu.close()
    finally:
        unload_module("i2c-stub")
    assert samples
    assert samples[0].sf_B_mps2[2] > 0.0
    assert samples[0].sf_B_mps2[:2] == (0.0, 0.0)


def _bus_named(name: str) -> int:
    found = [path for path in Path("/sys/bus/i2c/devices").glob("i2c-*") if (path / "name").read_text().strip() == name]
    return int(found[0].name.removeprefix("i2c-"))

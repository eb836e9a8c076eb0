"""The same driver on every chip of the table, each played register by register with its own filters and laws."""

import dataclasses

import numpy as np
import pytest

from drivers.imu.chips import CHIPS, ChipModel
from drivers.imu.registers import Register
from drivers.imu.settings import Mpu6050Settings
from drivers.protocols import DeviceError
from messages.arrays import FloatArray, IntArray
from tests.bench.imu_bench import ADDRESS, NOISY, ImuBench, lost_by_truth, swaying

ALL = pytest.mark.parametrize("model", CHIPS.values(), ids=lambda model: model.name)


def bench_of(model: ChipModel, settings: Mpu6050Settings | None = None) -> ImuBench:
    unit = dataclasses.replace(NOISY, clock_error=0.006)
    return ImuBench(unit=unit, who_am_i=model.who_am_i, settings=settings or Mpu6050Settings())


@ALL
def test_each_is_found_and_read_without_loss(model: ChipModel) -> None:
    bench = bench_of(model).opened()
    samples = bench.run(5.0)
    assert bench.imu.chip is model
    assert bench.imu.counters.lost == lost_by_truth(bench, samples) == 0
    assert len(samples) == pytest.approx(503, abs=2)


@ALL
@pytest.mark.parametrize("filter_row", [3, 4])
def test_the_gyroscope_stands_at_the_samples_time_and_the_accelerometer_where_the_table_says(
    model: ChipModel, filter_row: int
) -> None:
    bench = bench_of(model, Mpu6050Settings(filter_row=filter_row)).opened()
    bench.run(4.0)
    samples = bench.run(8.0)
    t_ns = np.array([sample.t_sample_ns for sample in samples])
    row = model.filter_rows[filter_row]
    w = np.array([sample.w_WB_B_radps for sample in samples])
    sf = np.array([sample.sf_B_mps2 for sample in samples])
    assert lag_s(w, t_ns, 1) == pytest.approx(0.0, abs=0.15e-3)
    assert lag_s(sf, t_ns, 0) == pytest.approx(row.accel_delay_s - row.gyro_delay_s, abs=0.15e-3)


def lag_s(measured: FloatArray, t_ns: IntArray, sensor: int) -> float:
    """Return how late the signal is against the motion, by least squares."""

    def true(shift_ns: int) -> FloatArray:
        return swaying(t_ns + shift_ns)[sensor]

    slope = (true(100_000) - true(-100_000)) / 0.2e-3
    return float(np.sum((true(0) - measured) * slope) / np.sum(slope**2))


@ALL
@pytest.mark.parametrize("temperature_degC", [5.0, 24.0, 45.0])
def test_each_has_its_own_thermometer(model: ChipModel, temperature_degC: float) -> None:
    bench = bench_of(model)
    bench.unit = dataclasses.replace(NOISY, temperature_degC=temperature_degC)
    bench.__post_init__()
    samples = bench.opened().run(0.3)
    assert samples[-1].temperature_degC == pytest.approx(temperature_degC, abs=0.002)


@ALL
def test_a_reader_may_be_as_late_as_the_fifo_is_long_and_no_later(model: ChipModel) -> None:
    bench = bench_of(model).opened()
    samples = bench.run(11.0)
    room_s = (model.fifo_bytes / 14 - 5) * 0.00994
    bench.pause(room_s)
    samples += bench.run(2.0)
    assert bench.imu.counters.lost == bench.imu.counters.fifo_overflows == 0
    bench.pause(room_s + 0.1)
    samples += bench.run(2.0)
    assert bench.imu.counters.fifo_overflows == 1
    assert bench.imu.counters.lost == lost_by_truth(bench, samples) > 20


@ALL
def test_the_accelerometers_own_filter_is_set_where_there_is_one(model: ChipModel) -> None:
    bench = bench_of(model).opened()
    value = bench.wires.open().read_byte_data(ADDRESS, Register.ACCEL_CONFIG_2)
    assert value == (model.accel_config_2 | 3 if model.has_accel_filter else 0)
    bench.run(1.0)
    bench.wires.open().write_byte_data(ADDRESS, Register.ACCEL_CONFIG_2, 0x07)
    bench.run(1.5)
    assert bench.imu.counters.resets == model.has_accel_filter


@ALL
def test_a_chip_exchanged_while_running_is_refused_even_if_it_is_supported(model: ChipModel) -> None:
    bench = bench_of(model).opened()
    bench.run(0.5)
    other = CHIPS[0x71 if model.who_am_i == 0x70 else 0x70]
    bench.chip.who_am_i = other.who_am_i
    bench.chip.brown_out()
    with pytest.raises(DeviceError, match=f"now 0x{other.who_am_i:02x} {other.name}, was 0x{model.who_am_i:02x}"):
        bench.run(1.0)

import dataclasses
import errno
import math

import numpy as np
import pytest
from scipy.signal import freqz, group_delay
from smbus2 import i2c_msg

from drivers.imu.chips import CHIPS, FilterRow
from drivers.imu.registers import (
    ACCEL_RANGES,
    GYRO_RANGES,
    RangeRow,
    Register,
)
from messages.arrays import FloatArray, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.imu.chip_unit import (
    CLOCK_LIMIT,
    CROSS_AXIS_LIMIT,
    SCALE_LIMIT,
    ZERO_G_LIMIT_MPS2,
    ZERO_RATE_LIMIT_RADPS,
    ChipUnit,
    draw_chip_unit,
)
from sim_rig.imu.i2c_bus import I2cWires
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from sim_rig.imu.mpu6050_signal import LOOK_AHEAD_S, Motion, low_pass
from tests.bench.imu_bench import ADDRESS, NOISY, SimulatedTime, still

AWAKE, PLL = 0x00, 0x01
FIFO_ON, FIFO_RESET = 0x40, 0x04
ALL_INTO_FIFO = 0xF8
DATA_READY, OVERFLOW = 0x01, 0x10
PERFECT = ChipUnit()
FILTER_ROWS = CHIPS[0x68].filter_rows


class Rig:
    """A chip, its clock and short names for its registers."""

    def __init__(self, motion: Motion = still, unit: ChipUnit = PERFECT) -> None:
        self.time = SimulatedTime()
        self.chip = Mpu6050Chip(motion, unit, self.time, seed=3)

    def set(self, register: int, value: int) -> None:
        self.chip.write(bytes([register, value]))

    def get(self, register: int, length: int = 1) -> bytes:
        self.chip.write(bytes([register]))
        return self.chip.read(length)

    def wake(self, *, divider: int = 9, dlpf: int = 3, accel: int = 1, gyro: int = 1) -> None:
        for register, value in (
            (Register.SMPLRT_DIV, divider),
            (Register.CONFIG, dlpf),
            (Register.ACCEL_CONFIG, accel << 3),
            (Register.GYRO_CONFIG, gyro << 3),
            (Register.INT_ENABLE, DATA_READY | OVERFLOW),
            (Register.PWR_MGMT_1, PLL),
        ):
            self.set(register, value)

    def start_fifo(self, content: int = ALL_INTO_FIFO) -> None:
        self.set(Register.FIFO_EN, content)
        self.set(Register.USER_CTRL, FIFO_ON)

    def fifo_count(self) -> int:
        return int.from_bytes(self.get(Register.FIFO_COUNTH, 2), "big")

    def outputs(self) -> IntArray:
        return np.frombuffer(self.get(Register.ACCEL_XOUT_H, 14), dtype=">i2").astype(np.int64)

    def record(self, n: int) -> tuple[IntArray, IntArray]:
        """Return the instants (n,) and outputs (n, 7) of the next samples, each read just after it is complete."""
        self.chip.take_edges()
        t_ns: list[int] = []
        outputs: list[IntArray] = []
        while len(t_ns) < n:
            self.time.sleep(self.chip.period_ns * 0.25e-9)
            if edges := self.chip.take_edges():
                t_ns += edges
                outputs.append(self.outputs())
        return np.array(t_ns[:n]), np.array(outputs[:n])


def ramp(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Steady change on every axis: behind a filter it is late by exactly the filter's delay."""
    t = (t_ns[:, None] - 1_000_000_000_000) * 1e-9
    return np.tile(8.0 * t, (1, 3)) - 4.0, np.tile(4.0 * t, (1, 3)) - 2.0


def test_a_chip_wakes_up_asleep_and_says_who_it_is() -> None:
    rig = Rig()
    rig.time.sleep(1.0)
    assert rig.get(Register.PWR_MGMT_1) == b"\x40"
    assert rig.get(Register.WHO_AM_I) == b"\x68"
    rig.set(Register.INT_ENABLE, DATA_READY)
    rig.start_fifo()
    rig.time.sleep(1.0)
    assert not rig.outputs().any()
    assert rig.fifo_count() == 0
    assert rig.chip.take_edges() == []


def test_configuration_reads_back_and_readings_cannot_be_written() -> None:
    rig = Rig()
    rig.wake(divider=19, dlpf=4, accel=2, gyro=3)
    assert rig.get(Register.SMPLRT_DIV, 4) == bytes([19, 4, 3 << 3, 2 << 3])
    for register in (Register.WHO_AM_I, Register.FIFO_COUNTH, Register.INT_STATUS):
        rig.set(register, 0x55)
    assert rig.get(Register.WHO_AM_I) == b"\x68"
    assert rig.get(Register.FIFO_COUNTH) == b"\x00"
    assert rig.get(Register.INT_STATUS) == b"\x00"


@pytest.mark.parametrize("mend", ["register", "power"])
def test_reset_and_brown_out_return_the_chip_to_sleep(mend: str) -> None:
    rig = Rig()
    rig.wake()
    rig.start_fifo()
    rig.time.sleep(0.1)
    assert rig.fifo_count() > 0
    if mend == "register":
        rig.set(Register.PWR_MGMT_1, 0x80)
    else:
        rig.chip.brown_out()
    assert rig.get(Register.PWR_MGMT_1) == b"\x40"
    assert rig.get(Register.CONFIG) == b"\x00"
    assert rig.fifo_count() == 0


@pytest.mark.parametrize(("divider", "dlpf", "rate_hz"), [(9, 3, 100), (4, 1, 200), (0, 6, 1000), (79, 0, 100)])
@pytest.mark.parametrize("clock_error", [-0.01, 0.0, 0.01])
def test_rate_follows_divider_filter_and_the_chips_own_clock(
    divider: int, dlpf: int, rate_hz: int, clock_error: float
) -> None:
    rig = Rig(unit=ChipUnit(clock_error=clock_error))
    rig.wake(divider=divider, dlpf=dlpf)
    edges = []
    for _ in range(20):
        rig.time.sleep(0.1)
        edges += rig.chip.take_edges()
    assert len(edges) == pytest.approx(2.0 * rate_hz * (1.0 + clock_error), abs=1.0)
    np.testing.assert_allclose(np.diff(edges), 1e9 / (rate_hz * (1.0 + clock_error)), atol=2.0)


def test_the_internal_oscillator_is_worse_than_the_gyroscopes_pll() -> None:
    rig = Rig(unit=ChipUnit(clock_error=0.01))
    rig.wake()
    with_pll = rig.chip.period_ns
    rig.set(Register.PWR_MGMT_1, AWAKE)
    assert rig.chip.period_ns == pytest.approx(10e6 / 1.05)
    assert with_pll == pytest.approx(10e6 / 1.01)


def test_a_sample_exists_only_once_its_instant_has_come() -> None:
    asked = []

    def watched(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        asked.append(int(t_ns[-1]))
        return still(t_ns)

    rig = Rig(watched)
    start_ns = rig.time.now_ns
    rig.wake()
    rig.start_fifo()
    rig.time.now_ns = start_ns + 9_999_999
    assert rig.fifo_count() == 0
    rig.time.now_ns = start_ns + 10_000_000
    assert rig.fifo_count() == 14
    assert max(asked) - rig.time.now_ns <= LOOK_AHEAD_S * 1e9


@pytest.mark.parametrize("row", FILTER_ROWS.values(), ids=lambda row: f"row{row.code}")
def test_the_chips_delay_is_the_datasheets(row: FilterRow) -> None:
    rig = Rig(ramp)
    rig.wake(divider=9 if row.code else 79, dlpf=row.code, accel=0, gyro=0)
    t_ns, outputs = rig.record(90)
    sf, w = (np.asarray(true) for true in ramp(t_ns))
    accel_lag_s = sf - outputs[:, 0:3] / 16384.0 * STANDARD_GRAVITY_MPS2
    gyro_lag_s = w - np.deg2rad(outputs[:, 4:7] / 131.0)
    settled = slice(75, None)
    assert np.mean(accel_lag_s[settled]) / 8.0 == pytest.approx(row.accel_delay_s, abs=2e-5)
    assert np.mean(gyro_lag_s[settled]) / 4.0 == pytest.approx(row.gyro_delay_s, abs=2e-5)


@pytest.mark.parametrize("row", FILTER_ROWS.values(), ids=lambda row: f"row{row.code}")
def test_the_filter_has_the_datasheets_bandwidth_and_delay(row: FilterRow) -> None:
    for bandwidth_hz, delay_s in (
        (row.accel_bandwidth_hz, row.accel_delay_s),
        (row.gyro_bandwidth_hz, row.gyro_delay_s),
    ):
        b, a = low_pass(bandwidth_hz, delay_s, row.rate_hz)
        _, edge = freqz(b, a, worN=[0.0, bandwidth_hz], fs=row.rate_hz)
        _, delay = group_delay((b, a), w=[1e-3], fs=row.rate_hz)
        assert abs(edge[0]) == pytest.approx(1.0, abs=1e-9)
        assert abs(edge[1]) == pytest.approx(math.sqrt(0.5), abs=1e-6)
        assert delay[0] / row.rate_hz == pytest.approx(delay_s, abs=1e-7)
        assert np.all(np.abs(np.roots(a)) < 1.0)


@pytest.mark.parametrize("accel", ACCEL_RANGES.values(), ids=lambda row: f"{row.full_scale}g")
@pytest.mark.parametrize("gyro", GYRO_RANGES.values(), ids=lambda row: f"{row.full_scale}dps")
def test_ranges_scale_and_clip(accel: RangeRow, gyro: RangeRow) -> None:
    inside, outside = 0.5, 1.2

    def pushed(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        shares = np.tile([inside, outside, -outside], (t_ns.size, 1))
        return shares * accel.full_scale * STANDARD_GRAVITY_MPS2, shares * np.deg2rad(gyro.full_scale)

    rig = Rig(pushed)
    rig.wake(accel=accel.code, gyro=gyro.code)
    rig.time.sleep(0.05)
    outputs = rig.outputs()
    assert outputs[0] == pytest.approx(inside * accel.full_scale * accel.lsb_per_unit, abs=1)
    assert outputs[4] == pytest.approx(inside * gyro.full_scale * gyro.lsb_per_unit, abs=1)
    assert list(outputs[[1, 2, 5, 6]]) == [32767, -32768, 32767, -32768]


@pytest.mark.parametrize("dlpf", [2, 3, 4])
def test_noise_is_the_densitys_within_the_filters_band(dlpf: int) -> None:
    rig = Rig(unit=NOISY)
    rig.wake(dlpf=dlpf, accel=0, gyro=0)
    _, outputs = rig.record(1500)
    row = FILTER_ROWS[dlpf]
    for columns, lsb, density, bandwidth_hz, delay_s in (
        (slice(0, 3), STANDARD_GRAVITY_MPS2 / 16384, NOISY.sf_noise_density, row.accel_bandwidth_hz, row.accel_delay_s),
        (slice(4, 7), np.deg2rad(1 / 131), NOISY.w_noise_density, row.gyro_bandwidth_hz, row.gyro_delay_s),
    ):
        f_hz, response = freqz(*low_pass(bandwidth_hz, delay_s, 1000.0), worN=4096, fs=1000.0)
        noise_bandwidth_hz = float(np.sum(np.abs(response) ** 2) * f_hz[1])
        assert bandwidth_hz < noise_bandwidth_hz < 1.6 * bandwidth_hz
        measured = np.std(outputs[20:, columns], axis=0) * lsb
        np.testing.assert_allclose(measured, density * math.sqrt(noise_bandwidth_hz), rtol=0.12)


def test_the_units_errors_reach_the_counts() -> None:
    unit = dataclasses.replace(draw_chip_unit(np.random.default_rng(7)), sf_noise_density=0.0, w_noise_density=0.0)
    sf_B, w_B = np.array([1.0, -2.0, 9.0]), np.array([0.5, -1.0, 2.0])

    def constant(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        return np.tile(sf_B, (t_ns.size, 1)), np.tile(w_B, (t_ns.size, 1))

    rig = Rig(constant, unit)
    rig.wake()
    rig.time.sleep(0.1)
    outputs = rig.outputs()
    expected_sf = unit.sf_matrix @ sf_B + unit.sf_bias_mps2
    expected_w = unit.w_matrix @ w_B + unit.w_bias_radps + unit.g_sensitivity @ sf_B
    np.testing.assert_allclose(outputs[0:3] / 8192 * STANDARD_GRAVITY_MPS2, expected_sf, atol=7e-4)
    np.testing.assert_allclose(np.deg2rad(outputs[4:7] / 65.5), expected_w, atol=2e-4)


def test_drawn_units_stay_within_the_datasheet_and_differ() -> None:
    units = [draw_chip_unit(np.random.default_rng(seed)) for seed in range(300)]
    diagonal = np.array([np.diag(unit.sf_matrix) - 1.0 for unit in units])
    cross = np.array([unit.w_matrix - np.diag(np.diag(unit.w_matrix)) for unit in units])
    zero_g = np.array([unit.sf_bias_mps2 for unit in units])
    zero_rate = np.array([unit.w_bias_radps for unit in units])
    clock = np.array([unit.clock_error for unit in units])
    for values, limit in (
        (diagonal, SCALE_LIMIT),
        (cross, CROSS_AXIS_LIMIT),
        (zero_g / ZERO_G_LIMIT_MPS2, 1.0),
        (zero_rate, ZERO_RATE_LIMIT_RADPS),
        (clock, CLOCK_LIMIT),
    ):
        assert np.max(np.abs(values)) <= limit * (1.0 + 1e-12)
        assert np.std(values[values != 0.0]) == pytest.approx(limit / 3.0, rel=0.15)
    again = draw_chip_unit(np.random.default_rng(5))
    np.testing.assert_array_equal(again.sf_matrix, units[5].sf_matrix)


@pytest.mark.parametrize("temperature_degC", [-5.0, 25.0, 36.53, 60.0])
def test_temperature_is_340_counts_a_degree(temperature_degC: float) -> None:
    rig = Rig(unit=ChipUnit(temperature_degC=temperature_degC))
    rig.wake()
    rig.time.sleep(0.05)
    assert rig.outputs()[3] / 340.0 + 36.53 == pytest.approx(temperature_degC, abs=1.0 / 340.0)


@pytest.mark.parametrize(
    ("content", "columns"),
    [(0xF8, range(7)), (0x78, [0, 1, 2, 4, 5, 6]), (0x08, [0, 1, 2]), (0x80 | 0x20, [3, 5]), (0x00, [])],
)
def test_the_fifo_holds_what_was_asked_in_register_order(content: int, columns: list[int]) -> None:
    rig = Rig(unit=NOISY)
    rig.wake()
    rig.start_fifo(content)
    expected = []
    for _ in range(5):
        rig.time.sleep(0.010)
        expected += list(rig.outputs()[list(columns)])
    assert rig.fifo_count() == 2 * len(expected)
    data = rig.get(Register.FIFO_R_W, 2 * len(expected)) if expected else b""
    assert list(np.frombuffer(data, dtype=">i2")) == expected
    assert rig.fifo_count() == 0


def test_an_overflowing_fifo_says_so_and_loses_its_oldest_bytes() -> None:
    rig = Rig(unit=NOISY)
    rig.wake()
    rig.start_fifo()
    _, outputs = rig.record(73)
    assert rig.fifo_count() == 73 * 14
    assert not rig.get(Register.INT_STATUS)[0] & OVERFLOW
    _, more = rig.record(3)
    assert rig.get(Register.INT_STATUS)[0] & OVERFLOW
    assert rig.fifo_count() == 1024
    written = np.concatenate((outputs, more)).astype(">i2").tobytes()
    assert rig.get(Register.FIFO_R_W, 1024) == written[-1024:]
    assert 1024 % 14 != 0


def test_an_empty_fifo_repeats_its_last_byte() -> None:
    rig = Rig()
    rig.wake()
    rig.start_fifo(0x80)
    rig.time.sleep(0.010)
    data = rig.get(Register.FIFO_R_W, 4)
    assert data[2:] == data[1:2] * 2


def test_fifo_reset_acts_only_while_the_fifo_is_off() -> None:
    rig = Rig()
    rig.wake()
    rig.start_fifo()
    rig.time.sleep(0.05)
    rig.set(Register.USER_CTRL, FIFO_ON | FIFO_RESET)
    assert rig.fifo_count() > 0
    rig.set(Register.USER_CTRL, FIFO_RESET)
    assert rig.fifo_count() == 0
    assert rig.get(Register.USER_CTRL) == b"\x00"
    rig.time.sleep(0.05)
    assert rig.fifo_count() == 0


def test_data_ready_clears_on_reading() -> None:
    rig = Rig()
    rig.wake()
    rig.time.sleep(0.011)
    assert rig.get(Register.INT_STATUS) == b"\x01"
    assert rig.get(Register.INT_STATUS) == b"\x00"
    rig.time.sleep(0.010)
    rig.outputs()
    assert rig.get(Register.INT_STATUS) == b"\x01"
    rig.set(Register.INT_PIN_CFG, 0x10)
    rig.time.sleep(0.010)
    rig.outputs()
    assert rig.get(Register.INT_STATUS) == b"\x00"


def test_a_latched_interrupt_has_no_second_edge_until_it_is_cleared() -> None:
    rig = Rig()
    rig.wake()
    rig.set(Register.INT_PIN_CFG, 0x20)
    rig.time.sleep(0.055)
    assert len(rig.chip.take_edges()) == 1
    rig.time.sleep(0.050)
    assert rig.chip.take_edges() == []
    rig.get(Register.INT_STATUS)
    rig.time.sleep(0.010)
    assert len(rig.chip.take_edges()) == 1


def test_frozen_sensors_repeat_themselves_although_samples_go_on() -> None:
    rig = Rig(unit=NOISY)
    rig.wake()
    rig.record(5)
    rig.chip.freeze()
    t_ns, outputs = rig.record(5)
    assert len(set(t_ns)) == 5
    assert np.all(outputs == outputs[0])
    rig.chip.freeze(False)
    _, outputs = rig.record(5)
    assert len(np.unique(outputs, axis=0)) == 5


def test_a_long_silence_of_the_host_costs_bounded_work() -> None:
    ticks = 0

    def counted(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        nonlocal ticks
        ticks += t_ns.size
        return still(t_ns)

    rig = Rig(counted)
    rig.wake()
    rig.start_fifo()
    rig.time.sleep(3600.0)
    assert rig.fifo_count() == 1024
    assert ticks < 10_000
    assert rig.chip.take_edges()[-1] == pytest.approx(rig.time.now_ns, abs=10_000_000)


def test_the_same_seed_gives_the_same_counts() -> None:
    recordings = []
    for _ in range(2):
        rig = Rig(unit=NOISY)
        rig.wake()
        recordings.append(rig.record(20)[1])
    np.testing.assert_array_equal(recordings[0], recordings[1])


def test_the_bus_fills_real_messages_and_refuses_what_smbus_cannot() -> None:
    rig = Rig()
    bus = I2cWires({ADDRESS: rig.chip}).open()
    who = i2c_msg.read(ADDRESS, 1)
    bus.i2c_rdwr(i2c_msg.write(ADDRESS, [Register.WHO_AM_I]), who)
    assert bytes(who) == b"\x68"
    bus.write_byte_data(ADDRESS, Register.SMPLRT_DIV, 9)
    assert bus.read_byte_data(ADDRESS, Register.SMPLRT_DIV) == 9
    assert bus.read_i2c_block_data(ADDRESS, Register.SMPLRT_DIV, 2) == [9, 0]
    with pytest.raises(ValueError, match="33"):
        bus.read_i2c_block_data(ADDRESS, Register.SMPLRT_DIV, 33)
    with pytest.raises(OSError, match="Remote I/O") as absent:
        bus.read_byte_data(0x69, Register.WHO_AM_I)
    assert absent.value.errno == errno.EREMOTEIO
    bus.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        bus.read_byte_data(ADDRESS, Register.WHO_AM_I)


def test_bus_faults_come_on_demand_and_pass() -> None:
    rig = Rig()
    wires = I2cWires({ADDRESS: rig.chip}, smbus_only=True)
    bus = wires.open()
    with pytest.raises(OSError, match="not supported") as refused:
        bus.i2c_rdwr(i2c_msg.read(ADDRESS, 1))
    assert refused.value.errno == errno.EOPNOTSUPP
    for error in (errno.EREMOTEIO, errno.ENXIO, errno.EIO, errno.EAGAIN):
        wires.fail(error)
        with pytest.raises(OSError) as failed:  # noqa: PT011 - the errno is the point
            bus.write_byte_data(ADDRESS, Register.SMPLRT_DIV, 7)
        assert failed.value.errno == error
    assert bus.read_byte_data(ADDRESS, Register.SMPLRT_DIV) == 0
    wires.stick(until_opened=True)
    with pytest.raises(OSError, match="timed out"):
        bus.read_byte_data(ADDRESS, Register.WHO_AM_I)
    assert wires.open().read_byte_data(ADDRESS, Register.WHO_AM_I) == 0x68

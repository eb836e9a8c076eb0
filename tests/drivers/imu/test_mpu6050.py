"""The driver against the simulated chip: configuration, scaling, and every fault it promises to survive."""

import dataclasses
import errno
import re

import numpy as np
import pytest
from smbus2 import i2c_msg

from drivers.imu.chips import CHIPS, REFUSED
from drivers.imu.mpu6050 import Mpu6050, Mpu6050Counters
from drivers.imu.register_access import RegisterBus
from drivers.imu.registers import Register
from drivers.imu.settings import Mpu6050Settings
from drivers.protocols import DeviceError
from messages import ImuSample
from messages.arrays import FloatArray, IntArray
from tests.bench.imu_bench import ADDRESS, NOISY, ImuBench, lost_by_truth, still

BOTH_BUSES = pytest.mark.parametrize("smbus_only", [False, True], ids=["fifo", "smbus"])


def assert_accounted_for(bench: ImuBench, samples: list[ImuSample]) -> None:
    """Every sample of the chip was delivered or counted as lost, in the right place, with increasing stamps."""
    lost = [sample.lost_before for sample in samples]
    assert sum(lost) == bench.imu.counters.lost == lost_by_truth(bench, samples)
    assert [sample.seq for sample in samples] == list(np.cumsum(np.array(lost) + 1))
    assert np.all(np.diff([sample.t_sample_ns for sample in samples]) > 0)


def registers(bench: ImuBench, register: int, length: int = 1) -> list[int]:
    return bench.wires.open().read_i2c_block_data(ADDRESS, register, length)


def test_opening_wakes_and_configures_the_chip() -> None:
    bench = ImuBench(settings=Mpu6050Settings(accel_range_g=8, gyro_range_deg_per_s=1000, filter_row=4)).opened()
    assert registers(bench, Register.SMPLRT_DIV, 4) == [9, 4, 2 << 3, 2 << 3]
    assert registers(bench, Register.FIFO_EN) == [0xF8]
    assert registers(bench, Register.USER_CTRL, 2) == [0x40, 0x01]
    assert bench.imu.counters == Mpu6050Counters()


def test_where_smbus_is_all_there_is_the_fifo_stays_off() -> None:
    bench = ImuBench(smbus_only=True).opened()
    assert registers(bench, Register.USER_CTRL, 2) == [0x00, 0x01]


@pytest.mark.parametrize("who_am_i", [*sorted(REFUSED), 0x12])
def test_another_chip_is_refused_by_name(who_am_i: int) -> None:
    bench = ImuBench()
    bench.chip.who_am_i = who_am_i
    name = REFUSED.get(who_am_i, "no chip this driver knows")
    line = f"IMU at I2C address 0x68: WHO_AM_I reads 0x{who_am_i:02x} ({name}), supported are 0x68 MPU-6050"
    with pytest.raises(DeviceError, match=re.escape(line)) as refused:
        bench.imu.open()
    assert "\n" not in str(refused.value)


def test_an_absent_chip_and_an_absent_bus_get_one_clear_line() -> None:
    bench = ImuBench()
    bench.wires.fail(errno.ENXIO, times=100)
    with pytest.raises(DeviceError, match=r"0x68: \[Errno 6\] No such device or address$"):
        bench.imu.open()

    def no_bus() -> RegisterBus:
        raise FileNotFoundError(errno.ENOENT, "No such file or directory", "/dev/i2c-9")

    with pytest.raises(DeviceError, match=r"'/dev/i2c-9'$"):
        Mpu6050(no_bus, settings=Mpu6050Settings(), clock=bench.time, sleep=bench.time.sleep).open()


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"rate_hz": 300}, r"rate_hz is 300, must divide 1000 and be 4 to 500"),
        ({"rate_hz": 1000}, r"rate_hz is 1000, .* 4 to 500"),
        ({"accel_range_g": 3}, r"accel_range_g is 3, must be one of \[2, 4, 8, 16\]"),
        ({"gyro_range_deg_per_s": 300}, r"gyro_range_deg_per_s is 300, .*\[250, 500, 1000, 2000\]"),
        ({"filter_row": 0}, r"filter_row is 0, must be one of \[1, 2, 3, 4, 5, 6\]"),
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, int], line: str) -> None:
    with pytest.raises(ValueError, match=line):
        Mpu6050Settings(**wrong)


@BOTH_BUSES
def test_samples_are_in_si_units_of_specific_force_and_rate(smbus_only: bool) -> None:
    def constant(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        return np.tile([1.0, -2.0, 9.5], (t_ns.size, 1)), np.tile([0.3, -4.0, 5.0], (t_ns.size, 1))

    unit = dataclasses.replace(NOISY, temperature_degC=31.25)
    samples = ImuBench(constant, unit, smbus_only=smbus_only).opened().run(1.0)
    np.testing.assert_allclose(np.mean([s.sf_B_mps2 for s in samples], axis=0), [1.0, -2.0, 9.5], atol=0.01)
    np.testing.assert_allclose(np.mean([s.w_WB_B_radps for s in samples], axis=0), [0.3, -4.0, 5.0], atol=5e-4)
    assert [s.temperature_degC for s in samples] == pytest.approx([31.25] * len(samples), abs=0.002)
    assert not any(s.clipped for s in samples)


def test_only_samples_at_the_end_of_the_range_are_marked_clipped() -> None:
    def knocks(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        sf, w = still(t_ns)
        sf[:, 0] = 60.0 * np.sin(2.0 * np.pi * t_ns * 1e-9)
        return sf, w

    samples = ImuBench(knocks).opened().run(2.0)
    limit_mps2 = 4.0 * 9.80665
    for sample in samples:
        assert sample.clipped == (abs(sample.sf_B_mps2[0]) > limit_mps2 - 0.002)
    assert 0.3 < np.mean([sample.clipped for sample in samples]) < 0.7


@pytest.mark.parametrize("filter_row", [1, 2, 3, 4])
@BOTH_BUSES
def test_a_samples_time_is_when_the_motion_was(filter_row: int, smbus_only: bool) -> None:
    """Accelerometer and gyroscope differ in delay by up to 0.2 ms; the one stamp lies between them."""
    unit = dataclasses.replace(NOISY, clock_error=0.006)
    bench = ImuBench(unit=unit, settings=Mpu6050Settings(filter_row=filter_row), smbus_only=smbus_only).opened()
    bench.run(4.0)
    samples = bench.run(8.0)
    assert abs(bench.time_offset_s(samples)) < 0.5e-3
    assert CHIPS[0x68].filter_rows[filter_row].delay_s > 3.0 * 0.5e-3


@pytest.mark.parametrize("clock_error", [-0.01, 0.0, 0.01])
def test_stamps_against_the_chips_own_instants(clock_error: float) -> None:
    bench = ImuBench(unit=dataclasses.replace(NOISY, clock_error=clock_error)).opened()
    samples = bench.run(25.0)
    errors_s = bench.stamp_errors_s(samples)[1000:]
    assert abs(np.mean(errors_s)) < 0.2e-3
    assert np.sqrt(np.mean(errors_s**2)) < 0.3e-3
    assert bench.imu.period_s == pytest.approx(0.010 / (1.0 + clock_error), rel=1e-4)
    assert bench.imu.counters.lost == 0
    assert_accounted_for(bench, samples)


def test_a_late_reader_loses_nothing_that_the_fifo_holds() -> None:
    bench = ImuBench().opened()
    samples = bench.run(3.0)
    bench.pause(0.6)
    samples += bench.run(3.0)
    assert bench.imu.counters.lost == 0
    assert len(samples) == pytest.approx(660, abs=2)
    assert_accounted_for(bench, samples)


@pytest.mark.parametrize("pause_s", [0.69, 0.705, 0.72, 0.75, 1.3, 30.0])
def test_an_overflowing_fifo_is_flushed_and_the_loss_counted(pause_s: float) -> None:
    bench = ImuBench(unit=dataclasses.replace(NOISY, clock_error=-0.007)).opened()
    samples = bench.run(11.0)
    bench.pause(pause_s)
    samples += bench.run(1.0)
    overflowed = pause_s > 0.70
    assert bench.imu.counters.fifo_overflows == overflowed
    assert (bench.imu.counters.lost > 0) == overflowed
    assert max(sample.lost_before for sample in samples) == bench.imu.counters.lost
    assert_accounted_for(bench, samples)


@pytest.mark.parametrize("seed", range(10))
def test_a_flush_is_exact_even_when_it_falls_due_as_a_sample_completes(seed: int) -> None:
    bench = ImuBench(seed=seed).opened()
    samples = bench.run(1.0)
    for lead_s in np.arange(0.0, 0.002, 0.0001):
        next_edge_ns = bench.edges_ns[-1] + round(bench.chip.period_ns)
        bench.pause(1.0 + (next_edge_ns - bench.time.now_ns) * 1e-9 - float(lead_s))
        samples += bench.run(0.1, jittery=False)
    assert bench.imu.counters.fifo_overflows == 20
    assert_accounted_for(bench, samples)


def test_a_driver_held_up_inside_a_read_does_not_trust_what_it_got(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = ImuBench().opened()
    samples = bench.run(3.0)
    burst = bench.wires.transfer_combined

    def late_burst(*messages: i2c_msg) -> None:
        monkeypatch.undo()
        bench.pause(2.0)
        burst(*messages)

    monkeypatch.setattr(bench.wires, "transfer_combined", late_burst)
    samples += bench.run(2.0)
    assert bench.imu.counters.fifo_overflows == 1
    assert_accounted_for(bench, samples)
    sf_B, _ = bench.motion(np.array([sample.t_sample_ns for sample in samples]))
    assert np.max(np.abs(np.array([sample.sf_B_mps2 for sample in samples]) - sf_B)[100:]) < 0.1


@pytest.mark.parametrize("error", [errno.EREMOTEIO, errno.ENXIO, errno.EIO, errno.EAGAIN])
@BOTH_BUSES
def test_a_missing_acknowledge_is_tried_again(error: int, smbus_only: bool) -> None:
    bench = ImuBench(smbus_only=smbus_only).opened()
    samples = bench.run(2.0, jittery=False)
    for _ in range(20):
        bench.wires.fail(error, times=2)
        samples += bench.run(0.05, jittery=False)
    assert bench.imu.counters.bus_errors == 40
    assert bench.imu.counters.resets == bench.imu.counters.lost == 0
    assert_accounted_for(bench, samples)


def test_retries_are_bounded() -> None:
    bench = ImuBench().opened()
    bench.run(1.0)
    bench.wires.fail(errno.EREMOTEIO, times=10_000)
    before = bench.wires.transfers
    with pytest.raises(DeviceError, match="Remote I/O error"):
        bench.poll()
    assert bench.wires.transfers - before == bench.imu.counters.bus_errors <= 15


def test_a_burst_that_breaks_off_leaves_an_unaligned_fifo_that_is_flushed(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = ImuBench().opened()
    samples = bench.run(2.0)
    bench.pause(0.1)
    burst = bench.wires.transfer_combined

    def breaking_burst(*messages: i2c_msg) -> None:
        monkeypatch.undo()
        bench.wires.fail(errno.EAGAIN, bytes_lost=33)
        burst(*messages)

    monkeypatch.setattr(bench.wires, "transfer_combined", breaking_burst)
    samples += bench.run(1.0)
    assert bench.imu.counters.bus_errors == 1
    assert bench.imu.counters.fifo_overflows == 1
    assert bench.imu.counters.lost == pytest.approx(10, abs=1)
    assert_accounted_for(bench, samples)


def test_a_burst_that_was_never_begun_is_tried_again_without_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = ImuBench().opened()
    samples = bench.run(2.0)
    bench.pause(0.1)
    burst = bench.wires.transfer_combined

    def refused_burst(*messages: i2c_msg) -> None:
        monkeypatch.undo()
        bench.wires.fail(errno.EREMOTEIO)
        burst(*messages)

    monkeypatch.setattr(bench.wires, "transfer_combined", refused_burst)
    samples += bench.run(1.0)
    assert bench.imu.counters == Mpu6050Counters(bus_errors=1)
    assert_accounted_for(bench, samples)


def test_frames_lost_without_a_trace_are_noticed_by_the_clock() -> None:
    bench = ImuBench().opened()
    samples = bench.run(3.0)
    bench.pause(0.1)
    stolen = 3
    bench.wires.open().i2c_rdwr(i2c_msg.write(ADDRESS, [Register.FIFO_R_W]), i2c_msg.read(ADDRESS, 14 * stolen))
    samples += bench.run(1.0)
    assert bench.imu.counters.lost == stolen
    assert_accounted_for(bench, samples)


@BOTH_BUSES
def test_a_stuck_bus_is_opened_anew(smbus_only: bool) -> None:
    bench = ImuBench(smbus_only=smbus_only).opened()
    samples = bench.run(2.0)
    bench.wires.stick(until_opened=True)
    samples += bench.run(2.0)
    assert bench.imu.counters.bus_errors == 1
    assert bench.imu.counters.resets == 0
    assert len(samples) > 380
    assert_accounted_for(bench, samples)


@BOTH_BUSES
def test_a_bus_that_stays_stuck_is_reported_and_the_next_read_starts_over(smbus_only: bool) -> None:
    bench = ImuBench(smbus_only=smbus_only).opened()
    bench.run(2.0)
    bench.wires.stick()
    for _ in range(3):
        with pytest.raises(DeviceError, match=r"0x68: \[Errno 110\] Connection timed out"):
            bench.poll()
        bench.time.sleep(0.5)
    bench.wires.release()
    assert bench.poll() == []
    after = bench.run(2.0)
    assert len(after) == pytest.approx(200, abs=8)
    assert bench.imu.counters.resets == 0
    assert after[0].lost_before == bench.imu.counters.lost == pytest.approx(3 * 0.5 * 100.0, abs=4)


@BOTH_BUSES
def test_a_brown_out_is_noticed_and_repaired(smbus_only: bool) -> None:
    bench = ImuBench(smbus_only=smbus_only).opened()
    before = bench.run(2.5)
    bench.chip.brown_out()
    after = bench.run(1.5)
    assert bench.imu.counters.resets == 1
    gap_s = (after[0].t_sample_ns - before[-1].t_sample_ns) * 1e-9
    assert gap_s < 0.45
    assert after[0].lost_before == pytest.approx(gap_s / bench.imu.period_s - 1.0, abs=1.0)
    assert abs(bench.time_offset_s(after[30:])) < 1.5e-3


def test_a_changed_range_is_noticed_within_a_second() -> None:
    bench = ImuBench().opened()
    bench.run(2.0)
    bench.wires.open().write_byte_data(ADDRESS, Register.ACCEL_CONFIG, 3 << 3)
    bench.run(1.5)
    assert bench.imu.counters.resets == 1
    assert registers(bench, Register.ACCEL_CONFIG) == [1 << 3]


def test_a_chip_whose_values_never_change_is_restarted_then_reported() -> None:
    bench = ImuBench().opened()
    bench.run(2.0)
    bench.chip.freeze()
    with pytest.raises(DeviceError, match="answers but its samples never change"):
        bench.run(3.0)
    assert bench.imu.counters.resets == 2
    bench.chip.freeze(False)
    assert len(bench.run(2.0)) == pytest.approx(200, abs=8)


def test_a_chip_that_never_delivers_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = ImuBench()
    monkeypatch.setattr(bench.chip, "_push_fifo", lambda _counts: None)
    bench.imu.open()
    with pytest.raises(DeviceError, match="answers but delivers no samples"):
        bench.run(1.0)


@BOTH_BUSES
def test_a_chip_swapped_while_running_is_refused_by_name(smbus_only: bool) -> None:
    bench = ImuBench(smbus_only=smbus_only).opened()
    bench.run(1.0)
    bench.chip.who_am_i = 0x70
    bench.chip.brown_out()
    with pytest.raises(DeviceError, match="MPU-6500"):
        bench.run(1.0)
    bench.chip.who_am_i = 0x68
    assert len(bench.run(2.0)) == pytest.approx(180, abs=20)


def test_smbus_polls_that_come_too_late_lose_samples_and_count_them_all() -> None:
    bench = ImuBench(smbus_only=True, unit=dataclasses.replace(NOISY, clock_error=0.003)).opened()
    samples = bench.run(5.0)
    rng = np.random.default_rng(2)
    for _ in range(60):
        bench.pause(float(rng.uniform(0.0, 0.08)))
        samples += bench.run(0.1)
    assert bench.imu.counters.lost > 100
    assert_accounted_for(bench, samples)


def test_closing_releases_the_bus_and_reading_again_starts_over() -> None:
    bench = ImuBench().opened()
    bench.run(0.5)
    bench.imu.close()
    bench.imu.close()
    assert bench.poll() == []
    assert len(bench.run(1.0)) == pytest.approx(100, abs=3)

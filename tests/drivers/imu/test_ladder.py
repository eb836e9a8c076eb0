"""The ladder: how soon the driver notices what goes wrong with the chip or the bus, what it does, and what it tells."""

import ctypes
import errno
from collections.abc import Callable

import numpy as np
import pytest
from smbus2 import i2c_msg

from drivers.imu.frames import refuse_without_data
from drivers.imu.registers import Register
from drivers.imu.settings import Mpu6050Settings, configure
from drivers.protocols import DeviceError
from messages import ImuSample
from tests.bench.imu_bench import ADDRESS, ImuBench, lost_by_truth

BOTH_BUSES = pytest.mark.parametrize("smbus_only", [False, True], ids=["fifo", "smbus"])


def assert_numbered(bench: ImuBench, samples: list[ImuSample]) -> None:
    """Whatever is missing was counted and is as long as its gap, also across restarts, when the chip made nothing."""
    lost = np.array([sample.lost_before for sample in samples])
    assert sum(lost) == bench.imu.counters.lost
    assert [sample.seq for sample in samples] == list(np.cumsum(lost + 1))
    spacing = np.diff([sample.t_sample_ns for sample in samples]) / (bench.imu.period_s * 1e9)
    assert np.all(spacing > 0.0)
    np.testing.assert_allclose(spacing - 1.0, lost[1:], atol=1.0 + 0.5 * bench.imu.counters.resets)


def silence_s(samples: list[ImuSample]) -> float:
    """Return the longest time without a sample, as the reader saw it."""
    return float(np.max(np.diff([sample.t_arrival_ns for sample in samples]))) * 1e-9


def test_frozen_registers_are_noticed_after_four_frames_and_none_is_delivered_before_they_live() -> None:
    bench = ImuBench().opened()
    before = bench.run(2.0, jittery=False)
    bench.chip.freeze()
    frozen_ns = bench.time.now_ns
    frozen = []
    while bench.imu.counters.resets == 0:
        bench.time.sleep(0.005)
        frozen += bench.poll()
    assert len(frozen) == 2  # the first to be held was a living one
    assert bench.imu.counters.resets == 1
    with pytest.raises(DeviceError, match="never change"):
        frozen += bench.run(1.0)
    for _ in range(5):
        with pytest.raises(DeviceError, match="never change"):
            frozen += bench.run(1.0)
    assert len(frozen) == 2
    bench.chip.freeze(False)
    released_ns = bench.time.now_ns
    after = bench.run(1.0)
    assert after[0].t_arrival_ns - released_ns < 50_000_000
    assert frozen_ns < before[-1].t_arrival_ns + 20_000_000
    assert_numbered(bench, before + frozen + after)


@pytest.mark.parametrize(
    ("settings", "frames"),
    [
        (Mpu6050Settings(), 4),
        (Mpu6050Settings(filter_row=1), 4),
        (Mpu6050Settings(filter_row=6), 32),
        (Mpu6050Settings(rate_hz=500), 20),
    ],
)
def test_a_slow_filter_needs_more_equal_frames_to_be_called_frozen(settings: Mpu6050Settings, frames: int) -> None:
    assert configure(settings).frozen_frames == frames


@pytest.mark.parametrize("with_line", [False, True], ids=["polled", "edges"])
def test_a_brown_out_costs_a_restart_and_three_periods(with_line: bool) -> None:
    bench = ImuBench(with_line=with_line).opened()
    samples = bench.follow(2.0)
    bench.chip.brown_out()
    samples += bench.follow(1.0)
    assert silence_s(samples) < 0.21 + 0.030 + 0.030
    assert bench.imu.counters.resets == 1
    assert_numbered(bench, samples)


@pytest.mark.parametrize("register", [Register.PWR_MGMT_2, Register.PWR_MGMT_1, Register.USER_CTRL, Register.FIFO_EN])
def test_whatever_is_changed_behind_the_drivers_back_is_put_right(register: Register) -> None:
    bench = ImuBench().opened()
    samples = bench.run(2.0)
    bench.wires.open().write_byte_data(ADDRESS, register, 0x03)
    samples += bench.run(2.0)
    assert bench.wires.open().read_byte_data(ADDRESS, register) in (0x00, 0x01, 0x40, 0xF8)
    assert bench.imu.counters.resets == 1
    assert len(samples) > 250
    assert_numbered(bench, samples)


@pytest.mark.parametrize("level", [0x00, 0xFF])
@BOTH_BUSES
def test_a_data_line_that_is_lost_never_becomes_a_sample(
    level: int, smbus_only: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = ImuBench(smbus_only=smbus_only).opened()
    samples = bench.run(2.0)
    monkeypatch.setattr(bench.chip, "read", lambda length: bytes([level]) * length)
    for _ in range(3):
        with pytest.raises(DeviceError, match=f"0x{level:02x}"):
            samples += bench.run(1.0)
    monkeypatch.undo()
    samples += bench.run(2.0)
    sf_B, _ = bench.motion(np.array([sample.t_sample_ns for sample in samples]))
    assert np.max(np.abs(np.array([sample.sf_B_mps2 for sample in samples]) - sf_B)) < 0.3
    assert_numbered(bench, samples)


@pytest.mark.parametrize("level", [0x00, 0xFF])
def test_frames_without_data_are_refused_and_counted(level: int, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = ImuBench().opened()
    samples = bench.run(2.0)
    bench.pause(0.05)
    burst = bench.wires.transfer_combined

    def empty_burst(*messages: i2c_msg) -> None:
        burst(*messages)
        if messages[-1].len > 1:
            monkeypatch.undo()
            ctypes.memset(messages[-1].buf, level, messages[-1].len)

    monkeypatch.setattr(bench.wires, "transfer_combined", empty_burst)
    samples += bench.run(1.0)
    assert bench.imu.counters.frames_refused == bench.imu.counters.lost == pytest.approx(5, abs=1)
    assert bench.imu.counters.resets == 0
    assert lost_by_truth(bench, samples) == bench.imu.counters.lost
    assert_numbered(bench, samples)


@pytest.mark.parametrize("error", [errno.EREMOTEIO, errno.EIO, errno.ETIMEDOUT])
def test_a_lasting_failure_is_told_within_milliseconds_of_bus_time(error: int) -> None:
    bench = ImuBench(with_line=True).opened()
    bench.follow(1.0)
    bench.wires.stick(error)
    before = bench.wires.transfers
    start_ns = bench.time.now_ns
    for _ in range(3):
        with pytest.raises(DeviceError):
            bench.imu.read(timeout_s=0.1)
    assert bench.time.now_ns - start_ns < 40_000_000
    assert bench.wires.transfers - before <= (4 if error == errno.ETIMEDOUT else 12)


def test_a_bus_that_fails_again_after_each_opening_ends_in_a_reset_then_an_error() -> None:
    bench = ImuBench().opened()
    bench.run(1.0)
    bench.wires.transfer_combined = _broken_bursts(bench)  # type: ignore[method-assign]
    with pytest.raises(DeviceError, match="answers but"):
        bench.run(3.0)
    assert bench.imu.counters.resets >= 1


def _broken_bursts(bench: ImuBench) -> Callable[..., None]:
    whole = bench.wires.transfer_combined

    def burst(*messages: i2c_msg) -> None:
        if messages[-1].len > 1:
            raise OSError(errno.EIO, "Input/output error")
        whole(*messages)

    return burst


def test_the_last_byte_of_an_empty_fifo_over_and_over_is_no_sample() -> None:
    with pytest.raises(OSError, match="0x5a alone"):
        refuse_without_data([bytes(range(14)), b"\x5a" * 14])
    refuse_without_data([bytes(range(14)), b"\x5a" * 13 + b"\x5b"])

"""The self-test against what the register maps and the application note say, and on every chip of the table."""

import dataclasses
import math

import numpy as np
import pytest

from drivers.imu.chips import CHIPS, ChipModel
from drivers.imu.register_access import RegisterAccess
from drivers.imu.self_test import AXES, TrimCodes, factory_trim_lsb, read_trim_codes
from drivers.protocols import DeviceError
from messages.arrays import FloatArray, IntArray
from sim_rig.imu.chip_unit import draw_chip_unit
from tests.bench.imu_bench import ADDRESS, NOISY, ImuBench, still

MPU6050, MPU6500 = CHIPS[0x68], CHIPS[0x70]
ALL = pytest.mark.parametrize("model", CHIPS.values(), ids=lambda model: model.name)


def test_the_mpu6050s_formulas() -> None:
    trims = factory_trim_lsb(MPU6050, TrimCodes((1, 31, 0), (1, 2, 31)))
    assert trims == pytest.approx((1392.64, 3768.32, 0.0, 3275.0, -3425.65, 12622.98), rel=1e-5)


def test_the_relatives_formula() -> None:
    trims = factory_trim_lsb(MPU6500, TrimCodes((1, 2, 0), (101, 1, 255)))
    assert trims == pytest.approx((2620.0, 2646.2, 0.0, 7086.7, 2620.0, 32803.6), rel=1e-4)


def test_the_mpu6050_packs_its_codes_into_four_registers() -> None:
    codes = TrimCodes((0b10110, 0b01001, 0b11111), (0b00001, 0b10000, 0b11111))
    assert codes.registers(MPU6050) == {0x0D: 0b10100001, 0x0E: 0b01010000, 0x0F: 0b11111111, 0x10: 0b00100111}


@ALL
def test_codes_are_read_as_they_were_written(model: ChipModel) -> None:
    codes = TrimCodes((3, 30, 17), (31, 1, 12))
    unit = dataclasses.replace(NOISY, trim_codes=codes)
    bench = ImuBench(unit=unit, who_am_i=model.who_am_i)
    access = RegisterAccess(bench.wires.open, ADDRESS, bench.imu.counters, bench.time.sleep)
    access.reopen(0x75)
    assert read_trim_codes(access, model) == codes


@ALL
def test_a_sound_unit_passes_and_streams_on(model: ChipModel) -> None:
    unit = draw_chip_unit(np.random.default_rng(4))
    bench = ImuBench(still, unit, who_am_i=model.who_am_i).opened()
    samples = bench.run(2.0)
    result = bench.imu.self_test()
    assert result.passed
    assert result.chip == model.name
    assert [axis.axis for axis in result.axes] == list(AXES)
    assert all(abs(axis.change_share) < 0.05 for axis in result.axes)
    samples += bench.run(2.0)
    assert len(samples) > 380
    assert samples[200].lost_before == pytest.approx(190, abs=40)
    assert np.linalg.norm(samples[-1].sf_B_mps2) == pytest.approx(9.8, abs=0.8)
    assert bench.imu.counters.resets == 0


@pytest.mark.parametrize("model", [MPU6050, MPU6500], ids=lambda model: model.name)
@pytest.mark.parametrize("failed", range(6))
def test_an_axis_that_answers_by_a_fraction_fails_alone(model: ChipModel, failed: int) -> None:
    push_share = np.ones(6)
    push_share[failed] = 0.3
    unit = dataclasses.replace(NOISY, push_share=push_share)
    result = ImuBench(still, unit, who_am_i=model.who_am_i).opened().imu.self_test()
    assert [axis.passed for axis in result.axes] == [place != failed for place in range(6)]
    assert not result.passed
    assert result.axes[failed].change_share == pytest.approx(-0.7, abs=0.02)


@pytest.mark.parametrize(("share", "passes"), [(1.13, True), (0.87, True), (1.16, False), (0.84, False)])
def test_the_mpu6050s_limit_is_14_percent(share: float, passes: bool) -> None:
    unit = dataclasses.replace(NOISY, push_share=np.full(6, share))
    result = ImuBench(still, unit).opened().imu.self_test()
    assert [axis.passed for axis in result.axes] == [passes] * 6


def test_without_a_factory_code_an_mpu6050_cannot_pass_and_a_relative_is_held_to_absolute_limits() -> None:
    unit = dataclasses.replace(NOISY, trim_codes=TrimCodes((0, 15, 19), (13, 11, 14)))
    result = ImuBench(still, unit).opened().imu.self_test()
    assert [axis.passed for axis in result.axes] == [False, True, True, True, True, True]
    assert math.isnan(result.axes[0].change_share)
    relative = ImuBench(still, unit, who_am_i=0x70).opened().imu.self_test()
    assert [axis.passed for axis in relative.axes] == [False, False, False, True, True, True]  # 0, 184 and 191 mg


def test_a_unit_that_moves_is_not_tested() -> None:
    bench = ImuBench().opened()
    with pytest.raises(DeviceError, match=r"the unit moves .* must lie at rest"):
        bench.imu.self_test()
    assert len(bench.run(1.0)) == pytest.approx(100, abs=3)


def test_a_unit_that_is_turned_meanwhile_is_not_tested() -> None:
    def turned(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        sf, w = still(t_ns)
        later = t_ns > 1_000_000_000_000 + 1_700_000_000
        sf[later] = [9.80665, 0.0, 0.0]
        return sf, w

    bench = ImuBench(turned).opened()
    with pytest.raises(DeviceError, match=r"the unit (was turned|moves)"):
        bench.imu.self_test()
    assert len(bench.run(1.0)) == pytest.approx(100, abs=3)


def test_a_bus_that_fails_meanwhile_is_told_and_the_next_read_starts_over() -> None:
    bench = ImuBench(still).opened()
    bench.wires.stick()
    with pytest.raises(DeviceError, match="timed out"):
        bench.imu.self_test()
    bench.wires.release()
    assert len(bench.run(1.0)) > 90

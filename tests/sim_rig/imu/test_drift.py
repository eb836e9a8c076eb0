"""What becomes of a chip's biases, and that its own thermometer tells it."""

from dataclasses import replace
from math import exp, radians

import numpy as np
import pytest

from drivers.imu.registers import Register
from messages.arrays import FloatArray
from sim_rig.imu.chip_unit import ChipUnit, draw_chip_unit
from sim_rig.imu.drift import NO_DRIFT, WARMING_S, Drift, Drifting
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer
from tests.bench.imu_bench import SimulatedTime, still

PER_K = replace(
    ChipUnit(), w_bias_radps_per_K=np.radians([0.05, -0.03, 0.1]), sf_bias_mps2_per_K=np.array([2e-3, -1e-3, 4e-3])
)


def outputs(drift: Drift, at_s: float, unit: ChipUnit = PER_K) -> FloatArray:
    """Return accelerometer (m/s²), temperature (°C) and gyroscope (rad/s), (7,), the mean of a few samples."""
    clock = SimulatedTime()
    power_on_ns = clock()
    chip = Mpu6050Chip(still, unit, clock, 1, drifting=Drifting(drift, power_on_ns))
    clock.sleep(at_s)
    for register, value in ((Register.CONFIG, 3), (Register.SMPLRT_DIV, 9), (Register.PWR_MGMT_1, 1)):
        chip.write(bytes([register, value]))
    read = []
    for _ in range(20):
        clock.sleep(0.02)
        chip.write(bytes([Register.ACCEL_XOUT_H]))
        read.append(np.frombuffer(chip.read(14), dtype=">i2").astype(np.float64))
    mean = np.mean(read, axis=0)
    physical: FloatArray = np.concatenate(
        (mean[:3] / 16384 * 9.80665, mean[3:4] / 340 + 36.53, np.radians(mean[4:] / 131))
    )
    return physical


def test_the_register_tells_the_temperature_that_moves_the_biases() -> None:
    drift = Drift(warming_K=12.0, air_steps=((400.0, -20.0),))
    warm = outputs(NO_DRIFT, 0.1)
    for at_s, rise_K in (
        (0.1, -12.0 * exp(-0.3 / WARMING_S)),
        (WARMING_S, -12.0 * exp(-1.0)),
        (3000.0, -20.0),
    ):
        change = outputs(drift, at_s) - warm
        assert change[3] == pytest.approx(rise_K, abs=0.03)
        np.testing.assert_allclose(change[4:], rise_K * PER_K.w_bias_radps_per_K, atol=2e-4)
        np.testing.assert_allclose(change[:3], rise_K * PER_K.sf_bias_mps2_per_K, atol=1e-3)


def test_a_bias_moves_and_jumps_as_told_and_the_thermometer_stays() -> None:
    rate, jump = radians(1.0) / 60.0, (radians(0.8), 0.0, radians(-2.0))
    drift = Drift(w_rate_radps2=(rate, -rate, 3 * rate), w_steps=((30.0, jump),))
    start = outputs(drift, 0.0)
    for at_s, jumps in ((20.0, 0.0), (60.0, 1.0), (180.0, 1.0)):
        change = outputs(drift, at_s) - start
        assert change[3] == 0.0
        np.testing.assert_allclose(
            change[4:], at_s * np.array((rate, -rate, 3 * rate)) + jumps * np.array(jump), atol=3e-4
        )


def test_drawn_coefficients_are_within_the_data_sheet() -> None:
    units = [draw_chip_unit(np.random.default_rng(seed)) for seed in range(200)]
    w, sf = (np.array([getattr(unit, name) for unit in units]) for name in ("w_bias_radps_per_K", "sf_bias_mps2_per_K"))
    assert np.degrees(np.abs(w).max()) <= 0.16
    assert np.degrees(w.std()) == pytest.approx(0.053, rel=0.1)
    assert (np.abs(sf).max(axis=0) <= np.array([0.5e-3, 0.5e-3, 0.86e-3]) * 9.80665).all()


def test_the_driver_reads_the_warming_of_the_scenario() -> None:
    wearer = SimulatedWearer(3, scenario("warming"), 10**10)
    *_, last = wearer.offline_samples(0.3)
    warm = wearer.unit.chip.temperature_degC
    assert last.temperature_degC == pytest.approx(warm - 12.0, abs=0.1)

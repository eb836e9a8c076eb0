import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.imu.settings import Mpu6050Settings
from sim_rig.imu.chip_unit import ChipUnit, draw_chip_unit
from tests.bench.imu_bench import ImuBench, lost_by_truth

units = st.builds(
    lambda seed, clock_error: dataclasses.replace(draw_chip_unit(np.random.default_rng(seed)), clock_error=clock_error),
    st.integers(0, 2**32 - 1),
    st.floats(-0.01, 0.01),
)
chip_settings = st.builds(
    Mpu6050Settings,
    rate_hz=st.sampled_from([50, 100, 200]),
    accel_range_g=st.sampled_from([2, 4, 8, 16]),
    gyro_range_deg_per_s=st.sampled_from([250, 500, 1000, 2000]),
    filter_row=st.sampled_from([1, 2, 3, 4, 5]),
)


@pytest.mark.long
@settings(max_examples=15, deadline=None, derandomize=True)
@given(unit=units, chip=chip_settings, poll_s=st.floats(0.003, 0.009), seed=st.integers(0, 1000))
def test_normal_running_loses_nothing_at_any_clock_error(
    unit: ChipUnit, chip: Mpu6050Settings, poll_s: float, seed: int
) -> None:
    bench = ImuBench(unit=unit, settings=chip, seed=seed).opened()
    samples = bench.run(6.0, poll_s=poll_s)
    rate_hz = chip.rate_hz * (1.0 + bench.unit.clock_error)
    assert abs(len(samples) - 6.0 * rate_hz) <= 3
    assert bench.imu.counters.lost == lost_by_truth(bench, samples) == 0
    assert bench.imu.counters.resets == bench.imu.counters.fifo_overflows == 0
    assert abs(bench.imu.period_s * rate_hz - 1.0) < 1e-3
    stamps_ns = [sample.t_sample_ns for sample in samples]
    assert np.all(np.diff(stamps_ns) > 0)


@pytest.mark.long
@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    unit=units,
    smbus_only=st.booleans(),
    pauses_s=st.lists(st.floats(0.0, 3.0), min_size=1, max_size=4),
    seed=st.integers(0, 1000),
)
def test_whatever_the_pauses_every_sample_is_delivered_or_counted(
    unit: ChipUnit, smbus_only: bool, pauses_s: list[float], seed: int
) -> None:
    bench = ImuBench(unit=unit, smbus_only=smbus_only, seed=seed).opened()
    samples = bench.run(0.5, jittery=False)  # a phase must be known before late polls can be told apart
    samples += bench.run(8.0)
    for pause_s in pauses_s:
        bench.pause(pause_s)
        samples += bench.run(0.5)
    lost = [sample.lost_before for sample in samples]
    assert sum(lost) == bench.imu.counters.lost == lost_by_truth(bench, samples)
    assert [sample.seq for sample in samples] == list(np.cumsum(np.array(lost) + 1))
    assert bench.imu.counters.resets == 0


line_events = st.lists(
    st.tuples(st.sampled_from(["lose", "cut", "mend", "away", "back", "pause", "drift", "none"]), st.floats(0.0, 1.0)),
    min_size=1,
    max_size=6,
)


@pytest.mark.long
@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    unit=units,
    clock_error=st.floats(-0.03, 0.03),
    late_share=st.floats(0.0, 0.3),
    events=line_events,
    seed=st.integers(0, 1000),
)
def test_whatever_becomes_of_the_line_no_sample_is_lost_unseen_and_no_stamp_runs_backwards(
    unit: ChipUnit, clock_error: float, late_share: float, events: list[tuple[str, float]], seed: int
) -> None:
    bench = ImuBench(unit=dataclasses.replace(unit, clock_error=clock_error), with_line=True, seed=seed).opened()
    bench.line.late_share = late_share
    samples = bench.follow(3.0)
    for event, share in events:
        if event == "lose":
            bench.line.lose(round(20 * share))
        elif event in ("cut", "mend"):
            bench.line.cut(event == "cut")
        elif event in ("away", "back"):
            bench.line.take_away(event == "away")
        elif event == "pause":
            bench.pause(2.0 * share)
        elif event == "drift":
            bench.chip.set_clock(1.0 + 2e-4 * (share - 0.5))
        samples += bench.follow(1.5)
    lost = [sample.lost_before for sample in samples]
    assert sum(lost) == bench.imu.counters.lost == lost_by_truth(bench, samples)
    assert [sample.seq for sample in samples] == list(np.cumsum(np.array(lost) + 1))
    assert np.all(np.diff([sample.t_sample_ns for sample in samples]) > 0)
    assert np.max(np.abs(bench.stamp_errors_s(samples[100:]))) < 1.5e-3
    assert bench.imu.counters.resets == 0

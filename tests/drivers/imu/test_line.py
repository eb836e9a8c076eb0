"""The driver on its data-ready line: exact times, late and lost edges, a wire that breaks."""

import dataclasses

import numpy as np
import pytest

from messages.arrays import FloatArray
from tests.bench.imu_bench import NOISY, ImuBench, lost_by_truth


def errors_ms(bench: ImuBench, seconds: float, settle_s: float = 1.0) -> FloatArray:
    samples = bench.follow(seconds)
    assert lost_by_truth(bench, samples) == bench.imu.counters.lost == 0
    assert np.all(np.diff([sample.t_sample_ns for sample in samples]) > 0)
    return 1e3 * bench.stamp_errors_s(samples)[round(100 * settle_s) :]


@pytest.mark.parametrize("clock_error", [-0.03, 0.0, 0.004, 0.03])
def test_edges_date_samples_to_some_hundredths_of_a_millisecond(clock_error: float) -> None:
    bench = ImuBench(unit=dataclasses.replace(NOISY, clock_error=clock_error), with_line=True).opened()
    late = errors_ms(bench, 15.0)
    assert np.sqrt(np.mean(late**2)) < 0.05
    assert np.max(np.abs(late)) < 0.15
    assert bench.imu.period_s == pytest.approx(0.010 / (1.0 + clock_error), rel=1e-5)


@pytest.mark.parametrize("late_share", [0.1, 0.5])
def test_many_late_interrupts_make_little_difference(late_share: float) -> None:
    bench = ImuBench(with_line=True).opened()
    bench.line.late_share = late_share
    late = errors_ms(bench, 15.0)
    assert np.sqrt(np.mean(late**2)) < 0.15
    assert np.max(np.abs(late)) < 0.6


@pytest.mark.parametrize(("with_line", "limit_ms"), [(True, 0.1), (False, 0.5)])
def test_a_clock_that_drifts_by_a_percent_a_minute_is_followed(with_line: bool, limit_ms: float) -> None:
    bench = ImuBench(with_line=with_line).opened()
    samples = []
    for step in range(250):
        bench.chip.set_clock(1.0 + 0.01 * step / 600)
        samples += bench.follow(0.1)
    late = 1e3 * bench.stamp_errors_s(samples)[300:]
    assert np.sqrt(np.mean(late**2)) < limit_ms
    assert lost_by_truth(bench, samples) == bench.imu.counters.lost == 0
    assert np.all(np.diff([sample.t_sample_ns for sample in samples]) > 0)


def test_a_sample_is_handed_on_as_soon_as_it_is_ready() -> None:
    bench = ImuBench(with_line=True).opened()
    samples = bench.follow(5.0)
    delay_ns = bench.filter_delay_ns()
    waited_ms = [1e-6 * (sample.t_arrival_ns - sample.t_sample_ns - delay_ns) for sample in samples]
    assert np.median(waited_ms) < 1.0


def test_lost_edges_are_counted_and_cost_no_sample() -> None:
    bench = ImuBench(with_line=True).opened()
    bench.follow(2.0)
    before = bench.imu.counters.edges_missed
    for _ in range(20):
        bench.line.lose(1)
        errors_ms(bench, 0.2, settle_s=0.0)
    assert bench.imu.counters.edges_missed - before == 20


@pytest.mark.parametrize("fault", ["cut", "take_away"])
def test_a_line_that_falls_silent_leaves_polling_and_comes_back(fault: str) -> None:
    bench = ImuBench(with_line=True).opened()
    late = errors_ms(bench, 5.0)
    getattr(bench.line, fault)(True)
    samples = bench.follow(5.0)
    waits_ms = 1e-6 * np.diff([sample.t_arrival_ns for sample in samples])
    assert np.percentile(waits_ms, 90) < 16.0
    assert bench.imu.counters.edges_missed == pytest.approx(500, abs=10)
    assert np.max(np.abs(bench.stamp_errors_s(samples))) < 0.5e-3
    getattr(bench.line, fault)(False)
    bench.follow(2.0)
    missed = bench.imu.counters.edges_missed
    late = errors_ms(bench, 5.0)
    assert bench.imu.counters.edges_missed - missed <= 1
    assert np.sqrt(np.mean(late**2)) < 0.05
    assert bench.imu.counters.resets == 0


def test_a_line_that_is_dead_from_the_start_is_as_good_as_polling() -> None:
    bench = ImuBench(with_line=True)
    bench.line.cut()
    late = errors_ms(bench.opened(), 20.0, settle_s=10.0)
    assert np.sqrt(np.mean(late**2)) < 0.3


def test_edges_that_waited_while_the_host_was_held_up_find_their_samples() -> None:
    bench = ImuBench(with_line=True).opened()
    samples = bench.follow(3.0)
    for pause_s in (0.03, 0.2, 0.5, 0.9, 3.0):
        bench.pause(pause_s)
        samples += bench.follow(1.0)
    assert lost_by_truth(bench, samples) == bench.imu.counters.lost > 100
    assert bench.imu.counters.fifo_overflows == 2
    assert np.max(np.abs(bench.stamp_errors_s(samples)[100:])) < 0.3e-3


def test_reading_returns_when_the_time_is_up_and_nothing_came() -> None:
    bench = ImuBench(with_line=True).opened()
    bench.follow(1.0)
    bench.chip.brown_out()
    start_ns = bench.time.now_ns
    assert bench.imu.read(timeout_s=0.02) == []
    assert bench.time.now_ns - start_ns == pytest.approx(20_000_000, abs=2_000_000)

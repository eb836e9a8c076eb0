"""The clock is judged on simulated time alone: how far its stamps are from the instants it never saw."""

from dataclasses import dataclass

import numpy as np
import pytest

from drivers.imu.sample_clock import SampleClock
from messages.arrays import FloatArray, IntArray

PERIOD_S = 0.010
TRANSFER_NS = 250_000
START_NS = 5_000_000_000_000


@dataclass
class Polled:
    """What a polled chip's clock made of its samples."""

    clock: SampleClock
    truth_ns: IntArray
    stamps_ns: IntArray
    missed: int

    def errors_ms(self, *, after_s: float) -> FloatArray:
        late = self.truth_ns - START_NS > after_s * 1e9
        return ((self.stamps_ns - self.truth_ns)[late] / 1e6).astype(np.float64)


def poll(
    clock_error: float,
    seed: int,
    *,
    duration_s: float = 20.0,
    poll_s: float = 0.005,
    drift_per_s: float = 0.0,
    chip_stops_s: tuple[float, float] | None = None,
) -> Polled:
    """Poll a FIFO's count every `poll_s`, late by 1 ms on average (exponential) and once in 200 times by 10 ms more."""
    rng = np.random.default_rng(seed)
    period_ns = PERIOD_S * 1e9 / (1.0 + clock_error)
    k = np.arange(int(duration_s / PERIOD_S * 1.05) + 10)
    since_start = rng.uniform(0.0, period_ns) + k * period_ns * (1.0 + 0.5 * drift_per_s * k * period_ns * 1e-9)
    if chip_stops_s is not None:
        begin, end = chip_stops_s
        since_start = since_start[(since_start < begin * 1e9) | (since_start > end * 1e9)]
    truth_ns = START_NS + np.rint(since_start).astype(np.int64)
    clock = SampleClock(PERIOD_S)
    clock.restart(0, START_NS)
    t_ns, seen, missed, stamps = START_NS, 0, 0, []
    for tick in range(int(duration_s / poll_s)):
        late_s = rng.exponential(0.001) + 0.010 * (rng.random() < 0.005)
        t_ns = max(t_ns + TRANSFER_NS, START_NS + round((tick * poll_s + late_s) * 1e9))
        now = int(np.searchsorted(truth_ns, t_ns + TRANSFER_NS // 3, side="right"))
        if now > seen:
            missed += clock.missed(now + missed, t_ns)
        newest = now + missed
        clock.pending_at(newest + 1, t_ns)
        if now > seen:
            clock.completed_by(newest, t_ns + TRANSFER_NS)
            stamps += [clock.stamp(newest - back) for back in range(now - seen)[::-1]]
            seen = now
    return Polled(clock, truth_ns[:seen], np.array(stamps), missed)


@pytest.mark.parametrize("clock_error", [-0.038, -0.01, -0.0002, 0.0, 0.003, 0.01, 0.04])
def test_stamps_are_far_better_than_the_polling_that_they_come_from(clock_error: float) -> None:
    for seed in range(3):
        polled = poll(clock_error, seed)
        errors_ms = polled.errors_ms(after_s=10.0)
        assert abs(np.mean(errors_ms)) < 0.2
        assert np.sqrt(np.mean(errors_ms**2)) < 0.3
        assert np.max(np.abs(polled.errors_ms(after_s=0.0))) < 5.0
        assert np.all(np.diff(polled.stamps_ns) > 0)
        assert polled.missed == 0
        assert polled.clock.period_s == pytest.approx(PERIOD_S / (1.0 + clock_error), rel=1e-4)


def test_a_grid_that_is_no_fraction_of_the_period_is_better_still() -> None:
    errors_ms = np.concatenate([poll(0.0, seed, poll_s=0.0047).errors_ms(after_s=3.0) for seed in range(5)])
    assert np.sqrt(np.mean(errors_ms**2)) < 0.1


def test_a_warming_crystal_is_followed() -> None:
    polled = poll(0.003, 1, duration_s=60.0, drift_per_s=14e-6)  # 0.1 °C a second at 1 % over 70 °C
    assert np.sqrt(np.mean(polled.errors_ms(after_s=20.0) ** 2)) < 0.3
    assert polled.missed == 0


def test_interval_between_stamps_is_steady_once_settled() -> None:
    polled = poll(0.004, 2)
    jitter_ms = (np.diff(polled.stamps_ns) - np.diff(polled.truth_ns))[1000:] * 1e-6
    assert np.std(jitter_ms) < 0.05


def test_a_chip_that_stops_for_a_while_has_missed_samples_and_keeps_its_line() -> None:
    polled = poll(0.002, 4, duration_s=15.0, chip_stops_s=(12.0, 13.0))
    assert polled.missed == pytest.approx(100, abs=1)
    assert np.max(np.abs(polled.errors_ms(after_s=10.0))) < 0.4


@pytest.mark.long
def test_a_chip_far_outside_its_datasheet_still_gets_increasing_stamps() -> None:
    polled = poll(-0.08, 1)
    assert np.all(np.diff(polled.stamps_ns) > 0)


def settled_clock() -> tuple[SampleClock, int]:
    """Return a clock that has seen 1000 samples, each within ±0.1 ms, and the instant of the newest."""
    clock = SampleClock(PERIOD_S)
    clock.restart(0, START_NS)
    for index in range(1, 1001):
        t_ns = START_NS + index * 10_000_000
        clock.pending_at(index, t_ns - 100_000)
        clock.completed_by(index, t_ns + 100_000)
        clock.stamp(index)
    return clock, START_NS + 1000 * 10_000_000


def test_samples_are_counted_from_time_alone() -> None:
    clock, newest_ns = settled_clock()
    assert clock.completed_at(newest_ns + 5_000_000) == 1000
    assert clock.completed_at(newest_ns + 995_000_000) == 1099
    assert clock.missed(1000, newest_ns + 9_000_000) == 0
    assert clock.missed(1000, newest_ns + 32_000_000) == 3
    assert clock.until_mid_period_s(newest_ns + 2_000_000) == pytest.approx(0.003, abs=1e-5)
    assert clock.until_mid_period_s(newest_ns + 7_000_000) == pytest.approx(0.008, abs=1e-5)


def test_doubt_lasts_until_the_boundary_is_surely_behind() -> None:
    clock, newest_ns = settled_clock()
    assert clock.ambiguous_s(1000, newest_ns + 5_000_000) == 0.0
    near_ns = newest_ns + 9_900_000
    ambiguous_s = clock.ambiguous_s(1000, near_ns)
    assert 0.0 < ambiguous_s < 0.001
    assert clock.missed(1000, near_ns) == 0
    assert clock.missed(1000, near_ns + round(ambiguous_s * 1e9) + 1000) == 1
    assert clock.ambiguous_s(1001, near_ns) == 0.0


def test_a_restart_forgets_the_phase_and_keeps_the_period() -> None:
    polled = poll(0.01, 1, duration_s=12.0)
    clock = polled.clock
    period_s = clock.period_s
    count = polled.truth_ns.size
    t_ns = int(polled.truth_ns[-1]) + 500_000_000
    assert clock.completed_at(t_ns) == pytest.approx(count + 50, abs=1)
    clock.restart(count + 50, t_ns)
    assert clock.period_s == period_s
    clock.completed_by(count + 51, t_ns + 6_000_000)
    assert t_ns < clock.stamp(count + 51) < t_ns + 6_000_000


def test_a_line_that_is_contradicted_is_given_up() -> None:
    clock, newest_ns = settled_clock()
    for index in range(1001, 1200):  # the same pace, 4 ms earlier
        t_ns = newest_ns + (index - 1000) * 10_000_000 - 4_000_000
        clock.pending_at(index, t_ns - 100_000)
        clock.completed_by(index, t_ns + 100_000)
        stamp_ns = clock.stamp(index)
    assert stamp_ns == pytest.approx(t_ns, abs=200_000)


def test_nothing_is_known_before_the_first_sample() -> None:
    clock = SampleClock(PERIOD_S)
    clock.restart(0, START_NS)
    assert clock.uncertainty_s == np.inf
    assert clock.missed(0, START_NS + 10**9) == 0
    assert clock.ambiguous_s(0, START_NS + 10**9) == 0.0
    with pytest.raises(ValueError, match="sample 1 was never observed"):
        clock.stamp(1)


def with_edges(
    seed: int, *, late_share: float = 0.01, lost_share: float = 0.0, clock_error: float = 0.0, seconds: float = 20.0
) -> FloatArray:
    """Return the stamps' errors, ms; interrupts are 20 µs late, a share of them up to 3 ms."""
    rng = np.random.default_rng(seed)
    period_ns = PERIOD_S * 1e9 / (1.0 + clock_error)
    clock = SampleClock(PERIOD_S)
    clock.restart(0, START_NS)
    errors_ns = []
    for index in range(1, int(seconds / PERIOD_S)):
        truth_ns = START_NS + round((index - 0.4) * period_ns)
        late_s = rng.uniform(0.0, 0.003) if rng.random() < late_share else rng.exponential(20e-6)
        edge_ns = truth_ns + round(late_s * 1e9)
        assert clock.edge_index(edge_ns) in (None, index)
        if rng.random() >= lost_share:
            clock.edge_at(index, edge_ns)
        clock.pending_at(index + 1, edge_ns + 200_000)
        clock.completed_by(index, edge_ns + 400_000)
        errors_ns.append(clock.stamp(index) - truth_ns)
    assert clock.period_s == pytest.approx(period_ns * 1e-9, rel=1e-5)
    return np.array(errors_ns) * 1e-6


@pytest.mark.parametrize("clock_error", [-0.03, 0.0, 0.0023, 0.03])
@pytest.mark.parametrize("lost_share", [0.0, 0.3])
def test_interrupts_make_stamps_exact_within_a_second(clock_error: float, lost_share: float) -> None:
    for seed in range(3):
        errors_ms = with_edges(seed, clock_error=clock_error, lost_share=lost_share)
        assert np.sqrt(np.mean(errors_ms[100:] ** 2)) < 0.05
        assert np.max(np.abs(errors_ms[100:])) < 0.12


def test_late_interrupts_do_not_draw_the_stamps_after_them() -> None:
    for seed in range(5):
        errors_ms = with_edges(seed, late_share=0.4)[100:]
        assert np.sqrt(np.mean(errors_ms**2)) < 0.1
        assert np.max(np.abs(errors_ms)) < 0.6


def test_a_drifting_clock_is_seen_through_a_shorter_window() -> None:
    polled = poll(0.0, 3, duration_s=60.0, poll_s=0.0047, drift_per_s=0.01 / 60.0)
    errors_ms = polled.errors_ms(after_s=5.0)
    assert np.sqrt(np.mean(errors_ms**2)) < 0.8
    assert polled.missed == 0
    assert np.all(np.diff(polled.stamps_ns) > 0)


@pytest.mark.parametrize(("jump", "most_ms"), [(0.01, 0.6), (0.03, 1.5), (-0.03, 5.0)])
def test_a_clock_that_jumps_is_followed_from_the_first_bound_that_refutes_its_line(jump: float, most_ms: float) -> None:
    """A slow one shows later: interrupts may be late, so that several in a row must be."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        clock = SampleClock(PERIOD_S)
        clock.restart(0, START_NS)
        since_start, errors_ns = 0.006, []
        for index in range(1, 1_200):
            edge_ns = START_NS + round(since_start * 1e9)
            if clock.edge_index(edge_ns) in (None, index):
                clock.edge_at(index, edge_ns + round(rng.exponential(20e3)))
            clock.pending_at(index + 1, edge_ns + 200_000)
            clock.completed_by(index, edge_ns + 400_000)
            errors_ns.append(clock.stamp(index) - edge_ns)
            since_start += PERIOD_S / (1.0 + (jump if index >= 600 + seed * 5 else 0.0))
        errors_ms = 1e-6 * np.array(errors_ns)
        assert np.max(np.abs(errors_ms[500:])) < most_ms
        assert np.max(np.abs(errors_ms[700:])) < 0.2

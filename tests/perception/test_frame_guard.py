"""The frame guard: repeated pictures and stamps that contradict the arrival."""

import numpy as np
from numpy.typing import NDArray

from messages import FrameHeader, Reason
from perception.frame_guard import FrameGuard

LATENCY_NS = 38_000_000
PERIOD_NS = 50_000_000


def header(k: int, latency_ns: int = LATENCY_NS) -> FrameHeader:
    t_arrival_ns = 10**12 + k * PERIOD_NS
    return FrameHeader(
        seq=k,
        t_exposure_ns=t_arrival_ns - latency_ns,
        t_arrival_ns=t_arrival_ns,
        exposure_s=0.004,
        width_px=64,
        height_px=48,
    )


def pictures(seed: int, count: int) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    rng = np.random.default_rng(seed)
    return [(left, right) for left, right in rng.integers(0, 255, (count, 2, 48, 64), dtype=np.uint8)]


def judged(guard: FrameGuard, latencies_ns: list[int], seed: int = 1) -> list[Reason]:
    views = pictures(seed, len(latencies_ns))
    return [guard.check(header(k, late), view) for k, (late, view) in enumerate(zip(latencies_ns, views, strict=True))]


def test_new_pictures_with_a_busy_hosts_delays_pass() -> None:
    delays = np.random.default_rng(2).exponential(8e6, 400).astype(int).tolist()
    assert set(judged(FrameGuard(), [LATENCY_NS + min(d, 60_000_000) for d in delays])) == {Reason.NONE}


def test_a_repeated_picture_is_frozen_at_once_and_a_new_one_is_not() -> None:
    guard = FrameGuard()
    (first, second) = pictures(3, 2)
    assert guard.check(header(0), first) is Reason.NONE
    assert guard.check(header(1), tuple(eye.copy() for eye in first)) is Reason.FROZEN_FRAME
    assert guard.check(header(2), second) is Reason.NONE


def test_one_frozen_eye_is_enough() -> None:
    guard = FrameGuard()
    (first, second) = pictures(4, 2)
    guard.check(header(0), first)
    assert guard.check(header(1), (second[0], first[1])) is Reason.FROZEN_FRAME


def test_uniform_pictures_are_left_to_the_matcher() -> None:
    guard, black = FrameGuard(), np.zeros((48, 64), np.uint8)
    assert [guard.check(header(k), (black, black)) for k in range(3)] == [Reason.NONE] * 3


def test_stamps_from_the_future_or_of_long_ago_are_refused() -> None:
    assert judged(FrameGuard(), [-1, LATENCY_NS, 2_100_000_000]) == [
        Reason.TIME_INCONSISTENT,
        Reason.NONE,
        Reason.TIME_INCONSISTENT,
    ]


def test_stamps_that_jump_forward_are_refused_until_they_are_the_rule() -> None:
    jumped = [LATENCY_NS] * 30 + [LATENCY_NS - 20_000_000] * (FrameGuard.relearn_after + 5)
    reasons = judged(FrameGuard(), jumped)
    assert set(reasons[:30]) == {Reason.NONE}
    assert set(reasons[30 : 30 + FrameGuard.relearn_after]) == {Reason.TIME_INCONSISTENT}
    assert set(reasons[-4:]) == {Reason.NONE}


def test_frames_that_were_late_for_long_and_are_punctual_again_pass() -> None:
    late = [LATENCY_NS] * 30 + [LATENCY_NS + 80_000_000] * 300 + [LATENCY_NS] * 30
    assert set(judged(FrameGuard(), late)) == {Reason.NONE}


def test_after_a_silence_the_timing_is_learnt_anew() -> None:
    guard = FrameGuard()
    judged(guard, [LATENCY_NS] * 30)
    guard.reset_timing()
    assert set(judged(guard, [LATENCY_NS - 20_000_000] * 5, seed=5)) == {Reason.NONE}


def test_a_silence_of_wrong_stamps_does_not_refuse_the_right_ones_after_it() -> None:
    guard = FrameGuard()
    judged(guard, [LATENCY_NS] * 30)
    guard.reset_timing()
    old = [LATENCY_NS + 1_000_000_000] * 60
    assert set(judged(guard, [*old, *[LATENCY_NS + 500_000] * 30], seed=6)) == {Reason.NONE}
    assert judged(guard, [LATENCY_NS - 20_000_000], seed=7) == [Reason.TIME_INCONSISTENT]


def test_another_camera_whose_stamps_jump_forward_is_refused_after_a_silence_as_well() -> None:
    guard = FrameGuard()
    judged(guard, [LATENCY_NS] * 30)
    guard.reset_timing()
    slower = [LATENCY_NS + 60_000_000] * 30
    assert set(judged(guard, [*slower, *[LATENCY_NS - 30_000_000] * 20], seed=8)[30:]) == {Reason.TIME_INCONSISTENT}


def test_a_backlog_of_frames_that_arrive_together_teaches_nothing() -> None:
    guard = FrameGuard()
    arrival_ns = 10**12
    backlog = [
        FrameHeader(
            seq=k,
            t_exposure_ns=arrival_ns - LATENCY_NS - (24 - k) * PERIOD_NS,
            t_arrival_ns=arrival_ns,
            exposure_s=0.004,
            width_px=64,
            height_px=48,
        )
        for k in range(25)
    ]
    views = pictures(6, 25)
    assert {guard.check(late, view) for late, view in zip(backlog, views, strict=True)} == {Reason.NONE}
    assert set(judged(guard, [LATENCY_NS] * 30, seed=7)) == {Reason.NONE}

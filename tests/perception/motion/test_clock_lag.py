"""The lag between IMU and camera: measured, said within 3 s of motion, never without motion."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from perception.motion.clock_lag import CameraTurns, ClockLagMonitor, ImuRates, lag_of
from perception.motion.ego_motion import EgoMotion
from sim_rig.unit import draw_unit
from tests.bench.seen_motion import (
    FRAME_NS,
    R_BC,
    START_NS,
    WALKING_NS,
    SampleAt,
    arrivals_until,
    calibration_of_the_camera,
    gait,
    imu_samples,
    seen,
)

S = 1_000_000_000
CALIBRATION = calibration_of_the_camera(draw_unit(4).exact_calibration())
WALK = gait(5)
STEPS = 24


def heard(to_ns: int, late_ns: Callable[[int], int], seed: int = 5, name: str = "level") -> list[tuple[int, bool]]:
    """Return what a monitor says, with the time of each word, of steps that are stamped late."""
    monitor, words, now_ns = ClockLagMonitor(CALIBRATION, np.eye(3)), [], START_NS
    for arrival in arrivals_until(to_ns, seed, name):
        if isinstance(arrival, SampleAt):
            monitor.add_sample(arrival.t_ns, arrival.w_B_radps)
            now_ns = arrival.t_ns
            continue
        before_ns, after_ns = arrival.t_before_ns, arrival.t_after_ns
        by_ns = late_ns(after_ns)
        late = replace(arrival, t_before_ns=before_ns + by_ns, t_after_ns=after_ns + by_ns)
        monitor.add_motion(late)
        monitor.update()
        words.append((now_ns, monitor.contradicts))
    return words


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_a_walk_raises_no_alarm(seed: int) -> None:
    assert not any(said for _, said in heard(WALKING_NS + 5 * S, lambda _: 0, seed))


def test_standing_tells_nothing() -> None:
    assert not any(said for _, said in heard(START_NS + 6 * S, lambda _: 80_000_000, name="standing"))


@pytest.mark.parametrize("by_ms", [-80, -50, -20, 20, 50, 80])
def test_stamps_that_are_off_are_seen_in_two_seconds(by_ms: int) -> None:
    words = heard(WALKING_NS + 3 * S, lambda _: by_ms * 1_000_000)
    assert next(t_ns for t_ns, said in words if said) < WALKING_NS + 2 * S
    assert words[-1][1]


@pytest.mark.parametrize("by_ms", [-6, 6])
def test_stamps_that_are_off_by_less_than_stated_are_left_alone(by_ms: int) -> None:
    assert not any(said for _, said in heard(WALKING_NS + 4 * S, lambda _: by_ms * 1_000_000))


@pytest.mark.parametrize("rate", [-0.01, 0.01])
def test_a_clock_that_drifts_is_seen_in_three_seconds(rate: float) -> None:
    words = heard(WALKING_NS + 4 * S, lambda t_ns: round(rate * max(0, t_ns - WALKING_NS)))
    assert next(t_ns for t_ns, said in words if said) < WALKING_NS + 3 * S
    assert words[-1][1]


def test_stamps_that_are_right_again_are_believed_in_two_seconds() -> None:
    end_ns = WALKING_NS + 2 * S
    words = heard(end_ns + 3 * S, lambda t_ns: 50_000_000 if t_ns < end_ns else 0)
    assert any(said for _, said in words)
    assert max(t_ns for t_ns, said in words if said) < end_ns + 2 * S


def stretch(noise: float = 0.0, late_ns: int = 0) -> tuple[CameraTurns, ImuRates]:
    """Return a second of walking; its steps are stamped `late_ns` after they were."""
    steps: list[EgoMotion] = [
        seen(WALK, t_ns, t_ns + FRAME_NS, noise) for t_ns in range(WALKING_NS, WALKING_NS + STEPS * FRAME_NS, FRAME_NS)
    ]
    samples = imu_samples(WALK, WALKING_NS - 300_000_000, WALKING_NS + STEPS * FRAME_NS + 300_000_000)
    return (
        CameraTurns(
            from_s=1e-9 * np.array([s.t_before_ns + late_ns - START_NS for s in steps]),
            to_s=1e-9 * np.array([s.t_after_ns + late_ns - START_NS for s in steps]),
            w_B_radps=np.array([s.w_C_radps for s in steps]) @ R_BC.T,
        ),
        ImuRates(1e-9 * np.array([s.t_ns - START_NS for s in samples]), np.array([s.w_B_radps for s in samples])),
    )


def test_camera_and_imu_agree_on_one_motion() -> None:
    lag = lag_of(*stretch(), longest_s=0.1, grid_s=0.01)
    assert lag.swing_radps.min() > 0.15
    assert lag.misfit_radps.max() < 0.01


@pytest.mark.parametrize("late_ms", [-80, -20, -3, 0, 3, 20, 80])
def test_a_late_stamp_is_a_lag(late_ms: int) -> None:
    lag = lag_of(*stretch(noise=1.0, late_ns=late_ms * 1_000_000), longest_s=0.1, grid_s=0.01)
    assert lag.lag_s == pytest.approx(-1e-3 * late_ms, abs=1.5e-3)
    assert 1e-4 < lag.deviation_s < 2e-3


def test_a_ground_that_turns_ever_faster_is_no_lag() -> None:
    sight, feeling = stretch(noise=1.0)
    riding = replace(feeling, w_B_radps=feeling.w_B_radps + np.outer(feeling.t_s - feeling.t_s[0], (0.1, 0.2, 0.3)))
    assert lag_of(sight, riding, 0.1, 0.01).lag_s == pytest.approx(0.0, abs=1.5e-3)


def test_without_motion_there_is_no_lag() -> None:
    sight, feeling = stretch()
    still = replace(sight, w_B_radps=np.zeros((STEPS, 3)))
    assert lag_of(still, replace(feeling, w_B_radps=np.zeros_like(feeling.w_B_radps)), 0.1, 0.01).deviation_s == np.inf

"""The length of a path: what is gone counts, what sways and what is noise do not."""

import math

import numpy as np
import pytest

from messages import vec3
from messages.arrays import FloatArray
from perception.attitude.camera_step import CameraStep
from perception.attitude.path_length import PathLength, Travel, Way

STEP_NS = 50_000_000
NOISE_M = 0.0003


def walked(points_m: FloatArray, *, seed: int = 1, scale: float = 0.0, scale_std: float = 0.0) -> PathLength:
    """The path through `points_m` (n, 2), one each step, seen with noise by a camera that does not turn."""
    rng, path = np.random.default_rng(seed), PathLength()
    covariance = np.diag([1e-8] * 3 + [NOISE_M**2] * 3)
    for k, travel in enumerate(np.diff(points_m, axis=0)):
        seen = (1.0 + scale) * np.append(travel, 0.0) + rng.normal(0.0, NOISE_M, 3)
        step = CameraStep(k * STEP_NS, (k + 1) * STEP_NS, (0.0, 0.0, 0.0), vec3(seen), covariance, (0.0, 0.0, 0.0))
        path.add_step(step, np.eye(3), 1.0, scale, scale_std)
    return path


def way(path: PathLength) -> Way:
    assert path.end_ns is not None
    return path.at(path.end_ns, Travel(np.zeros(3), np.zeros((3, 3))))


def test_a_straight_walk_is_as_long_as_it_is() -> None:
    line = np.column_stack((np.arange(0.0, 100.0, 0.06), np.zeros(1667)))
    found = way(walked(line))
    assert found.distance_m == pytest.approx(line[-1, 0], abs=0.05)
    assert math.sqrt(found.variance_m2) == pytest.approx(NOISE_M * math.sqrt(len(line)), rel=0.05)


def test_a_curved_walk_loses_next_to_nothing() -> None:
    angle = np.arange(0.0, 20.0, 0.06)
    assert way(walked(np.column_stack((np.cos(angle), np.sin(angle))))).distance_m == pytest.approx(angle[-1], rel=2e-3)


def test_standing_and_swaying_for_five_minutes_is_no_way() -> None:
    t_s = np.arange(0.0, 300.0, 0.05)
    sway_m = np.column_stack((0.01 * np.sin(2.0 * t_s), 0.01 * np.sin(1.3 * t_s)))
    assert way(walked(sway_m)).distance_m < 0.1


def test_the_scale_is_taken_off_and_its_deviation_common_to_all_steps() -> None:
    line = np.column_stack((np.arange(0.0, 50.0, 0.06), np.zeros(834)))
    found = way(walked(line, scale=0.02, scale_std=0.002))
    assert found.distance_m == pytest.approx(line[-1, 0], abs=0.05)
    assert math.sqrt(found.variance_m2) == pytest.approx(0.002 * line[-1, 0], rel=0.05)


def test_steps_whose_rows_overlap_do_not_count_twice() -> None:
    path = PathLength()
    for k in range(100):
        start_ns = k * STEP_NS - (1_000_000 if k else 0)
        travel = (1e-9 * ((k + 1) * STEP_NS - start_ns), 0.0, 0.0)  # at 1 m/s
        path.add_step(
            CameraStep(start_ns, (k + 1) * STEP_NS, (0.0, 0.0, 0.0), travel, np.zeros((6, 6)), (0.0, 0.0, 0.0)),
            np.eye(3),
            1.0,
            0.0,
            0.0,
        )
    assert way(path).distance_m == pytest.approx(5.0)


def test_the_way_goes_on_at_the_velocity_of_now_until_the_instant_asked_for() -> None:
    path = walked(np.array([[0.0, 0.0], [0.05, 0.0]]))
    assert path.end_ns is not None
    found = path.at(path.end_ns + STEP_NS, Travel(np.array([1.0, 0.0, 0.0]), 0.01**2 * np.eye(3)))
    assert found.distance_m == pytest.approx(0.1, abs=0.002)
    assert found.variance_m2 == pytest.approx(NOISE_M**2 + 0.0005**2)


def test_what_nobody_saw_adds_nothing_but_uncertainty() -> None:
    path = walked(np.array([[0.0, 0.0], [0.05, 0.0]]))
    assert path.end_ns is not None
    path.interrupt(path.end_ns + 2_000_000_000, 1.2)
    found = way(path)
    assert found.distance_m == pytest.approx(0.05, abs=0.002)
    assert math.sqrt(found.variance_m2) == pytest.approx(2.4, rel=0.01)


def test_what_the_samples_tell_of_a_gap_counts_with_its_variance() -> None:
    path = walked(np.array([[0.0, 0.0], [0.2, 0.0]]))
    assert path.end_ns is not None
    path.add_unseen(path.end_ns + 4 * STEP_NS, Travel(np.array([0.2, 0.0, 0.0]), np.diag([0.03**2, 1.0, 1.0])))
    found = way(path)
    assert found.distance_m == pytest.approx(0.4, abs=0.002)
    assert math.sqrt(found.variance_m2) == pytest.approx(0.03, rel=0.01)

"""The plane over time: averaging on one plane, jumping at an edge, forgetting after a gap."""

import numpy as np
import pytest
from numpy.typing import NDArray

from perception.plane import Plane, PlaneFit
from perception.tracking import PlaneTracker, TrackingSettings

FRAME_NS = 50_000_000
SURE = np.zeros((2, 2))
SEEN_COV = np.diag([0.01**2, 0.01**2, 0.003**2])


def seen(a: float, b: float, h: float) -> PlaneFit:
    return PlaneFit(Plane((a, b), h), SEEN_COV, 0.1, 0.9)


def yawed(yaw_rad: float) -> NDArray[np.float64]:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def test_frames_on_one_plane_are_averaged() -> None:
    rng = np.random.default_rng(3)
    tracker = PlaneTracker(TrackingSettings())
    errors = []
    for k in range(200):
        plane, cov = tracker.updated(
            k * FRAME_NS, seen(0.1 + rng.normal(0, 0.01), rng.normal(0, 0.01), 0.95), np.eye(3), SURE
        )
        errors.append(plane.gradient[0] - 0.1)
    assert np.std(errors[40:]) < 0.006
    assert cov[0, 0] < SEEN_COV[0, 0]


def test_turning_on_a_slope_changes_no_gradient_in_W() -> None:
    tracker = PlaneTracker(TrackingSettings())
    for k in range(40):
        yaw = 0.02 * k
        a, b = yawed(yaw)[:2, :2].T @ np.array([0.1, 0.0])
        plane, _ = tracker.updated(k * FRAME_NS, seen(a, b, 0.95), yawed(yaw), SURE)
        assert plane.gradient == pytest.approx((a, b), abs=1e-9)


def test_an_edge_starts_a_new_track_at_once() -> None:
    tracker = PlaneTracker(TrackingSettings())
    for k in range(20):
        tracker.updated(k * FRAME_NS, seen(0.0, 0.0, 0.95), np.eye(3), SURE)
    plane, cov = tracker.updated(20 * FRAME_NS, seen(0.0, 0.0, 0.78), np.eye(3), SURE)
    assert plane.height_m == pytest.approx(0.78)
    assert cov[2, 2] >= SEEN_COV[2, 2]


def test_a_track_is_forgotten_after_a_gap() -> None:
    tracker = PlaneTracker(TrackingSettings(longest_gap_s=0.5))
    tracker.updated(0, seen(0.0, 0.0, 0.95), np.eye(3), SURE)
    assert tracker.predicted(400_000_000, np.eye(3)) is not None
    assert tracker.predicted(600_000_000, np.eye(3)) is None


def test_uncertainty_grows_without_frames() -> None:
    def gain_after(gap_ns: int) -> float:
        tracker = PlaneTracker(TrackingSettings())
        for k in range(40):
            tracker.updated(k * FRAME_NS, seen(0.0, 0.0, 0.95), np.eye(3), SURE)
        plane, _ = tracker.updated(39 * FRAME_NS + gap_ns, seen(0.01, 0.0, 0.95), np.eye(3), SURE)
        return plane.gradient[0] / 0.01

    assert gain_after(450_000_000) > 1.2 * gain_after(50_000_000)


def test_what_the_attitude_learns_the_track_learns_too() -> None:
    def gradient_after(attitude_deviation_rad: float) -> float:
        tracker = PlaneTracker(TrackingSettings())
        for k in range(40):
            tracker.updated(k * FRAME_NS, seen(0.0, 0.0, 0.95), np.eye(3), attitude_deviation_rad**2 * np.eye(2))
        plane, cov = tracker.updated(40 * FRAME_NS, seen(0.03, 0.0, 0.95), np.eye(3), SURE)
        assert cov[0, 0] <= SEEN_COV[0, 0] + 1e-4
        return plane.gradient[0]

    assert gradient_after(0.0) < 0.02
    assert gradient_after(0.05) > 0.025

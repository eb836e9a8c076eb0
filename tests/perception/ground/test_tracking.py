"""The plane over time: averaging on one plane, jumping at an edge, forgetting after a gap."""

import numpy as np
import pytest

from messages.arrays import FloatArray
from perception.ground.plane import Plane, PlaneFit
from perception.ground.tracking import PlaneTracker, TrackingSettings

FRAME_NS = 50_000_000
LEVEL = np.eye(3)
SURE = np.zeros((2, 2))
SEEN_COV = np.diag([0.01**2, 0.01**2, 0.003**2])


def seen(a: float, b: float, h: float) -> PlaneFit:
    return PlaneFit(Plane((a, b), h), SEEN_COV, 0.1, 0.9)


def yawed(yaw_rad: float) -> FloatArray:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def told(
    tracker: PlaneTracker,
    t_ns: int,
    fit: PlaneFit,
    *,
    R_WH: FloatArray = LEVEL,
    attitude_cov_W: FloatArray = SURE,
    matched_share: float = 1.0,
    may_begin: bool = True,
    even: bool = True,
    v_W_mps: FloatArray | None = None,
) -> tuple[Plane, FloatArray] | None:
    return tracker.updated(
        t_ns, fit, matched_share, R_WH, attitude_cov_W, may_begin=may_begin, even=even, v_W_mps=v_W_mps
    )


def known(answer: tuple[Plane, FloatArray] | None) -> tuple[Plane, FloatArray]:
    assert answer is not None
    return answer


def test_frames_on_one_plane_are_averaged() -> None:
    rng = np.random.default_rng(3)
    tracker = PlaneTracker(TrackingSettings())
    errors = []
    assert told(tracker, -FRAME_NS, seen(0.1, 0.0, 0.95)) is None
    for k in range(200):
        plane, cov = known(told(tracker, k * FRAME_NS, seen(0.1 + rng.normal(0, 0.01), rng.normal(0, 0.01), 0.95)))
        errors.append(plane.gradient[0] - 0.1)
    assert np.std(errors[40:]) < 0.006
    assert cov[0, 0] == pytest.approx(SEEN_COV[0, 0], rel=1.0)


def test_what_the_track_says_is_no_surer_than_its_newest_frame_and_less_sure_where_it_lags_behind() -> None:
    plane, cov = known(told(on_level_ground(40), 40 * FRAME_NS, seen(0.02, 0.0, 0.95)))
    lag = 0.02 - plane.gradient[0]
    assert lag > 0.004
    assert cov[0, 0] == pytest.approx(SEEN_COV[0, 0] + lag**2)
    plane, cov = known(told(on_level_ground(40), 40 * FRAME_NS, seen(0.0, 0.0, 0.95)))
    np.testing.assert_allclose(cov, SEEN_COV, atol=1e-12)


def test_turning_on_a_slope_changes_no_gradient_in_W() -> None:
    tracker = PlaneTracker(TrackingSettings())
    for k in range(40):
        yaw = 0.02 * k
        a, b = yawed(yaw)[:2, :2].T @ np.array([0.1, 0.0])
        answer = told(tracker, k * FRAME_NS, seen(a, b, 0.95), R_WH=yawed(yaw))
        assert (answer is None) == (k == 0)
        if answer is not None:
            assert answer[0].gradient == pytest.approx((a, b), abs=1e-9)


def on_level_ground(frames: int) -> PlaneTracker:
    tracker = PlaneTracker(TrackingSettings())
    for k in range(frames):
        told(tracker, k * FRAME_NS, seen(0.0, 0.0, 0.95))
    return tracker


def test_an_edge_starts_a_new_track_as_soon_as_a_second_frame_confirms_it() -> None:
    tracker = on_level_ground(20)
    assert told(tracker, 20 * FRAME_NS, seen(0.0, 0.0, 0.78)) is None
    plane, cov = known(told(tracker, 21 * FRAME_NS, seen(0.0, 0.0, 0.78)))
    assert plane.height_m == pytest.approx(0.78)
    assert cov[2, 2] == pytest.approx(SEEN_COV[2, 2])
    assert told(tracker, 22 * FRAME_NS, seen(0.0, 0.0, 0.95)) is None


def test_a_chance_match_is_not_believed_and_does_not_end_the_track() -> None:
    tracker = on_level_ground(20)
    for k, slope in enumerate((0.5, -0.4, 0.3, -0.6)):
        assert told(tracker, (20 + k) * FRAME_NS, seen(slope, 0.0, 0.7)) is None
    plane, _ = known(told(tracker, 24 * FRAME_NS, seen(0.0, 0.0, 0.95)))
    assert plane.height_m == pytest.approx(0.95)


def test_a_contradiction_is_confirmed_only_by_the_next_frame_and_where_most_matched() -> None:
    tracker = on_level_ground(20)
    edge = seen(0.0, 0.0, 0.78)
    assert told(tracker, 20 * FRAME_NS, edge) is None
    tracker.miss()
    tracker.miss()
    assert told(tracker, 23 * FRAME_NS, edge) is None
    assert told(tracker, 24 * FRAME_NS, edge, matched_share=0.5) is None
    assert told(tracker, 25 * FRAME_NS, edge) is None
    assert told(tracker, 26 * FRAME_NS, edge) is not None


@pytest.mark.parametrize(("gap_frames", "confirmed"), [(5, True), (7, False)])
def test_where_frames_are_few_the_next_one_confirms_too(gap_frames: int, confirmed: bool) -> None:
    tracker = on_level_ground(20)
    edge = seen(0.0, 0.0, 0.78)
    assert told(tracker, 20 * FRAME_NS, edge) is None
    tracker.miss()
    assert (told(tracker, (20 + gap_frames) * FRAME_NS, edge) is not None) == confirmed


def test_a_track_is_forgotten_after_a_gap() -> None:
    tracker = on_level_ground(2)
    assert tracker.predicted(450_000_000, LEVEL) is not None
    assert tracker.predicted(600_000_000, LEVEL) is None


def test_uncertainty_grows_without_frames() -> None:
    def gain_after(gap_ns: int) -> float:
        plane, _ = known(told(on_level_ground(40), 39 * FRAME_NS + gap_ns, seen(0.01, 0.0, 0.95)))
        return plane.gradient[0] / 0.01

    assert gain_after(450_000_000) > 1.2 * gain_after(50_000_000)


def test_what_the_attitude_learns_the_track_learns_too() -> None:
    def gradient_after(attitude_deviation_rad: float) -> float:
        tracker, unsure = PlaneTracker(TrackingSettings()), attitude_deviation_rad**2 * np.eye(2)
        for k in range(40):
            told(tracker, k * FRAME_NS, seen(0.0, 0.0, 0.95), attitude_cov_W=unsure)
        plane, cov = known(told(tracker, 40 * FRAME_NS, seen(0.03, 0.0, 0.95)))
        assert cov[0, 0] == pytest.approx(SEEN_COV[0, 0] + (0.03 - plane.gradient[0]) ** 2)
        return plane.gradient[0]

    assert gradient_after(0.0) < 0.02
    assert gradient_after(0.05) > 0.025


def test_a_frame_that_may_begin_no_track_joins_one_and_contradicts_none() -> None:
    tracker = on_level_ground(5)
    for k in (5, 6, 7):
        assert told(tracker, k * FRAME_NS, seen(0.0, 0.0, 0.79), may_begin=False) is None
    assert told(tracker, 8 * FRAME_NS, seen(0.0, 0.0, 0.95), may_begin=False) is not None


def test_a_plane_beside_which_much_else_is_seen_confirms_no_track_however_often_it_is_seen() -> None:
    tracker = on_level_ground(5)
    for k in range(5, 40):
        assert told(tracker, k * FRAME_NS, seen(0.0, 0.0, 0.86), even=False, v_W_mps=np.zeros(3)) is None
    assert told(tracker, 40 * FRAME_NS, seen(0.0, 0.0, 0.86)) is not None


@pytest.mark.parametrize(("rises_mps", "expected_m"), [(0.3, 1.01), (-0.3, 0.89), (0.0, 0.95)])
def test_a_plane_beside_which_much_else_is_seen_agrees_with_the_track_as_the_camera_s_velocity_carries_it(
    rises_mps: float, expected_m: float
) -> None:
    for height_m in (0.89, 0.95, 1.01):
        tracker, v_W_mps = on_level_ground(5), np.array([1.2, 0.0, rises_mps])
        is_told = told(tracker, 8 * FRAME_NS, seen(0.0, 0.0, height_m), even=False, v_W_mps=v_W_mps) is not None
        assert is_told == (height_m == expected_m)


def test_a_plane_beside_which_much_else_is_seen_joins_no_track_that_was_seen_long_before() -> None:
    for even in (True, False):
        tracker = on_level_ground(5)
        assert (told(tracker, 13 * FRAME_NS, seen(0.0, 0.0, 0.95), even=even) is not None) == even


def test_a_plane_known_from_elsewhere_is_as_unsure_as_its_only_picture_differs_from_it() -> None:
    tracker = PlaneTracker(TrackingSettings())
    path_cov = np.diag([0.03**2, 0.03**2, 0.012**2])
    tracker.begin(0, Plane((0.0, 0.0), 0.95), path_cov, LEVEL, SURE)
    steep = seen(0.07, 0.0, 0.95)
    _, cov = known(told(tracker, FRAME_NS, steep))
    assert cov[0, 0] > 0.07**2
    for k in (2, 9):
        _, carried_cov = known(tracker.carry(k * FRAME_NS, LEVEL, np.zeros(3), SURE))
        assert carried_cov[0, 0] > 0.07**2
    _, cov = known(told(tracker, 10 * FRAME_NS, steep))
    assert cov[0, 0] < 0.02**2


def test_a_plane_that_pictures_have_shown_is_carried_as_surely() -> None:
    tracker = on_level_ground(40)
    _, cov = known(told(tracker, 40 * FRAME_NS, seen(0.02, 0.0, 0.95)))
    _, carried_cov = known(tracker.carry(41 * FRAME_NS, LEVEL, np.zeros(3), SURE))
    assert carried_cov[0, 0] < cov[0, 0]

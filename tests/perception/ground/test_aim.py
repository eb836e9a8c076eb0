"""The region follows the foothold within the surface that carries it; what cannot be seen is said."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import Reason
from perception.ground.aim import View, aimed
from perception.ground.foothold import FootholdSettings
from perception.ground.plane import Plane
from perception.ground.surface_change import SurfaceChange, apart_cov, beside_bend_cov, is_other_surface, plane_under
from perception.ground.tracking import PlaneTracker, TrackingSettings
from perception.terrain.edges import Edge
from perception.terrain.path_ahead import PathAhead, moved
from perception.terrain.surfaces import Surface

SETTINGS = FootholdSettings()
VIEW = View(0.95, 0.30, 3.0)


def edge(distance_m: float, rise_m: float, *, yaw_rad: float = 0.0, bound_only: bool = False) -> Edge:
    return Edge(distance_m, 0.005, rise_m, 0.003, yaw_rad, 0.01, bound_only)


def flat(from_m: float, to_m: float, z_m: float, slope: float = 0.0) -> Surface:
    return Surface(from_m, to_m, 0.5 * (from_m + to_m), z_m, slope, 0.002, 0.005)


def flight(rise_m: float, first_m: float = 0.55, tread_m: float = 0.28, shadow_m: float = 0.0) -> PathAhead:
    """Four steps; behind a falling lip the first `shadow_m` of each tread are hidden."""
    edges = tuple(edge(first_m + k * tread_m, rise_m) for k in range(4))
    treads = tuple(
        flat(first_m + (k - 1) * tread_m + (shadow_m if k else 0.0), first_m + k * tread_m, -0.95 + k * rise_m)
        for k in range(5)
    )
    return PathAhead(edges, treads)


def test_without_a_foothold_and_edges_the_region_is_the_settings_own() -> None:
    assert aimed(SETTINGS, None, PathAhead(), VIEW).region == SETTINGS.region


def test_on_clear_ground_the_region_stays_where_the_ground_is_measured_best() -> None:
    for ahead_m in (0.35, 0.8, 1.6):
        region = aimed(SETTINGS, (ahead_m, -0.1), PathAhead(surfaces=(flat(0.3, 2.6, -0.95),)), VIEW).region
        assert region.half_length_m == pytest.approx(0.3)
        assert 0.6 - 1e-9 <= region.ahead_m <= 0.7
        assert region.left_m == -0.1
        assert not region.bounded


@given(ahead_m=st.floats(0.56, 1.35), rise_m=st.sampled_from((0.17, -0.12)))
def test_on_stairs_the_region_is_on_one_tread(ahead_m: float, rise_m: float) -> None:
    path = flight(rise_m, shadow_m=0.08 if rise_m < 0.0 else 0.0)
    aim = aimed(SETTINGS, (ahead_m, -0.1), path, VIEW)
    if aim.reason is not Reason.NONE:
        assert aim.reason in (Reason.OCCLUDED, Reason.FOOTHOLD_OUT_OF_VIEW)
        return
    begin_m, end_m = (aim.region.ahead_m + side * aim.region.half_length_m for side in (-1.0, 1.0))
    assert aim.region.bounded
    assert not any(begin_m < each.distance_m < end_m for each in path.edges)
    assert math.floor((aim.region.ahead_m - 0.55) / 0.28) == math.floor((ahead_m - 0.55) / 0.28)


def test_what_a_lip_hides_is_occluded() -> None:
    bound = PathAhead((edge(0.6, -0.1, bound_only=True),), (flat(0.3, 0.6, -0.95), flat(1.1, 2.0, -1.3)))
    assert aimed(SETTINGS, None, bound, VIEW).reason is Reason.OCCLUDED
    # seen only from 0.6 (0.95 + 0.17) / 0.95 = 0.71 m on, and the next lip is at 0.84 m
    steep = PathAhead((edge(0.6, -0.17), edge(0.84, -0.17)), (flat(0.3, 0.6, -0.95), flat(0.72, 0.84, -1.12)))
    assert aimed(SETTINGS, (0.75, 0.0), steep, VIEW).reason is Reason.OCCLUDED
    single = PathAhead((edge(0.6, -0.17),), (flat(0.3, 0.6, -0.95), flat(0.72, 2.0, -1.12)))
    aim = aimed(SETTINGS, (0.75, 0.0), single, VIEW)
    assert aim.reason is Reason.NONE
    assert aim.region.ahead_m - aim.region.half_length_m > 0.71


def test_a_tread_that_the_picture_does_not_reach_down_to_is_passed() -> None:
    path = PathAhead((edge(0.08, 0.17), edge(0.36, 0.17)), (flat(0.3, 0.36, -0.78), flat(0.36, 0.64, -0.61)))
    aim = aimed(SETTINGS, (0.22, -0.1), path, VIEW)
    assert (aim.reason, aim.passed) == (Reason.FOOTHOLD_OUT_OF_VIEW, True)


def test_a_camera_that_looks_up_sees_no_foothold() -> None:
    """As an attitude says whose accelerometer has turned over: no region is without a place."""
    for path in (PathAhead(), flight(0.17), PathAhead((edge(0.6, 0.17),))):
        aim = aimed(SETTINGS, (0.7, -0.1), path, View(0.95, math.inf, math.inf))
        assert aim.reason is Reason.FOOTHOLD_OUT_OF_VIEW
        assert not aim.passed
        assert math.isfinite(aim.region.ahead_m)


def test_a_tread_that_legs_hide_is_passed_where_it_was_shown_before() -> None:
    edges, beyond = (edge(0.75, -0.17),), flat(0.9, 2.0, -1.12)
    hidden = PathAhead(edges, (beyond,))
    aim = aimed(SETTINGS, (0.55, 0.0), hidden, VIEW)
    assert (aim.reason, aim.passed) == (Reason.FOOTHOLD_OUT_OF_VIEW, False)
    shown = PathAhead(edges, (beyond,), shown_before=(flat(0.3, 0.75, -0.95),))
    aim = aimed(SETTINGS, (0.55, 0.0), shown, VIEW)
    assert (aim.reason, aim.passed) == (Reason.FOOTHOLD_OUT_OF_VIEW, True)
    under = plane_under(aim.region, shown)
    assert under is not None
    assert under[0].height_m == pytest.approx(0.95)


def test_what_was_shown_before_an_edge_is_not_known_beyond_it() -> None:
    path = PathAhead((edge(0.65, -0.17),), (flat(0.9, 2.0, -1.12),), shown_before=(flat(0.3, 0.66, -0.95),))
    assert path.known_at(0.60) is not None
    assert path.known_at(0.70) is None
    assert not aimed(SETTINGS, (0.70, 0.0), path, VIEW).passed


def test_a_region_turns_with_the_edges_that_bound_it() -> None:
    path = PathAhead((edge(0.5, 0.17, yaw_rad=0.4), edge(0.85, 0.17, yaw_rad=0.4)), (flat(0.5, 0.85, -0.8),), 0.4)
    region = aimed(SETTINGS, (0.65, 0.0), path, VIEW).region
    assert region.yaw_rad == 0.4
    corners = region.footprint(Plane((0.0, 0.0), 0.8), 0.0)
    along = corners[:, 0] + corners[:, 1] * math.tan(0.4)
    assert along.min() > 0.5
    assert along.max() < 0.85


def test_a_region_that_moves_over_a_border_measures_another_surface() -> None:
    change, path = SurfaceChange(), flight(0.17)
    first = aimed(SETTINGS, (0.42, 0.0), path, VIEW).region
    assert not change.has_come(0, first, path)
    change.move(50_000_000, np.array([0.0, 0.0]))
    assert not change.has_come(50_000_000, first, path)
    assert change.has_come(100_000_000, aimed(SETTINGS, (0.7, 0.0), path, VIEW).region, path)


def test_ground_that_was_measured_and_is_passed_under_stays_the_same_surface() -> None:
    change = SurfaceChange()
    region = aimed(SETTINGS, (0.7, 0.0), flight(0.17), VIEW).region
    change.has_come(0, region, flight(0.17))
    change.move(100_000_000, np.array([1.0, 0.0]))
    nearer = flight(0.17, first_m=0.45)
    assert not change.has_come(100_000_000, aimed(SETTINGS, (0.6, 0.0), nearer, VIEW).region, nearer)


def test_the_plane_under_a_region_is_that_of_the_surface_there() -> None:
    path = PathAhead(surfaces=(flat(0.3, 0.9, -0.95), flat(0.9, 2.0, -0.9, slope=0.1)))
    found = plane_under(aimed(SETTINGS, (0.7, 0.0), path, VIEW).region, path)
    assert found is not None
    assert found[0].height_m == pytest.approx(0.95)
    assert np.linalg.eigvalsh(found[1]).min() > 0.0
    assert plane_under(SETTINGS.region, PathAhead()) is None


def test_an_edge_found_before_a_region_that_has_not_moved_makes_it_another_surface() -> None:
    """Standing above stairs the region lies beyond the lip before the lip is known."""
    path = flight(-0.17, shadow_m=0.05)
    region = aimed(SETTINGS, (0.75, 0.0), path, VIEW).region
    landing, tread = Plane((0.0, 0.0), 0.95), Plane((0.0, 0.0), 0.95 + 0.17)
    assert is_other_surface(landing, region, path)
    assert not is_other_surface(tread, region, path)
    assert not is_other_surface(landing, SETTINGS.region, path)


def test_a_plane_that_contradicts_the_path_is_as_uncertain_as_they_are_apart() -> None:
    region, path, cov = SETTINGS.region, PathAhead(surfaces=(flat(0.3, 2.0, -0.95),)), 1e-6 * np.eye(3)
    assert not apart_cov(Plane((0.01, 0.0), 0.95), cov, region, path).any()
    steep = apart_cov(Plane((0.25, 0.0), 0.95 + 0.25 * region.ahead_m), cov, region, path)
    assert np.sqrt(np.diag(steep)[:2]) == pytest.approx(0.25)
    lower = apart_cov(Plane((0.0, 0.0), 1.15), cov, region, path)
    assert math.sqrt(lower[2, 2]) == pytest.approx(0.2)


def test_on_rough_ground_the_path_tells_no_plane() -> None:
    path = PathAhead(surfaces=(flat(0.3, 2.0, -0.95),), rough=True)
    assert plane_under(SETTINGS.region, path) is None
    assert not apart_cov(Plane((0.2, 0.0), 0.95), 1e-6 * np.eye(3), SETTINGS.region, path).any()


def test_a_surface_whose_end_may_be_turned_is_one_only_well_before_it() -> None:
    surfaces = (flat(0.3, 2.0, -0.95),)
    assert PathAhead(surfaces=surfaces).is_one_surface(0.7, 1.8, 0.0)
    assert not PathAhead(surfaces=surfaces).is_one_surface(0.7, 1.9, 0.0)
    assert not PathAhead(surfaces=surfaces).is_one_surface(0.7, 1.8, -0.3)
    assert PathAhead((edge(2.0, -0.17),), surfaces).is_one_surface(0.7, 1.9, 0.0)
    assert not PathAhead((edge(0.3, 0.17),), surfaces).is_one_surface(0.7, 1.9, 0.0)  # one behind says nothing of it


def test_a_track_goes_on_from_a_known_surface_and_is_carried_where_it_is_not_seen() -> None:
    tracker, level = PlaneTracker(TrackingSettings()), np.eye(3)
    tracker.begin(0, Plane((0.1, 0.0), 0.8), np.diag([1e-4, 1e-4, 1e-4]), level, np.zeros((2, 2)))
    predicted = tracker.predicted(50_000_000, level)
    assert predicted is not None
    assert predicted.height_m == pytest.approx(0.8)
    # the camera goes 0.1 m ahead over ground that rises by 0.01 m there, and 0.02 m up
    carried = tracker.carry(100_000_000, level, np.array([1.0, 0.0, 0.2]), np.zeros((2, 2)))
    assert carried is not None
    assert carried[0].height_m == pytest.approx(0.81)
    assert carried[1][2, 2] > 1e-4
    assert tracker.carry(900_000_000, level, np.zeros(3), np.zeros((2, 2))) is None
    tracker.forget()
    assert tracker.predicted(100_000_000, level) is None


def test_a_track_is_not_carried_for_longer_than_half_a_second_after_it_was_seen() -> None:
    tracker, level = PlaneTracker(TrackingSettings()), np.eye(3)
    tracker.begin(0, Plane((0.1, 0.0), 0.8), np.diag([1e-4, 1e-4, 1e-4]), level, np.zeros((2, 2)))
    times_ns = range(50_000_000, 800_000_000, 50_000_000)
    carried = [t for t in times_ns if tracker.carry(t, level, np.zeros(3), np.zeros((2, 2))) is not None]
    assert carried == list(range(50_000_000, 550_000_000, 50_000_000))
    assert tracker.predicted(600_000_000, level) is None


def test_surfaces_move_with_the_camera() -> None:
    surface = moved(flat(0.5, 1.0, -0.9, slope=0.2), 0.1, 0.03)
    assert (surface.from_m, surface.to_m) == pytest.approx((0.4, 0.9))
    assert surface.at(0.65) == pytest.approx(-0.93)


def test_bends_bound_surfaces_and_are_told_where_a_foot_lands_beside_them() -> None:
    path = PathAhead(surfaces=(flat(0.3, 0.9, -0.95), flat(0.9, 2.0, -0.9, slope=0.1)))
    assert path.borders_m(0.0) == pytest.approx([0.9])
    assert path.bend_near(0.8, 0.0, 0.3) == pytest.approx(0.1)
    assert path.bend_near(0.4, 0.0, 0.3) == 0.0
    assert path.is_one_surface(0.4, 0.7, 0.0)
    assert not path.is_one_surface(0.4, 1.2, 0.0)


@given(bend_m=st.floats(0.51, 1.29), slope=st.floats(-0.18, 0.18).filter(lambda slope: abs(slope) > 0.04))
def test_a_bend_that_something_covers_is_where_both_surfaces_would_meet(bend_m: float, slope: float) -> None:
    before = flat(0.3, 0.5, -0.95)
    beyond = flat(1.3, 2.7, -0.95 + slope * (2.0 - bend_m), slope)
    assert PathAhead(surfaces=(before, beyond)).borders_m(0.0) == pytest.approx([bend_m])
    step = edge(0.8, 0.05)
    assert PathAhead((step,), (before, beyond)).borders_m(0.0) == [0.8]
    apart = replace(beyond, height_m=beyond.height_m - 1.3 * slope)
    assert PathAhead(surfaces=(before, apart)).borders_m(0.0) == []


def test_a_plane_told_where_the_slope_changes_is_as_uncertain_as_that() -> None:
    path = PathAhead(surfaces=(flat(0.3, 0.7, -0.95), flat(0.7, 2.0, -0.95 - 0.14 * 0.65, slope=-0.14)))
    beside = beside_bend_cov(replace(SETTINGS.region, ahead_m=0.67), path)
    assert np.sqrt(beside[0, 0]) == pytest.approx(0.07)
    assert not beside_bend_cov(replace(SETTINGS.region, ahead_m=0.6), path).any()

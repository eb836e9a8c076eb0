"""Profile, surfaces and edges of paths whose geometry is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.terrain.edges import OFFSET_PX, Edge, common_sd_m, find_edges
from perception.terrain.path_points import PathPoints
from perception.terrain.profile import profile_of
from perception.terrain.surfaces import Surface, find_surfaces
from tests.bench.path_scene import B_M, F_PX, Piece, flight, points_seen

WIDTH_M = 0.5


def found(points: PathPoints, yaw_rad: float = 0.0) -> tuple[list[Surface], list[Edge]]:
    surfaces = find_surfaces(profile_of(points, yaw_rad, WIDTH_M))
    return surfaces, find_edges(surfaces, points, yaw_rad)


def nearest(edges: list[Edge], at_m: float) -> Edge:
    return min(edges, key=lambda edge: abs(edge.distance_m - at_m))


def test_level_ground_is_one_surface_without_an_edge() -> None:
    surfaces, edges = found(points_seen([(-1.0, 0.0, 6.0, 0.0)]))
    assert len(surfaces) == 1
    assert edges == []
    assert surfaces[0].height_m == pytest.approx(-0.95, abs=0.002)
    assert surfaces[0].slope == pytest.approx(0.0, abs=0.003)


def test_the_foot_of_a_ramp_is_a_crease_and_no_edge() -> None:
    slope = math.tan(math.radians(8.0))
    surfaces, edges = found(points_seen([(-1.0, 0.0, 0.9, 0.0), (0.9, 0.0, 4.0, 3.1 * slope)]))
    assert edges == []
    assert surfaces[-1].slope == pytest.approx(slope, abs=0.02)
    assert surfaces[0].slope == pytest.approx(0.0, abs=0.02)


@settings(max_examples=25, deadline=None)
@given(
    start_m=st.floats(0.5, 1.0),
    rise_m=st.floats(0.06, 0.20),
    tread_m=st.floats(0.24, 0.36),
    height_m=st.floats(0.85, 1.0),
    seed=st.integers(1, 1000),
)
def test_risers_ahead_are_found_with_their_height_and_place(
    start_m: float, rise_m: float, tread_m: float, height_m: float, seed: int
) -> None:
    _, edges = found(points_seen(flight(start_m, rise_m, tread_m, 3), height_m=height_m, seed=seed))
    for place in range(2):
        at_m = start_m + place * tread_m
        if height_m - rise_m * (place + 1) < 0.45:  # nearly as high as the camera: above the picture
            continue
        edge = nearest(edges, at_m)
        assert edge.distance_m == pytest.approx(at_m, abs=0.015)
        assert edge.rise_m == pytest.approx(rise_m, abs=0.008)
        assert not edge.bound_only


@settings(max_examples=25, deadline=None)
@given(
    start_m=st.floats(0.5, 0.9),
    drop_m=st.floats(0.06, 0.20),
    tread_m=st.floats(0.26, 0.36),
    height_m=st.floats(0.85, 1.0),
    seed=st.integers(1, 1000),
)
def test_a_drop_is_told_with_its_height_once_enough_of_what_follows_is_seen(
    start_m: float, drop_m: float, tread_m: float, height_m: float, seed: int
) -> None:
    _, edges = found(points_seen(flight(start_m, -drop_m, tread_m, 3), height_m=height_m, seed=seed))
    hidden_m = start_m * drop_m / height_m
    edge = nearest(edges, start_m)
    assert edge.distance_m == pytest.approx(start_m, abs=0.02)
    assert edge.rise_m < 0.0
    if tread_m - hidden_m > 0.12:
        assert not edge.bound_only
        assert edge.rise_m == pytest.approx(-drop_m, abs=0.010)


def test_the_drops_between_short_treads_seen_from_afar_are_right_to_millimetres() -> None:
    """A third of each tread is in view: its own slope, extrapolated over what is hidden, would be off by 4 mm RMS."""
    told = [
        edge
        for seed in range(12)
        for edge in found(points_seen(flight(1.0, -0.17, 0.30, 8), height_m=0.9, seed=seed, noise_px=0.2))[1]
        if not edge.bound_only
    ]
    for to_m, least, most_m in ((1.45, 20, 0.0025), (1.8, 28, 0.004)):
        off_m = [edge.rise_m + 0.17 for edge in told if edge.distance_m < to_m]
        assert len(off_m) > least
        assert math.sqrt(np.mean(np.square(off_m))) < most_m


def test_treads_that_are_known_tell_that_no_other_is_hidden_behind_the_next_lip() -> None:
    """Behind the third lip 0.23 m are hidden, where a tread of 0.22 m would have room."""
    off_m = []
    for seed in range(4):
        _, edges = found(points_seen(flight(0.9, -0.2, 0.36, 4), height_m=1.0, seed=seed))
        third = nearest(edges, 0.9 + 2 * 0.36)
        assert not third.bound_only
        off_m.append(third.rise_m + 0.2)
    assert np.abs(off_m).max() < 0.012


def test_what_falls_on_behind_a_lip_may_be_nosings_and_bounds_the_drop() -> None:
    slope = math.tan(math.radians(9.0))
    ramp = [(-1.0, 0.0, 1.2, 0.0), (1.2, 0.0, 1.2, -0.14), (1.2, -0.14, 4.0, -0.14 - 2.8 * slope)]
    _, edges = found(points_seen(ramp, height_m=1.0))
    assert nearest(edges, 1.2).bound_only
    assert -0.14 - 0.01 < nearest(edges, 1.2).rise_m < 0.0


@pytest.mark.parametrize("rise_m", [0.13, 0.19])
def test_of_a_flight_up_the_riser_is_told_whose_tread_is_above_the_picture(rise_m: float) -> None:
    pieces = flight(0.45, rise_m, 0.3, 5)
    points = points_seen(pieces, height_m=0.95)
    _, edges = found(points.where(points.z_m < -0.95 + 2.9 * rise_m))
    assert [edge.distance_m for edge in edges] == pytest.approx([0.45, 0.75, 1.05], abs=0.015)
    assert edges[-1].rise_m == pytest.approx(rise_m, abs=0.01)
    assert edges[-1].rise_sd_m > 0.014


def test_what_stands_on_a_tread_is_no_riser() -> None:
    pieces = flight(0.45, 0.15, 0.3, 5)
    points = points_seen(pieces, height_m=0.95)
    box = (points.z_m < -0.95 + 2.05 * 0.15) | (np.abs(points.y_m) < 0.1) & (points.z_m < -0.95 + 2.9 * 0.15)
    _, edges = found(points.where(box))
    assert [edge.distance_m for edge in edges] == pytest.approx([0.45, 0.75], abs=0.015)


@pytest.mark.parametrize("at_m", [0.7, 1.2, 1.9])
def test_what_moves_all_disparities_moves_an_edge_by_its_common_deviation(at_m: float) -> None:
    """It grows with the square of the distance, and is no smaller however many frames show the edge."""
    points = points_seen([(-1.0, 0.0, at_m, 0.0), (at_m, 0.0, at_m, 0.15), (at_m, 0.15, 6.0, 0.15)], noise_px=0.0)
    disparity_px = F_PX * B_M * math.sqrt(2.0) / (points.x_m - points.z_m)
    farther = disparity_px / (disparity_px - OFFSET_PX)
    moved = replace(points, x_m=farther * points.x_m, y_m=farther * points.y_m, z_m=farther * points.z_m)
    off_m = nearest(found(moved)[1], at_m).distance_m - nearest(found(points)[1], at_m).distance_m
    assert off_m == pytest.approx(common_sd_m(at_m, 0.95, F_PX * B_M), rel=0.25)


def test_no_surface_is_laid_over_the_nosings_of_a_flight() -> None:
    """Half of each tread is hidden, and the line through what is seen of them falls by 19°."""
    for seed in range(3):
        surfaces, edges = found(points_seen(flight(1.4, -0.125, 0.355, 8), height_m=0.9, seed=seed, noise_px=0.2))
        assert all(surface.to_m - surface.from_m < 0.25 for surface in surfaces[1:3])
        assert nearest(edges, 1.4).rise_m == pytest.approx(-0.125, abs=0.02)


@pytest.mark.parametrize("start_m", [0.95, 1.1, 1.2])
def test_a_steep_flight_is_known_while_only_slivers_of_its_treads_and_the_landing_are_seen(start_m: float) -> None:
    """Slivers are 3 to 7 cm long: too narrow for surfaces, but they lie below the lip where its shadow ends."""
    for seed in range(3):
        surfaces, edges = found(points_seen(flight(start_m, -0.18, 0.255, 3), height_m=0.95, seed=seed, noise_px=0.1))
        assert surfaces[1].from_m > start_m + 0.3
        edge = nearest(edges, start_m)
        assert edge.distance_m == pytest.approx(start_m, abs=0.03)
        assert edge.bound_only
        assert -0.19 < edge.rise_m < -0.08


def test_where_ground_behind_a_lip_does_not_match_the_bound_still_holds() -> None:
    """The first tread is in view and unmatched, as where there is no texture: the landing is not what follows."""
    for seed in range(3):
        points = points_seen(flight(1.1, -0.16, 0.25, 2), seed=seed)
        points = points.where((points.z_m > -0.95 - 0.05) | (points.z_m < -0.95 - 0.25))
        _, edges = found(points)
        edge = nearest(edges, 1.1)
        assert edge.bound_only
        assert -0.16 - 0.01 < edge.rise_m < -0.06


def test_lower_ground_far_behind_where_matching_ends_is_no_edge() -> None:
    """Between both nothing is seen: where the one ends is not known."""
    pieces: list[Piece] = [(-1.0, 0.0, 1.6, 0.0), (1.6, 0.0, 1.6, -0.12), (1.6, -0.12, 6.0, -0.12)]
    points = points_seen(pieces)
    _, edges = found(points.where((points.x_m < 0.9) | (points.x_m > 1.65)))
    assert edges == []


def test_a_ramp_of_15_degrees_is_ground() -> None:
    slope = math.tan(math.radians(15.0))
    surfaces, edges = found(points_seen([(-1.0, 0.0, 0.8, 0.0), (0.8, 0.0, 4.0, -3.2 * slope)]))
    assert edges == []
    assert surfaces[-1].slope == pytest.approx(-slope, abs=0.02)


def test_a_kerb_beyond_which_a_ramp_is_well_seen_keeps_the_ramps_slope() -> None:
    slope = math.tan(math.radians(8.0))
    pieces: list[Piece] = [(-1.0, 0.0, 0.7, 0.0), (0.7, 0.0, 0.7, -0.10), (0.7, -0.10, 4.0, -0.10 + 3.3 * slope)]
    _, edges = found(points_seen(pieces))
    assert nearest(edges, 0.7).rise_m == pytest.approx(-0.10, abs=0.008)


def test_behind_a_lip_that_hides_a_whole_tread_only_a_bound_is_told() -> None:
    pieces: list[Piece] = [(-1.0, 0.0, 1.4, 0.0), (1.4, 0.0, 1.4, -0.5), (1.4, -0.5, 6.0, -0.5)]
    _, edges = found(points_seen(pieces))
    edge = nearest(edges, 1.4)
    assert edge.bound_only
    assert -0.5 < edge.rise_m < -0.05


@pytest.mark.parametrize("yaw_deg", [-30.0, -12.0, 12.0, 30.0])
def test_an_edge_at_an_angle_is_found_with_its_yaw(yaw_deg: float) -> None:
    yaw_rad = math.radians(yaw_deg)
    points = points_seen(flight(0.9, 0.15, 3.0, 1), yaw_rad=yaw_rad)
    _, first = found(points)
    guess_rad = nearest(first, 0.9).yaw_rad
    _, edges = found(points, guess_rad)
    edge = nearest(edges, 0.9)
    assert math.degrees(edge.yaw_rad) == pytest.approx(yaw_deg, abs=2.0)
    assert edge.distance_m == pytest.approx(0.9, abs=0.02)
    assert edge.rise_m == pytest.approx(0.15, abs=0.01)


@pytest.mark.parametrize("skewed_deg", [-50.0, 50.0])
def test_a_face_of_which_a_few_points_are_seen_is_not_turned_as_these_lie(skewed_deg: float) -> None:
    """Matches at the border of what is textured lie askew, and close together tell nothing of the whole width."""
    points = points_seen(flight(1.0, 0.17, 0.28, 3))
    face = (np.abs(points.x_m - 1.0) < 0.02) & (points.z_m > 0.02 - 0.95) & (points.z_m < 0.15 - 0.95)
    seen = (points.y_m > 0.08) & (points.y_m < 0.16)
    askew_m = points.x_m + np.where(face, np.tan(np.radians(skewed_deg)) * (points.y_m - 0.12), 0.0)
    _, edges = found(replace(points, x_m=askew_m).where(~face | seen))
    first = nearest(edges, 1.0)
    assert first.distance_m == pytest.approx(1.0, abs=0.05)
    assert abs(np.degrees(first.yaw_rad)) < 20.0
    assert abs(first.yaw_rad) < 2.5 * first.yaw_sd_rad


def test_what_the_matcher_puts_along_the_line_of_sight_is_no_surface() -> None:
    _, edges = found(points_seen(flight(0.6, -0.17, 0.28, 8)))
    assert all(edge.rise_m == pytest.approx(-0.17, abs=0.02) for edge in edges if edge.distance_m < 1.0)


def test_no_point_gives_no_surface() -> None:
    empty = PathPoints(*(np.empty(0) for _ in range(6)))
    assert find_surfaces(profile_of(empty, 0.0, WIDTH_M)) == []


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000), count=st.integers(0, 4000), spread_m=st.floats(0.0, 1.0), yaw_rad=st.floats(-0.6, 0.6)
)
def test_whatever_is_seen_gives_finite_surfaces_and_edges(
    seed: int, count: int, spread_m: float, yaw_rad: float
) -> None:
    chance = np.random.default_rng(seed)
    x_m, y_m = chance.uniform(0.15, 2.75, count), chance.uniform(-0.25, 0.25, count)
    steps_m = chance.uniform(-0.4, 0.4, 6)[np.minimum((x_m / 0.5).astype(int), 5)]
    z_m = np.minimum(-0.95 + steps_m + spread_m * chance.normal(size=count), -0.3)
    points = PathPoints(x_m, y_m, z_m, np.full(count, 0.003), np.full(count, 1e-4), np.full(count, 0.01))
    surfaces, edges = found(points, yaw_rad)
    assert all(np.isfinite((s.from_m, s.to_m, s.height_m, s.slope, s.height_sd_m, s.slope_sd)).all() for s in surfaces)
    assert [s.from_m for s in surfaces] == sorted(s.from_m for s in surfaces)
    for edge in edges:
        assert np.isfinite((edge.distance_m, edge.rise_m, edge.yaw_rad)).all()
        assert min(edge.distance_sd_m, edge.rise_sd_m, edge.yaw_sd_rad) > 0.0
        assert edge.rise_m < 0.0 or not edge.bound_only


def test_a_lip_whose_last_rows_did_not_match_is_unsure_by_what_may_be_there() -> None:
    """What lies behind it is seen where the true lip's shadow ends, whatever of the upper tread matched."""
    lip_m, unmatched_m = 0.8, 0.05
    whole = points_seen([(-1.0, 0.0, lip_m, 0.0), (lip_m, -0.18, 4.0, -0.18)], noise_px=0.02)
    matched = whole.where((whole.x_m < lip_m - unmatched_m) | (whole.z_m < -1.04))
    (sure,), (unsure,) = (found(points)[1] for points in (whole, matched))
    assert abs(sure.distance_m - lip_m) < 0.01
    assert sure.distance_sd_m < 0.01
    assert unsure.distance_m == pytest.approx(lip_m - unmatched_m, abs=0.01)
    assert unsure.distance_sd_m == pytest.approx(unmatched_m / math.sqrt(12.0), rel=0.3)

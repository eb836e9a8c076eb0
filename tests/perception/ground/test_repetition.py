"""Of planes a tile apart the one is taken that the picture, or the track, tells; where neither does, none."""

import numpy as np
import pytest

from messages import Reason
from perception.depth.repeats import NO_REPEATS, Repeats, Rival
from perception.ground.foothold import FootholdSettings
from perception.ground.meter import GroundMeasurement
from perception.ground.plane import Plane, PlaneFit
from perception.ground.repetition import RepetitionWatch, as_steep
from perception.terrain.surfaces import Surface

REGION = FootholdSettings().region
TRACKED = Plane((0.0, 0.0), 0.95)
TILE = 0.025 / 0.12
LIKE = Repeats(0.05, (Rival(1.0 + TILE, 0.06), Rival(1.0 - TILE, 0.07)))
TREAD = Surface(1.1, 1.4, 1.25, -0.8, 0.0, 0.002, 0.003)
SELF_CLEAR = Repeats(0.02, (Rival(1.0 + TILE, 0.06), Rival(1.0 - TILE, 0.07)))


def measured(height_m: float, inlier_share: float = 1.0) -> GroundMeasurement:
    return GroundMeasurement(Reason.NONE, 0.9, PlaneFit(Plane((0.0, 0.0), height_m), np.eye(3), 0.1, inlier_share))


class Floor:
    """Answers `ask` with what it is given, and `measure` with the plane that it is asked to look near."""

    def __init__(self, repeats: Repeats) -> None:
        self.repeats, self.asked, self.looked_near = repeats, 0, list[tuple[float, float]]()

    def ask(self, plane: Plane) -> Repeats:
        assert plane.height_m > 0.0
        self.asked += 1
        return self.repeats

    def measure(self, near: Plane, margin_m: float) -> GroundMeasurement:
        self.looked_near.append((near.height_m, margin_m))
        return measured(near.height_m)


def resolved(
    watch: RepetitionWatch, floor: Floor, frame: GroundMeasurement, expected: Plane | None
) -> tuple[GroundMeasurement, bool]:
    assert frame.fit is not None
    return watch.resolved(0, frame, frame.fit, expected, REGION, floor.ask, floor.measure)


def height_m(measurement: GroundMeasurement) -> float:
    assert measurement.fit is not None
    return measurement.fit.plane.height_m


def test_a_floor_that_does_not_repeat_changes_nothing() -> None:
    watch, floor, frame = RepetitionWatch(), Floor(NO_REPEATS), measured(0.95)
    assert resolved(watch, floor, frame, None) == (frame, True)
    assert not watch.repeats(0)
    assert watch.margin_m(0, TRACKED) is None


def test_on_the_track_nothing_is_asked() -> None:
    watch, floor = RepetitionWatch(), Floor(LIKE)
    resolved(watch, floor, measured(0.955), TRACKED)
    assert floor.asked == 0


@pytest.mark.parametrize("frame", [measured(0.99), measured(0.95, inlier_share=0.7)])
def test_a_surprise_is_asked_about(frame: GroundMeasurement) -> None:
    watch, floor = RepetitionWatch(), Floor(LIKE)
    resolved(watch, floor, frame, TRACKED)
    assert floor.asked == 1
    assert watch.repeats(0)
    assert not watch.repeats(2_000_000_000)


def test_the_other_surface_at_an_edge_is_no_tile() -> None:
    watch, floor = RepetitionWatch(), Floor(Repeats(0.35, (Rival(0.88, 0.05, alike=False),)))
    frame = measured(0.83, inlier_share=0.6)
    assert resolved(watch, floor, frame, TRACKED) == (frame, True)
    assert floor.asked == 1
    assert not watch.repeats(0)


def test_without_a_track_like_planes_give_none() -> None:
    answer, may_begin = resolved(RepetitionWatch(), Floor(LIKE), measured(0.95), None)
    assert (answer.fit, answer.reason, may_begin) == (None, Reason.LOW_TEXTURE, False)


def test_without_a_track_the_plane_that_stands_out_is_taken() -> None:
    answer, may_begin = resolved(RepetitionWatch(), Floor(SELF_CLEAR), measured(0.95), None)
    assert (height_m(answer), may_begin) == (0.95, True)
    off = Repeats(0.1, (Rival(1.0 + TILE, 0.02), Rival(1.0 - TILE, 0.2)))
    answer, may_begin = resolved(RepetitionWatch(), Floor(off), measured(0.95 * (1.0 + TILE)), None)
    assert height_m(answer) == pytest.approx(0.95)
    assert may_begin


def test_planes_where_no_ground_can_be_are_no_rivals() -> None:
    beyond = Repeats(0.05, (Rival(0.5, 0.05), Rival(1.6, 0.05)))  # 1.9 and 0.59 m; it may lie at 0.6 to 1.3 m
    answer, may_begin = resolved(RepetitionWatch(), Floor(beyond), measured(0.95), None)
    assert (height_m(answer), may_begin) == (0.95, True)


def test_of_like_planes_the_tracks_is_taken_and_no_new_track_begins() -> None:
    floor = Floor(LIKE)
    answer, may_begin = resolved(RepetitionWatch(), floor, measured(0.95 / (1.0 - TILE)), TRACKED)
    assert (height_m(answer), may_begin) == (0.95, False)
    (_, margin_m), = floor.looked_near  # fmt: skip
    assert margin_m < 0.5 * (0.95 - 0.95 / (1.0 + TILE)) + 1e-9


def test_no_plane_is_taken_that_hardly_fits() -> None:
    watch = RepetitionWatch()
    resolved(watch, Floor(LIKE), measured(0.95), TRACKED)
    for repeats in (Repeats(0.3, ()), Repeats(0.3, (Rival(1.0 + TILE, 0.31),))):
        assert resolved(watch, Floor(LIKE), measured(0.99), TRACKED)[0].fit is not None
        answer, may_begin = resolved(watch, Floor(repeats), measured(0.95), TRACKED)
        assert (answer.fit, answer.reason, may_begin) == (None, Reason.NOT_PLANAR, False)


def test_while_the_floor_repeats_the_ground_is_looked_for_within_half_a_tile() -> None:
    watch = RepetitionWatch()
    resolved(watch, Floor(LIKE), measured(0.95), None)
    assert watch.margin_m(0, None) is None
    margin_m = watch.margin_m(0, TRACKED)
    assert margin_m is not None
    assert 1.0 / (0.95 - margin_m) - 1.0 / 0.95 == pytest.approx(0.5 * TILE / 0.95)


def test_a_floor_is_ambiguous_until_it_ends_once_no_plane_has_stood_out() -> None:
    watch = RepetitionWatch()
    resolved(watch, Floor(SELF_CLEAR), measured(0.95), None)
    assert watch.repeats(0)
    assert not watch.is_ambiguous(0)
    resolved(watch, Floor(LIKE), measured(0.95), TRACKED)
    resolved(watch, Floor(SELF_CLEAR), measured(0.95), TRACKED)
    assert watch.is_ambiguous(0)
    assert not watch.is_ambiguous(2_000_000_000)


@pytest.mark.parametrize(
    ("other_m", "ambiguous"),
    [(0.95 / (1.0 - 2.0 * TILE), True), (0.95 / (1.0 + TILE), True), (0.95, False), (0.95 / (1.0 - 0.5 * TILE), False)],
    ids=["two tiles lower", "a tile higher", "the ground itself", "a step of half a tile"],
)
def test_a_surface_of_the_path_a_tile_off_the_ground_makes_a_floor_that_repeats_ambiguous(
    other_m: float, ambiguous: bool
) -> None:
    watch = RepetitionWatch()
    assert not watch.makes_ambiguous(0, 0.95, [(TREAD, other_m)], lambda _: LIKE)
    resolved(watch, Floor(SELF_CLEAR), measured(0.95), None)
    assert watch.makes_ambiguous(0, 0.95, [(TREAD, 0.95), (TREAD, other_m)], lambda _: LIKE) is ambiguous
    assert watch.is_ambiguous(0) is ambiguous
    assert not watch.is_ambiguous(2_000_000_000)


@pytest.mark.parametrize(("tiles", "ambiguous"), [(1.0, True), (1.03, True), (1.13, False), (0.87, False)])
def test_of_large_tiles_the_height_tells_a_step_from_a_tile(tiles: float, ambiguous: bool) -> None:
    watch, brick = RepetitionWatch(), 0.09 / 0.12
    resolved(watch, Floor(Repeats(0.02, (Rival(1.0 + brick, 0.06),))), measured(0.95), None)
    assert watch.makes_ambiguous(0, 0.95, [(TREAD, 0.95 / (1.0 + tiles * brick))], lambda _: NO_REPEATS) is ambiguous


@pytest.mark.parametrize(
    ("told", "ambiguous"),
    [(Repeats(0.05, ()), False), (SELF_CLEAR, False), (LIKE, True), (Repeats(0.3, ()), True), (NO_REPEATS, True)],
    ids=["it is alone", "it stands out", "the other fits as well", "it is no plane", "it cannot be asked"],
)
def test_a_surface_that_the_picture_tells_from_a_tile_makes_nothing_ambiguous(told: Repeats, ambiguous: bool) -> None:
    watch = RepetitionWatch()
    resolved(watch, Floor(SELF_CLEAR), measured(0.95), None)
    assert watch.makes_ambiguous(0, 0.95, [(TREAD, 0.95 / (1.0 + TILE))], lambda _: told) is ambiguous


def test_what_is_no_plane_tells_nothing_of_tiles() -> None:
    """At an edge, two surfaces in one region: all planes fit badly, none stands out."""
    watch = RepetitionWatch()
    resolved(watch, Floor(SELF_CLEAR), measured(0.95), None)
    resolved(watch, Floor(Repeats(0.5, (Rival(1.0 + TILE, 0.55),))), measured(0.95), TRACKED)
    assert watch.repeats(0)
    assert not watch.is_ambiguous(0)


def test_only_a_surface_as_steep_as_the_ground_can_be_a_tile_off() -> None:
    """Beyond the end of a ramp it is level; its height where the ramp is measured would be a tile off by chance."""
    ramp = Surface(0.3, 1.7, 1.0, -0.72, 0.2, 0.002, 0.003)
    level = Surface(1.8, 2.1, 2.0, -0.56, 0.0, 0.004, 0.03)
    unsure = Surface(2.2, 2.4, 2.3, -0.56, 0.05, 0.01, 0.08)
    above = Surface(2.2, 2.4, 2.3, 0.6, 0.2, 0.01, 0.08)
    (first, ramp_m), (second, unsure_m) = as_steep([ramp, level, unsure, above], 0.2)
    assert (first, second) == (ramp, unsure)
    assert (ramp_m, unsure_m) == pytest.approx((0.92, 1.02))


def test_a_plane_that_the_path_foretells_is_believed_only_where_the_picture_tells_it_apart() -> None:
    watch, floor = RepetitionWatch(), Floor(LIKE)
    watch.check_next()
    for _ in range(2):
        answer, may_begin = resolved(watch, floor, measured(0.95), TRACKED)
        assert (answer.fit, answer.reason, may_begin) == (None, Reason.LOW_TEXTURE, False)
    assert height_m(resolved(watch, Floor(SELF_CLEAR), measured(0.95), TRACKED)[0]) == 0.95
    assert height_m(resolved(watch, floor, measured(0.95), TRACKED)[0]) == 0.95


def test_a_foretold_plane_is_asked_about_once_where_the_floor_does_not_repeat() -> None:
    watch, floor = RepetitionWatch(), Floor(NO_REPEATS)
    watch.check_next()
    for _ in range(2):
        assert resolved(watch, floor, measured(0.95), TRACKED)[1]
    assert floor.asked == 1

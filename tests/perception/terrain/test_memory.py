"""Edges remembered while the wearer walks over them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.terrain.edges import Edge
from perception.terrain.memory import EdgeMemory
from perception.terrain.surfaces import Surface

RISER = Edge(
    distance_m=1.2, distance_sd_m=0.01, rise_m=0.17, rise_sd_m=0.004, yaw_rad=0.0, yaw_sd_rad=math.radians(1.0)
)
STRAIGHT_ON = Surface(from_m=0.2, to_m=2.5, middle_m=1.0, height_m=-0.95, slope=0.0, height_sd_m=0.001, slope_sd=0.001)
FRAME_NS = 50_000_000


def walked(memory: EdgeMemory, frames: int, edge: Edge | None, *, first: int = 0, speed_mps: float = 1.0) -> list[Edge]:
    """Walk straight on; `edge` stands where it stood at frame 0."""
    told: list[Edge] = []
    for k in range(first, first + frames):
        gone_m = 0.05 * k * speed_mps
        seen = [] if edge is None else [replace(edge, distance_m=edge.distance_m - gone_m)]
        told = memory.update(k * FRAME_NS, np.array([speed_mps, 0.0]), 0.0, seen, [])
    return told


def test_an_edge_is_told_by_its_third_frame() -> None:
    memory = EdgeMemory()
    assert walked(memory, 2, RISER) == []
    (told,) = walked(memory, 1, RISER, first=2)
    assert told.distance_m == pytest.approx(1.1, abs=1e-9)
    assert told.distance_sd_m < RISER.distance_sd_m


def test_an_edge_that_is_out_of_view_is_carried_on_until_it_lies_behind() -> None:
    memory = EdgeMemory()
    walked(memory, 10, RISER)
    (told,) = walked(memory, 18, None, first=10)
    assert told.distance_m == pytest.approx(1.2 - 0.05 * 27, abs=1e-9)
    assert walked(memory, 6, None, first=28) == []


def test_an_edge_where_ground_goes_on_is_forgotten() -> None:
    memory = EdgeMemory()
    walked(memory, 4, RISER, speed_mps=0.0)
    for k in range(4, 7):
        told = memory.update(k * FRAME_NS, np.zeros(2), 0.0, [], [STRAIGHT_ON])
    assert told == []


def test_a_value_replaces_a_bound_and_a_bound_never_a_value() -> None:
    memory = EdgeMemory()
    bound = replace(RISER, rise_m=-0.10, bound_only=True)
    walked(memory, 4, bound, speed_mps=0.0)
    (told,) = walked(memory, 1, replace(RISER, rise_m=-0.17), first=4, speed_mps=0.0)
    assert (told.bound_only, told.rise_m) == (False, -0.17)
    (told,) = walked(memory, 1, bound, first=5, speed_mps=0.0)
    assert (told.bound_only, told.rise_m) == (False, -0.17)


def test_at_one_place_there_is_one_edge_and_a_rise_that_is_seen_again_and_again_replaces_another() -> None:
    memory = EdgeMemory()
    wrong, right = (replace(RISER, rise_m=rise_m) for rise_m in (-0.05, -0.14))
    walked(memory, 4, wrong, speed_mps=0.0)
    (told,) = walked(memory, 2, right, first=4, speed_mps=0.0)
    assert told.rise_m == -0.05
    (told,) = walked(memory, 1, right, first=6, speed_mps=0.0)
    assert told.rise_m == -0.14


def test_a_rise_seen_once_does_not_move_the_one_that_is_known() -> None:
    memory = EdgeMemory()
    right = replace(RISER, rise_m=-0.14)
    walked(memory, 4, right, speed_mps=0.0)
    (told,) = walked(memory, 1, replace(RISER, rise_m=-0.05), first=4, speed_mps=0.0)
    assert told.rise_m == pytest.approx(-0.14, abs=1e-9)
    (told,) = walked(memory, 1, right, first=5, speed_mps=0.0)
    assert told.rise_m == pytest.approx(-0.14, abs=1e-9)


def test_an_edge_where_two_surfaces_meet_without_a_step_is_forgotten() -> None:
    """Bumps of rough ground look like an edge once; a moment later the same ground is two surfaces that meet."""
    memory = EdgeMemory()
    walked(memory, 4, replace(RISER, rise_m=0.08), speed_mps=0.0)
    near = replace(STRAIGHT_ON, to_m=1.16)
    far = replace(STRAIGHT_ON, from_m=1.16, middle_m=1.8, height_m=-0.94)
    for k in range(4, 7):
        told = memory.update(k * FRAME_NS, np.zeros(2), 0.0, [], [near, far])
    assert told == []


def test_an_edge_on_both_sides_of_which_its_surfaces_are_seen_is_kept() -> None:
    memory = EdgeMemory()
    walked(memory, 4, RISER, speed_mps=0.0)
    surfaces = [replace(STRAIGHT_ON, to_m=1.18), replace(STRAIGHT_ON, from_m=1.22, height_m=-0.95 + RISER.rise_m)]
    for k in range(4, 14):
        told = memory.update(k * FRAME_NS, np.zeros(2), 0.0, [], surfaces)
    assert len(told) == 1


def test_an_edge_beside_which_another_is_seen_with_no_tread_between_is_forgotten() -> None:
    memory = EdgeMemory()
    walked(memory, 4, RISER, speed_mps=0.0)
    beside = replace(RISER, distance_m=RISER.distance_m + 0.11)
    told = walked(memory, 3, beside, first=4, speed_mps=0.0)
    assert [edge.distance_m for edge in told] == [pytest.approx(beside.distance_m)]


def test_a_rise_follows_what_is_seen_nearer_by() -> None:
    """What is seen from afar errs together, however often: it does not outweigh a few frames from near by."""
    memory = EdgeMemory()
    walked(memory, 60, replace(RISER, rise_m=-0.12, rise_sd_m=0.015), speed_mps=0.0)
    (told,) = walked(memory, 10, replace(RISER, rise_m=-0.14, rise_sd_m=0.008), first=60, speed_mps=0.0)
    assert told.rise_m == pytest.approx(-0.14, abs=0.006)


UPPER = Surface(from_m=0.3, to_m=0.9, middle_m=0.6, height_m=-0.95, slope=0.0, height_sd_m=0.002, slope_sd=0.003)
LANDING = Surface(from_m=1.5, to_m=2.4, middle_m=1.9, height_m=-1.27, slope=0.0, height_sd_m=0.003, slope_sd=0.003)
LIPS = (
    replace(RISER, distance_m=0.9, rise_m=-0.175, rise_sd_m=0.01),
    replace(RISER, distance_m=1.2, rise_m=-0.115, rise_sd_m=0.02),
)


def test_drops_between_two_surfaces_that_are_seen_have_the_sum_that_these_tell() -> None:
    """Of the tread between them a few frames showed a sliver, 30 mm too high: both together fall by 32 cm."""
    memory = EdgeMemory()
    for k in range(3):
        memory.update(k * FRAME_NS, np.zeros(2), 0.0, LIPS, [])
    first, second = memory.update(3 * FRAME_NS, np.zeros(2), 0.0, [], [])
    told = memory.update(4 * FRAME_NS, np.zeros(2), 0.0, [], [UPPER, LANDING])
    assert sum(edge.rise_m for edge in told) == pytest.approx(-0.32, abs=0.012)
    assert second.rise_m - told[1].rise_m > 2.0 * (first.rise_m - told[0].rise_m) > 0.0  # by their variances
    assert told[1].rise_sd_m < second.rise_sd_m


def test_a_sum_tells_nothing_of_a_bound() -> None:
    memory, lips = EdgeMemory(), (LIPS[0], replace(LIPS[1], bound_only=True))
    for k in range(4):
        before = memory.update(k * FRAME_NS, np.zeros(2), 0.0, lips, [])
    after = memory.update(4 * FRAME_NS, np.zeros(2), 0.0, [], [UPPER, LANDING])
    assert [edge.rise_m for edge in after] == [edge.rise_m for edge in before]


def test_an_inferred_rise_becomes_no_surer_and_a_measured_one_replaces_it() -> None:
    memory, inferred = EdgeMemory(), replace(RISER, rise_m=0.15, rise_sd_m=0.015, inferred=True)
    (told,) = walked(memory, 20, inferred, speed_mps=0.0)
    assert told.rise_sd_m > 0.0149
    (told,) = walked(memory, 1, RISER, first=20, speed_mps=0.0)
    assert (told.rise_m, told.inferred) == (RISER.rise_m, False)
    (told,) = walked(memory, 3, inferred, first=21, speed_mps=0.0)
    assert told.rise_m == RISER.rise_m


def test_after_a_long_gap_nothing_is_remembered() -> None:
    memory = EdgeMemory()
    walked(memory, 5, RISER, speed_mps=0.0)
    assert memory.update(5 * FRAME_NS + 600_000_000, np.zeros(2), 0.0, [], []) == []


@given(heading_rad=st.floats(-3.1, 3.1), yaw_rad=st.floats(-0.6, 0.6), turn_rad=st.floats(-0.5, 0.5))
def test_turning_on_the_spot_moves_an_edge(heading_rad: float, yaw_rad: float, turn_rad: float) -> None:
    memory = EdgeMemory()
    edge = replace(RISER, yaw_rad=yaw_rad)
    for k in range(3):
        memory.update(k * FRAME_NS, np.zeros(2), heading_rad, [edge], [])
    (told,) = memory.update(3 * FRAME_NS, np.zeros(2), heading_rad + turn_rad, [], [])
    assert told.yaw_rad == pytest.approx(yaw_rad - turn_rad, abs=1e-9)
    across_m = edge.distance_m * math.cos(yaw_rad)  # of the edge from the camera, square to it
    assert told.distance_m == pytest.approx(across_m / math.cos(yaw_rad - turn_rad), abs=1e-9)


def test_where_an_edge_lies_does_not_rest_on_how_far_the_wearer_has_come() -> None:
    """Met at 35° its yaw scatters by 3° from frame to frame: as little at 50 m from where the walk began as at 0."""
    yaw_rad, told = math.radians(35.0), []
    for come_m in (0.0, 50.0):
        memory, chance = EdgeMemory(), np.random.default_rng(1)
        memory.update(0, np.zeros(2), 0.0, [], [])
        memory.update(FRAME_NS, np.array([2.0 * come_m / 0.05, 0.0]), 0.0, [], [])
        for k in range(2, 32):
            seen = replace(
                RISER,
                yaw_rad=yaw_rad + float(chance.normal(0.0, math.radians(3.0))),
                yaw_sd_rad=math.radians(3.0),
            )
            told.append(memory.update(k * FRAME_NS, np.zeros(2), 0.0, [seen], []))
    assert all(abs(edge.distance_m - RISER.distance_m) < 1e-9 for frame in told for edge in frame)


def test_an_edge_that_may_be_turned_is_the_less_sure_the_farther_along_it_the_path_comes() -> None:
    memory = EdgeMemory()
    oblique = replace(RISER, yaw_rad=0.6, yaw_sd_rad=0.1)
    before = walked(memory, 4, oblique, speed_mps=0.0)[0].distance_sd_m
    told: list[Edge] = []
    for k in range(4, 14):
        told = memory.update(k * FRAME_NS, np.array([0.0, 1.0 if k < 13 else 0.0]), 0.0, [], [])
    aside_m = 0.45  # of the trapezia from rest to rest
    (edge,) = told
    assert edge.distance_m == pytest.approx(1.2 - aside_m * math.tan(0.6), abs=1e-9)
    turned_m = aside_m * 0.05 / math.cos(0.6) ** 2  # four frames of 0.1 rad
    assert edge.distance_sd_m == pytest.approx(math.hypot(before, turned_m), rel=0.15)

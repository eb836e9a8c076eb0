"""Ground near the feet that a leg hides for a moment."""

from dataclasses import replace

import pytest

from perception.terrain.near_ground import NearGround
from tests.perception.terrain.test_memory import FRAME_NS, STRAIGHT_ON

HIDDEN_TO_M = 1.0


def test_what_a_leg_hides_is_known_from_the_frames_before_as_it_lies_now() -> None:
    near = NearGround()
    near.update(0, 0.0, 0.0, [STRAIGHT_ON])
    rest = replace(STRAIGHT_ON, from_m=HIDDEN_TO_M)
    known = near.update(FRAME_NS, 0.06, 0.01, [rest])
    assert known[1] is rest
    assert known[0].from_m == pytest.approx(STRAIGHT_ON.from_m - 0.06)
    assert known[0].to_m == HIDDEN_TO_M
    assert known[0].at(0.5) == pytest.approx(STRAIGHT_ON.at(0.5) - 0.01)


def test_what_a_frame_shows_takes_the_place_of_what_was_known() -> None:
    near = NearGround()
    near.update(0, 0.0, 0.0, [STRAIGHT_ON])
    assert near.update(FRAME_NS, 0.05, 0.0, [STRAIGHT_ON]) == [STRAIGHT_ON]


def test_beyond_the_first_surface_nothing_is_carried() -> None:
    """There a lip may hide another surface than the one that was seen."""
    near = NearGround()
    near.update(0, 0.0, 0.0, [STRAIGHT_ON])
    short = replace(STRAIGHT_ON, to_m=1.4)
    assert near.update(FRAME_NS, 0.0, 0.0, [short]) == [short]


def test_after_a_second_it_is_forgotten() -> None:
    near = NearGround()
    near.update(0, 0.0, 0.0, [STRAIGHT_ON])
    rest = replace(STRAIGHT_ON, from_m=HIDDEN_TO_M)
    for k in range(1, 21):
        assert len(near.update(k * FRAME_NS, 0.0, 0.0, [rest])) == 2
    assert near.update(21 * FRAME_NS, 0.0, 0.0, [rest]) == [rest]


def test_a_frame_without_surfaces_tells_none_and_forgets_none() -> None:
    near = NearGround()
    near.update(0, 0.0, 0.0, [STRAIGHT_ON])
    assert near.update(FRAME_NS, 0.0, 0.0, []) == []
    assert len(near.update(2 * FRAME_NS, 0.0, 0.0, [replace(STRAIGHT_ON, from_m=HIDDEN_TO_M)])) == 2

"""What the wearer's known height says of the ground: shoes and posture are no contradiction, a camera that errs is."""

import math
from collections.abc import Iterable

import pytest

from messages import WearerHeight
from perception.ground.foothold import FootholdSettings
from perception.ground.known_height import HeightDifference, KnownHeight

REGION = FootholdSettings().region
KNOWN_M = 0.97
FRAME_NS = 50_000_000


def bob_m(k: int) -> float:
    """What the hip of a walker rises by in frame k."""
    return 0.022 * math.sin(2 * math.pi * 1.8 * 0.05 * k)


class Walker:
    """Hands frames to the average, 20 a second."""

    def __init__(self, std_m: float = 0.005) -> None:
        self.known = KnownHeight(WearerHeight(camera_height_m=KNOWN_M, std_m=std_m))
        self.frames = 0

    def go(self, seconds: float, height_m: float, speed_mps: float = 1.2) -> HeightDifference:
        """Walk on with this mean height, or stand where the speed is 0."""
        return self.follow((height_m + bob_m(k) * (speed_mps > 0.0) for k in range(round(20 * seconds))), speed_mps)

    def follow(self, heights_m: Iterable[float], speed_mps: float) -> HeightDifference:
        for height_m in heights_m:
            self.frames += 1
            self.known.add(self.frames * FRAME_NS, height_m, speed_mps, REGION)
        return self.known.difference


def test_without_a_known_height_nothing_is_known() -> None:
    known = KnownHeight(None)
    for k in range(400):
        known.add(k * FRAME_NS, 1.5, 1.2, REGION)
    assert math.isnan(known.difference.off_m)
    assert (known.difference.variance_m2, known.difference.contradicts) == (0.0, False)


def test_at_the_known_height_the_uncertainty_stays() -> None:
    found = Walker().go(20.0, KNOWN_M)
    assert abs(found.off_m) < 0.005
    assert math.sqrt(found.variance_m2) < 0.005
    assert not found.contradicts


@pytest.mark.parametrize("shoes_m", [-0.03, 0.03, 0.05])
def test_other_shoes_widen_and_do_not_contradict(shoes_m: float) -> None:
    found = Walker().go(30.0, KNOWN_M + shoes_m)
    assert found.off_m == pytest.approx(shoes_m, abs=0.004)
    assert math.sqrt(found.variance_m2) == pytest.approx(abs(shoes_m), abs=0.004)
    assert not found.contradicts


@pytest.mark.parametrize("slip_m", [0.019, -0.037])
def test_a_slip_below_the_bound_is_within_two_deviations(slip_m: float) -> None:
    walker = Walker()
    walker.go(10.0, KNOWN_M)
    found = walker.go(20.0, KNOWN_M + slip_m)
    assert abs(slip_m) < 2.0 * math.sqrt(found.variance_m2 + 0.003**2)


def test_what_no_shoe_explains_contradicts_within_seconds_and_only_as_long_as_it_lasts() -> None:
    walker = Walker()
    assert not walker.go(10.0, KNOWN_M).contradicts
    assert not walker.go(1.0, KNOWN_M + 0.1).contradicts
    assert walker.go(9.0, KNOWN_M + 0.1).contradicts
    assert math.sqrt(walker.known.difference.variance_m2) > 0.075
    assert not walker.go(15.0, KNOWN_M).contradicts


def test_the_known_heights_own_uncertainty_widens_the_bound() -> None:
    assert Walker(std_m=0.002).go(20.0, KNOWN_M + 0.075).contradicts
    assert not Walker(std_m=0.02).go(20.0, KNOWN_M + 0.075).contradicts


def test_sitting_and_bending_say_nothing() -> None:
    walker = Walker()
    walker.go(10.0, KNOWN_M)
    down = (KNOWN_M - 0.4 * min(1.0, k / 32) for k in range(400))
    seated = walker.follow(down, 0.0)
    assert abs(seated.off_m) < 0.01
    assert not seated.contradicts
    assert not walker.go(5.0, KNOWN_M).contradicts


def test_who_only_stands_or_has_not_reached_the_plane_says_nothing() -> None:
    assert math.isnan(Walker().go(30.0, KNOWN_M - 0.17, speed_mps=0.0).off_m)
    assert math.isnan(Walker().go(1.0, KNOWN_M - 0.17).off_m)


def test_on_stairs_each_tread_begins_anew() -> None:
    walker = Walker()
    walker.go(10.0, KNOWN_M)
    for _ in range(60):
        walker.known.begin_anew()
        walker.go(0.6, KNOWN_M - 0.34, speed_mps=0.46)
    assert abs(walker.known.difference.off_m) < 0.01


def test_standing_after_a_walk_counts() -> None:
    walker = Walker()
    walker.go(10.0, KNOWN_M)
    assert walker.go(30.0, KNOWN_M + 0.04, speed_mps=0.0).off_m == pytest.approx(0.04, abs=0.004)

"""Ground that rises and falls by turns, as wide as the path; ramps and stairs are none."""

import math

import pytest

from perception.terrain.surfaces import Surface
from perception.terrain.undulation import Undulation

FRAME_M = 0.05


def walked(pieces: list[tuple[float, float]], frames: int, slope_sd: float = 0.005) -> list[bool]:
    """Return what is told frame by frame while the camera walks over `pieces`, each a length, m, and a slope, degrees,
    of which it sees 0.3 to 2 m ahead."""
    path, told = Undulation(), []
    for frame in range(frames):
        surfaces, from_m = [], 0.3 - frame * FRAME_M
        for length_m, slope_deg in pieces:
            near_m, far_m = max(from_m, 0.3), min(from_m + length_m, 2.0)
            if far_m - near_m > 0.1:
                middle_m, slope = 0.5 * (near_m + far_m), math.tan(math.radians(slope_deg))
                surfaces.append(Surface(near_m, far_m, middle_m, -0.9, slope, 0.002, slope_sd))
            from_m += length_m
        path.add(FRAME_M if frame else 0.0, surfaces)
        told.append(path.undulates)
    return told


def test_ground_that_rises_and_falls_by_turns_is_told_once_it_has_turned_twice_and_a_metre_longer() -> None:
    told = walked([(1.0, 0.0), (0.6, 3.0), (0.6, -3.0), (0.6, 3.0), (6.0, 0.0)], 120)
    first = told.index(True)
    assert 18 <= first <= 30  # 0.2 m of the third slope come into view after 0.9 m
    assert all(told[first : first + 20])
    assert not any(told[80:])


@pytest.mark.parametrize(
    "pieces",
    [
        [(9.0, 0.3)],
        [(1.0, 0.0), (2.0, 8.0), (6.0, 0.0)],
        [(1.0, 0.0), (0.9, -5.0), (4.0, 0.0), (0.9, 5.0), (3.0, 0.0)],  # dropped kerbs on both sides of a road
        [(1.0, 0.0), (0.5, 6.0), (0.5, -6.0), (6.0, 0.0)],  # a speed bump
        [(0.3, 2.0 * (-1) ** k) for k in range(20)],  # no more than is unsure
    ],
)
def test_ramps_and_bumps_alone_are_no_undulation(pieces: list[tuple[float, float]]) -> None:
    assert not any(walked(pieces, 100, slope_sd=0.03 if len(pieces) == 20 else 0.005))


def test_what_is_not_known_any_more_is_forgotten() -> None:
    path = Undulation()
    up, down = (Surface(0.3, 0.8, 0.55, -0.9, slope, 0.002, 0.005) for slope in (0.06, -0.06))
    for surface in (up, down, up):
        path.add(0.6, [surface])
    assert path.undulates
    path.clear()
    assert not path.undulates

"""What the path ahead tells of changes of its slope, seen or not."""

import numpy as np
import pytest

from perception.terrain.path_ahead import PathAhead
from perception.terrain.profile import BIN_M, BINS, FIRST_M, Profile
from perception.terrain.surfaces import find_surfaces

SEEN_TO_M = 2.0


def path_that_bends(at_m: float, slope: float, *, deviation_m: float = 0.006, one_in: int = 1) -> PathAhead:
    """Return what a profile to `SEEN_TO_M`, as sure as a picture's is at 1.5 m, shows of ground that bends; beyond
    1.2 m one bin in so many is shown."""
    u_m = FIRST_M + (np.arange(BINS) + 0.5) * BIN_M
    height_m = -0.9 + slope * np.maximum(u_m - at_m, 0.0)
    shown = (u_m > 0.3) & (u_m < SEEN_TO_M) & ((u_m < 1.2) | (np.arange(BINS) % one_in == 0))
    profile = Profile(height_m, np.zeros(BINS), shown.astype(float), np.full(BINS, deviation_m))
    return PathAhead(surfaces=tuple(find_surfaces(profile)))


@pytest.mark.parametrize("beyond_m", [0.35, 0.5, 0.7])
def test_no_larger_bend_is_hidden_than_is_told(beyond_m: float) -> None:
    told = PathAhead(surfaces=path_that_bends(1.0, 0.0).surfaces).hidden_bend(SEEN_TO_M - beyond_m, 0.0)
    assert len(path_that_bends(SEEN_TO_M - beyond_m, 0.6 * told).surfaces) == 1
    assert len(path_that_bends(SEEN_TO_M - beyond_m, 1.4 * told).surfaces) == 2


@pytest.mark.parametrize("beyond_m", [0.4, 0.5, 0.7])
def test_where_few_bins_match_a_larger_bend_is_hidden_and_told(beyond_m: float) -> None:
    """At the end of a smooth ramp every third bin matched, to 12 mm: a bend by 10° was not seen."""

    def bent(slope: float) -> PathAhead:
        return path_that_bends(SEEN_TO_M - beyond_m, slope, deviation_m=0.012, one_in=3)

    told = bent(0.0).hidden_bend(SEEN_TO_M - beyond_m, 0.0)
    assert len(bent(0.6 * told).surfaces) == 1
    assert len(bent(1.4 * told).surfaces) == 2


def test_where_no_surface_is_seen_none_is_told() -> None:
    assert PathAhead().hidden_bend(1.0, 0.0) == 0.0

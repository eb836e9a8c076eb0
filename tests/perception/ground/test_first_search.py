"""While nothing is followed every height that is possible is searched, one bounded band of it in each frame."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import CAMERA_HEIGHTS_M, Reason, WearerHeight
from perception.ground.first_search import FirstSearch
from perception.ground.foothold import FootholdSettings

SETTINGS = st.builds(
    FootholdSettings,
    nominal_height_m=st.floats(0.3, 2.0),
    height_margin_m=st.floats(0.05, 1.0),
)


def bands(search: FirstSearch, foothold: FootholdSettings, frames: int) -> list[tuple[float, float]]:
    """Return (lowest, highest) of the heights that each of some frames without a plane searches."""
    found = []
    for _ in range(frames):
        band = search.begin(foothold.region).band
        found.append((band.nominal_height_m - band.height_margin_m, band.nominal_height_m + band.height_margin_m))
        search.ended(Reason.NOT_PLANAR)
    return found


@given(SETTINGS)
def test_eight_frames_search_every_height_in_bands_no_wider_than_before(foothold: FootholdSettings) -> None:
    searched = bands(FirstSearch(None), foothold, 8)
    reached_m = CAMERA_HEIGHTS_M[0]
    for low_m, high_m in sorted(searched):
        assert high_m - low_m <= max(0.7, 2.0 * foothold.height_margin_m) + 1e-9
        if low_m <= reached_m + 1e-9:
            reached_m = max(reached_m, high_m)
    assert reached_m >= CAMERA_HEIGHTS_M[1] - 1e-9


@given(SETTINGS)
def test_the_configured_height_has_every_second_frame(foothold: FootholdSettings) -> None:
    likely = bands(FirstSearch(None), foothold, 10)[::2]
    assert set(likely) == {
        (
            foothold.nominal_height_m - foothold.height_margin_m,
            foothold.nominal_height_m + foothold.height_margin_m,
        )
    }


def test_the_wearers_height_takes_the_place_of_the_configured_one() -> None:
    search = FirstSearch(WearerHeight(camera_height_m=1.07, std_m=0.005))
    begun = search.begin(FootholdSettings(nominal_height_m=0.5).region)
    assert begun.band.nominal_height_m == begun.likely.nominal_height_m == 1.07


def test_a_band_with_a_plane_is_searched_again_to_confirm_it_and_left_if_it_is_not_confirmed() -> None:
    search, foothold = FirstSearch(None), FootholdSettings(nominal_height_m=0.5).region
    search.begin(foothold)
    search.ended(Reason.LOW_TEXTURE)
    found = search.begin(foothold).band
    assert found != foothold
    assert search.ended(Reason.NONE) is Reason.NONE
    search.not_followed()
    assert search.begin(foothold).band == found
    search.ended(Reason.NONE)
    search.not_followed()
    assert search.begin(foothold).band == foothold


def test_a_band_whose_plane_is_refused_for_another_reason_is_kept() -> None:
    search, foothold = FirstSearch(None), FootholdSettings().region
    for _ in range(5):
        assert search.begin(foothold).band == foothold
        assert search.ended(Reason.NONE) is Reason.NONE


def test_after_a_track_the_search_begins_anew() -> None:
    search, foothold = FirstSearch(None), FootholdSettings().region
    search.begin(foothold)
    search.ended(Reason.NOT_PLANAR)
    assert search.begin(foothold).band != foothold
    assert search.skip(foothold).band == search.begin(foothold).band == foothold


@pytest.mark.parametrize("other", [Reason.OUT_OF_RANGE, Reason.FOOTHOLD_OUT_OF_VIEW])
def test_without_a_plane_it_is_told_what_the_likely_band_showed(other: Reason) -> None:
    search, foothold = FirstSearch(None), FootholdSettings().region
    told = []
    for reason in (Reason.LOW_TEXTURE, other, Reason.NOT_PLANAR, other):
        search.begin(foothold)
        told.append(search.ended(reason))
    assert told == [Reason.LOW_TEXTURE, Reason.LOW_TEXTURE, Reason.NOT_PLANAR, Reason.NOT_PLANAR]


def test_outside_the_likely_band_rivals_are_sought_at_all_heights() -> None:
    search, foothold = FirstSearch(None), FootholdSettings().region
    likely = search.begin(foothold)
    assert (likely.bounds, likely.unlikely) == (foothold, False)
    search.ended(Reason.NOT_PLANAR)
    other = search.begin(foothold)
    assert other.unlikely
    bounds = other.bounds
    assert bounds.nominal_height_m - bounds.height_margin_m == pytest.approx(CAMERA_HEIGHTS_M[0])
    assert bounds.nominal_height_m + bounds.height_margin_m == pytest.approx(CAMERA_HEIGHTS_M[1])
    assert replace(bounds, nominal_height_m=0.95, height_margin_m=0.35) == foothold

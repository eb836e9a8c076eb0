"""At which heights the ground is looked for while no plane is followed: one band of heights in each frame.

The configured height, or the wearer's where it is known, comes first and every second time; the rest of what is
possible is asked between, band by band, so that a wrong `nominal_height_m` or a wearer who has sat down costs some
frames, and no frame is matched over more than one band. Where a band shows a plane, the next frame is asked for the
same band, to confirm it.
"""

import math
from dataclasses import replace
from typing import NamedTuple

from messages import CAMERA_HEIGHTS_M, Reason, WearerHeight
from perception.ground.region import FootholdRegion


class Searched(NamedTuple):
    """The foothold region as one frame searches it, each with its band of heights (`nominal_height_m` and margin).

    `band` is this frame's, `likely` the most likely one, `bounds` where a plane of the band may have a rival.
    `unlikely` says that it is another than the most likely: there, only even ground is believed.
    """

    band: FootholdRegion
    likely: FootholdRegion
    bounds: FootholdRegion
    unlikely: bool = False


class FirstSearch:
    """Tells each frame without a track which band of heights to search, and what to say if there is nothing."""

    def __init__(self, wearer: WearerHeight | None) -> None:
        self._wearer = wearer
        self._turn = 0
        self._to_confirm = False
        self._likely_reason = Reason.NONE

    def skip(self, foothold: FootholdRegion) -> Searched:
        """Return what a frame searches that knows where the ground is; the next search begins anew."""
        self._turn, self._to_confirm = 0, False
        return self.begin(foothold)

    def begin(self, foothold: FootholdRegion) -> Searched:
        """Return what this frame searches. In the likely band a plane has rivals of that band only; one found outside
        must stand out among all heights that are possible."""
        likely = foothold
        if self._wearer is not None:
            likely = replace(foothold, nominal_height_m=self._wearer.camera_height_m)
        others = _other_bands(likely)
        if self._at_likely or not others:
            return Searched(likely, likely, likely)
        low_m = min(CAMERA_HEIGHTS_M[0], likely.nominal_height_m - likely.height_margin_m)
        high_m = max(CAMERA_HEIGHTS_M[1], likely.nominal_height_m + likely.height_margin_m)
        bounds = _with_band(foothold, 0.5 * (low_m + high_m), 0.5 * (high_m - low_m))
        band = _with_band(foothold, *others[self._turn // 2 % len(others)])
        return Searched(band, likely, bounds, unlikely=True)

    def ended(self, reason: Reason) -> Reason:
        """Take how this frame's search ended, NONE with a plane, and return what to say of it.

        What is said where there is no plane is what the most likely band showed last.
        """
        if self._at_likely:
            self._likely_reason = reason
        elif reason is not Reason.NONE and self._likely_reason is not Reason.NONE:
            reason = self._likely_reason
        if reason is not Reason.NONE:
            self._turn, self._to_confirm = self._turn + 1, False
        return reason

    def not_followed(self) -> None:
        """Leave the band whose plane the next frame has not confirmed either."""
        self._turn, self._to_confirm = self._turn + self._to_confirm, not self._to_confirm

    @property
    def _at_likely(self) -> bool:
        return self._turn % 2 == 0


def _with_band(foothold: FootholdRegion, height_m: float, margin_m: float) -> FootholdRegion:
    return replace(foothold, nominal_height_m=height_m, height_margin_m=margin_m)


def _other_bands(likely: FootholdRegion) -> list[tuple[float, float]]:
    """Return (height, margin) of bands that hold, beside the likely one, every height that is possible."""
    low_m, high_m = CAMERA_HEIGHTS_M
    below = (low_m, min(high_m, likely.nominal_height_m - likely.height_margin_m))
    above = (max(low_m, likely.nominal_height_m + likely.height_margin_m), high_m)
    bands = []
    for from_m, to_m in (below, above):
        count = max(0, math.ceil((to_m - from_m) / _BAND_M))
        half_m = 0.5 * (to_m - from_m) / max(1, count)
        bands += [(from_m + (2 * k + 1) * half_m, half_m + _OVERLAP_M) for k in range(count)]
    return bands


_BAND_M = 0.4
_OVERLAP_M = 0.15
"""Ground at a band's end may rise or fall by this within the region: 8° over its farther half."""

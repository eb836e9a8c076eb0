"""The settings of the foothold: whose foot, and the ground that is measured while no foothold is predicted."""

from typing import Annotated

import msgspec

from messages import Side
from messages.constants import MATCHING_WIDTH_PX
from perception.ground.region import FootholdRegion


class FootholdSettings(msgspec.Struct, frozen=True, kw_only=True):
    """The rectangle of ground that is measured, and how far up or down it may lie; `side` is that of the prosthesis.

    While no foothold is predicted the region is centred `ahead_m` along x of H and on the wearer's midline; else it
    follows the prediction (`aim`), no larger than this. While no plane is known the ground is
    looked for `nominal_height_m` below the camera, give or take `height_margin_m`, and in every second frame elsewhere
    (`first_search`); afterwards it may rise or fall by `step_m` from one frame to the next (a stair is 0.17 m, a high
    kerb 0.25 m).

    Pictures of a pair are reduced to about `matching_width_px` before they are matched, from the start of a run. Twice
    as wide takes four times as long, which a recording has (docs/results/ground.md says what it gains).
    """

    side: Side = Side.RIGHT
    ahead_m: Annotated[float, msgspec.Meta(ge=0.2, le=4.0)] = 0.7
    half_length_m: Annotated[float, msgspec.Meta(ge=0.1, le=2.0)] = 0.3
    half_width_m: Annotated[float, msgspec.Meta(ge=0.1, le=2.0)] = 0.3
    nominal_height_m: Annotated[float, msgspec.Meta(ge=0.3, le=2.0)] = 0.95
    height_margin_m: Annotated[float, msgspec.Meta(ge=0.05, le=1.0)] = 0.35
    step_m: Annotated[float, msgspec.Meta(ge=0.05, le=0.5)] = 0.25
    matching_width_px: Annotated[int, msgspec.Meta(ge=320, le=2560)] = MATCHING_WIDTH_PX

    @property
    def region(self) -> FootholdRegion:
        """Return the fixed region."""
        return FootholdRegion(
            ahead_m=self.ahead_m,
            left_m=0.0,
            half_length_m=self.half_length_m,
            half_width_m=self.half_width_m,
            nominal_height_m=self.nominal_height_m,
            height_margin_m=self.height_margin_m,
            step_m=self.step_m,
        )

"""The unit whose eyes are shown: seed and size, for the host that renders and the machine that looks."""

import msgspec

from messages import Lens, StereoCalibration

SEED = 5
SHRINK = 4
"""The pictures are a quarter as wide and high as a ZED's, for all that handles them is emulated."""


def shrunk_stereo(stereo: StereoCalibration) -> StereoCalibration:
    """Return the same cameras with SHRINK × SHRINK pixels taken together; pixel centres are at whole numbers."""

    def shrunk(lens: Lens) -> Lens:
        return msgspec.structs.replace(
            lens,
            width_px=lens.width_px // SHRINK,
            height_px=lens.height_px // SHRINK,
            fx_px=lens.fx_px / SHRINK,
            fy_px=lens.fy_px / SHRINK,
            cx_px=(lens.cx_px + 0.5) / SHRINK - 0.5,
            cy_px=(lens.cy_px + 0.5) / SHRINK - 0.5,
        )

    return msgspec.structs.replace(
        stereo, left=shrunk(stereo.left), right=shrunk(stereo.right), row_time_s=stereo.row_time_s * SHRINK
    )

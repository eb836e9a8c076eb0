"""What a polished floor mirrors: the straight rays that meet the floor go on to a ceiling as far below it.

Being farther away it moves less in the picture than the floor does, and is smeared less.
"""

from collections.abc import Iterator

import cv2
import numpy as np

from messages.arrays import FloatArray, FloatImage, GreyImage
from sim_rig.camera.grid import of_pixels
from sim_rig.walk.polish import Polish
from sim_rig.walk.world import Segment


def ceiling_pieces(polish: Polish, x_m: float) -> Iterator[Segment]:
    """Yield the ceiling as a floor shows it, far to near, from behind a wearer at `x_m` to as far as it is seen."""
    here = int(x_m // _PIECE_M)
    for number in range(here + _AHEAD, here - _BEHIND, -1):
        x0_m, z_m = number * _PIECE_M, -polish.ceiling_m
        yield Segment(x0_m, z_m, x0_m + _PIECE_M, z_m, "level", "ceiling")


def add_mirrored(polish: Polish, d_W: FloatArray, ceiling: GreyImage, picture: GreyImage) -> None:
    """Add to the `picture` of a level floor what it mirrors of the `ceiling` that lies below it; the nodes' rays are
    `d_W` (rows, columns, 3)."""
    cosine = np.clip(-d_W[..., 2] / np.linalg.norm(d_W, axis=-1), 0.0, 1.0)
    light: FloatImage = of_pixels(polish.mirrored(cosine)) * ceiling * np.float32(polish.lamp_grey / _LAMP_LEVEL)
    cv2.add(picture, light, dst=picture, dtype=cv2.CV_8U)


_LAMP_LEVEL = 255.0
"""Of the lamps in the texture."""
_PIECE_M = 4.096
"""Of the ceiling: a tile of its texture, so that pieces meet."""
_AHEAD, _BEHIND = 8, 2

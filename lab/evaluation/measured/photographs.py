"""Photographs of streets, rooms and boards, from the real data sets, to cover simulated ground with."""

import cv2

from lab.evaluation.measured.data_folder import data_folder
from messages import UserError
from messages.arrays import GreyImage

_FILES = (
    ("karlsruhe_urban", "*.png"),
    ("middlebury_cones", "left.png"),
    ("euroc_v1_01_easy", "cam0/*.png"),
    ("zed_chessboard_720p", "*.png"),
)
_OF_EACH = 4
_LEAST_DEVIATION = 15.0  # of the grey levels, below which there is nothing to see


def photographs() -> list[GreyImage]:
    """Return some grey pictures of several places, each of its own size.

    Raises UserError where a data set is absent, or has no picture.
    """
    found: list[GreyImage] = []
    for name, pattern in _FILES:
        folder = data_folder(name)
        read = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(folder.glob(pattern))[:_OF_EACH]]
        seen = [picture for picture in read if picture is not None and picture.std() > _LEAST_DEVIATION]
        if not seen:
            raise UserError(f"{folder}: no picture {pattern} to cover ground with")
        found += seen  # type: ignore[arg-type]
    return found

"""Text and labels in a picture, large enough to be read where it is shown 640 px wide."""

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
"""(height, width, 3), blue, green, red."""
Colour = tuple[int, int, int]

WHITE: Colour = (255, 255, 255)
SHOWN_PX = 640


class Lettering:
    """Writes into one picture; labels give way to those that are there already."""

    def __init__(self, picture: Picture) -> None:
        self._picture = picture
        self.unit = picture.shape[1] / SHOWN_PX
        self._font = cv2.FontFace("sans")
        self._taken: list[tuple[int, int, int, int]] = []

    def label(self, text: str, at_px: tuple[float, float], colour: Colour) -> None:
        """Write `text` to the right of a pixel, moved into the picture and off other labels."""
        size = round(_LABEL_PX * self.unit)
        rows, columns = self._picture.shape[:2]
        width, height, pad = self._width(text, size), round(1.3 * size), round(0.3 * size)
        left = int(np.clip(at_px[0] + 2 * pad, 0, max(0, columns - width - 2 * pad)))
        middle = int(np.clip(at_px[1], height, rows - height))
        for step in range(2 * rows // height):
            top = middle - height // 2 + (-1) ** step * ((step + 1) // 2) * (height // 2)
            box = (left, top, left + width + 2 * pad, top + height)
            if top >= 0 and box[3] <= rows and not any(_overlap(box, other) for other in self._taken):
                self._taken.append(box)
                self._dark(*box)
                self._write(text, (left + pad, top + size), size, colour)
                return

    def _width(self, text: str, size: int) -> int:
        rows, columns = self._picture.shape[:2]
        return int(cv2.getTextSize((columns, rows), text, (0, 0), self._font, size)[2])

    def _write(self, text: str, at: tuple[int, int], size: int, colour: Colour) -> None:
        cv2.putText(self._picture, text, at, colour, self._font, size, _WEIGHT)

    def _dark(self, left: int, top: int, right: int, bottom: int) -> None:
        part = self._picture[max(top, 0) : bottom, max(left, 0) : right]
        part[:] = (0.35 * part).astype(np.uint8)


def bar(texts: list[tuple[str, Colour]], width: int) -> Picture:
    """Return `texts` below one another on a dark bar as wide as a picture, of an even number of rows."""
    size = round(_TEXT_PX * width / SHOWN_PX)
    pitch, margin = round(1.4 * size), round(0.5 * size)
    dark = np.full((2 * ((pitch * len(texts) + margin + 1) // 2), width, 3), _DARK, np.uint8)
    for k, (text, colour) in enumerate(texts):
        at = (margin, margin // 2 + pitch * (k + 1) - round(0.3 * size))
        cv2.putText(dark, text, at, colour, cv2.FontFace("sans"), size, _WEIGHT)
    return dark


def _overlap(one: tuple[int, int, int, int], other: tuple[int, int, int, int]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


_TEXT_PX, _LABEL_PX = 15.0, 13.0
_DARK, _WEIGHT = 30, 500

"""What the service says of one frame, drawn into the picture in which it was seen."""

import math
from itertools import pairwise

import cv2
import numpy as np

from cli.overlay.lettering import WHITE, Colour, Lettering, Picture, bar
from cli.overlay.projection import Sight
from cli.overlay.shapes import OBSTACLE, REGION, Said, Shape, shapes
from daemon.pictures import grey
from messages import Image, Status
from messages.arrays import BoolArray, FloatArray
from perception.ground.foothold import FootholdSettings


def drawn(image: Image, said: Said, region: FootholdSettings) -> Picture:
    """Return `image` (height, width) in colours with what was `said` of it, below a bar of text with its numbers.

    `image` may be smaller than the camera's. `region` is that of the ground. Of a depth image near is bright, and black
    what has no depth.
    """
    picture = cv2.cvtColor(grey(image), cv2.COLOR_GRAY2BGR).astype(np.uint8, copy=False)
    if said.sight is not None:
        pen = _Pen(picture, said.sight)
        for shape in shapes(said, region):
            pen.draw(shape)
        pen.write_labels()
    return np.vstack((bar(numbers(said), picture.shape[1]), picture))


class _Pen:
    def __init__(self, picture: Picture, sight: Sight) -> None:
        self._picture = picture
        self._sight = sight
        self._letters = Lettering(picture)
        self._labels: list[tuple[str, tuple[float, float], Colour]] = []

    def draw(self, shape: Shape) -> None:
        """Draw the lines of a shape, over its area if it is filled; its label is written later."""
        for corners_H in shape.lines:
            if shape.filled:
                self._area(corners_H, shape.colour)
            at_px = self._line(corners_H, shape.colour, shape.width)
            if shape.label and at_px is not None:
                self._labels.append((shape.label, at_px, shape.colour))

    def write_labels(self) -> None:
        """Write what the lines mean, the nearest first."""
        for text, at_px, colour in sorted(self._labels, key=lambda label: -label[1][1]):
            self._letters.label(text, at_px, colour)

    def _pixels(self, corners_H: FloatArray) -> FloatArray:
        """Return pixels (n, 2) along the lines from corner to corner."""
        along = [np.linspace(one, other, _PIECES) for one, other in pairwise(corners_H)]
        pixels: FloatArray = self._sight.pixels(np.concatenate(along))
        scale: float = self._picture.shape[1] / self._sight.lens.width_px
        return scale * (pixels + 0.5) - 0.5

    def _line(self, corners_H: FloatArray, colour: Colour, width: int) -> tuple[float, float] | None:
        """Draw lines through `corners_H` (n, 3); return the rightmost pixel of it in the picture, if any is."""
        pixels = self._pixels(corners_H)
        rows, columns = self._picture.shape[:2]
        shown: BoolArray = ~np.isnan(pixels.sum(axis=1))
        for one, other in pairwise(range(len(pixels))):
            if shown[one] and shown[other]:
                ends = np.rint(pixels[[one, other]] * 2**_SHIFT).astype(int)
                thick = max(1, round(width * self._letters.unit))
                cv2.line(self._picture, tuple(ends[0]), tuple(ends[1]), colour, thick, cv2.LINE_AA, _SHIFT)
        inside = shown & (np.nan_to_num(pixels, nan=-1.0) >= 0.0).all(axis=1)
        inside &= (np.nan_to_num(pixels) <= (columns - 1, rows - 1)).all(axis=1)
        if not inside.any():
            return None
        rightmost = pixels[inside][np.argmax(pixels[inside][:, 0])]
        return float(rightmost[0]), float(rightmost[1])

    def _area(self, corners_H: FloatArray, colour: Colour) -> None:
        pixels = self._pixels(corners_H)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        if len(pixels) > _LEAST_CORNERS:
            tinted = self._picture.copy()
            cv2.fillPoly(tinted, [np.rint(pixels).astype(np.int32)], colour)
            self._picture[:] = cv2.addWeighted(self._picture, 1.0 - _TINT, tinted, _TINT, 0.0)


def numbers(said: Said) -> list[tuple[str, Colour]]:
    """Return the lines of text on slope, height and kind, or why there are none, each in its colour."""
    ground, terrain = said.ground, said.terrain
    if ground.status is Status.VALID:
        sd = [math.sqrt(ground.covariance[k]) for k in (0, 3, 5)]
        text = (
            f"ahead {_degrees(ground.slope_sagittal_rad)} ±{math.degrees(sd[0]):.1f}°   "
            f"across {_degrees(ground.slope_frontal_rad)} ±{math.degrees(sd[1]):.1f}°   "
            f"height {100 * ground.height_m:.1f} ±{100 * sd[2]:.1f} cm"
        )
        lines = [(text, REGION)]
    else:
        lines = [(f"no ground: {ground.reason.value}", OBSTACLE)]
    if terrain is None:
        return [*lines, (f"{said.t_s:.2f} s", WHITE)]
    if terrain.status is not Status.VALID:
        return [*lines, (f"{said.t_s:.2f} s   no terrain: {terrain.reason.value}", OBSTACLE)]
    return [*lines, (f"{said.t_s:.2f} s   {terrain.kind.value} {terrain.probability:.0%}", WHITE)]


def _degrees(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):+.1f}°"


_PIECES = 24
_SHIFT = 3
_TINT = 0.18
_LEAST_CORNERS = 3

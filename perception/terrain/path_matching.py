"""Where a frame shows the path, and its disparities there: a fifth of all the work on a frame.

It needs the attitude no better than it is known before anything has been made of the frame, so it may be done beside
the rest, on another processor.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from messages import Image
from messages.arrays import FloatArray
from perception.depth.disparity import DisparityCamera, DisparityPatch, View


@dataclass(frozen=True)
class PathSettings:
    """The path is `half_width_m` wide to either side and reaches from `nearest_m` to `farthest_m` along x of H.

    Ground is looked for down to `below_m` under the ground that the wearer stands on, and up to `above_m` over it,
    far away, half as high near the feet. What a polished floor mirrors lies deeper: down to `mirrored_m` it is found,
    and left out, since where it is not looked for something else is like it by chance.
    """

    nearest_m: float = 0.15
    farthest_m: float = 2.75
    half_width_m: float = 0.25
    above_m: float = 0.60
    below_m: float = 1.50
    mirrored_m: float = 4.50


class MatchedBand(NamedTuple):
    """What was matched of one band of a picture's rows, of which one row and one column in so many is kept."""

    patch: DisparityPatch
    strides: tuple[int, int]


Work = Callable[[], tuple[MatchedBand, ...]]
Beside = Callable[[Work], Work]
"""Begins work in another thread; what it returns, called once, waits for it and returns its result."""


def in_turn(work: Work) -> Work:
    """Leave the work until its result is asked for."""
    return work


@dataclass(frozen=True)
class PathMatching:
    """What has been begun, as the path is seen with this attitude (3, 3), and what returns its `result`."""

    R_HC: FloatArray
    result: Work

    def serves(self, R_HC: FloatArray) -> bool:
        """Return whether the path is where it was looked for."""
        return float(np.trace(self.R_HC.T @ R_HC)) > 1.0 + 2.0 * math.cos(_MOST_OFF_RAD)


def match_path(
    camera: DisparityCamera, images: Sequence[Image], R_HC: FloatArray, height_m: float, path: PathSettings
) -> tuple[MatchedBand, ...]:
    """Return the disparities of the path in a frame's raw `images`, in bands of rows: each sees other distances.

    `R_HC` and the `height_m` of the camera over the ground that the wearer stands on tell where to look: a degree and
    some centimetres more or less make no difference.
    """
    views = _views(camera, R_HC, height_m, path)
    matched = [(camera.find_in_view(images, view), strides) for view, strides in views]
    return tuple(MatchedBand(patch.every(*strides), strides) for patch, strides in matched if patch is not None)


def _views(
    camera: DisparityCamera, R_HC: FloatArray, height_m: float, path: PathSettings
) -> list[tuple[View, tuple[int, int]]]:
    """Return what of the picture shows the path, band by band from top to bottom, and of how many rows and columns
    one is taken."""
    top, bottom = camera.tangents_down
    edges = np.linspace(top, bottom, len(_STRIDES) + 1)
    views = []
    for band, strides, share in zip(itertools.pairwise(edges), _STRIDES, (1.0, 0.75, 0.5), strict=True):
        highest_m, lowest_m = max(height_m - share * path.above_m, _LEAST_HEIGHT_M), height_m + path.mirrored_m
        falls = -(np.array([[0.0, band[0], 1.0], [0.0, band[1], 1.0]]) @ R_HC.T)[:, 2]  # of a ray that is 1 deep
        if falls[1] <= LEAST_FALL:
            continue
        deepest_m = lowest_m / max(falls[0], LEAST_FALL)
        nearest_m = highest_m / falls[1]
        reach = path.half_width_m * falls[1] / max(height_m - _USUAL_RISE_M, _LEAST_HEIGHT_M)
        views.append((View((-reach, reach), band, (nearest_m, min(deepest_m, _DEEPEST_M))), strides))
    return views


_STRIDES = ((1, 4), (2, 4), (3, 5))
"""Rows and columns of which one is taken, in the top, middle and bottom band."""
_MOST_OFF_RAD = math.radians(1.0)
LEAST_FALL = 0.15
"""Of a ray that is 1 deep: what falls less meets no ground on the path."""
_LEAST_HEIGHT_M = 0.35
_USUAL_RISE_M = 0.25  # over ground that is higher still, the path is narrower
_DEEPEST_M = 12.0

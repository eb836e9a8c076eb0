"""Have the eyes moved against each other? Distances that all jump between two pictures, as no ground's do.

A corner followed from one left picture to the next should there have the disparity d' that the step of the camera
gives it. What the pair then shows, d, differs by noise. If an eye has turned on its mount, or a window before it has
bent, all corners differ at once, at (x, y) by

    d − d' = a + b x + c y                                                                            (1)

The step takes its distances from the pair before, and both are told by pictures alone: neither the IMU nor any idea of
the ground has part in this. Only corners that agree with the step count: what moves by itself tells nothing. Jumps are
summed up until they cancel out, or until something else tells that distances are right again: the one back may be
missed, in a frame that shows nothing, and where the IMU errs a step may be wrong by as much as a jump.
"""

import math
from dataclasses import dataclass

import numpy as np

from messages.arrays import Float32Array, FloatArray


@dataclass(frozen=True, kw_only=True)
class JumpSettings:
    """What counts as a jump, in pixels of the picture whose corners are followed.

    Corners off (1) by more than `usual_px` count the less, and `least_share` of them are off by less than
    `agreeing_px`. The jump is at least `least_px` somewhere between them, beyond `sigmas` of chance. Eyes that slip
    still show the same corners: the first jump is shown by `first_share` of as many as usual, fewer may be chance
    matches of pictures that do not belong together.
    """

    least_px: float = 0.4
    sigmas: float = 4.0
    agreeing_px: float = 0.3
    least_share: float = 0.8
    least_corners: int = 12
    usual_px: float = 0.1
    rounds: int = 4
    first_share: float = 0.4
    usual_kept: float = 0.9  # of how many are usual, from one picture without a jump to the next


class DistanceJumps:
    """Sums up the jumps of one pair of eyes; `contradict` while what they leave would be one.

    `newest_px` is by how much distances differed in the newest picture, beyond chance; NaN where its corners do not
    tell.
    """

    def __init__(self, settings: JumpSettings | None = None) -> None:
        self._settings = settings or JumpSettings()
        self._sum: FloatArray = np.zeros(3)
        self._usual_corners = 0.0
        self.contradict = False
        self.newest_px = math.nan

    @property
    def jumped(self) -> bool:
        """Return whether distances differed by a jump in the newest picture."""
        return self.newest_px > self._settings.least_px

    def forget(self) -> None:
        """Take distances for right from now on."""
        self._sum, self.contradict = np.zeros(3), False

    def add(self, corners_px: Float32Array, off_px: FloatArray) -> None:
        """Take corners (N, 2) of one left picture and d − d' (N,) of each, pixels."""
        settings, self.newest_px = self._settings, math.nan
        if len(off_px) < settings.least_corners:
            return
        places_px = corners_px.astype(np.float64)
        jump = self._fitted(places_px, off_px)
        left_px = np.abs(off_px - jump[0] - places_px @ jump[1:])
        agreed = np.count_nonzero(left_px < settings.agreeing_px) > settings.least_share * len(off_px)
        if not agreed:
            return
        # of N corners the deviation at a corner of the rectangle is that of three means
        chance_px = settings.sigmas * _OF_MEDIAN * float(np.median(left_px)) * math.sqrt(3.0 / len(off_px))
        self.newest_px = max(0.0, _largest_px(jump, places_px) - chance_px)
        if not self.jumped:
            kept = settings.usual_kept if self._usual_corners else 0.0
            self._usual_corners = kept * self._usual_corners + (1.0 - kept) * len(off_px)
        elif self.contradict or len(off_px) >= settings.first_share * self._usual_corners:
            self._sum = self._sum + jump
            self.contradict = _largest_px(self._sum, places_px) > settings.least_px
            if not self.contradict:
                self._sum = np.zeros(3)

    def _fitted(self, places_px: FloatArray, off_px: FloatArray) -> FloatArray:
        """Return (a, b, c) of (1) by least squares with Huber's weights."""
        A = np.column_stack((np.ones(len(places_px)), places_px))
        fit = np.array([np.median(off_px), 0.0, 0.0])
        for _ in range(self._settings.rounds):
            weighted = A / np.maximum(np.abs(off_px - A @ fit) / self._settings.usual_px, 1.0)[:, None]
            fit = np.linalg.lstsq(weighted.T @ A, weighted.T @ off_px, rcond=None)[0]
        return fit


def _largest_px(jump: FloatArray, places_px: FloatArray) -> float:
    """Return how far (a, b, c) moves a corner of the rectangle one deviation about the middle of all places (N, 2)."""
    middle_px, deviation_px = places_px.mean(axis=0), places_px.std(axis=0)
    at_corners = jump[0] + jump[1:] @ (middle_px + deviation_px * _RECTANGLE).T
    return float(np.abs(at_corners).max())


_OF_MEDIAN = 1.4826
"""One standard deviation of normal errors in units of the median of their sizes."""
_RECTANGLE = np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])

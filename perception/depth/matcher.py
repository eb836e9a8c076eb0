"""Semi-global matching (OpenCV's three-way variant) of one rectified window, over a stated disparity range."""

from dataclasses import dataclass

import cv2
import numpy as np

from messages.arrays import FloatImage, GreyImage
from perception.depth.rectify import Rectifier, Window

_SUBPIXEL = 16  # OpenCV's fixed-point disparity
_WHITE = 254  # what interpolation leaves of 255
_STEP = 16  # numDisparities must be a multiple of this


@dataclass(frozen=True)
class DisparityRange:
    """Disparities from `low_px` up to `low_px + count` are searched; `count` is a multiple of 16."""

    low_px: int
    count: int

    @classmethod
    def covering(cls, low_px: float, high_px: float) -> "DisparityRange":
        """Return the smallest searchable range that holds [low_px, high_px] and one pixel either side."""
        low = max(0, int(np.floor(low_px)) - 1)
        return cls(low_px=low, count=int(np.ceil((high_px + 1 - low) / _STEP)) * _STEP)


class SemiGlobalMatcher:
    """Dense disparity of a window of the left eye.

    Deterministic for any thread count: the three-way variant always cuts the image into the same stripes.
    """

    least_contrast = 2.0
    """Standard deviation of the window's grey levels: less may be the sensor's noise alone, which matches by chance."""
    uniqueness_percent = 5  # 100 would kill the process with SIGFPE in OpenCV 5.0.0

    def __init__(self, rectifier: Rectifier, rows_together: int = 1, speckle_px: int = 50) -> None:
        """`rows_together` are averaged before they are matched: where no detail is needed, that costs less.

        What matches in a patch smaller than `speckle_px` is left out.
        """
        self._rectifier = rectifier
        self._rows_together = rows_together
        # A block of three averaged rows sees as much as one of five, and as few pixels vote for less smoothness.
        self._block_px, self._bend = (5, 8) if rows_together == 1 else (3, 16)
        self._speckle_px = speckle_px // rows_together
        self._matchers: dict[int, cv2.StereoSGBM] = {}

    def match(self, left: GreyImage, right: GreyImage, window: Window, search: DisparityRange) -> FloatImage:
        """Return (rows // `rows_together`, columns) disparities in px of the reduced image; NaN where nothing matched.

        Where the left eye is at the end of its scale there is nothing to match, whatever the matcher fills in.
        `left` and `right` are raw images of the calibrated size.
        """
        # The matcher needs `count` columns to the left of the window; the right eye is shifted by `low_px`.
        wide = Window(window.top, window.bottom, max(0, window.left - search.count), window.right)
        left_eye, right_eye = self._rectifier.rectify(left, right, wide, search.low_px)
        if self._rows_together > 1:
            left_eye, right_eye = self._averaged(left_eye), self._averaged(right_eye)
        fixed = self._matcher(search.count).compute(left_eye, right_eye)
        fixed, shown = fixed[:, window.left - wide.left :], left_eye[:, window.left - wide.left :]
        disparity: FloatImage = fixed.astype(np.float32) / np.float32(_SUBPIXEL) + np.float32(search.low_px)
        contrast = float(cv2.meanStdDev(shown)[1][0, 0])
        disparity[(fixed < 0) | (shown == 0) | (shown >= _WHITE) | (contrast < self.least_contrast)] = np.nan
        return disparity

    def _averaged(self, eye: GreyImage) -> GreyImage:
        size = (eye.shape[1], eye.shape[0] // self._rows_together)
        return cv2.resize(eye, size, interpolation=cv2.INTER_AREA)  # type: ignore[return-value]

    def _matcher(self, count: int) -> cv2.StereoSGBM:
        if count not in self._matchers:
            self._matchers[count] = cv2.StereoSGBM.create(
                minDisparity=0,
                numDisparities=count,
                blockSize=self._block_px,
                P1=self._bend * self._block_px**2,
                P2=4 * self._bend * self._block_px**2,
                disp12MaxDiff=1,
                preFilterCap=31,
                uniquenessRatio=self.uniqueness_percent,
                speckleWindowSize=self._speckle_px,
                speckleRange=1,
                mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
            )
        return self._matchers[count]

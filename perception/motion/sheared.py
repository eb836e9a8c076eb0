"""Following corners of the ground into a picture that shows it stretched: in the other eye, or a step later.

Ground that is looked at from above is slanted, so its disparity changes by a tenth of a pixel and more from row to row;
and one who walks sees it grow by some hundredths from frame to frame. Within the window that is followed, one picture
is sheared against the other, and where the corner is found then depends on which side of it has more contrast: all are
drawn to a line where two grounds meet. So the other picture is first sheared as the ground about most corners is,

    x' = A (x, y, 1),                                                                                           (1)

with A (2, 3) of robust least squares over about how corners lie to their neighbours: treads are sheared otherwise than
the flight that they make up. What is then followed is alike in both, and whatever A is, (1) carries the result back
exactly.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from messages.arrays import BoolArray, Float32Array, FloatArray, GreyImage
from perception.motion.corners import followed, inside, returned


class Shear:
    """A of (1), from corners (N, 2) of one picture and about where they are in the other (N, 2)."""

    def __init__(self, corners_px: Float32Array, about_px: Float32Array) -> None:
        self._corners_px = corners_px
        self._A = _affine(corners_px.astype(np.float64), about_px.astype(np.float64))
        self._about_px = _moved(about_px, cv2.invertAffineTransform(self._A))  # type: ignore[arg-type]

    def matched(self, left: GreyImage, right: GreyImage) -> tuple[Float32Array, BoolArray]:
        """Return where (N, 2) the corners of the left eye are in the right one, and which of them were found there."""
        found_px, good = followed(left, self._sheared(right, cv2.INTER_LINEAR), self._corners_px, self._about_px)
        return _moved(found_px, self._A), good

    def tracked(self, before: GreyImage, after: GreyImage, levels: int) -> tuple[Float32Array, BoolArray]:
        """Return where (N, 2) the corners are a step later, and which, followed back, end where they began.

        The search begins in pictures reduced `levels` times by a half.
        """
        sheared = self._sheared(after, cv2.INTER_CUBIC)  # what linear interpolation blurs would make a slow drift
        found_px, good = followed(before, sheared, self._corners_px, self._about_px, levels)
        good &= returned(before, sheared, self._corners_px, found_px)
        there_px = _moved(found_px, self._A)
        return there_px, good & inside(after, there_px)

    def _sheared(self, image: GreyImage, interpolation: int) -> GreyImage:
        """Return what `image` shows at (1) of each of its pixels."""
        height, width = image.shape
        flags = interpolation | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(image, self._A, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[return-value]


def _affine(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return A (2, 3) that brings x (N, 2) to about y (N, 2), its shear from neighbours alone, by weights that fall
    with the misfit (Cauchy's).

    It shifts most by whole pixels, so that interpolation blurs nothing where nothing is sheared. What too few
    neighbours do not tell is no shear.
    """
    one, other = _neighbours(x)
    shift = y - x
    apart, design = shift[one] - shift[other], (x[one] - x[other]) / _NEAR_PX
    weighted, by = design, np.zeros((2, 2))
    for _ in range(_ROUNDS if len(one) else 0):
        by = np.linalg.solve(weighted.T @ design + _RIDGE, weighted.T @ apart).T
        misfit = apart - design @ by.T
        square = (misfit * misfit).sum(axis=1)
        usual_square = max(_LEAST_MISFIT_PX**2, float(np.partition(square, len(square) // 2)[len(square) // 2]))
        weighted = design / (1.0 + square / usual_square)[:, None]
    by /= _NEAR_PX
    middle = x.mean(axis=0)
    usual_shift = np.median(shift - (x - middle) @ by.T, axis=0)
    shear = np.eye(2) + by
    return np.column_stack((shear, middle + np.rint(usual_shift) - shear @ middle))


def _neighbours(x: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the pairs of points (N, 2) that are less than `_NEAR_PX` apart, along either axis."""
    near = np.abs(x[:, None, 0] - x[:, 0]) < _NEAR_PX
    near &= np.abs(x[:, None, 1] - x[:, 1]) < _NEAR_PX
    one, other = np.nonzero(np.triu(near, 1))
    return one, other


def _moved(points_px: Float32Array, A: FloatArray) -> Float32Array:
    moved: Float32Array = (points_px @ A[:, :2].T + A[:, 2]).astype(np.float32)
    return moved


_ROUNDS = 3
_NEAR_PX = 18.0
"""Between neighbours: no more than a tread of stairs has at two metres."""
_RIDGE = 1e-2 * np.eye(2)
"""Weight of no shear, in pairs so far apart."""
_LEAST_MISFIT_PX = 0.1
"""What dense matching errs by between neighbours."""

"""Corners of a picture: found where they can be followed, spread over the whole of it, and followed into another."""

import cv2
import numpy as np

from messages import Lens
from messages.arrays import BoolArray, Float32Array, FloatArray, FloatImage, GreyImage
from perception.depth.rectify import intrinsics


class Eye:
    """One lens, its rays turned into C by `R_C_raw` (3, 3)."""

    def __init__(self, lens: Lens, R_C_raw: FloatArray) -> None:
        self._K = intrinsics(lens)
        self._distortion = np.array(lens.distortion)
        self._R_C_raw = R_C_raw
        self._turn_back = cv2.Rodrigues(R_C_raw.T)[0]
        self.f_px = float(self._K[0, 0])

    def rays_C(self, points_px: Float32Array) -> FloatArray:
        """Return the rays (N, 3), z = 1, in C of pixels (N, 2)."""
        points = points_px[:, None].astype(np.float64)
        flat = cv2.undistortPoints(points, self._K, self._distortion, R=self._R_C_raw, criteria=_UNDISTORTED)
        rays = np.ones((len(flat), 3))
        rays[:, :2] = flat[:, 0]
        return rays

    def pixels(self, points_C: FloatArray) -> Float32Array:
        """Return the pixels (N, 2) that show points (N, 3) in C."""
        flat = cv2.projectPoints(points_C[:, None], self._turn_back, _ORIGIN, self._K, self._distortion)[0]
        return flat.reshape(-1, 2).astype(np.float32)


def detail(image: GreyImage, divisor: int) -> GreyImage:
    """Return `image` reduced by `divisor`, about grey `_MIDDLE`, less its local mean and with its usual contrast.

    Tracking takes a difference in brightness for a motion. Two eyes differ by their gain, and every lens by where it is
    darker: at the local mean that leaves nothing. Faint pictures get the contrast of others.
    """
    small = _reduced(image, divisor)
    about_mean = cv2.subtract(small, cv2.blur(small, _NEIGHBOURHOOD_PX))
    some = np.abs(about_mean[::_EVERY_PX, ::_EVERY_PX]).ravel()
    usual = float(np.partition(some, some.size // 2)[some.size // 2])
    gain = _USUAL_CONTRAST / max(usual, _USUAL_CONTRAST / _MOST_GAIN)
    return cv2.convertScaleAbs(about_mean, alpha=gain, beta=_MIDDLE)  # type: ignore[return-value]


def _reduced(image: GreyImage, divisor: int) -> FloatImage:
    """Return the area average; by a half in whole grey values first, which is fast and rounds off little."""
    height, width = image.shape
    size = (width // divisor, height // divisor)
    if divisor % 2 == 0:
        image = cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
    small = image.astype(np.float32)
    return small if divisor <= 2 else cv2.resize(small, size, interpolation=cv2.INTER_AREA)  # type: ignore[return-value]


def corners(image: GreyImage) -> Float32Array:
    """Return the pixels (N, 2) of the best corners of each cell of the picture, `_PER_CELL` at most."""
    strength = cv2.cornerMinEigenVal(image, _STRENGTH_BLOCK_PX)
    best = (strength >= cv2.dilate(strength, _SPACING)) & (strength > _LEAST_STRENGTH)
    best[:_BORDER_PX], best[-_BORDER_PX:], best[:, :_BORDER_PX], best[:, -_BORDER_PX:] = False, False, False, False
    v, u = np.divmod(np.flatnonzero(best), image.shape[1])
    cell = (v // _CELL_PX) * (image.shape[1] // _CELL_PX + 1) + u // _CELL_PX
    order = np.lexsort((-strength[v, u], cell))
    v, u, cell = v[order], u[order], cell[order]
    rank = np.arange(len(cell)) - np.searchsorted(cell, cell)
    kept = rank < _PER_CELL
    off_centre = np.outer(np.arange(np.count_nonzero(kept)), _GOLDEN) % 1.0 - 0.5
    return (np.column_stack((u[kept], v[kept])) + off_centre).astype(np.float32)


def followed(
    before: GreyImage,
    after: GreyImage,
    points_px: Float32Array,
    guess_px: Float32Array,
    levels: int = 0,
    stop: tuple[int, int, float] | None = None,
) -> tuple[Float32Array, BoolArray]:
    """Return where `points_px` (N, 2) of one picture are in another, and which of them were found there, but not where
    the window reaches beyond its border: what is made up there draws them to the inside.

    The search begins at `guess_px`, in a picture reduced `levels` times by a half, and ends at `stop`, else `_STOP`.
    """
    there_px, status, _ = cv2.calcOpticalFlowPyrLK(
        before,
        after,
        points_px[:, None],
        guess_px[:, None].copy(),
        winSize=_WINDOW_PX,
        maxLevel=levels,
        criteria=stop or _STOP,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW | cv2.OPTFLOW_LK_GET_MIN_EIGENVALS,  # which cost less than OpenCV's errors
    )
    found_px: Float32Array = there_px.reshape(-1, 2).astype(np.float32)
    return found_px, inside(after, found_px) & (status.ravel() == 1)


def returned(before: GreyImage, after: GreyImage, points_px: Float32Array, found_px: Float32Array) -> BoolArray:
    """Return which of `points_px` (N, 2), found at `found_px` (N, 2), end where they began when followed back."""
    back_px, found = followed(after, before, found_px, points_px, stop=_STOP_NEAR)
    closed: BoolArray = np.abs(back_px - points_px).max(axis=1, initial=0.0) < _MOST_RETURN_PX
    return found & closed


def inside(image: GreyImage, points_px: Float32Array) -> BoolArray:
    """Return about which of `points_px` (N, 2) the window lies within the picture."""
    height, width = image.shape
    last_px = np.array((width - 1 - _BORDER_PX, height - 1 - _BORDER_PX))
    within: BoolArray = np.all((points_px >= _BORDER_PX) & (points_px <= last_px), axis=1)
    return within


def is_ambiguous(left: GreyImage, right: GreyImage, corner_px: Float32Array, matched_px: Float32Array) -> bool:
    """Return whether what is about a corner (2,) of the left eye is found in the right one not only at `matched_px`
    (2,), but nearly as well further along the row, with something unlike it between the two.

    What changes little along the row, as a joint of floorboards does, is alike everywhere and comes back nowhere.
    """
    half, above = _WINDOW_PX[0] // 2, _ROWS_APART_PX
    (u, v), (u_there, v_there) = (map(round, point_px.tolist()) for point_px in (corner_px, matched_px))
    height, width = left.shape
    first, last = max(0, u_there - _ALONG_PX), min(width, u_there + _ALONG_PX + 1)
    inside = half <= u < width - half and half <= v < height - half and first + half <= u_there < last - half
    if not (inside and half + above <= v_there < height - half - above):
        return False
    window = left[v - half : v + half + 1, u - half : u + half + 1]
    row = right[v_there - half - above : v_there + half + above + 1, first:last]
    likeness = cv2.matchTemplate(row, window, cv2.TM_CCOEFF_NORMED).max(axis=0)
    here = u_there - first - half
    between = np.concatenate((np.minimum.accumulate(likeness[here::-1])[:0:-1], np.minimum.accumulate(likeness[here:])))
    comes_back = (likeness > _ALIKE * likeness[max(0, here - 1) : here + 2].max()) & (between < _UNLIKE * likeness)
    return bool(comes_back.any())


_ORIGIN = np.zeros(3)
_UNDISTORTED = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-4)
"""Steps at most, and in px what ends them: OpenCV's five steps leave 0.1 px at a picture's corner."""
_NEIGHBOURHOOD_PX = (21, 21)
"""Of the local mean: twice the window that is followed."""
REACH_PX = 16
"""As far from a corner what is seen has a part in where it is found: half a window, and half the neighbourhood."""
_MIDDLE = 128.0
_USUAL_CONTRAST = 10.0
"""Grey values, median of the absolute: a few times more before white or black cut it off."""
_MOST_GAIN = 24.0
"""Of a picture so faint that rounding to whole grey values, 0.1 after the reduction, begins to show."""
_EVERY_PX = 4
"""Of rows and of columns: enough for a median."""
_STRENGTH_BLOCK_PX = 3
_LEAST_STRENGTH = 1e-4
"""OpenCV's measure of a corner in pictures of the usual contrast: less is followed to no better than half a pixel."""
_SPACING = np.ones((11, 11), np.uint8)
"""About a window: corners within it would be much the same."""
_BORDER_PX = 5
"""Half a window."""
_CELL_PX = 32
_PER_CELL = 2
_MOST_RETURN_PX = 0.5
_WINDOW_PX = (11, 11)
"""Followed about a corner: more would reach over edges in depth."""
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.01)
"""Steps at most, and in px the step that ends the search: below the noise, so that no trace of the guess is left."""
_STOP_NEAR = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 5, 0.1)
"""Where only `_MOST_RETURN_PX` is asked."""
_GOLDEN = np.array([0.7548776662466927, 0.5698402909980532])
"""Steps that fill the unit square evenly (Roberts' sequence)."""
_ROWS_APART_PX = 2
"""That a match may be above or below the row, so that a corner is looked for where its like would be."""
_ALONG_PX = 45
"""To either side: some of the smaller tiles, one of the larger."""
_ALIKE = 0.9
"""Share of the best likeness."""
_UNLIKE = 0.7
"""Of that likeness, or less, is left between two tiles, at nine tenths of their corners; on floorboards at no more than
four tenths of those that look alike elsewhere."""

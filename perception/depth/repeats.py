"""Whether a floor repeats itself along the rows, so that planes of other heights match the pair as well as one.

Both rectified eyes are laid on a plane d = r · θ: of row v the left eye at the columns u_j = u_0 + j ε d(u_0, v) and
the right one at u_j − d(u_j, v), where the two show the same ground. The plane of ρ times those disparities (as steep,
at 1/ρ of the height) takes the right eye's column j + k for the left one's j, with

    k ε d = (1 − ρ) d,        k = (1 − ρ) / ε,                                                              (1)

for all rows at once. So one correlation along the rows compares all these planes over the whole region. Where the
laid picture also repeats itself by k, that is the floor's doing, and not a second surface's; and where another plane
fits far better, the one found cannot be trusted either way.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

import cv2
import numpy as np

from messages import Image
from messages.arrays import Float32Array, FloatArray, GreyImage
from perception.depth.rectify import Rectifier, Window


class Rival(NamedTuple):
    """A plane of `ratio` times the disparities, which the pair supports too; `misfit` is 1 less its correlation.

    It is `alike` where the picture repeats itself there; where not, the plane may be that of a second surface."""

    ratio: float
    misfit: float
    alike: bool = True


class Repeats(NamedTuple):
    """What the pair says of a plane and of those that a repeating floor puts beside it; `misfit` is the plane's own,
    NaN where it could not be asked."""

    misfit: float
    rivals: tuple[Rival, ...]

    def misfit_near(self, ratio: float) -> float:
        """Return the misfit of the plane, this one among them, whose ratio is nearest to `ratio`."""
        return min((self._itself, *self.rivals), key=lambda rival: abs(rival.ratio - ratio)).misfit

    @property
    def best_misfit(self) -> float:
        """Return the least misfit, of the plane and its rivals."""
        return min((self._itself, *self.rivals), key=lambda rival: rival.misfit).misfit

    def of_the_floor(self) -> "Repeats":
        """Return the same without what may be the plane of a second surface."""
        return self._replace(rivals=tuple(rival for rival in self.rivals if rival.alike))

    def within(self, ratios: tuple[float, float]) -> "Repeats":
        """Return the same without the rivals beyond the least and the greatest of `ratios`."""
        return self._replace(rivals=tuple(rival for rival in self.rivals if ratios[0] < rival.ratio < ratios[1]))

    def standing_out(self) -> float | None:
        """Return the ratio of the plane that fits clearly better than all others, 1 for the plane itself; or None."""
        best, *others = sorted((self._itself, *self.rivals), key=lambda rival: rival.misfit)
        return best.ratio if all(other.misfit > _CLEARLY * best.misfit for other in others) else None

    @property
    def _itself(self) -> Rival:
        return Rival(1.0, self.misfit)


NO_REPEATS = Repeats(math.nan, ())


class _LaidPair(NamedTuple):
    """Both eyes laid on a plane: the part of the left one's columns begins in the right one at `here`."""

    left: Float32Array
    right: Float32Array
    here: int


def find_repeats(rectifier: Rectifier, images: Sequence[Image], points_C: FloatArray, theta_C: FloatArray) -> Repeats:
    """Return the rivals of the plane d = r · `theta_C` (3,), px, in the region of the raw pair that shows `points_C`.

    `points_C` (N, 3) lie before the camera. No rivals where the region is hardly in view.
    """
    laid = _laid_pair(rectifier, images, points_C, theta_C)
    if laid is None:
        return NO_REPEATS
    likeness = _likeness(laid.right, laid.left)
    peaks, misfit = _peaks(likeness, laid.here), 1.0 - _best_near(likeness, laid.here)
    if not peaks:
        return Repeats(misfit, ())
    itself = _self_likeness(laid.right, laid.here, laid.left.shape[1])
    rivals = (
        Rival(1.0 - _EPSILON * (k - laid.here), 1.0 - float(likeness[k]), _comes_back(itself, laid.here, k))
        for k in peaks
    )
    return Repeats(misfit, tuple(rival for rival in rivals if rival.alike or _FAR * rival.misfit < misfit))


def _laid_pair(
    rectifier: Rectifier, images: Sequence[Image], points_C: FloatArray, theta_C: FloatArray
) -> _LaidPair | None:
    u = rectifier.f_px * points_C[:, 0] / points_C[:, 2] + rectifier.cx_px
    v = rectifier.f_px * points_C[:, 1] / points_C[:, 2] + rectifier.cy_px
    window = Window(max(0, int(v.min())), min(rectifier.height_px, int(v.max()) + 1), 0, rectifier.width_px)
    every = max(1, min(_EVERY_ROW, (window.bottom - window.top) // _LEAST_ROWS))
    rows = np.arange(window.top, window.bottom, every, dtype=np.float64)[:, None]
    if len(rows) < _LEAST_ROWS:
        return None

    def disparity(u_px: FloatArray) -> FloatArray:
        x, y = (u_px - rectifier.cx_px) / rectifier.f_px, (rows - rectifier.cy_px) / rectifier.f_px
        d: FloatArray = x * theta_C[0] + y * theta_C[1] + theta_C[2]
        return d

    middle_px = 0.5 * float(u.min() + u.max())
    middle_d = disparity(np.full((1, 1), middle_px))
    widest = float(middle_d.max())
    room_px = min(middle_px - widest, rectifier.width_px - 2 - middle_px)
    half = int(min(0.5 * _WIDTH * float(u.max() - u.min()), room_px) / (_EPSILON * widest)) if widest > 0.0 else 0
    if half < _LEAST_HALF or middle_d.min() <= 0.0:
        return None
    left_px = middle_px + _EPSILON * middle_d * np.arange(-half, half + 1)
    wide_px = middle_px + _EPSILON * middle_d * np.arange(-half - _SHIFTS, half + _SHIFTS + 1)
    right_px = wide_px - disparity(wide_px)
    seen = np.flatnonzero(((right_px >= 0.0) & (right_px < rectifier.width_px - 1)).all(axis=0))
    if len(seen) == 0 or seen[0] > _SHIFTS or seen[-1] < _SHIFTS + 2 * half:
        return None
    left, right = cast("tuple[GreyImage, GreyImage]", images)
    left_rows, right_rows = rectifier.rectify(left, right, window, 0, every=every)
    return _LaidPair(_laid(left_rows, left_px), _laid(right_rows, right_px[:, seen]), _SHIFTS - int(seen[0]))


def _laid(rows: GreyImage, u_px: FloatArray) -> Float32Array:
    """Return `rows` (N, width) at the columns `u_px` (N, M)."""
    v_px = np.repeat(np.arange(len(u_px), dtype=np.float32)[:, None], u_px.shape[1], axis=1)
    return cv2.remap(rows, u_px.astype(np.float32), v_px, cv2.INTER_LINEAR).astype(np.float32)


def _self_likeness(laid: Float32Array, first: int, columns: int) -> FloatArray:
    """Return the correlation of some columns of a laid picture with all of it, both less the local mean of each row.

    What does not change along the rows, an edge or a joint across them, is alike at any shift and repeats nothing.
    """
    about_mean = laid - cv2.blur(laid, _ALONG)
    return _likeness(about_mean, about_mean[:, first : first + columns])


def _comes_back(itself: FloatArray, here: int, shift: int) -> bool:
    """Return whether the picture is alike at `shift` again, and not only still, as a smooth one is a little further."""
    again = _best_near(itself, shift)
    return bool(again > _ALIKE and itself[min(here, shift) : max(here, shift) + 1].min() < _UNLIKE * again)


def _likeness(wide: Float32Array, part: Float32Array) -> FloatArray:
    """Return the correlation of `part` with `wide`, of as many rows, at each shift."""
    likeness: FloatArray = cv2.matchTemplate(wide, part, cv2.TM_CCOEFF_NORMED)[0].astype(np.float64)
    return likeness


def _best_near(likeness: FloatArray, shift: int) -> float:
    return float(likeness[max(0, shift - _NEAR) : shift + _NEAR + 1].max())


def _peaks(likeness: FloatArray, here: int) -> list[int]:
    """Return the shifts, but for `here`, at which the eyes are nearly as alike."""
    inner = likeness[1:-1]
    peaks = 1 + np.flatnonzero((inner >= likeness[:-2]) & (inner > likeness[2:]))
    least = max(_LEAST, _ALIKE * _best_near(likeness, here))
    return [k for k in map(int, peaks) if abs(k - here) > _NEAR + 1 and likeness[k] > least]


_EPSILON = 0.0125
"""Of a disparity: half a pixel at 1.2 m."""
_SHIFTS = 48
"""To either side: planes of 0.4 to 1.6 times the disparities."""
_EVERY_ROW = 4
"""More where that leaves fewer than the least."""
_LEAST_ROWS = 8
_LEAST_HALF = 40
"""Steps: half the width, 6 cm at a baseline of 12 cm."""
_WIDTH = 0.9
"""Of the region's widest row."""
_ALONG = (_SHIFTS + 1, 1)
"""About the largest tile that is looked for."""
_NEAR = 2
"""Steps by which the best likeness may miss the plane that was fitted."""
_ALIKE = 0.6
"""Share of the likeness at the plane itself; also the correlation of the laid picture with itself. Other floors have
0.2 at most, tiles that are all alike 0.65 and more."""
_UNLIKE = 0.5
"""Of that likeness, or less, is left between two tiles."""
_LEAST = 0.3
_CLEARLY = 2.0
"""Times the misfit: tiles that differ slightly in print have 2.7 and more."""
_FAR = 4.0
"""Times the misfit: where the rows cross the tiles at more than 8° a tile to the side is hardly alike any more, but a
plane that far off may still be found in part of the picture; two treads of a stair differ by 1.5."""

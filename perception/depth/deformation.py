"""Whether something before a lens deforms one eye's picture: shifts between the eyes that belong to the picture.

- Both eyes see on one row what lies on it, wherever and however far. So shifts up or down, less what all tiles
  share, are zero everywhere. A drop, a bent window or a pressed lens moves a picture along the gradient of its
  thickness: along the rows, and about as far up and down.
- Along the rows nothing is left where the ground is the plane that was found. Relief leaves something, which passes
  through the picture with the ground; what stays after a way is no relief. Who walks along a kerb or on an arched path
  sees relief that stays, but in the same columns all along: what a column's tiles share is not counted.

What neither shows is a thickness that depends on the column alone. Where it grows with its square, the ground seems to
rise to one side, and nothing that two eyes see contradicts that.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from messages.arrays import BoolArray, FloatArray
from perception.depth.eye_shifts import EyeShifts


@dataclass(frozen=True)
class DeformationSettings:
    """Sizes in px of the rectified picture, of which a raw one of 1280 px has twice as many."""

    kept_share: float = 0.85  # of what was seen up or down, from one frame asked to the next: six of them
    remembered_m: float = 2.0  # of the way, for what is seen along the rows
    relief_m: float = 0.25  # after which relief is another one
    least_way_m: float = 1.0
    most_off_plane_px: float = 1.5  # what is farther from the plane is another surface
    least_tiles: int = 12
    least_shift_px: float = 0.02  # deviation of one tile's shift, however clear the picture
    sigmas: float = 4.0  # of the many tiles the one that is farthest off
    another_m: float = 0.02  # of the way, after which what errs with the texture errs otherwise: a tile's size
    contradicts_px: float = 0.07  # beyond those, where the two newest frames both show it,
    at_once_px: float = 0.14  # or the newest alone: an edge passes through, and is farther off by chance
    settles_px: float = 0.04  # likewise: less, in `settled_frames` in a row, ends the contradiction
    settled_frames: int = 6
    doubtful_sigmas: float = 2.0
    doubtful_px: float = 0.05
    contradicts_along_px: float = 0.10


class Deformation(NamedTuple):
    """What is known of the view: `size_px` (RMS) by which tiles are shifted, beyond chance; whether it `contradicts`
    a sound view, and whether it is `doubtful` enough that nothing new may be begun on it."""

    size_px: float
    contradicts: bool
    doubtful: bool


SOUND = Deformation(0.0, contradicts=False, doubtful=False)


class DeformationWatch:
    """Averages the shifts of each tile of the picture over frames; for one unit."""

    def __init__(self, calibrated_px: float = 0.0, settings: DeformationSettings | None = None) -> None:
        """`calibrated_px`, 1 σ, of a tile's shift is what the calibration leaves, and no deformation."""
        self._settings = settings or DeformationSettings()
        self._calibrated_px = _FAR_SIGMAS * calibrated_px
        self._of_picture = (0, 0)
        self._up_down, self._newest, self._before, self._along = (_TileMeans(self._of_picture) for _ in range(4))
        self._together = _Together(self._settings.kept_share)
        self._calm_frames = 0
        self._verdict = SOUND

    def begin_anew(self, *, with_newest: bool) -> None:
        """Judge what is up or down by frames to come, and by the newest: the ground changed at once, or the view."""
        self._up_down = self._newest if with_newest else _TileMeans(self._of_picture)
        self._newest, self._before = _TileMeans(self._of_picture), _TileMeans(self._of_picture)
        self._together = _Together(self._settings.kept_share)
        if with_newest:
            self._together.add(0.0)

    def add(self, shifts: EyeShifts, way_m: float) -> Deformation:
        """Take the shifts of a frame that the camera comes to by `way_m`, and return what is known now."""
        s = self._settings
        # about an edge what one eye sees is hidden from the other
        good = _around((~shifts.whole).astype(np.float64)) == 0.0
        inner = good & (_around(good.astype(np.float64)) >= _LEAST_AROUND)
        if np.count_nonzero(good) < s.least_tiles or not inner.any():
            return self._verdict
        if shifts.of_picture != self._of_picture:
            self._of_picture = shifts.of_picture
            self._up_down, self._newest, self._before, self._along = (_TileMeans(self._of_picture) for _ in range(4))
        self._together.add(math.exp(-way_m / s.another_m))
        where = (
            slice(shifts.row, shifts.row + good.shape[0]),
            slice(shifts.column, shifts.column + good.shape[1]),
        )
        weight = np.where(good, 1.0 / (shifts.y_var_px2 + s.least_shift_px**2), 0.0)
        y_px = np.where(good, shifts.y_px - np.median(shifts.y_px[good]), 0.0)
        self._newest, self._before = self._before, self._newest
        self._newest.add(where, y_px, weight, kept=0.0)
        self._up_down.add(where, y_px, weight, kept=s.kept_share)
        if way_m > 0.0:
            near = good & (np.abs(shifts.x_px) < s.most_off_plane_px)
            if np.count_nonzero(near) >= s.least_tiles:
                x_px, of_way = _off_plane(shifts.x_px, near, way_m)
                self._along.add(where, x_px, of_way, kept=math.exp(-way_m / s.remembered_m))
        if self._verdict.contradicts and self._has_changed(where, inner):
            self.begin_anew(with_newest=True)
            self._along = _TileMeans(self._of_picture)
        self._verdict = self._judged(where, inner)
        return self._verdict

    def _has_changed(self, where: tuple[slice, slice], inner: BoolArray) -> bool:
        """Return whether the newest frame shows something else up or down than those before it, as once a drop has
        run down: fading alone would take a second and more to forget it."""
        s, (y_px, y_std_px) = self._settings, self._vertical(where, inner)
        weight, newest_px, _ = (each[inner] for each in self._newest.around(where))
        off_px = np.abs(newest_px - np.median(newest_px) - y_px)
        return bool((off_px > s.contradicts_px + s.sigmas * np.sqrt(y_std_px**2 + 1.0 / weight)).any())

    def _judged(self, where: tuple[slice, slice], inner: BoolArray) -> Deformation:
        s = self._settings
        y_px, y_std_px = self._vertical(where, inner)
        x_px, x_std_px = self._lasting(where, inner)
        by_newest, by_both = self._shown(y_px, where, inner)
        off_px = np.abs(y_px) - s.sigmas * y_std_px - self._calibrated_px
        along_px = float((np.abs(x_px) - s.sigmas * x_std_px).max()) - self._calibrated_px
        lasting = min(1.0, self._together.variance**-0.5)  # the deviation of who stands holds what frames share
        contradicts = bool((off_px[by_both] > lasting * s.contradicts_px).any())
        contradicts |= bool((off_px[by_newest] > s.at_once_px).any()) or along_px > s.contradicts_along_px
        is_calm = float(off_px.max()) <= lasting * s.settles_px and along_px <= s.settles_px
        self._calm_frames = self._calm_frames + 1 if is_calm else 0
        contradicts |= self._verdict.contradicts and self._calm_frames < s.settled_frames
        unlikely_px = float((np.abs(y_px) - s.doubtful_sigmas * y_std_px).max()) - self._calibrated_px
        doubtful = unlikely_px > s.doubtful_px
        size_px = math.hypot(_beyond_chance(y_px, y_std_px), _beyond_chance(x_px, x_std_px))
        return Deformation(size_px, contradicts, contradicts or doubtful)

    def _vertical(self, where: tuple[slice, slice], inner: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return what tiles and their neighbours (n,) are shifted down more than most, and its deviation."""
        weight, y_px, _ = (each[inner] for each in self._up_down.around(where))
        y_px = y_px - np.median(y_px)
        return y_px, np.sqrt(self._together.variance / weight)

    def _shown(self, y_px: FloatArray, where: tuple[slice, slice], inner: BoolArray) -> tuple[BoolArray, BoolArray]:
        """Return of which tiles (n,) the newest frame shows half of the shift or more, and of which the two newest."""

        def shows(frame: _TileMeans) -> BoolArray:
            of_frame_px = frame.around(where)[1][inner]
            shows: BoolArray = (of_frame_px - np.median(of_frame_px)) * np.sign(y_px) > 0.5 * np.abs(y_px)
            return shows

        by_newest = shows(self._newest)
        return by_newest, by_newest & shows(self._before)

    def _lasting(self, where: tuple[slice, slice], inner: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return what tiles (n,) are shifted along the rows more than others of their column, and its deviation."""
        way_m, x_px, square = self._along.at(where)
        seen = inner & (way_m > self._settings.least_way_m)
        if np.count_nonzero(seen) < self._settings.least_tiles:
            return np.zeros(1), np.zeros(1)
        of_column = (x_px * seen).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
        variance = np.maximum(square - x_px * x_px, 0.0) * (self._settings.relief_m / np.maximum(way_m, _TINY))
        return (x_px - of_column)[seen], np.sqrt(variance[seen])


class _Together:
    """The variance of a mean over frames, each of which counts `kept` times as much as the next, over that of one frame
    by the sum of its weights. Errors of two in a row are correlated by c, so that of Σ keptᵏ eₖ, with S = Σ keptᵏ,

        C ← 1 + kept c C,        V ← 1 + 2 kept c C + kept² V,        S ← 1 + kept S,        V / S."""

    def __init__(self, kept: float) -> None:
        self._kept = kept
        self._of_newest = self._of_sum = self._weights = 0.0

    def add(self, alike: float) -> None:
        """Take a frame whose errors are `alike` those of the frame before: c, 1 where the camera stands."""
        shared = self._kept * alike * self._of_newest
        self._of_sum = 1.0 + 2.0 * shared + self._kept**2 * self._of_sum
        self._of_newest = 1.0 + shared
        self._weights = 1.0 + self._kept * self._weights

    @property
    def variance(self) -> float:
        """Return V / S; 1 for a single frame."""
        return self._of_sum / self._weights


class _TileMeans:
    """Weighted means of what the picture's tiles show, and of its square."""

    def __init__(self, of_picture: tuple[int, int]) -> None:
        self._totals = np.zeros((3, *of_picture))

    def add(
        self,
        where: tuple[slice, slice],
        values: FloatArray,
        weight: FloatArray,
        *,
        kept: float,
    ) -> None:
        """Take what the tiles `where` show, and keep a share of what is known."""
        self._totals *= kept
        weighted = weight * values
        self._totals[:, where[0], where[1]] += np.stack((weight, weighted, weighted * values))

    def at(self, where: tuple[slice, slice]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return weight, mean and mean square of each tile."""
        weight, total, square = self._totals[:, where[0], where[1]]
        some = np.maximum(weight, _TINY)
        return weight, total / some, square / some

    def around(self, where: tuple[slice, slice]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the same of each tile together with its neighbours."""
        weight, total, square = (_around(each) for each in self._totals[:, where[0], where[1]])
        some = np.maximum(weight, _TINY)
        return weight, total / some, square / some


def _off_plane(x_px: FloatArray, near: BoolArray, way_m: float) -> tuple[FloatArray, FloatArray]:
    """Return how far tiles and their neighbours are off the plane that is best for those `near` it, and their weight:
    `way_m`."""
    rows, columns = np.mgrid[: x_px.shape[0], : x_px.shape[1]].astype(np.float64)
    terms = np.stack((np.ones(rows.size), rows.ravel(), columns.ravel()), axis=-1)
    of_near = terms * near.reshape(-1, 1)
    plane = np.linalg.solve(of_near.T @ terms + _TINY * np.eye(3), of_near.T @ x_px.ravel())
    off = np.where(near, x_px - (terms @ plane).reshape(x_px.shape), 0.0)
    together = _around(near.astype(np.float64))
    return _around(off) / np.maximum(together, 1.0), np.where(together > 0.0, way_m, 0.0)


def _around(values: FloatArray) -> FloatArray:
    """Return the sum of each tile's value and its eight neighbours'."""
    together = cv2.boxFilter(values, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return together  # type: ignore[return-value]


def _beyond_chance(values: FloatArray, deviations: FloatArray) -> float:
    return math.sqrt(max(0.0, float(np.mean(values * values - deviations * deviations))))


_FAR_SIGMAS = 3.0
"""Standard deviations that an error of the calibration may have."""
_LEAST_AROUND = 6
"""Good tiles among a tile and its eight neighbours."""
_TINY = 1e-9

"""Do both eyes still see things on one row, as the calibration says? From any pictures with texture, without a board.

Blocks around corners of the rectified left picture are looked for in the right one, along the row and several rows up
and down. Where the right eye sees them lower by y(x, y) px of the focal length f, with x, y the place in its picture in
units of f, a small error of the pair shows as

    Δ = f (a (1 + y²) + b x + c x y + e y)                                                              (1)

a: its pitch (turn about x), b: its roll (about z), c: its toe-in (about y), e: its focal length against the other's.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass

import cv2
import numpy as np

from calib.stereo.pairs import Pair
from messages import StereoCalibration, UserError
from messages.arrays import FloatArray, GreyImage
from perception.depth.rectify import Rectifier

FAULT_PX = 0.5
"""Rows that differ by more, root mean square over the picture: matching by rows then loses points and depth."""
LEAST_MATCHES = 150
MOST_PAIRS = 24
_CORNERS, _APART_PX, _QUALITY = 600, 12.0, 0.01
_HALF_PX, _SEARCH_ROWS, _SEARCH_COLUMNS = 12, 10, 0.2
"""Half a block; rows searched either way, px of a 1280 px wide picture; columns, as a share of the width."""
_USUAL_WIDTH_PX = 1280
_LEAST_LIKENESS, _LEAST_LEAD = 0.9, 0.1
"""Correlation of a match, and by how much it must lead every other place: repeated tiles lead by nothing."""
_WIDEST_GRID = 0.9
_CAUSES = ("pitch", "roll", "toe-in", "focal lengths")
_ROUNDS, _LEAST_SPREAD_PX = 50, 0.1


@dataclass(frozen=True)
class RowsCheck:
    """How rows differ: root mean square of (1) over the picture and its largest value, px; by which cause (px RMS), the
    angles (rad; of the focal lengths the relative difference) and one standard deviation of each; the matches' median
    absolute difference. `at` (3, 3) is (1) in the middle of each region."""

    pairs: int
    matches: int
    rms_px: float
    rms_std_px: float
    most_px: float
    median_px: float
    shares_px: dict[str, float]
    values: dict[str, float]
    stds: dict[str, float]
    at: FloatArray

    @property
    def cause(self) -> str:
        """Return what makes most of the difference."""
        return max(self.shares_px, key=self.shares_px.__getitem__)

    @property
    def facts(self) -> dict[str, object]:
        """Return all of it for a program."""
        return {**asdict(self), "at": self.at.tolist(), "cause": self.cause, "is_fault": self.is_fault}

    @property
    def is_fault(self) -> bool:
        """Return whether the rows differ by more than a calibration leaves."""
        return self.rms_px - 2.0 * self.rms_std_px > FAULT_PX


def check_rows(stereo: StereoCalibration, pairs: Iterable[Pair], where: str) -> RowsCheck:
    """Return how far the right eye's rows are off in raw pairs. Raises UserError where too little is seen."""
    rectifier = Rectifier(stereo, 1)
    found, counted = list[FloatArray](), 0
    for pair in pairs:
        if pair.left.shape != (stereo.left.height_px, stereo.left.width_px):
            size = f"{pair.left.shape[1]}x{pair.left.shape[0]}"
            raise UserError(
                f"{where}: {pair.name} is {size} px, the calibration's allowed "
                f"{stereo.left.width_px}x{stereo.left.height_px}"
            )
        found.append(_matches(rectifier, pair))
        counted += 1
    every = np.concatenate(found) if found else np.empty((0, 3))
    if len(every) < LEAST_MATCHES:
        raise UserError(
            f"{where}: {len(every)} things in {counted} pairs are surely the same in both eyes, allowed from "
            f"{LEAST_MATCHES}: show something with texture that does not repeat"
        )
    return _fitted(every, rectifier, counted)


def _matches(rectifier: Rectifier, pair: Pair) -> FloatArray:
    """Return (n, 3): place in the right rectified picture and how much lower that is than in the left one, px."""
    left: GreyImage = cv2.remap(pair.left, *rectifier.left_maps, cv2.INTER_LINEAR).astype(np.uint8, copy=False)
    right: GreyImage = cv2.remap(pair.right, *rectifier.right_maps, cv2.INTER_LINEAR).astype(np.uint8, copy=False)
    corners = cv2.goodFeaturesToTrack(left, _CORNERS, _QUALITY, _APART_PX)
    found = []
    for u, v in np.empty((0, 2), dtype=int) if corners is None else corners.reshape(-1, 2).astype(int):
        match = _match(left, right, int(u), int(v))
        if match is not None:
            found.append(match)
    return np.array(found).reshape(-1, 3)


def _match(left: GreyImage, right: GreyImage, u: int, v: int) -> tuple[float, float, float] | None:
    height, width = left.shape
    half, rows = _HALF_PX, max(3, round(_SEARCH_ROWS * width / _USUAL_WIDTH_PX))
    top, start, stop = v - half - rows, max(0, u - half - round(_SEARCH_COLUMNS * width)), u + half + 5
    if top < 0 or v + half + rows >= height or u < half or u + half >= width or stop - start < 4 * half:
        return None
    likeness = cv2.matchTemplate(
        right[top : v + half + rows + 1, start:stop],
        left[v - half : v + half + 1, u - half : u + half + 1],
        cv2.TM_CCOEFF_NORMED,
    )
    row, column = np.unravel_index(int(likeness.argmax()), likeness.shape)
    best = float(likeness[row, column])
    inside = 0 < row < likeness.shape[0] - 1 and 0 < column < likeness.shape[1] - 1
    if not inside or not best > _LEAST_LIKENESS:
        return None
    above, below = float(likeness[row - 1, column]), float(likeness[row + 1, column])
    likeness[max(0, row - 4) : row + 5, max(0, column - 4) : column + 5] = -1.0
    if float(likeness.max()) > best - _LEAST_LEAD:
        return None
    lower = float(row) - rows + 0.5 * (above - below) / (above - 2.0 * best + below)
    return float(start + column + half), v + lower, lower


def _fitted(every: FloatArray, rectifier: Rectifier, pairs: int) -> RowsCheck:
    f_px = rectifier.f_px
    centre = np.array((rectifier.cx_px, rectifier.cy_px))
    A, lower = f_px * _terms((every[:, :2] - centre) / f_px), every[:, 2]
    weights = np.ones(len(A))
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(A * weights[:, None], lower * weights, rcond=None)[0]
        off = lower - A @ found
        spread = max(_LEAST_SPREAD_PX, 1.4826 * float(np.median(np.abs(off))))
        weights = 1.0 / (1.0 + (off / spread) ** 2)
    inverse = np.linalg.pinv((A * weights[:, None]).T @ A)
    # a scene's few things make many matches of consecutive pictures, which err alike
    covariance = spread**2 * inverse * max(1.0, pairs / 2.0)
    side = np.linspace(-_WIDEST_GRID, _WIDEST_GRID, 9)
    u, v = np.meshgrid(0.5 * rectifier.width_px * (1 + side), 0.5 * rectifier.height_px * (1 + side))
    grid = f_px * _terms((np.stack((u.ravel(), v.ravel()), axis=-1) - centre) / f_px)
    difference = grid @ found
    rms_px = float(np.sqrt((difference**2).mean()))
    by = difference @ grid / (len(grid) * max(rms_px, 1e-12))
    middles = np.array([k for k in range(81) if k // 9 in (1, 4, 7) and k % 9 in (1, 4, 7)])
    return RowsCheck(
        pairs=pairs,
        matches=len(every),
        rms_px=rms_px,
        rms_std_px=float(np.sqrt(by @ covariance @ by)),
        most_px=float(np.abs(difference).max()),
        median_px=float(np.median(np.abs(lower))),
        shares_px=dict(zip(_CAUSES, np.sqrt(((grid * found) ** 2).mean(axis=0)).tolist(), strict=True)),
        values=dict(zip(_CAUSES, found.tolist(), strict=True)),
        stds=dict(zip(_CAUSES, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        at=difference[middles].reshape(3, 3),
    )


def _terms(places: FloatArray) -> FloatArray:
    """Return (n, 4), what stands beside a, b, c and e in (1), at places (n, 2) in units of f."""
    x, y = places.T
    return np.stack((1.0 + y**2, x, x * y, y), axis=-1)

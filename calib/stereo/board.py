"""Calibration boards: chessboards and ChArUco boards, and where their inner corners are in a picture.

A corner's window for the sub-pixel step reaches as far as the nearest corner allows, and the picture is smoothed a
little before: on two sets of real pairs that made the corners' scatter smaller by a third to a half.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from messages import UserError
from messages.arrays import FloatArray, GreyImage, IntArray

SQUARES_M = (0.002, 0.5)
CORNERS = (3, 40)
"""Inner corners along an edge of a board."""
DICTIONARIES = tuple(sorted({name.upper() for name in dir(cv2.aruco) if name.startswith("DICT_")}))
_SMOOTHING_PX = 1.0
_WINDOW_SHARE, _WINDOW_PX, _MARKED_PX = 0.45, 25, 15
"""Half a window, as a share of the distance to the nearest corner, and the most, with markers beside the corner too: no
other corner may be in it."""
_SMALLEST_SHARE, _SMALLEST_PX = 0.2, (3, 12)
_ASTRAY_SHARE, _ASTRAY_PX = 0.02, 0.5
"""By how much the larger window may lead elsewhere, of the same distance, and at least: blur grows with the picture."""
_SUBPIXEL = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4)
_LEAST_SHARE = 0.25
"""Of a ChArUco board's corners that a picture must show; at least `_LEAST_CORNERS`."""
_LEAST_CORNERS = 8


class Corners(NamedTuple):
    """The corners of a board that one picture shows: which (n,), rising, and where, px (n, 2)."""

    ids: IntArray
    px: FloatArray


@dataclass(frozen=True)
class Board:
    """`columns` × `rows` inner corners, `square_m` apart; a ChArUco board if `dictionary` names its markers.

    A ChArUco board has one square more than inner corners either way; its markers' side is `marker_share` of a
    square. `legacy` is for boards drawn by OpenCV before 4.6. Raises UserError where a number is out of its range.
    """

    columns: int
    rows: int
    square_m: float
    dictionary: str | None = None
    marker_share: float = 0.75
    legacy: bool = False

    def __post_init__(self) -> None:
        for name, count in (("columns", self.columns), ("rows", self.rows)):
            if not CORNERS[0] <= count <= CORNERS[1]:
                raise UserError(f"board: {count} inner corners in {name}, allowed {CORNERS[0]} to {CORNERS[1]}")
        if not SQUARES_M[0] <= self.square_m <= SQUARES_M[1]:
            low_mm, high_mm = (1e3 * each for each in SQUARES_M)
            raise UserError(f"board: a square of {1e3 * self.square_m:g} mm, allowed {low_mm:g} to {high_mm:g} mm")
        if self.dictionary is not None and self.dictionary not in DICTIONARIES:
            raise UserError(f"board: dictionary {self.dictionary}, allowed {', '.join(DICTIONARIES)}")
        if not 0.2 <= self.marker_share <= 0.95:
            raise UserError(f"board: a marker of {self.marker_share:g} of a square, allowed 0.2 to 0.95")

    @property
    def points(self) -> FloatArray:
        """Return all corners (columns · rows, 3) on the board, m: x along the columns, y along the rows, z = 0."""
        y, x = np.mgrid[: self.rows, : self.columns]
        return self.square_m * np.stack((x.ravel(), y.ravel(), np.zeros(x.size)), axis=-1)

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """Return OpenCV's board. Raises UserError for a plain chessboard."""
        if self.dictionary is None:
            raise UserError("board: is a plain chessboard, without a dictionary of markers")
        size = (self.columns + 1, self.rows + 1)
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        board = cv2.aruco.CharucoBoard(size, self.square_m, self.marker_share * self.square_m, dictionary)
        board.setLegacyPattern(self.legacy)
        return board


def find_corners(board: Board, picture: GreyImage) -> Corners | None:
    """Return the corners of `board` in a grey picture; None where it is not seen, a plain chessboard not wholly."""
    if board.dictionary is None:
        found, px = cv2.findChessboardCorners(
            picture,
            (board.columns, board.rows),
            flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE,
        )
        if not found:
            return None
        ids: IntArray = np.arange(board.columns * board.rows, dtype=np.int64)
    else:
        px, marked, _, _ = cv2.aruco.CharucoDetector(board.charuco()).detectBoard(picture)
        if marked is None or len(marked) < max(_LEAST_CORNERS, _LEAST_SHARE * board.columns * board.rows):
            return None
        ids = marked.ravel().astype(np.int64)
    order = np.argsort(ids)
    apart = board.dictionary is None
    return Corners(ids[order], _refined(picture, px.reshape(-1, 2)[order].astype(np.float64), nothing_between=apart))


def find_pair(board: Board, left: GreyImage, right: GreyImage) -> tuple[Corners, Corners] | None:
    """Return the corners that both eyes see, the same in both; None where they do not.

    A plain chessboard of odd by odd or even by even corners looks the same turned by 180°: the right eye's is turned
    to lie as the left's.
    """
    seen_left, seen_right = find_corners(board, left), None
    if seen_left is not None:
        seen_right = find_corners(board, right)
    if seen_left is None or seen_right is None:
        return None
    if board.dictionary is None:
        along_left, along_right = (seen.px[-1] - seen.px[0] for seen in (seen_left, seen_right))
        if along_left @ along_right < 0.0:
            seen_right = Corners(seen_right.ids, seen_right.px[::-1])
        return seen_left, seen_right
    ids, at_left, at_right = np.intersect1d(seen_left.ids, seen_right.ids, return_indices=True)
    if len(ids) < _LEAST_CORNERS:
        return None
    return Corners(ids, seen_left.px[at_left]), Corners(ids, seen_right.px[at_right])


def size_of_chessboard(pictures: Sequence[GreyImage], where: str) -> tuple[int, int]:
    """Return the inner corners of the chessboard that most of the `pictures` show whole, the longer edge first.

    Raises UserError, its line beginning with `where`, where none is found.
    """
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    proposed = Counter[tuple[int, int]]()
    for picture in pictures:
        seen, _, marks = cv2.findChessboardCornersSBWithMeta(picture, (CORNERS[0], CORNERS[0]), flags)
        if seen:
            rows, columns = sorted(marks.shape[:2])
            proposed[columns, rows] += 1
    # what is proposed may be part of the board; the whole one is what is found whole
    whole = {
        size: sum(find_corners(Board(*size, SQUARES_M[1]), picture) is not None for picture in pictures)
        for size in proposed
    }
    best = max(whole, key=lambda size: (whole[size], size), default=None)
    if best is None or not whole[best]:
        raise UserError(f"{where}: no whole chessboard is found; tell its inner corners, as in --board 9x6")
    return best


def _refined(picture: GreyImage, px: FloatArray, *, nothing_between: bool) -> FloatArray:
    """Return corners (n, 2) to a fraction of a pixel, each in a window that no other corner is in.

    Where the larger window leads elsewhere than the smallest, as at a picture's or a board's edge, that one counts.
    With `nothing_between` corners the smallest grows with the board; markers between them would be in it.
    """
    smooth: GreyImage = cv2.GaussianBlur(picture, (0, 0), _SMOOTHING_PX).astype(np.uint8, copy=False)
    apart = np.linalg.norm(px[:, None] - px[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    nearest = apart.min(axis=1)
    free = nearest if nothing_between else np.zeros_like(nearest)
    least_px = np.clip((_SMALLEST_SHARE * free).astype(int), *_SMALLEST_PX)
    smallest = _in_windows(smooth, px, least_px)
    most_px = _WINDOW_PX if nothing_between else _MARKED_PX
    half_px = np.clip((_WINDOW_SHARE * nearest).astype(int), least_px, most_px)
    refined = _in_windows(smooth, smallest, half_px)
    moved = np.linalg.norm(refined - smallest, axis=1)
    astray = moved > np.maximum(_ASTRAY_PX, _ASTRAY_SHARE * free)
    refined[astray] = smallest[astray]
    return refined


def _in_windows(picture: GreyImage, px: FloatArray, half_px: IntArray) -> FloatArray:
    refined = px.astype(np.float32)
    for half in np.unique(half_px):
        chosen = half_px == half
        some = refined[chosen].reshape(-1, 1, 2).copy()
        cv2.cornerSubPix(picture, some, (int(half), int(half)), (-1, -1), _SUBPIXEL)
        refined[chosen] = some[:, 0]
    return refined.astype(np.float64)


def board_of_text(text: str, square_m: float, dictionary: str | None, marker_share: float, *, legacy: bool) -> Board:
    """Return the board that the options tell; `text` is its inner corners, as 9x6. Raises UserError."""
    parts: Sequence[str] = text.lower().split("x")
    try:
        columns, rows = map(int, parts)
    except ValueError as error:
        raise UserError(f"--board {text}: expected inner corners, as in 9x6") from error
    return Board(columns, rows, square_m, dictionary, marker_share, legacy)

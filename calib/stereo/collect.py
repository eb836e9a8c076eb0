"""Which views of a board are worth keeping, and what they cover by now: from a folder, a recording or a live camera."""

from collections.abc import Iterator

import numpy as np

from calib.stereo.board import Board, Corners, find_pair
from calib.stereo.bundle import SeenPair
from calib.stereo.pairs import Pair
from messages.arrays import BoolArray, FloatArray, IntArray

MOST_VIEWS = 60
ENOUGH_VIEWS = 20
_NEW = 0.04
"""Of the picture's width: the corners' mean distance from those of every view kept, at least."""
_STILL = 0.0015
"""Of the picture's width: by how much corners may have moved since the frame before: 2 px of 1280."""
_CELLS = (3, 3)
_LEAST_IN_CELL = 8


class Views:
    """Collects views of a board. With `moving` pictures only those are kept that are new and held still."""

    def __init__(self, board: Board, *, moving: bool) -> None:
        self.board = board
        self.kept: list[SeenPair] = []
        self.looked_at = 0
        self.seen = 0
        self.moved = 0
        self.size_px = (0, 0)
        self._moving = moving
        self._before: tuple[Corners, Corners] | None = None

    @property
    def is_full(self) -> bool:
        """Return whether no further view is taken."""
        return len(self.kept) >= MOST_VIEWS

    @property
    def is_enough(self) -> bool:
        """Return whether every region of both eyes is covered, by enough views."""
        return len(self.kept) >= ENOUGH_VIEWS and bool(self.covered.all())

    @property
    def covered(self) -> BoolArray:
        """Return which regions (2, 3, 3) of the left and the right picture have corners."""
        found = np.zeros((2, *_CELLS), dtype=np.bool_)
        width, height = self.size_px
        for eye in (0, 1) if self.kept else ():
            px = np.concatenate([view[2 + eye] for view in self.kept])
            counts = np.histogram2d(px[:, 1], px[:, 0], bins=_CELLS, range=((0, height), (0, width)))[0]
            found[eye] = counts >= _LEAST_IN_CELL
        return found

    def add(self, pair: Pair) -> bool:
        """Look at a pair; return whether it was kept."""
        self.looked_at += 1
        self.size_px = (pair.left.shape[1], pair.left.shape[0])
        if self.is_full:
            return False
        corners = find_pair(self.board, pair.left, pair.right)
        before, self._before = self._before, corners
        if corners is None:
            return False
        self.seen += 1
        left, right = corners
        if self._moving and not (before is not None and self._is_still(before[0], left)):
            self.moved += before is not None
            return False
        if self._moving and not self._is_new(left):
            return False
        self.kept.append(SeenPair(pair.name, left.ids, left.px, right.px))
        return True

    def _is_still(self, before: Corners, now: Corners) -> bool:
        moved = _apart(before, now.ids, now.px)
        return moved is not None and moved < _STILL * self.size_px[0]

    def _is_new(self, corners: Corners) -> bool:
        apart = (_apart(corners, view.ids, view.left_px) for view in self.kept)
        return all(each is None or each > _NEW * self.size_px[0] for each in apart)


def _apart(corners: Corners, ids: IntArray, px: FloatArray) -> float | None:
    """Return the mean distance, px, of corners that both know; None where they are too few."""
    both, here, there = np.intersect1d(corners.ids, ids, return_indices=True)
    if len(both) < _LEAST_IN_CELL:
        return None
    return float(np.linalg.norm(corners.px[here] - px[there], axis=1).mean())


def thinned(pairs: Iterator[Pair], every: int) -> Iterator[Pair]:
    """Yield two pairs in a row of each `every`, so that the second tells whether the board was held still."""
    for number, pair in enumerate(pairs):
        if number % every < 2:
            yield pair


def looks(covered: BoolArray) -> list[str]:
    """Return the names of the regions that no corner is in, as "left eye, top right"."""
    rows, columns = ("top", "middle", "bottom"), ("left", "middle", "right")
    return [
        f"{'right' if eye else 'left'} eye, {rows[row]} {columns[column]}"
        for eye, row, column in zip(*np.nonzero(~covered), strict=True)
    ]

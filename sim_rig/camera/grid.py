"""The grid on which the renderer's geometry is exact: nodes in the middle of cells 8 px wide."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from messages.arrays import BoolArray, Float32Array, FloatArray
from sim_rig.unit import HEIGHT_PX, WIDTH_PX

CELL = 8
ROWS, COLUMNS = HEIGHT_PX // CELL, WIDTH_PX // CELL
AROUND = np.ones((3, 3), np.uint8)
"""A node and its neighbours, between which a cell's pixels lie; for `cv2.dilate` and `cv2.erode`."""


def node_pixels(cells: int) -> FloatArray:
    """Return the pixel of each node: the middle of each cell and of one more on either side, as cv2.resize has it."""
    return np.arange(-1, cells + 1, dtype=np.float64) * CELL + (CELL - 1) / 2


def of_pixels(nodes: FloatArray) -> Float32Array:
    """Return ((rows − 2) · CELL, (columns − 2) · CELL): `nodes` (rows, columns), interpolated inside the outer ones."""
    size = (nodes.shape[1] * CELL, nodes.shape[0] * CELL)
    grown: Float32Array = cv2.resize(nodes.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)  # type: ignore[assignment]
    return grown[CELL:-CELL, CELL:-CELL]


class Cells(NamedTuple):
    """The cells [top, bottom) × [left, right) of the picture."""

    top: int
    bottom: int
    left: int
    right: int

    @classmethod
    def over(cls, parts: Sequence["Cells"]) -> "Cells":
        """Return the smallest block of cells that holds all of `parts`."""
        tops, bottoms, lefts, rights = zip(*parts, strict=True)
        return cls(min(tops), max(bottoms), min(lefts), max(rights))

    @classmethod
    def holding(cls, wanted: BoolArray, within: "Cells") -> "Cells | None":
        """Return the smallest block that holds all `wanted` cells of those `within` a block; None without any."""
        left, top, width, height = cv2.boundingRect(wanted.view(np.uint8))
        top, left = within.top + top, within.left + left
        return cls(top, top + height, left, left + width) if width else None

    def grown(self) -> "Cells":
        """Return them and one more on either side where the picture has it."""
        return Cells(
            max(0, self.top - 1), min(ROWS, self.bottom + 1), max(0, self.left - 1), min(COLUMNS, self.right + 1)
        )

    @property
    def block(self) -> tuple[slice, slice]:
        """Return where they are among all cells."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def nodes(self) -> tuple[slice, slice]:
        """Return their nodes and one more on either side."""
        return slice(self.top, self.bottom + 2), slice(self.left, self.right + 2)

    @property
    def shape_px(self) -> tuple[int, int]:
        """Return how many rows and columns of pixels they have."""
        return (self.bottom - self.top) * CELL, (self.right - self.left) * CELL

    def pixels(self, origin: "Cells") -> tuple[slice, slice]:
        """Return their pixels, counted from the first one of `origin`."""
        (rows, columns), top, left = self.shape_px, (self.top - origin.top) * CELL, (self.left - origin.left) * CELL
        return slice(top, top + rows), slice(left, left + columns)


PICTURE = Cells(0, ROWS, 0, COLUMNS)

"""How light each pixel is under hard shadows: whole cells at once, pixel by pixel only where a border runs through one.

All that is asked of a pixel is the sign of functions that are linear in it, given at the nodes.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from messages.arrays import BoolArray, Float32Array, FloatArray, FloatImage, IntArray
from sim_rig.camera.grid import CELL, COLUMNS, ROWS


class Shaded(NamedTuple):
    """A slab seen from one camera: `factor` of the light is left where `into` and `left` (nodes), are not negative."""

    into: FloatArray
    left: FloatArray
    factor: float


class LightMap:
    """The share of light on each pixel of what was drawn last there; all of it where nothing was."""

    def __init__(self) -> None:
        self.pixels: FloatImage = np.ones((ROWS * CELL, COLUMNS * CELL), np.float32)
        self._cells = self.pixels.reshape(ROWS, CELL, COLUMNS, CELL)

    def note(self, piece: Sequence[FloatArray], shades: Sequence[Shaded]) -> None:
        """Note the light on a piece of ground, which is where none of the functions `piece` (nodes) is negative."""
        extremes = [_extremes(function) for function in piece]
        touched: BoolArray = np.logical_and.reduce([highest >= 0 for _, highest in extremes])
        whole: BoolArray = np.logical_and.reduce([lowest >= 0 for lowest, _ in extremes])
        border, light = touched & ~whole, np.ones((ROWS, COLUMNS), np.float32)
        for into, left, factor in shades:
            (into_low, into_high), (left_low, left_high) = _extremes(into), _extremes(left)
            inside = (into_low >= 0) & (left_low >= 0)
            light[inside] *= factor
            border |= touched & ~inside & (into_high >= 0) & (left_high >= 0)
        whole &= ~border
        rows, columns = np.nonzero(whole)
        self._cells[rows, :, columns, :] = light[whole][:, None, None]
        rows, columns = np.nonzero(border)
        on_piece = np.logical_and.reduce([_in_cells(function, rows, columns) >= 0 for function in piece])
        lit = np.ones(on_piece.shape, np.float32)
        for into, left, factor in shades:
            lit[(_in_cells(into, rows, columns) >= 0) & (_in_cells(left, rows, columns) >= 0)] *= factor
        self._cells[rows, :, columns, :] = np.where(on_piece, lit, self._cells[rows, :, columns, :])


def _extremes(nodes: FloatArray) -> tuple[Float32Array, Float32Array]:
    """Return the least and the greatest value (ROWS, COLUMNS) at each cell's node and its neighbours."""
    values, around = nodes.astype(np.float32), np.ones((3, 3))
    lowest: Float32Array = cv2.erode(values, around)[1:-1, 1:-1]  # type: ignore[assignment]
    highest: Float32Array = cv2.dilate(values, around)[1:-1, 1:-1]  # type: ignore[assignment]
    return lowest, highest


def _in_cells(nodes: FloatArray, rows: IntArray, columns: IntArray) -> FloatArray:
    """Return the function (n, CELL, CELL) at the pixels of some cells, interpolated as `of_pixels` does."""
    around = np.stack([nodes[rows + i, columns + j] for i in range(3) for j in range(3)], axis=-1)
    return (around @ _WEIGHTS).reshape(-1, CELL, CELL)


def _weights() -> FloatArray:
    """Return (9, CELL²): what of a node and its neighbours is in each pixel of its cell."""
    offset = (np.arange(CELL) + 0.5) / CELL - 0.5
    along = np.stack((np.maximum(-offset, 0.0), 1.0 - np.abs(offset), np.maximum(offset, 0.0)))
    return np.kron(along, along)


_WEIGHTS = _weights()

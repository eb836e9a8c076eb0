"""How light each pixel is under hard shadows: whole cells at once, pixel by pixel only where a border runs through one.

What lies where is told by functions that are linear in the pixel, given at the nodes. A shadow's border darkens a pixel
by the share of its area that it covers: decided by pixels' middles, a border along the rows would be a stair of whole
rows, which the two eyes see at different places.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from messages.arrays import BoolArray, FloatArray, FloatImage, IntArray
from sim_rig.camera.grid import AROUND, CELL, COLUMNS, PICTURE, ROWS, Cells
from sim_rig.walk.shade import Shade


class LightMap:
    """The share of light under `shades` on each pixel of what was drawn last there; all of it where nothing was.

    The nodes' rays go from o_W (rows, 3) along d_W (rows, columns, 3).
    """

    def __init__(self, shades: Sequence[Shade], o_W: FloatArray, d_W: FloatArray) -> None:
        self.pixels: FloatImage = np.ones((ROWS * CELL, COLUMNS * CELL), np.float32)
        self._cells = self.pixels.reshape(ROWS, CELL, COLUMNS, CELL)
        self._shades = [(shade, (o_W @ shade.normal_W)[:, None], d_W @ shade.normal_W) for shade in shades]

    def note(self, above_m: FloatArray, S: FloatArray, W: FloatArray, length_m: float) -> None:
        """Note the light on a piece of ground, met at λ = above / W and S / W of its `length_m` along it.

        A point p = o + λd has n·p W = n·o W + above n·d, linear in the pixel.
        """
        piece = _Region.of(W, S, length_m * W - S)
        cells = Cells.holding(piece.whole | piece.cut, PICTURE)
        if cells is None:
            return
        block, nodes = cells.block, cells.nodes
        whole, border = piece.whole[block], piece.cut[block]
        above_m, W = np.broadcast_to(above_m, W.shape)[nodes], W[nodes]
        light = np.ones(whole.shape, np.float32)
        shaded = []
        for shade, o_n, d_n in self._shades:
            along = o_n[nodes[0]] * W + above_m * d_n[nodes]
            region = _Region.of(along - shade.from_m * W, shade.to_m * W - along)
            if region.whole.any() or region.cut.any():
                light[region.whole] *= shade.factor
                border = border | whole & region.cut
                shaded.append((region, shade.factor))
        pixels = self._cells[block[0], :, block[1]]
        rows, columns = np.nonzero(whole & ~border)
        pixels[rows, :, columns, :] = light[rows, columns, None, None]
        rows, columns = np.nonzero(border)
        lit = np.ones((len(rows), CELL, CELL), np.float32)
        for region, factor in shaded:
            lit *= 1.0 - (1.0 - factor) * region.shares(rows, columns)
        on_piece = piece.pixels(cells.top + rows, cells.left + columns)
        pixels[rows, :, columns, :] = np.where(on_piece, lit, pixels[rows, :, columns, :])


class _Region(NamedTuple):
    """Where none of some functions (nodes) is negative: `whole` cells, and parts of those that its border may `cut`."""

    functions: tuple[FloatArray, ...]
    whole: BoolArray
    cut: BoolArray

    @classmethod
    def of(cls, *functions: FloatArray) -> "_Region":
        signs = [(function >= 0).view(np.uint8) for function in functions]
        whole = cv2.erode(np.bitwise_and.reduce(signs), AROUND)[1:-1, 1:-1] > 0
        touched = np.bitwise_and.reduce([cv2.dilate(sign, AROUND)[1:-1, 1:-1] for sign in signs]) > 0
        return cls(functions, whole, touched & ~whole)

    def pixels(self, rows: IntArray, columns: IntArray) -> BoolArray:
        """Return the pixels (n, CELL, CELL) of some cells whose middles are in it."""
        inside = self.whole[rows, columns].repeat(CELL * CELL).reshape(-1, CELL, CELL)
        cut = self.cut[rows, columns]
        around = [_around(each, rows[cut], columns[cut]) for each in self.functions]
        inside[cut] = np.logical_and.reduce([_in_cells(each) >= 0 for each in around])
        return inside

    def shares(self, rows: IntArray, columns: IntArray) -> FloatImage:
        """Return the share (n, CELL, CELL) of each pixel of some cells that is in it; its borders do not cross there.

        A border at a distance d from a pixel's middle leaves ½ + d of it, to within 0.06 where it runs askew.
        """
        inside = np.repeat(self.whole[rows, columns].astype(np.float32), CELL * CELL).reshape(-1, CELL, CELL)
        cut = self.cut[rows, columns]
        outside = np.zeros((np.count_nonzero(cut), CELL, CELL))
        for each in self.functions:
            around = _around(each, rows[cut], columns[cut])
            distance_px = _in_cells(around) / _steepness(around)[:, None, None]
            outside += np.clip(0.5 - distance_px, 0.0, 1.0)
        inside[cut] = np.maximum(1.0 - outside, 0.0)
        return inside


def _around(nodes: FloatArray, rows: IntArray, columns: IntArray) -> FloatArray:
    """Return the function (n, 9) at the nodes of some cells and at those around each."""
    around: FloatArray = nodes[rows[:, None] + _DOWN, columns[:, None] + _ACROSS]
    return around


def _in_cells(around: FloatArray) -> FloatArray:
    """Return the function (n, CELL, CELL) at the pixels of cells, interpolated as `of_pixels` does."""
    return (around @ _WEIGHTS).reshape(-1, CELL, CELL)


def _steepness(around: FloatArray) -> FloatArray:
    """Return the size (n,) of the function's gradient, per pixel, over zero; of nine nodes the middle one is 4."""
    across, down = around[:, 5] - around[:, 3], around[:, 7] - around[:, 1]
    steepness: FloatArray = np.maximum(np.hypot(across, down) / (2.0 * CELL), np.finfo(np.float64).tiny)
    return steepness


def _weights() -> FloatArray:
    """Return (9, CELL²): what of a node and its neighbours is in each pixel of its cell."""
    offset = (np.arange(CELL) + 0.5) / CELL - 0.5
    along = np.stack((np.maximum(-offset, 0.0), 1.0 - np.abs(offset), np.maximum(offset, 0.0)))
    return np.kron(along, along)


_DOWN, _ACROSS = np.indices((3, 3)).reshape(2, 9)
_WEIGHTS = _weights()

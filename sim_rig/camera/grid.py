"""The grid on which the renderer's geometry is exact: nodes in the middle of cells 8 px wide."""

import cv2
import numpy as np

from messages.arrays import Float32Array, FloatArray
from sim_rig.unit import HEIGHT_PX, WIDTH_PX

CELL = 8
ROWS, COLUMNS = HEIGHT_PX // CELL, WIDTH_PX // CELL


def node_pixels(cells: int) -> FloatArray:
    """Return the pixel of each node: the middle of each cell and of one more on either side, as cv2.resize has it."""
    return np.arange(-1, cells + 1, dtype=np.float64) * CELL + (CELL - 1) / 2


def of_pixels(nodes: FloatArray) -> Float32Array:
    """Return ((rows − 2) · CELL, (columns − 2) · CELL): `nodes` (rows, columns), interpolated inside the outer ones."""
    size = (nodes.shape[1] * CELL, nodes.shape[0] * CELL)
    grown: Float32Array = cv2.resize(nodes.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)  # type: ignore[assignment]
    return grown[CELL:-CELL, CELL:-CELL]

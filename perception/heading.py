"""The heading frame H: gravity-aligned, its x the horizontal projection of the camera's optical axis."""

import math

import numpy as np

from messages.arrays import FloatArray


def heading(R_WC: FloatArray) -> FloatArray | None:
    """Return R_WH (3, 3): H's x is the horizontal projection of C's optical axis; None if that is vertical."""
    direction = laid_down(R_WC[0, 2], R_WC[1, 2])
    if direction is None:
        return None
    c, s = direction
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def laid_down(x: float, y: float) -> tuple[float, float] | None:
    """Return cosine and sine of the angle of (x, y), the horizontal part of a unit vector; None if that is vertical."""
    length = math.hypot(x, y)
    return None if length < _LEAST_HORIZONTAL else (x / length, y / length)


_LEAST_HORIZONTAL = 0.05

"""The heading frame H: gravity-aligned, its x the horizontal projection of the camera's optical axis."""

import numpy as np

from messages.arrays import FloatArray


def heading(R_WC: FloatArray) -> FloatArray | None:
    """Return R_WH (3, 3): H's x is the horizontal projection of C's optical axis; None if that is vertical."""
    x, y = R_WC[0, 2], R_WC[1, 2]
    length = float(np.hypot(x, y))
    if length < _LEAST_HORIZONTAL:
        return None
    c, s = x / length, y / length
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


_LEAST_HORIZONTAL = 0.05

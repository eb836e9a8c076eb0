"""Array types, by the numbers they hold, and the size of an array. A shape stands in the docstring of whatever takes or
returns the array.
"""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

GreyImage = NDArray[np.uint8]
"""Grey values, (height, width)."""
DepthImage = NDArray[np.uint16]
"""Depth in the camera's unit, 0 where unknown, (height, width)."""
FloatImage = NDArray[np.float32]
"""One number a pixel, such as a disparity in px, (height, width)."""


def rms(values: FloatArray) -> float:
    """Return the root of the mean square of all `values`; NaN in any makes it NaN."""
    return float(np.sqrt((values**2).mean()))


def column_rms(values: FloatArray) -> FloatArray:
    """Return the root mean square (…) of each column of `values` (n, …)."""
    found: FloatArray = np.sqrt((values**2).mean(axis=0))
    return found

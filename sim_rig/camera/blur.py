"""How the lens and motion during the exposure smear a picture."""

import numpy as np

from messages.arrays import Float32Array, FloatArray

LENS_BLUR_PX = 0.55
_LEAST_BLUR_PX = 0.3  # motion blur below it is not to be seen beside the lens's
_MOST_BLUR_PX = 12.0  # a limit to the kernel's size


def line_kernel(motion_px: FloatArray) -> Float32Array | None:
    """Return a box along `motion_px` (2,), centred, of sum 1; None where it is too short to matter."""
    length_px = float(np.hypot(*motion_px))
    if length_px < _LEAST_BLUR_PX:
        return None
    motion_px = motion_px * min(1.0, _MOST_BLUR_PX / length_px)
    radius = int(np.ceil(np.abs(motion_px).max() / 2))
    samples = 4 * radius + 1
    along = (np.arange(samples) + 0.5) / samples - 0.5
    kernel = np.zeros((2 * radius + 1, 2 * radius + 1), np.float32)
    at = along[:, None] * motion_px + radius
    whole = np.clip(np.floor(at), 0, max(2 * radius - 1, 0)).astype(int)
    part = at - whole
    weights = np.abs(1 - _DU - part[:, 0]) * np.abs(1 - _DV - part[:, 1]) / samples
    np.add.at(kernel, (whole[:, 1] + _DV, whole[:, 0] + _DU), weights)
    return kernel


_DV, _DU = np.array([0, 0, 1, 1])[:, None], np.array([0, 1, 0, 1])[:, None]
"""Of the four pixels around a point, (4, 1) each."""

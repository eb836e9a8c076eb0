"""What a force plate makes of a wrench, and where: geometry, gains, time, and what is not linear. Arrays are (6, n)."""

import numpy as np

from messages.arrays import BoolArray, FloatArray
from systems.platform.memory import last_kept

CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")
_HARMONICS = 12
"""Of the staircase: its edges are then about a twentieth of a step wide, and noise blurs them further."""
_MOST_EXPONENT = 40.0
"""A harmonic weakened by exp(−40) is far below the last digit."""
_LEAST_LEVELS = 2
"""Values of a channel: as few may be a switch, and tell no spacing."""
_SAMPLES_OF_A_LEVEL = 4
"""Samples for each value that occurs: where there are fewer, values do not repeat as those of a lattice do."""


def about_height(height_m: float) -> FloatArray:
    """Return the matrix (6, 6) that takes moments about P's origin to those about a point `height_m` above it.

    T' = T − (0, h, 0) × f.
    """
    matrix = np.eye(6)
    matrix[3, 2], matrix[5, 0] = -height_m, height_m
    return matrix


def turned(rotation_rad: FloatArray) -> FloatArray:
    """Return the matrix (6, 6) that takes a wrench in P to a sensor turned against P by a rotation vector (3,)."""
    angle = float(np.linalg.norm(rotation_rad))
    if angle == 0.0:
        return np.eye(6)
    x, y, z = rotation_rad / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    R_PS = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = R_PS.T
    return matrix


def rounded(x: FloatArray, step: float, noise: float) -> FloatArray:
    """Return what rounding to multiples of `step` makes on average of `x` with normal `noise` on it.

    x + (step/π) Σ_k (−1)ᵏ/k exp(−2 (π k noise / step)²) sin(2π k x / step): without noise the staircase itself.
    """
    phase = 2.0 * np.pi * x / step
    mean: FloatArray = x.copy()
    for k in range(1, _HARMONICS + 1):
        exponent = 2.0 * (np.pi * k * noise / step) ** 2
        if exponent < _MOST_EXPONENT:
            mean = mean + (-1.0) ** k * step / (np.pi * k) * np.exp(-exponent) * np.sin(k * phase)
    return mean


def held(values: FloatArray, repeats: BoolArray, share: float) -> FloatArray:
    """Return `values` (6, n) with a `share` of the way from every sample that `repeats` (n,) to the one it repeats."""
    result: FloatArray = values + share * (values[:, last_kept(repeats)] - values)
    return result


def repeats(wrench: FloatArray) -> BoolArray:
    """Return where (n,) all channels of a measured wrench (n, 6) are exactly those of the sample before."""
    same = np.zeros(len(wrench), dtype=np.bool_)
    same[1:] = (wrench[1:] == wrench[:-1]).all(axis=1)
    return same


def lattice(values: FloatArray) -> float | None:
    """Return the spacing of what values (n,) lie on multiples of it, or None where they take almost any value."""
    levels = np.unique(values)
    if not _LEAST_LEVELS < len(levels) < len(values) / _SAMPLES_OF_A_LEVEL:
        return None
    smaller_half = np.sort(np.diff(levels))[: max(1, len(levels) // 2)]  # the larger ones span values not taken
    return float(np.median(smaller_half))

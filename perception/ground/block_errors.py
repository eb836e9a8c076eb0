"""The covariance of sums over pixels whose errors are alike within blocks of the picture, and not beyond."""

import numpy as np

from messages.arrays import FloatArray, IntArray

BLOCK_PX = 48
"""Side of a block: larger ones say no more of a textured floor, smaller ones less (the matcher's errors are alike over
some twenty pixels there; where texture is poor, over more)."""


def blocks(shape: tuple[int, int], stride: int) -> IntArray:
    """Return the block (rows, columns) of each pixel of a picture of which every `stride`-th row and column is left."""
    rows, columns = (np.arange(count) * stride // BLOCK_PX for count in shape)
    block: IntArray = rows[:, None] * (columns[-1] + 1) + columns
    return block


def sums_of(values: FloatArray, block: IntArray) -> FloatArray:
    """Return the sums (k, blocks) of `values` (N, k) by `block` (N,)."""
    return np.stack([np.bincount(block, column) for column in values.T])


def covariance_of_sum(scores: FloatArray, block: IntArray) -> FloatArray:
    """Return the covariance (k, k) of Σ `scores` (N, k), what is left of a fit of k parameters, by `block` (N,).

    Σ_b g_b g_bᵀ · n / (n − k), g_b the sum over block b of n: the clustered sandwich's middle (Liang, Zeger, Biometrika
    73(1), 1986). It needs no model of how the errors within a block are correlated.
    """
    parameters = scores.shape[1]
    sums = sums_of(scores, block)
    count = np.count_nonzero(np.bincount(block))
    covariance: FloatArray = sums @ sums.T * (count / max(count - parameters, 1))
    return covariance

"""Channels that remember: play, and samples that repeat the last one in place of a lost one. Time is the first axis."""

import numpy as np
from numpy.typing import NDArray

from messages.arrays import BoolArray, FloatArray


def with_play(x: FloatArray, half_play: FloatArray | float, start: FloatArray | float) -> FloatArray:
    """Return what comes through a play of ± `half_play`: y follows x (n, ...) only where it would be further behind.

        y_k = min(max(y_{k−1}, x_k − half_play), x_k + half_play),   y_{−1} = start                              (1)

    Each step is a clamp between two limits, and a clamp after a clamp is a clamp: all prefixes in log2 n passes.
    """
    low, high = x - half_play, x + half_play
    step = 1
    while step < len(x):
        low[step:], high[step:] = (
            np.clip(low[:-step], low[step:], high[step:]),
            np.clip(high[:-step], low[step:], high[step:]),
        )
        step *= 2
    y: FloatArray = np.clip(start, low, high)
    return y


def last_kept(lost: BoolArray) -> NDArray[np.intp]:
    """Return for each sample (n,) the index of the last one up to it that was not `lost` (n,)."""
    index: NDArray[np.intp] = np.maximum.accumulate(np.where(lost, 0, np.arange(len(lost))))
    return index

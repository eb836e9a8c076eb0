"""The pool of pixel buffers that every camera source shares: it bounds image memory."""

import math
import weakref
from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from messages import FrameHeader, StereoFrame
from messages.arrays import GreyImage


class FramePair(NamedTuple):
    """Pixels to fill: `left` and `right` are writable (height_px, width_px) uint8, their content undefined."""

    left: GreyImage
    right: GreyImage

    def frame(self, header: FrameHeader) -> StereoFrame:
        """Return the message that owns these pixels from now on; they become read-only."""
        self.left.flags.writeable = False
        self.right.flags.writeable = False
        return StereoFrame(header=header, left=self.left, right=self.right)


class PixelPool:
    """A fixed number of arrays, allocated once, so that a steady stream of frames allocates no image memory.

    An array is lent by `lend` and comes back by itself once nothing refers to it any more, nor to any view, slice or
    memoryview of it. `lend` and the return may happen in different threads.
    """

    def __init__(self, count: int, shape: tuple[int, ...], dtype: DTypeLike) -> None:
        self._shape, self._dtype = shape, np.dtype(dtype)
        self._free = deque(bytearray(math.prod(shape) * self._dtype.itemsize) for _ in range(count))

    @property
    def free(self) -> int:
        """Return how many arrays could be lent now."""
        return len(self._free)

    def lend(self) -> NDArray[Any] | None:
        """Lend an array, or return None while all of them are held (the caller counts `POOL_EXHAUSTED`)."""
        try:
            storage = self._free.popleft()
        except IndexError:
            return None
        # NumPy lets a view of a view refer straight to the array that owns the memory. `lent` counts as that owner,
        # because what lies below it is no array; so it lives exactly as long as the last view of it.
        lent: NDArray[Any] = np.ndarray(self._shape, self._dtype, buffer=storage)
        # No lock here: the last reference may go in any thread and at any time, in the middle of `lend` too.
        # Appending to a deque is atomic, a lock could be taken twice.
        weakref.finalize(lent, self._free.append, storage).atexit = False
        return lent


class FramePool(PixelPool):
    """A PixelPool of stereo pairs."""

    def __init__(self, count: int, width_px: int, height_px: int) -> None:
        super().__init__(count, (2, height_px, width_px), np.uint8)

    def take(self) -> FramePair | None:
        """Lend a pair, or return None while all of them are held."""
        both = self.lend()
        return None if both is None else FramePair(both[0], both[1])

"""The one copy of a frame out of the capture buffer, against the other ways to split the eyes; milliseconds a frame.

    python -m benchmarks.capture

Many buffers in turn, as mmap capture has, so that none is still in the cache.
"""

import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.camera.frame_pool import FramePair
from drivers.camera.side_by_side import split_eyes

WIDTH_PX, HEIGHT_PX = 1280, 720
BUFFERS, FRAMES = 25, 480

Bytes = NDArray[np.uint8]
Split = Callable[[Bytes, FramePair], None]


def this_project(frame: Bytes, pair: FramePair) -> None:
    """Cut each 16-bit pixel down to its low byte."""
    split_eyes(frame.view("<u2"), pair)


def strided(frame: Bytes, pair: FramePair) -> None:
    """Copy every second byte with NumPy."""
    pixels = frame.reshape(HEIGHT_PX, 2 * WIDTH_PX, 2)
    np.copyto(pair.left, pixels[:, :WIDTH_PX, 0])
    np.copyto(pair.right, pixels[:, WIDTH_PX:, 0])


def converted(frame: Bytes, pair: FramePair) -> None:
    """Let OpenCV convert YUYV to grey."""
    pixels = frame.reshape(HEIGHT_PX, 2 * WIDTH_PX, 2)
    cv2.cvtColor(pixels[:, :WIDTH_PX], cv2.COLOR_YUV2GRAY_YUY2, dst=pair.left)
    cv2.cvtColor(pixels[:, WIDTH_PX:], cv2.COLOR_YUV2GRAY_YUY2, dst=pair.right)


def main() -> None:
    """Print p50, p99 and the ratio to this project's way."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 256, (HEIGHT_PX, 4 * WIDTH_PX), np.uint8) for _ in range(BUFFERS)]
    pairs = [FramePair(*np.zeros((2, HEIGHT_PX, WIDTH_PX), np.uint8)) for _ in range(BUFFERS)]
    ways: dict[str, Split] = {"this project": this_project, "NumPy, strided": strided, "OpenCV cvtColor": converted}
    spent_ms: dict[str, list[float]] = {name: [] for name in ways}
    for k in range(FRAMES):
        for place, (name, split) in enumerate(ways.items()):
            buffer = (k * len(ways) + place) % BUFFERS
            start_s = time.perf_counter()
            split(frames[buffer], pairs[buffer])
            spent_ms[name].append(1e3 * (time.perf_counter() - start_s))
    own_ms = np.median(spent_ms["this project"])
    for name, spent in spent_ms.items():
        p50, p99 = np.percentile(spent, (50, 99))
        print(f"{name:16} p50 {p50:5.2f}  p99 {p99:5.2f}  ratio {p50 / own_ms:4.1f}")


if __name__ == "__main__":
    main()

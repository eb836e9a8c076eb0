"""Pictures as a V4L2 camera writes them into a buffer."""

import mmap
from collections.abc import Sequence

import numpy as np

from messages import Image

PIXEL_BYTES = {"GREY": 1, "YUYV": 2, "Z16 ": 2, "MJPG": 0}
"""Compressed images have no pitch of rows."""
_U, _V = 90, 200


def write_pixels(
    memory: mmap.mmap, code: str, size: tuple[int, int], pitch: int, pictures: Sequence[Image], rows: slice
) -> None:
    """Write `rows` of `pictures`, side by side, as an image of `size` (width, height) in the pixel format `code`."""
    width, height = size
    number = "<u2" if code == "Z16 " else "u1"
    pixels = np.ndarray((height, width), number, memory, strides=(pitch, PIXEL_BYTES[code]))
    column = 0
    for picture in pictures:
        pixels[rows, column : column + picture.shape[1]] = picture[rows]
        column += picture.shape[1]
    if code == "YUYV":
        chroma = np.ndarray((height, width), np.uint8, memory, offset=1, strides=(pitch, 2))
        chroma[rows, 0::2] = _U
        chroma[rows, 1::2] = _V

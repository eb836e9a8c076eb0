"""What the ground looks like: photographs from scikit-image and procedural surfaces, as tiles that repeat seamlessly.

A tile is (TILE, TILE) uint8 at TEXEL_M a texel: rows along the walk, columns across it. Canvases are tiles laid side
by side and reduced by powers of two, independently in both directions, so that a surface seen at a flat angle is
filtered along the walk only.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.ndimage import convolve1d, gaussian_filter
from skimage import data

from messages.arrays import BoolArray, FloatArray, GreyImage

TEXEL_M = 0.002
TILE = 1024
MAX_LEVEL = 4
CANVAS_COLUMNS = 2048
"""Columns, beyond one tile, of a canvas at any level."""

_BINOMIAL = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0


def canvas(texture: str, rows: int, phase: int, row_level: int, column_level: int) -> GreyImage:
    """Return (rows / 2^row_level + 1, TILE / 2^column_level + CANVAS_COLUMNS) texels of `texture`.

    `rows` counts full-size texels and is a multiple of 2^MAX_LEVEL. Texel (0, 0) of every level is the same point of
    the surface, texel (i, j) lies i·2^row_level and j·2^column_level full-size texels from it. `phase` moves the
    surface by that many times 2^MAX_LEVEL texels.
    """
    return _canvas(texture, rows, phase % (TILE >> MAX_LEVEL), row_level, column_level)


@lru_cache(maxsize=256)
def _canvas(texture: str, rows: int, phase: int, row_level: int, column_level: int) -> GreyImage:
    tile = _reduced(texture, row_level, column_level)
    first_row = phase << (MAX_LEVEL - row_level)
    row = np.arange(first_row, first_row + (rows >> row_level) + 1) % tile.shape[0]
    column = np.arange(tile.shape[1] + CANVAS_COLUMNS) % tile.shape[1]
    laid: GreyImage = np.ascontiguousarray(tile[row][:, column])
    return laid


@lru_cache(maxsize=256)
def _reduced(texture: str, row_level: int, column_level: int) -> GreyImage:
    image = _tile(texture).astype(np.float32)
    for axis, level in enumerate((row_level, column_level)):
        for _ in range(level):
            image = convolve1d(image, _BINOMIAL, axis=axis, mode="wrap")
            image = image[::2] if axis == 0 else image[:, ::2]
    return np.rint(image).astype(np.uint8)


@lru_cache(maxsize=32)
def _tile(texture: str) -> GreyImage:
    surface = TEXTURES[texture]()
    return np.clip(np.rint(surface), 0, 255).astype(np.uint8)


def _photograph(name: str, mean: float) -> FloatArray:
    """Return skimage.data's photograph mirrored at its edges: it repeats without seams, and no mirror in mid-path."""
    image: GreyImage = getattr(data, name)()
    mirrored = np.block([[image, image[:, ::-1]], [image[::-1], image[::-1, ::-1]]]).astype(np.float64)
    rolled: FloatArray = np.roll(mirrored, TILE // 4, axis=1)
    return rolled + (mean - float(rolled.mean()))


def _noise(seed: int, roughness: float, stretch: tuple[float, float] = (1.0, 1.0)) -> FloatArray:
    """Return periodic noise (TILE, TILE), mean 0 and deviation 1, whose amplitude falls as frequency^−roughness."""
    white = np.fft.rfft2(np.random.default_rng(seed).standard_normal((TILE, TILE)))
    fy, fx = np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None]
    radius = np.hypot(fy * stretch[0], fx * stretch[1])
    radius[0, 0] = np.inf
    noise: FloatArray = np.fft.irfft2(white * np.maximum(radius, 1 / 256) ** -roughness)
    noise /= noise.std()
    return noise


def _smooth(surface: FloatArray, sigma: float) -> FloatArray:
    smooth: FloatArray = gaussian_filter(surface, sigma, mode="wrap")
    return smooth


def _joints(spacing: int, width: int) -> BoolArray:
    """Return (TILE, 1) where joints lie across the walk: `width` texels of every `spacing`."""
    return np.arange(TILE)[:, None] % spacing < width


def _concrete() -> FloatArray:
    pores = _smooth((np.random.default_rng(11).random((TILE, TILE)) < 0.004).astype(np.float64), 1.2)
    return 150 + 7 * _noise(12, 1.0) + 6 * _noise(13, 0.3) - 170 * pores


def _asphalt() -> FloatArray:
    stones = _smooth(np.random.default_rng(21).standard_normal((TILE, TILE)), 1.3)
    return 88 + 19 / float(stones.std()) * stones + 6 * _noise(22, 1.2)


def _paving() -> FloatArray:
    slabs = 6 * np.random.default_rng(31).standard_normal((4, 4)).repeat(TILE // 4, 0).repeat(TILE // 4, 1)
    surface = 158 + slabs + 6 * _noise(32, 1.1) + 5 * _noise(33, 0.2)
    joints = _joints(TILE // 4, 4) | _joints(TILE // 4, 4).T
    return np.where(joints, 92 + 8 * _noise(34, 0.2), surface)


def _wood() -> FloatArray:
    boards = 9 * np.random.default_rng(41).standard_normal(16).repeat(TILE // 16)[:, None]
    grain = 11 * _noise(42, 0.9, (0.15, 1.8)) + 5 * _noise(43, 0.4, (0.3, 1.5)) + 5 * _noise(44, 0.2)
    return np.where(_joints(TILE // 16, 2), 55.0, 126 + boards + grain)


def _kerbstone() -> FloatArray:
    return 112 + 8 * _noise(51, 0.9) + 10 * _noise(52, 0.25)


TEXTURES: dict[str, Callable[[], FloatArray]] = {
    "brick": lambda: _photograph("brick", 110.0),
    "grass": lambda: _photograph("grass", 118.0),
    "gravel": lambda: _photograph("gravel", 126.0),
    "concrete": _concrete,
    "asphalt": _asphalt,
    "paving": _paving,
    "wood": _wood,
    "kerbstone": _kerbstone,
}
"""Every surface by name, in grey levels of a well-exposed picture."""

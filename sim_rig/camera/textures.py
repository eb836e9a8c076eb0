"""What surfaces look like: photographs from scikit-image and procedural surfaces, as tiles that repeat seamlessly.

A tile is (TILE, TILE) uint8 at `texel_m` a texel: rows along the walk, columns across it. Canvases are tiles laid side
by side and reduced by powers of two, independently in both directions, so that a surface seen at a flat angle is
filtered along the walk only.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.ndimage import convolve1d, gaussian_filter
from skimage import data

from messages.arrays import BoolArray, Float32Array, FloatArray, GreyImage

TEXEL_M = 0.002
TILE = 1024
MAX_LEVEL = 4
CANVAS_COLUMNS = 2048
"""Columns, beyond one tile, of a canvas at any level."""

_VARIED = "-varied"
_MOSAIC_TILES = {"mosaic-6cm": (0.060, 32, 1.6), "mosaic-2.5cm": (0.025, 16, 1.3)}
"""Period in metres and in texels, a power of two so that all tiles are sampled alike; the joint's width in texels."""

_OWN_TEXELS_M = {"ceiling": 0.004} | {name: period_m / texels for name, (period_m, texels, _) in _MOSAIC_TILES.items()}
"""Of what does not have the usual ones."""

_BINOMIAL = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0


def canvas(texture: str, rows: int, phase: int, row_level: int, column_level: int) -> GreyImage:
    """Return (rows / 2^row_level + 1, TILE / 2^column_level + CANVAS_COLUMNS) texels of `texture`.

    `rows` counts full-size texels and is a multiple of 2^MAX_LEVEL. Texel (0, 0) of every level is the same point of
    the surface, texel (i, j) lies i·2^row_level and j·2^column_level full-size texels from it. `phase` moves the
    surface by that many times 2^MAX_LEVEL texels.
    """
    return _canvas(texture, rows, phase % (TILE >> MAX_LEVEL), row_level, column_level)


def face(texture: str, rows: int, columns: int, row_level: int, column_level: int) -> GreyImage:
    """Return the corner of `canvas` that holds `rows` by `columns` full-size texels.

    Raises ValueError for more than TILE of either, where the surface would repeat.
    """
    if max(rows, columns) > TILE:
        raise ValueError(f"a face of {texture} is {rows} by {columns} texels, allowed are {TILE}: choose larger ones")
    laid = canvas(texture, TILE, 0, row_level, column_level)
    return laid[: -(-rows >> row_level) + 2, : -(-columns >> column_level) + 2]


def texel_m(texture: str) -> float:
    """Return the size of a full-size texel of `texture` on the ground."""
    return _OWN_TEXELS_M.get(texture.removesuffix(_VARIED), TEXEL_M)


@lru_cache(maxsize=256)
def _canvas(texture: str, rows: int, phase: int, row_level: int, column_level: int) -> GreyImage:
    tile = _reduced(texture, row_level, column_level)
    first_row = phase << (MAX_LEVEL - row_level)
    row = np.arange(first_row, first_row + (rows >> row_level) + 1) % tile.shape[0]
    column = np.arange(tile.shape[1] + CANVAS_COLUMNS) % tile.shape[1]
    laid: GreyImage = np.ascontiguousarray(tile[row][:, column])
    return laid


def _reduced(texture: str, row_level: int, column_level: int) -> GreyImage:
    return np.rint(_level(texture, row_level, column_level)).astype(np.uint8)


@lru_cache(maxsize=256)
def _level(texture: str, row_level: int, column_level: int) -> Float32Array:
    if row_level == column_level == 0:
        return _tile(texture).astype(np.float32)
    if column_level == 0:
        return convolve1d(_level(texture, row_level - 1, 0), _BINOMIAL, axis=0, mode="wrap")[::2]
    return convolve1d(_level(texture, row_level, column_level - 1), _BINOMIAL, axis=1, mode="wrap")[:, ::2]


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


def _mosaic(name: str, variation: float) -> FloatArray:
    """Return square tiles, all alike but for `variation` in their grey and a print of half of that."""
    _, texels, joint = _MOSAIC_TILES[name]
    start = np.arange(TILE) % texels
    in_joint = np.clip(joint - start, 0.0, 1.0)  # the share of each texel that the joint covers
    covered = 1.0 - (1.0 - in_joint)[:, None] * (1.0 - in_joint)[None]
    count = TILE // texels
    tiles = np.random.default_rng(61).standard_normal((count, count)).repeat(texels, 0).repeat(texels, 1)
    surface: FloatArray = (1.0 - covered) * (165.0 + variation * (tiles + 0.5 * _noise(62, 0.5))) + covered * 92.0
    return surface


def _print() -> FloatArray:
    """Return a bold print: blocks of 16 texels and smaller ones of 4, from nearly black to nearly white."""
    rng = np.random.default_rng(71)
    blocks, grains = (rng.uniform(-1, 1, (TILE // size, TILE // size)) for size in (16, 4))
    surface: FloatArray = np.kron(blocks, np.ones((16, 16))) * 65 + np.kron(grains, np.ones((4, 4))) * 35
    return 128 + surface


def _ceiling() -> FloatArray:
    """Return beams and boards, dark and bright, of half a metre and more, and a row of lamps of 0.6 m by 1.2 m, as
    white as can be, each 4.1 m."""
    boards = np.random.default_rng(81).uniform(10.0, 70.0, (8, 8)).repeat(TILE // 8, 0).repeat(TILE // 8, 1)
    along, across = np.arange(TILE)[:, None], np.arange(TILE)[None]
    lamp = (along % 512 < 300) & ((across < 75) | (across >= TILE - 75))
    return np.where(lamp, 255.0, boards)


TEXTURES: dict[str, Callable[[], FloatArray]] = {
    "brick": lambda: _photograph("brick", 110.0),
    "grass": lambda: _photograph("grass", 118.0),
    "gravel": lambda: _photograph("gravel", 126.0),
    "concrete": _concrete,
    "asphalt": _asphalt,
    "paving": _paving,
    "wood": _wood,
    "kerbstone": _kerbstone,
    "mosaic-6cm": lambda: _mosaic("mosaic-6cm", 0.0),
    "mosaic-2.5cm": lambda: _mosaic("mosaic-2.5cm", 0.0),
    "mosaic-6cm-varied": lambda: _mosaic("mosaic-6cm", 4.0),
    "mosaic-2.5cm-varied": lambda: _mosaic("mosaic-2.5cm", 4.0),
    "resin": lambda: 150 + 14 * _noise(65, 1.6) + 6 * (1 + 0.8 * _noise(67, 1.6)) * _noise(66, 0.3),
    "print": _print,
    "jacket": lambda: 95 + 9 * _noise(72, 1.1) + 7 * _noise(73, 0.3),
    "trousers": lambda: 80 + 5 * _noise(74, 1.2) + 6 * _noise(75, 0.2, (0.3, 1.5)),
    "cane": lambda: np.where(_joints(TILE // 4, TILE // 16), 70.0, 208 + 3 * _noise(79, 0.3)),
    "leather": lambda: 72 + 6 * _noise(76, 0.8) + 4 * _noise(77, 0.2),
    "ceiling": _ceiling,
    "steel": lambda: 140 + 8 * _noise(78, 1.2, (1.8, 0.15)),
}
"""Every surface by name, in grey levels of a well-exposed picture."""

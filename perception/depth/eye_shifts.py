"""By how much, tile by tile, one eye's picture is shifted against the other's once their disparity is taken off.

What the left eye shows at (x, y) a sound right one shows at (x − d, y), whatever it is. With the disparities d that
were matched, M half the sum of the two and D the right eye less the left, a shift s of the right one that is left over
leaves D = −s · ∇M, so within a tile, by least squares,

    s = −(Σ ∇M ∇Mᵀ)⁻¹ Σ ∇M D,        cov s = σ² (Σ ∇M ∇Mᵀ)⁻¹                                               (1)

with σ² the mean square that (1) leaves (Lucas and Kanade 1981, alike in both eyes). Of s the part up or down is of
interest; along the rows it is what d is off the plane d = r · θ that was fitted. Where the eyes' rows differ, a rolling
shutter exposes what both see at instants that differ by τ. In it a point at depth Z moves down by

    τ ẏ = τ (ω_x (1 + y²) − ω_y x y − ω_z x + (y v_z − v_y) / Z),                                           (2)

the optical flow of a camera that turns by ω and moves by v (Longuet-Higgins and Prazdny 1980), which s is told without.
Tiles are fixed in the picture: what comes of a lens stays in its tile, what lies on the ground passes through.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np

from messages import Image
from messages.arrays import BoolArray, Float32Array, FloatArray, FloatImage, GreyImage
from perception.depth.rectify import Rectifier, Window

TILE_PX = 20
"""Of the rectified picture: a few of them side by side show a drop on the lens."""


@dataclass(frozen=True)
class EyeShifts:
    """What (rows, columns) tiles show, the first of which is that at `row` and `column` of the picture's, of which
    there are `of_picture` (rows, columns).

    `y_px` is the shift of (1), down, with its variance; `x_px` how much more disparity there is than the plane's. Only
    where it is `whole` does a tile show one surface, and both eyes the same. Of the tiles that matched and show more
    than noise, the eyes are alike in `alike_share`; NaN where none does. `middle` (x, y) is where the tiles' middle
    lies, on rays with z = 1, and `half` (x, y) half their width and height.
    """

    row: int
    column: int
    of_picture: tuple[int, int]
    x_px: FloatArray
    y_px: FloatArray
    y_var_px2: FloatArray
    whole: BoolArray
    alike_share: float
    middle: tuple[float, float]
    half: tuple[float, float]


def find_shifts(
    rectifier: Rectifier,
    images: Sequence[Image],
    window: Window,
    disparity_px: FloatArray,
    points_C: FloatArray,
    theta_C: FloatArray,
    w_C_radps: FloatArray,
    v_C_mps: FloatArray,
) -> EyeShifts | None:
    """Return the shifts where the rectified left eye shows `points_C` (N, 3), which lie before the camera.

    `disparity_px` (rows, columns) are those of the `window` about them, NaN where unknown; the plane is
    d = r · `theta_C` (3,), px. The camera turns by `w_C_radps` (3,) and moves by `v_C_mps` (3,). None where hardly any
    of it is in view.
    """
    tiles = _tiles_about(points_C, window, rectifier)
    if tiles is None:
        return None
    # of the disparities every fourth along rows and columns: they are much like their neighbours
    u = np.arange(tiles.left + _EVERY // 2, tiles.right, _EVERY)
    v = np.arange(tiles.top + _EVERY // 2, tiles.bottom, _EVERY)[:, None]
    plane = rectifier.on_plane(u, v, theta_C)
    some = disparity_px[
        tiles.top - window.top + _EVERY // 2 : tiles.bottom - window.top : _EVERY,
        tiles.left - window.left + _EVERY // 2 : tiles.right - window.left : _EVERY,
    ]
    known = np.isfinite(some)
    disparity = np.where(known, some, plane)
    low, high = math.floor(disparity.min()) - 1, math.ceil(disparity.max()) + 1
    if low < 0:
        return None
    left_eye, right_eye = rectifier.rectify_apart(*cast("tuple[GreyImage, GreyImage]", images), tiles, (low, high))
    # Column j of `right_eye` is column tiles.left − high + j of the right picture.
    columns = np.arange(left_eye.shape[1], dtype=np.float32) + np.float32(high)
    there = columns - cv2.resize(disparity.astype(np.float32), left_eye.shape[::-1])
    same_row = np.repeat(np.arange(there.shape[0], dtype=np.float32)[:, None], there.shape[1], axis=1)
    laid = cast("GreyImage", cv2.remap(right_eye, there, same_row, cv2.INTER_LINEAR))
    y_px, y_var_px2, unlike, detail = _vertical(left_eye, laid)
    x_px, spread_px2, share = _off_plane((disparity - plane).astype(np.float32), known)
    middle_u = tiles.left - 0.5 + TILE_PX * (0.5 + np.arange(x_px.shape[1]))
    middle_v = tiles.top - 0.5 + TILE_PX * (0.5 + np.arange(x_px.shape[0]))[:, None]
    d = rectifier.on_plane(middle_u, middle_v, theta_C) + x_px
    x, y = (middle_u - rectifier.cx_px) / rectifier.f_px, (middle_v - rectifier.cy_px) / rectifier.f_px
    (wx, wy, wz), (_, vy, vz) = w_C_radps, v_C_mps
    matched, alike = share > _LEAST_KNOWN, unlike < _MOST_UNLIKE
    telling = matched & (detail > _LEAST_DETAIL**2)
    nearness = d / (rectifier.f_px * rectifier.baseline_m)
    flow = wx * (1.0 + y * y) - wy * x * y - wz * x + (y * vz - vy) * nearness
    return EyeShifts(
        row=tiles.top // TILE_PX,
        column=tiles.left // TILE_PX,
        of_picture=(rectifier.height_px // TILE_PX, rectifier.width_px // TILE_PX),
        x_px=x_px,
        y_px=y_px - rectifier.f_px * rectifier.lag_s(middle_u, middle_v, d) * flow,
        y_var_px2=y_var_px2,
        whole=matched & alike & (spread_px2 < _MOST_SPREAD_PX**2),
        alike_share=float(alike[telling].mean()) if telling.any() else math.nan,
        middle=(float(x.mean()), float(y.mean())),
        half=(0.5 * there.shape[1] / rectifier.f_px, 0.5 * there.shape[0] / rectifier.f_px),
    )


def _tiles_about(points_C: FloatArray, window: Window, rectifier: Rectifier) -> Window | None:
    """Return the tiles within `window` that show `points_C`; None if they are few."""
    u = rectifier.f_px * points_C[:, 0] / points_C[:, 2] + rectifier.cx_px
    v = rectifier.f_px * points_C[:, 1] / points_C[:, 2] + rectifier.cy_px
    top, left = (
        max(math.floor(low / TILE_PX), math.ceil(first / TILE_PX)) * TILE_PX
        for low, first in ((v.min(), window.top), (u.min(), window.left))
    )
    bottom, right = (
        min(math.ceil(high / TILE_PX), math.floor(last / TILE_PX)) * TILE_PX
        for high, last in ((v.max(), window.bottom), (u.max(), window.right))
    )
    seen = bottom - top >= _LEAST_TILES * TILE_PX and right - left >= _LEAST_TILES * TILE_PX
    return Window(top, bottom, left, right) if seen else None


def _off_plane(off_px: Float32Array, known: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean and variance of each tile's disparities off the plane, 0 where unknown, and the share known."""
    size = TILE_PX // _EVERY
    share = np.maximum(_mean(known.astype(np.float32), size), _TINY)
    mean = _mean(off_px, size) / share
    return mean, _mean(off_px * off_px, size) / share - mean * mean, share


def _mean(image: FloatImage, size_px: int = TILE_PX) -> FloatArray:
    """Return the mean of each tile of `size_px`."""
    tiles = (image.shape[1] // size_px, image.shape[0] // size_px)
    of_tiles: FloatArray = cv2.resize(image, tiles, interpolation=cv2.INTER_AREA).astype(np.float64)
    return of_tiles


def _vertical(left_eye: GreyImage, right_eye: GreyImage) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return y of (1) of each tile and its variance; 1 less the correlation of the two eyes, and their detail's
    variance, grey levels squared."""
    left, right = _detail(left_eye), _detail(right_eye)
    both, difference = left + right, right - left
    by_x, by_y = (cv2.Sobel(both, cv2.CV_32F, *axis, ksize=3, scale=1.0 / 16.0) for axis in ((1, 0), (0, 1)))
    xx, xy, yy = _mean(by_x * by_x), _mean(by_x * by_y), _mean(by_y * by_y)
    xd, yd = _mean(by_x * difference), _mean(by_y * difference)
    det = xx * yy - xy * xy + _TINY
    x_px, y_px = (xy * yd - yy * xd) / det, (xy * xd - xx * yd) / det
    unexplained = np.maximum(_mean(difference * difference) + x_px * xd + y_px * yd, 0.0)
    detail: FloatArray = np.sqrt(_mean(left * left) * _mean(right * right) + _TINY)
    unlike = 1.0 - _mean(left * right) / detail
    return y_px, unexplained * xx / det * (_CORRELATED_PX / TILE_PX) ** 2, unlike, detail


def _detail(eye: GreyImage) -> FloatImage:
    """Return a little smoothed picture less its local mean, in which two eyes' gains differ."""
    smooth = cv2.GaussianBlur(eye.astype(np.float32), (5, 5), 1.0)
    about_mean: FloatImage = smooth - cv2.blur(smooth, _NEIGHBOURHOOD_PX)
    return about_mean


_LEAST_TILES = 3
"""Of a side."""
_NEIGHBOURHOOD_PX = (25, 25)
_CORRELATED_PX = 3.0
"""Over which the smoothed noise of neighbours is the same."""
_EVERY = 4
_LEAST_KNOWN = 0.8
"""Of a tile's disparities."""
_MOST_SPREAD_PX = 0.6
"""Of a tile's disparities about the plane: more, and there are two surfaces."""
_MOST_UNLIKE = 0.3
_LEAST_DETAIL = 1.5
"""Grey levels, deviation: in less the noise of a sensor, 0.3 to 0.5 once smoothed, makes sound eyes unlike."""
_TINY = 1e-6
"""Grey values to the fourth: an even tile has no shift, and a large variance."""

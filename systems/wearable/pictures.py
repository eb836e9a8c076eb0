"""From the pictures of a recording to a few robust numbers a frame: what the disparity map is against the ground's.

The project's own rectification and matching are used, as the daemon uses them. The lower part of the left picture is
cut into patches. Of each the median of disparity minus the ground's is kept, which is robust and, because disparity
runs through several pixels within a patch, free of the matcher's rounding; that is kept apart (`locking_px`).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from messages import FrameHeader, StereoCalibration, StereoFrame
from messages.arrays import Float32Array, FloatArray, GreyImage
from perception.depth.matcher import DisparityRange, SemiGlobalMatcher
from perception.depth.rectify import Rectifier, Window
from perception.depth.stereo_camera import StereoCamera
from systems.wearable.ground_path import GroundPath

ROWS, COLUMNS = 4, 6
PATCHES = ROWS * COLUMNS
_TOP, _BOTTOM, _LEFT, _RIGHT = 0.2, 0.96, 0.16, 0.98  # of the picture: what is left of it lacks a partner on the right
_STRIDE = 2
"""Of disparity's pixels, rows and columns, one is used: neighbours share most of the matching window."""
_MARGIN_PX = 5.0
"""By which disparity is searched beyond what the ground alone would show: room for every effect of the library."""
_LEAST_DISPARITY_PX = 2.0
"""Where the search begins at the earliest: ground in reach is never as far."""
_MOST_DISPARITIES = 128
"""In a search: a frame that needs more is left out, as its ground is told wrongly or right before the lens."""
_LEAST_SHARE = 0.4
"""Of a patch's pixels that are matched: of fewer, the median would be that of the easy ones."""
_CONTRAST_BOX_PX = 15
"""Width of the surroundings that contrast is counted from: about that of the matching window."""
_LEAST_POWER = 1e-3
"""Squared grey levels, added or as a divisor's least: far below a camera's noise, and an even picture stays finite."""
LAGS_PX = (1, 2, 3, 4, 6, 8, 12)
_LOCKING_PIXELS = 150
"""So few that the matcher's own change from surface to surface, 0.003 px, stays within this number's noise."""
_COUNT = 3 * PATCHES + 2 + len(LAGS_PX)


@dataclass(frozen=True)
class Layout:
    """Where the patches lie: `window` of the rectified picture, thinned pixels' `rays_C` (rows, columns, 3) and row
    times, and of each patch's centre the ray (p, 3) and the row time (p,). `row` and `right_row` (p,) are the raw rows
    of the centre in the left eye and of what it is matched with in the right one, from −½ to ½ of the picture.
    """

    window: Window
    rays_C: FloatArray
    row_time_s: FloatArray
    centre_C: FloatArray
    centre_time_s: FloatArray
    row: FloatArray
    right_row: FloatArray

    @staticmethod
    def of(camera: StereoCamera, stereo: StereoCalibration, mean_theta: FloatArray) -> "Layout":
        """Return the layout for one calibrated pair above ground that is seen, on average, with `mean_theta` (3,)."""
        rectifier = camera.rectifier
        height, width = rectifier.height_px, rectifier.width_px
        step_v, step_u = _STRIDE * ROWS, _STRIDE * COLUMNS
        rows = round((_BOTTOM - _TOP) * height) // step_v * step_v
        columns = round((_RIGHT - _LEFT) * width) // step_u * step_u
        top, left = round(_TOP * height), round(_LEFT * width)
        window = Window(top, top + rows, left, left + columns)
        some = (slice(window.top, window.bottom, _STRIDE), slice(window.left, window.right, _STRIDE))
        rays_C = rectifier.rays_C(window)[::_STRIDE, ::_STRIDE]
        row_time_s = rectifier.row_time_s[some].astype(np.float64)
        centre_C = _tiles(rays_C).mean(axis=1)
        u = rectifier.f_px * centre_C[:, 0] + rectifier.cx_px
        v = rectifier.f_px * centre_C[:, 1] + rectifier.cy_px
        partner = np.clip(u - centre_C @ mean_theta, 0, width - 1)
        raw_rows = (
            rectifier.divisor * (maps[1][np.rint(v).astype(int), np.rint(column).astype(int)] + 0.5) - 0.5
            for maps, column in ((rectifier.left_maps, u), (rectifier.right_maps, partner))
        )
        raw_height = stereo.left.height_px
        row, right_row = ((raw - (raw_height - 1) / 2) / raw_height for raw in raw_rows)
        return Layout(window, rays_C, row_time_s, centre_C, _tiles(row_time_s).mean(axis=1), row, right_row)


@dataclass(frozen=True)
class FrameNumbers:
    """What is kept of n frames: headers; per patch (n, p) the median misfit in px, the contrast as log2 of grey levels
    and how far the texture leans; per frame (n,) how much disparities crowd about whole pixels, in px, and log2 of how
    steep the picture is downwards against across, which a blur downwards lowers; and (n, lags) how much the picture
    differs from itself moved across by LAGS_PX, in squares of grey levels.
    """

    headers: tuple[FrameHeader, ...]
    misfit_px: FloatArray
    contrast: FloatArray
    lean: FloatArray
    locking_px: FloatArray
    sharpness: FloatArray
    difference: FloatArray


def measure(frames: Iterable[StereoFrame], rectifier: Rectifier, layout: Layout, path: GroundPath) -> FrameNumbers:
    """Return the numbers of all frames; NaN where a patch is hardly matched or the ground is not known."""
    matcher = SemiGlobalMatcher(rectifier)
    headers, rows = [], []
    for frame in frames:
        headers.append(frame.header)
        rows.append(_numbers(frame, matcher, rectifier, layout, path))
    table = np.array(rows).reshape(len(rows), _COUNT)
    misfit, contrast, lean = (table[:, k * PATCHES : (k + 1) * PATCHES] for k in range(3))
    locking, sharpness, difference = np.split(table[:, 3 * PATCHES :], (1, 2), axis=1)
    return FrameNumbers(tuple(headers), misfit, contrast, lean, locking[:, 0], sharpness[:, 0], difference)


def _numbers(
    frame: StereoFrame, matcher: SemiGlobalMatcher, rectifier: Rectifier, layout: Layout, path: GroundPath
) -> FloatArray:
    theta, rate = path.theta_at(frame.header.t_exposure_ns * 1e-9)
    nothing = np.full(_COUNT, np.nan)
    if not np.isfinite(theta).all():
        return nothing
    expected = layout.rays_C @ theta + layout.row_time_s * (layout.rays_C @ rate)
    low, high = max(_LEAST_DISPARITY_PX, expected.min() - _MARGIN_PX), expected.max() + _MARGIN_PX
    search = DisparityRange.covering(low, high)
    if search.count > _MOST_DISPARITIES:
        return nothing
    disparity = matcher.match(frame.left, frame.right, layout.window, search)
    misfit = _tiles(disparity[::_STRIDE, ::_STRIDE] - expected)
    seen = np.isfinite(misfit).mean(axis=1) >= _LEAST_SHARE
    if not seen.any():
        return nothing
    median = np.full(PATCHES, np.nan)
    median[seen] = np.nanmedian(misfit[seen], axis=1)
    left, _ = rectifier.rectify(frame.left, frame.right, layout.window, 0)
    whole = (_crowding(disparity, frame.header.seq), _sharpness(left))
    return np.concatenate((median, _contrast(left), _lean(left), whole, _difference(left)))


def _crowding(disparity_px: Float32Array, seq: int) -> float:
    """Return the mean of cos 2πd over `_LOCKING_PIXELS` pixels drawn by the frame's number, over π.

    Disparities d − a sin 2πd of evenly spread d have the mean J₁(2πa), which is πa for small a.
    """
    seen = disparity_px[np.isfinite(disparity_px)]
    if len(seen) < _LOCKING_PIXELS:
        return float("nan")
    some = np.random.default_rng(seq).choice(seen, _LOCKING_PIXELS)  # even steps could meet even phases
    return float(np.mean(np.cos(2.0 * np.pi * some))) / np.pi


def _contrast(left: GreyImage) -> FloatArray:
    """Return (p,) log2 of the deviation, in grey levels, from the surroundings of `_CONTRAST_BOX_PX`."""
    grey = left.astype(np.float32)
    detail = grey - cv2.blur(grey, (_CONTRAST_BOX_PX, _CONTRAST_BOX_PX))
    power = _tiles(detail[::_STRIDE, ::_STRIDE] ** 2).mean(axis=1, dtype=np.float64)
    contrast: FloatArray = 0.5 * np.log2(np.maximum(power, _LEAST_POWER))
    return contrast


def _lean(left: GreyImage) -> FloatArray:
    """Return (p,) how far the texture leans across per pixel down: −Σ g_x g_y / Σ g_x², g the slope of the grey.

    Where the partner stands a pixel too low, the row above is matched in its place; what fits best there, in the sense
    of least squares, lies so much to the side.
    """
    grey = left.astype(np.float32)
    across, down = (cv2.Sobel(grey, cv2.CV_32F, dx, dy) for dx, dy in ((1, 0), (0, 1)))
    square, mixed = (
        _tiles(product[::_STRIDE, ::_STRIDE]).mean(axis=1, dtype=np.float64)
        for product in (across * across, across * down)
    )
    lean: FloatArray = -mixed / np.maximum(square, _LEAST_POWER)
    return lean


def _sharpness(left: GreyImage) -> float:
    grey = left.astype(np.float32)
    down, across = grey[1:] - grey[:-1], grey[:, 1:] - grey[:, :-1]
    return 0.5 * float(np.log2((np.mean(down**2) + _LEAST_POWER) / (np.mean(across**2) + _LEAST_POWER)))


def _difference(left: GreyImage) -> FloatArray:
    """Return (lags,) the mean square of the picture minus itself, moved across by LAGS_PX."""
    grey = left.astype(np.float32)
    return np.array([np.mean((grey[:, lag:] - grey[:, :-lag]) ** 2, dtype=np.float64) for lag in LAGS_PX])


def _tiles(image: NDArray[Any]) -> NDArray[Any]:
    """Return (p, pixels, …): the patches of an image (rows, columns, …), row by row."""
    rows, columns = image.shape[0] // ROWS, image.shape[1] // COLUMNS
    tiles = image.reshape(ROWS, rows, COLUMNS, columns, *image.shape[2:]).swapaxes(1, 2)
    patches: NDArray[Any] = tiles.reshape(PATCHES, rows * columns, *image.shape[2:])
    return patches

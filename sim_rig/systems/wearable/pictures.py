"""From the pictures of a recording to a few robust numbers a frame: what the disparity map is against the ground's.

The project's own rectification and matching are used, as the daemon uses them. The lower part of the left picture is
cut into patches. Of each the median of disparity minus the ground's is kept, which is robust and, because disparity
runs through several pixels within a patch, free of the matcher's rounding; that is kept apart (`locking_px`).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from messages import FrameHeader, GreyImage, StereoCalibration, StereoFrame
from perception.rectify import Rectifier, Window
from perception.stereo import DisparityRange, SemiGlobalMatcher
from perception.stereo_camera import StereoCamera
from sim_rig.systems.wearable.ground_path import GroundPath

FloatArray = NDArray[np.float64]

ROWS, COLUMNS = 4, 6
PATCHES = ROWS * COLUMNS
_TOP, _BOTTOM, _LEFT, _RIGHT = 0.2, 0.96, 0.16, 0.98  # of the picture: what is left of it lacks a partner on the right
_STRIDE = 2
_MARGIN_PX = 5.0
_LEAST_DISPARITY_PX = 2.0
_MOST_DISPARITIES = 128
_LEAST_SHARE = 0.4
_NEAR_PX = 0.5
_CONTRAST_BOX_PX = 15
_LOCKING_PIXELS = 96
"""So few that the matcher's own change from surface to surface, 0.004 px, stays within this number's noise."""


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
    """What is kept of n frames: headers; per patch (n, p) the median misfit in px and the contrast as log2 of grey
    levels; per frame (n,) how strongly the misfit follows the fraction of disparity, its robust deviation in px, and
    log2 of how steep the picture is downwards against across, which a blur downwards lowers.
    """

    headers: tuple[FrameHeader, ...]
    misfit_px: FloatArray
    contrast: FloatArray
    locking_px: FloatArray
    spread_px: FloatArray
    sharpness: FloatArray


def measure(frames: Iterable[StereoFrame], rectifier: Rectifier, layout: Layout, path: GroundPath) -> FrameNumbers:
    """Return the numbers of all frames; NaN where a patch is hardly matched or the ground is not known."""
    matcher = SemiGlobalMatcher(rectifier)
    headers, rows = [], []
    for frame in frames:
        headers.append(frame.header)
        rows.append(_numbers(frame, matcher, rectifier, layout, path))
    table = np.array(rows).reshape(len(rows), 2 * PATCHES + 3)
    misfit, contrast = table[:, :PATCHES], table[:, PATCHES : 2 * PATCHES]
    return FrameNumbers(tuple(headers), misfit, contrast, *table[:, 2 * PATCHES :].T)


def _numbers(
    frame: StereoFrame, matcher: SemiGlobalMatcher, rectifier: Rectifier, layout: Layout, path: GroundPath
) -> FloatArray:
    theta, rate = path.theta_at(frame.header.t_exposure_ns * 1e-9)
    nothing = np.full(2 * PATCHES + 3, np.nan)
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
    about = misfit - median[:, None]
    phase = 2.0 * np.pi * (_tiles(expected) + median[:, None])
    left, _ = rectifier.rectify(frame.left, frame.right, layout.window, 0)
    spread = 1.4826 * float(np.nanmedian(np.abs(about)))
    return np.concatenate(
        (median, _contrast(left), (_locking(about, phase, frame.header.seq), spread, _sharpness(left)))
    )


def _locking(about_px: FloatArray, phase: FloatArray, seq: int) -> float:
    """Return twice the mean of misfit · sin(phase) over `_LOCKING_PIXELS` pixels, others in each frame."""
    near = np.flatnonzero(np.abs(about_px.ravel()) < _NEAR_PX)
    if len(near) < _LOCKING_PIXELS:
        return float("nan")
    some = near[np.linspace(seq * 37 % 101, len(near) - 1, _LOCKING_PIXELS).astype(int)]
    return 2.0 * float(np.mean(np.sin(phase.ravel()[some]) * about_px.ravel()[some]))


def _contrast(left: GreyImage) -> FloatArray:
    """Return (p,) log2 of the deviation, in grey levels, from the surroundings of `_CONTRAST_BOX_PX`."""
    grey = left.astype(np.float32)
    detail = grey - cv2.blur(grey, (_CONTRAST_BOX_PX, _CONTRAST_BOX_PX))
    power = _tiles((detail[::_STRIDE, ::_STRIDE] ** 2).astype(np.float64)).mean(axis=1)
    contrast: FloatArray = 0.5 * np.log2(np.maximum(power, 1e-3))
    return contrast


def _sharpness(left: GreyImage) -> float:
    grey = left.astype(np.float32)
    down, across = grey[1:] - grey[:-1], grey[:, 1:] - grey[:, :-1]
    return 0.5 * float(np.log2((np.mean(down**2) + 1e-3) / (np.mean(across**2) + 1e-3)))


def _tiles(image: FloatArray) -> FloatArray:
    """Return (p, pixels, …): the patches of an image (rows, columns, …), row by row."""
    rows, columns = image.shape[0] // ROWS, image.shape[1] // COLUMNS
    tiles = image.reshape(ROWS, rows, COLUMNS, columns, *image.shape[2:]).swapaxes(1, 2)
    patches: FloatArray = tiles.reshape(PATCHES, rows * columns, *image.shape[2:])
    return patches

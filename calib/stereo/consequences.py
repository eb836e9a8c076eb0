"""What a stereo calibration's uncertainty means for its users: rows and distances; and what the views cover."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from calib.stereo.bundle import LENS_TERMS, Bundle, SeenPair
from messages import StereoCalibration
from messages.arrays import BoolArray, FloatArray
from perception import so3
from perception.depth.rectify import Rectifier, intrinsics

REGIONS = 3
"""Either way over the picture."""
_LEAST_CORNERS = 8
"""Of a region, that tell its lens."""
_COLUMNS, _ROWS, _MARGIN = 8, 5, 0.06
"""The grid of pixels on which errors are foretold, and how far from the border it begins."""
_NEAR_M, _FAR_M = 1.0, 1e4
"""The ground, and what has no disparity."""
_STEPS = np.array([*(1e-2,) * 4, *(1e-5,) * 5] * 2 + [1e-6] * 3 + [1e-6] * 3)
"""Of numerical differences: px, lens terms, rad, m."""


@dataclass(frozen=True)
class Consequences:
    """One standard deviation each, unless said otherwise.

    `rows_px` over the picture, root mean square; `depth_scale` relative, of points 1 m away, over the picture, the
    board's own error included; `toe_in_rad` between the optical axes, in the picture's middle; `baseline` relative.
    Of the views: mean and largest difference of rectified rows; each region's root mean square residual, px
    (2, 3, 3) for left and right eye, NaN where it has fewer than eight corners, which `covered` tells.
    """

    rows_px: float
    rows_rad: float
    depth_scale: float
    toe_in_rad: float
    baseline: float
    board_error: float
    row_error_mean_px: float
    row_error_rms_px: float
    row_error_most_px: float
    covered: BoolArray


def consequences(
    stereo: StereoCalibration, bundle: Bundle, covariance: FloatArray, views: Sequence[SeenPair], board_error: float
) -> Consequences:
    """Return what `covariance`, of the lenses, the pair and the board's shape, means for users of `stereo`."""
    rectifier = Rectifier(stereo, 1)
    f_px = rectifier.f_px
    cov = covariance[: 2 * LENS_TERMS + 6, : 2 * LENS_TERMS + 6]
    d_near, rows_near = _derivatives(stereo, bundle, rectifier, _NEAR_M)
    d_far, _ = _derivatives(stereo, bundle, rectifier, _FAR_M)
    middle = len(d_far) // 2
    near_px = f_px * rectifier.baseline_m / _NEAR_M
    depth = _rms_std(d_near, cov) / near_px
    rows_px = _rms_std(rows_near, cov)
    T = bundle.pair[3:]
    along = T / np.linalg.norm(T)
    baseline = float(np.sqrt(along @ cov[-3:, -3:] @ along)) / rectifier.baseline_m
    rows = row_differences(stereo, views, rectifier)
    return Consequences(
        rows_px=rows_px,
        rows_rad=rows_px / f_px,
        depth_scale=float(np.hypot(depth, board_error)),
        toe_in_rad=float(np.sqrt(d_far[middle] @ cov @ d_far[middle])) / f_px,
        baseline=float(np.hypot(baseline, board_error)),
        board_error=board_error,
        row_error_mean_px=float(np.abs(rows).mean()),
        row_error_rms_px=float(np.sqrt((rows**2).mean())),
        row_error_most_px=float(np.abs(rows).max()),
        covered=np.array([counts(stereo, views, eye) >= _LEAST_CORNERS for eye in (0, 1)]),
    )


def row_differences(stereo: StereoCalibration, views: Sequence[SeenPair], rectifier: Rectifier) -> FloatArray:
    """Return by how much lower (n,), px, the right eye sees each corner after rectification."""
    left = np.concatenate([view.left_px for view in views])
    right = np.concatenate([view.right_px for view in views])
    return _rectified(stereo, rectifier, 1, right)[:, 1] - _rectified(stereo, rectifier, 0, left)[:, 1]


def counts(stereo: StereoCalibration, views: Sequence[SeenPair], eye: int) -> FloatArray:
    """Return how many corners (3, 3) lie in each region of one eye's picture."""
    px = np.concatenate([view[2 + eye] for view in views])
    size = ((0, stereo.left.height_px), (0, stereo.left.width_px))
    found: FloatArray = np.histogram2d(px[:, 1], px[:, 0], bins=REGIONS, range=size)[0]
    return found


def by_region(stereo: StereoCalibration, views: Sequence[SeenPair], residuals_px: Sequence[FloatArray]) -> FloatArray:
    """Return (2, 3, 3): each eye's root mean square residual by region of its picture, NaN where corners are few."""
    every = np.concatenate(residuals_px)
    found = np.full((2, REGIONS, REGIONS), np.nan)
    size = np.array((stereo.left.width_px, stereo.left.height_px))
    for eye in (0, 1):
        px = np.concatenate([view[2 + eye] for view in views])
        column, row = np.clip((REGIONS * px / size).astype(int), 0, REGIONS - 1).T
        squares = (every[:, 2 * eye : 2 * eye + 2] ** 2).sum(axis=1)
        for place in np.ndindex(REGIONS, REGIONS):
            here = (row == place[0]) & (column == place[1])
            if here.sum() >= _LEAST_CORNERS:
                found[eye, place[0], place[1]] = np.sqrt(squares[here].mean())
    return found


def _derivatives(
    stereo: StereoCalibration, bundle: Bundle, rectifier: Rectifier, depth_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return how disparity and row difference (n, p), rectified px, of points at a depth change with the parameters."""
    u, v = np.meshgrid(
        np.linspace(_MARGIN, 1.0 - _MARGIN, _COLUMNS) * (rectifier.width_px - 1),
        np.linspace(_MARGIN, 1.0 - _MARGIN, _ROWS) * (rectifier.height_px - 1),
    )
    rays = np.stack(
        ((u - rectifier.cx_px) / rectifier.f_px, (v - rectifier.cy_px) / rectifier.f_px, np.ones_like(u)), -1
    )
    points_L = depth_m * rays.reshape(-1, 3) @ rectifier.R_LC.T
    base = np.concatenate((bundle.left, bundle.right, bundle.pair))
    shifts = np.empty((2, len(points_L), len(base)))
    for k, step in enumerate(_STEPS):
        seen = [_seen(stereo, rectifier, points_L, base + sign * step * np.eye(len(base))[k]) for sign in (1.0, -1.0)]
        shifts[:, :, k] = (seen[0] - seen[1]) / (2.0 * step)
    return shifts[0], shifts[1]


def _seen(stereo: StereoCalibration, rectifier: Rectifier, points_L: FloatArray, vector: FloatArray) -> FloatArray:
    """Return disparity and row difference (2, n) that `stereo` makes of points seen by a pair with other parameters."""
    lenses = vector[:LENS_TERMS], vector[LENS_TERMS : 2 * LENS_TERMS]
    R_RL, p_m = so3.exp(vector[-6:-3]), vector[-3:]
    in_eye = points_L, points_L @ R_RL.T + p_m
    left, right = (_rectified(stereo, rectifier, eye, _projected(in_eye[eye], lenses[eye])) for eye in (0, 1))
    return np.stack((left[:, 0] - right[:, 0], right[:, 1] - left[:, 1]))


def _projected(points: FloatArray, lens: FloatArray) -> FloatArray:
    K = np.array(((lens[0], 0.0, lens[2]), (0.0, lens[1], lens[3]), (0.0, 0.0, 1.0)))
    px = cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, lens[4:])[0][:, 0]
    return np.asarray(px, dtype=np.float64)


def _rectified(stereo: StereoCalibration, rectifier: Rectifier, eye: int, px: FloatArray) -> FloatArray:
    """Return where (n, 2) raw pixels of one eye, 0 the left, are after rectification, px."""
    lens = (stereo.left, stereo.right)[eye]
    R_CE = rectifier.R_LC.T if eye == 0 else rectifier.R_LC.T @ np.array(stereo.X_RL.R).T
    rays = cv2.undistortPoints(px[:, None].astype(np.float64), intrinsics(lens), np.array(lens.distortion), R=R_CE)[
        :, 0
    ].astype(np.float64)
    rectified: FloatArray = rays * rectifier.f_px + (rectifier.cx_px, rectifier.cy_px)
    return rectified


def _rms_std(derivatives: FloatArray, covariance: FloatArray) -> float:
    return float(np.sqrt(np.einsum("np,pq,nq->n", derivatives, covariance, derivatives).mean()))

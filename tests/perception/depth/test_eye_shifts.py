"""Shifts planted in one eye of an exact pair are found again, tile by tile; a sound pair has none."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from messages import Lens, Pose, StereoCalibration, matrix3
from messages.arrays import FloatArray, GreyImage
from perception.depth.eye_shifts import TILE_PX, EyeShifts, find_shifts
from perception.depth.rectify import Rectifier, Window

F_PX, BASELINE_M, WIDTH_PX, HEIGHT_PX = 350.0, 0.12, 640, 360
ROW_TIME_S = 22e-6
THETA_C = np.array([3.0, 25.0, 35.0])
"""Ground that rises away from the camera's right, 1.2 m away."""
POINTS_C = np.array([[x, y, 1.0] for x in (-0.3, 0.3) for y in (-0.1, 0.25)])
WHOLE = Window(0, HEIGHT_PX, 0, WIDTH_PX)
STILL = np.zeros(3)


def rectifier(right_lower_px: float = 0.0) -> Rectifier:
    """Return that of a pair without distortion whose right lens sees all `right_lower_px` lower."""
    left, right = (
        Lens(
            width_px=WIDTH_PX, height_px=HEIGHT_PX, fx_px=F_PX, fy_px=F_PX, cx_px=319.5, cy_px=179.5 + lower_px,
            distortion=(0.0,) * 5,
        )
        for lower_px in (0.0, right_lower_px)
    )  # fmt: skip
    pose = Pose(R=matrix3(np.eye(3)), p_m=(-BASELINE_M, 0.0, 0.0))
    return Rectifier(StereoCalibration(left=left, right=right, X_RL=pose, row_time_s=ROW_TIME_S), 1)


def texture(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return smooth noise at (u, v)."""
    grain = cv2.GaussianBlur(np.random.default_rng(3).normal(0.0, 1.0, (600, 900)), (0, 0), 1.6).astype(np.float32)
    contrast = (40.0 / grain.std() * grain).astype(np.float32)
    at = cv2.remap(contrast, (u + 100).astype(np.float32), (v + 100).astype(np.float32), cv2.INTER_CUBIC)
    shown: FloatArray = 120.0 + at.astype(np.float64)
    return shown


def slanted_joints(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return thin bright lines that lean, as joints between bricks that lead away to one side, and little else."""
    across = np.mod(u + 0.35 * v, 26.0) - 13.0
    shown: FloatArray = 90.0 + 80.0 * np.exp(-((across / 2.0) ** 2)) + 0.15 * (texture(u, v) - 120.0)
    return shown


def faint(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return less detail than the sensor's noise."""
    shown: FloatArray = 120.0 + 0.01 * (texture(u, v) - 120.0)
    return shown


def disparity(off_plane_px: FloatArray | float = 0.0) -> FloatArray:
    v, u = np.mgrid[:HEIGHT_PX, :WIDTH_PX]
    shown: FloatArray = (u - 319.5) / F_PX * THETA_C[0] + (v - 179.5) / F_PX * THETA_C[1] + THETA_C[2] + off_plane_px
    return shown


def pair(
    down_px: FloatArray | float = 0.0,
    gain: float = 1.0,
    ground: Callable[[FloatArray, FloatArray], FloatArray] = texture,
) -> tuple[GreyImage, GreyImage]:
    """Return both eyes, before a `ground`; in the right one all is `down_px` lower, and `gain` times as bright."""
    v, u = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float64)
    noise = np.random.default_rng(4).normal(0.0, 1.0, (2, HEIGHT_PX, WIDTH_PX))
    # at (u − d, v) the right eye shows what the left one does at (u, v); d grows with u by less than 1 %
    left_u = u
    for _ in range(4):
        left_u = u + THETA_C[2] + (left_u - 319.5) / F_PX * THETA_C[0] + (v - 179.5) / F_PX * THETA_C[1]
    eyes = ground(u, v) + noise[0], gain * ground(left_u, v - down_px) + noise[1]
    left, right = (np.clip(np.rint(eye), 0, 255).astype(np.uint8) for eye in eyes)
    return left, right


def found(images: tuple[GreyImage, GreyImage], disparity_px: FloatArray | None = None) -> EyeShifts:
    shown = disparity() if disparity_px is None else disparity_px
    shifts = find_shifts(rectifier(), images, WHOLE, shown, POINTS_C, THETA_C, STILL, STILL)
    assert shifts is not None
    return shifts


@pytest.mark.parametrize("gain", [1.0, 0.8])
def test_a_sound_pair_is_not_shifted_whatever_the_gain_of_its_eyes(gain: float) -> None:
    shifts = found(pair(gain=gain))
    assert shifts.whole.mean() > 0.95
    assert np.abs(shifts.y_px[shifts.whole]).max() < 0.12
    assert np.abs(shifts.y_px[shifts.whole].mean()) < 0.01


def test_lines_that_lean_are_not_shifted_at_the_sides_of_the_window_either() -> None:
    shifts = found(pair(ground=slanted_joints))
    ratio = np.abs(shifts.y_px / np.hypot(0.02, np.sqrt(shifts.y_var_px2)))
    assert shifts.whole[:, [0, -1]].all()
    assert ratio[:, [0, -1]].max() < 4.0


@pytest.mark.parametrize(("down_px", "least", "most"), [(0.0, 0.99, 1.0), (10.0, 0.0, 0.1)])
def test_eyes_are_alike_where_what_matched_is_the_same(down_px: float, least: float, most: float) -> None:
    assert least <= found(pair(down_px)).alike_share <= most


def test_noise_tells_nothing_of_how_alike_eyes_are() -> None:
    assert np.isnan(found(pair(ground=faint)).alike_share)


@pytest.mark.parametrize("down_px", [0.15, -0.4, 0.8])
def test_what_one_eye_sees_lower_is_found_tile_by_tile(down_px: float) -> None:
    v, u = np.mgrid[:HEIGHT_PX, :WIDTH_PX]
    drop = down_px * np.exp(-(((u - 300) / 60.0) ** 2) - ((v - 200) / 60.0) ** 2)
    shifts = found(pair(drop))
    rows = TILE_PX * (np.arange(shifts.y_px.shape[0]) + shifts.row) + TILE_PX // 2
    columns = TILE_PX * (np.arange(shifts.y_px.shape[1]) + shifts.column) + TILE_PX // 2
    planted = drop[np.ix_(rows, np.clip(columns - 35, 0, WIDTH_PX - 1))]  # the drop is where the right eye's picture is
    assert np.abs(shifts.y_px - planted)[shifts.whole].max() < 0.12 + 0.15 * abs(down_px)
    assert np.corrcoef(shifts.y_px[shifts.whole], planted[shifts.whole])[0, 1] > 0.8


def test_its_stated_deviation_is_that_of_the_noise() -> None:
    shifts = found(pair())
    ratio = shifts.y_px[shifts.whole] / np.sqrt(shifts.y_var_px2[shifts.whole])
    assert 0.4 < ratio.std() < 1.6


def test_disparity_off_the_plane_is_told_along_the_rows_and_two_surfaces_are_no_whole_tile() -> None:
    off = np.zeros((HEIGHT_PX, WIDTH_PX))
    off[:, 300:] = 0.3
    off[:150] = 4.0
    off[150:180, :200] = np.nan
    shifts = found(pair(), disparity(off))
    lower = TILE_PX * (np.arange(shifts.x_px.shape[0]) + shifts.row) >= 180
    assert np.allclose(shifts.x_px[lower][:, -2:], 0.3, atol=1e-3)
    upper = TILE_PX * (np.arange(shifts.x_px.shape[0]) + shifts.row) == 140
    assert not shifts.whole[upper].any()


def test_what_a_rolling_shutter_moves_between_the_eyes_rows_is_no_shift() -> None:
    turning, of_pair = np.array([1.5, 0.0, 1.5]), rectifier(right_lower_px=40.0)
    left, right = pair()
    right = np.roll(right, 40, axis=0)
    still, moved = (
        find_shifts(of_pair, (left, right), WHOLE, disparity(), POINTS_C, THETA_C, w_C, STILL)
        for w_C in (STILL, turning)
    )
    assert still is not None
    assert moved is not None
    rows, columns = (
        TILE_PX * (np.arange(n) + first + 0.5)
        for n, first in zip(still.y_px.shape, (still.row, still.column), strict=True)
    )
    x, y = (columns - 0.5 - of_pair.cx_px) / of_pair.f_px, (rows[:, None] - 0.5 - of_pair.cy_px) / of_pair.f_px
    moved_px = of_pair.f_px * 40 * ROW_TIME_S * 1.5 * (1.0 + y * y - x)
    assert np.allclose(still.y_px - moved.y_px, moved_px, rtol=0.03)


def test_a_foothold_out_of_view_has_no_shifts() -> None:
    beyond = POINTS_C + np.array([2.0, 0.0, 0.0])
    assert find_shifts(rectifier(), pair(), WHOLE, disparity(), beyond, THETA_C, STILL, STILL) is None

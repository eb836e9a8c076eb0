"""Corners of slanted ground in both eyes, and of ground that comes nearer: as exact as if one stood before a wall."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from messages.arrays import Float32Array, FloatArray, GreyImage
from perception.motion.corners import corners, detail, followed
from perception.motion.sheared import Shear

SHIFT_PX, SHEAR = 20.0, 0.15
"""x_right = x - SHIFT_PX + SHEAR (y - 90), as of ground from above at a baseline of 12 cm."""


def slope(rows: FloatArray) -> FloatArray:
    """Return by how much less than `SHIFT_PX` reduced pixels of `rows` are apart, on one slope."""
    return SHEAR * (rows - 90.0)


def treads(rows: FloatArray) -> FloatArray:
    """Return the same of treads 30 rows long, as steep, that climb a third as much."""
    middle = 30.0 * np.floor(rows / 30.0) + 15.0
    return SHEAR * (rows - middle + (middle - 90.0) / 3.0)


def both_eyes(seed: int, ground: Callable[[FloatArray], FloatArray] = slope) -> tuple[GreyImage, GreyImage]:
    noise = np.random.default_rng(seed).standard_normal((720, 1480)).astype(np.float32)
    surface = cv2.GaussianBlur(noise, (0, 0), 5.0)
    grey = np.clip(120.0 + 25.0 * surface / surface.std(), 0, 255).astype(np.float32)
    columns, rows = np.meshgrid(np.arange(1280, dtype=np.float32), np.arange(720, dtype=np.float32))
    there = columns + 4.0 * (SHIFT_PX - ground(rows.astype(np.float64) / 4.0)).astype(np.float32)
    right = cv2.remap(grey, there + 100.0, rows, cv2.INTER_CUBIC)
    left = grey[:, 100:1380]
    one, other = (detail(np.clip(np.rint(eye), 0, 255).astype(np.uint8), 4) for eye in (left, right))
    return one, other


def expected(points_px: Float32Array, ground: Callable[[FloatArray], FloatArray] = slope) -> FloatArray:
    x, y = np.asarray(points_px, np.float64).T
    return np.column_stack((x - SHIFT_PX + ground(y + 0.375), y))  # a reduced pixel is the mean of four


@pytest.mark.parametrize("guessed_shear", [SHEAR, 0.5 * SHEAR])
def test_a_slant_does_not_scatter_the_matches(guessed_shear: float) -> None:
    left, right = both_eyes(7)
    corners_px = corners(left)
    truth_px = expected(corners_px)
    about_px = truth_px.copy()
    about_px[:, 0] += (guessed_shear - SHEAR) * (corners_px[:, 1] - 90.0)
    seen = (truth_px > 12.0).all(axis=1) & (truth_px[:, 0] < 305.0)
    plain_px, plain_good = followed(left, right, corners_px, about_px.astype(np.float32), levels=0)
    found_px, good = Shear(corners_px, about_px.astype(np.float32)).matched(left, right)
    plain, slanted = (
        np.median(np.abs(px[ok & seen, 0] - truth_px[ok & seen, 0]))
        for px, ok in ((plain_px, plain_good), (found_px, good))
    )
    assert (good & seen).sum() > 60
    assert slanted < (0.5 if guessed_shear == SHEAR else 0.8) * plain
    assert np.abs(np.median(found_px[good & seen] - truth_px[good & seen], axis=0)).max() < 0.03


def test_treads_are_followed_as_the_slope_that_each_has() -> None:
    left, right = both_eyes(10, treads)
    corners_px = corners(left)
    truth_px = expected(corners_px, treads)
    inside = np.abs((corners_px[:, 1] + 0.375) % 30.0 - 15.0) < 8.0
    seen = (truth_px > 12.0).all(axis=1) & (truth_px[:, 0] < 305.0) & inside
    found_px, good = Shear(corners_px, truth_px.astype(np.float32)).matched(left, right)
    assert (good & seen).sum() > 40
    assert np.median(np.abs(found_px[good & seen, 0] - truth_px[good & seen, 0])) < 0.04


def test_matches_of_another_surface_do_not_bend_the_slant() -> None:
    left, right = both_eyes(8)
    corners_px = corners(left)
    truth_px = expected(corners_px)
    about_px = truth_px.astype(np.float32)
    wrong = np.arange(len(about_px)) % 4 == 0
    about_px[wrong, 0] -= 15.0
    seen = (truth_px > 12.0).all(axis=1) & (truth_px[:, 0] < 305.0) & ~wrong
    found_px, good = Shear(corners_px, about_px).matched(left, right)
    assert np.median(np.abs(found_px[good & seen] - truth_px[good & seen])) < 0.05


@pytest.mark.parametrize("count", [1, 2])
def test_few_corners_tell_a_shift(count: int) -> None:
    left, right = both_eyes(9)
    corners_px = corners(left)
    near = np.argsort(np.hypot(*(corners_px - np.array((160.0, 90.0))).T))[:count]
    truth_px = expected(corners_px[near])
    found_px, good = Shear(corners_px[near], truth_px.astype(np.float32)).matched(left, right)
    assert good.all()
    assert np.abs(found_px - truth_px).max() < 0.5


GROWTH = 1.046
"""Of a picture from one frame to the next, at 1.2 m/s and 1.3 m above the ground."""


def where_grounds_meet(growth: float) -> GreyImage:
    """Return a picture, grown about its lower edge, of rough dark ground above its middle row and bright one below."""
    noise = np.random.default_rng(3).standard_normal((720, 1280)).astype(np.float32)
    surface = cv2.GaussianBlur(noise, (0, 0), 10.0)
    columns, rows = np.meshgrid(np.arange(1280, dtype=np.float32), np.arange(720, dtype=np.float32))
    mean, contrast = np.where(rows < 360.0, 80.0, 150.0), np.where(rows < 360.0, 12.0, 6.0)
    grey = (mean + contrast * surface / surface.std()).astype(np.float32)
    there = [(at - middle) / growth + middle for at, middle in ((columns, 639.5), (rows, 719.5))]
    grown = cv2.remap(grey, there[0], there[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return detail(np.clip(np.rint(grown), 0, 255).astype(np.uint8), 4)


def test_a_line_where_grounds_meet_draws_what_is_beside_it_along_no_more_than_half() -> None:
    before, after = where_grounds_meet(1.0), where_grounds_meet(GROWTH)
    corners_px = corners(before)
    middle_px = np.array((159.5, 179.5))
    truth_px = (corners_px - middle_px) * GROWTH + middle_px
    about_px = (truth_px + 0.3).astype(np.float32)
    beside = np.abs(corners_px[:, 1] - 90.0) < 10.0
    plain_px, plain_good = followed(before, after, corners_px, about_px)
    found_px, good = Shear(corners_px, about_px).tracked(before, after, 0)
    plain, sheared = (
        float(np.median(np.abs(px[ok & beside, 1] - truth_px[ok & beside, 1])))
        for px, ok in ((plain_px, plain_good), (found_px, good))
    )
    assert (good & beside).sum() > 15
    assert sheared < 0.5 * plain


def test_a_camera_at_rest_stays_where_it_is() -> None:
    still = where_grounds_meet(1.0)
    corners_px = corners(still)
    about_px = corners_px + np.array((0.2, -0.3), np.float32)
    found_px, good = Shear(corners_px, about_px).tracked(still, still, 0)
    assert good.mean() > 0.9
    assert np.abs(np.median(found_px[good] - corners_px[good], axis=0)).max() < 0.005

"""Corners of slanted ground in both eyes: as exact as those of ground that faces them."""

import cv2
import numpy as np
import pytest

from messages.arrays import Float32Array, FloatArray, GreyImage
from perception.motion.corners import corners, detail, followed
from perception.motion.slanted import Slant

SHIFT_PX, SHEAR = 20.0, 0.15
"""x_right = x - SHIFT_PX + SHEAR (y - 90), as of ground from above at a baseline of 12 cm."""


def both_eyes(seed: int) -> tuple[GreyImage, GreyImage]:
    noise = np.random.default_rng(seed).standard_normal((720, 1480)).astype(np.float32)
    surface = cv2.GaussianBlur(noise, (0, 0), 5.0)
    grey = np.clip(120.0 + 25.0 * surface / surface.std(), 0, 255).astype(np.float32)
    columns, rows = np.meshgrid(np.arange(1280, dtype=np.float32), np.arange(720, dtype=np.float32))
    there = columns + 4.0 * SHIFT_PX - SHEAR * (rows - 4.0 * 90.0)
    right = cv2.remap(grey, there + 100.0, rows, cv2.INTER_CUBIC)
    left = grey[:, 100:1380]
    one, other = (detail(np.clip(np.rint(eye), 0, 255).astype(np.uint8), 4) for eye in (left, right))
    return one, other


def expected(points_px: Float32Array) -> FloatArray:
    x, y = np.asarray(points_px, np.float64).T
    return np.column_stack((x - SHIFT_PX + SHEAR * (y + 0.375 - 90.0), y))  # a reduced pixel is the mean of four


@pytest.mark.parametrize("guessed_shear", [SHEAR, 0.5 * SHEAR])
def test_a_slant_does_not_scatter_the_matches(guessed_shear: float) -> None:
    left, right = both_eyes(7)
    corners_px = corners(left)
    truth_px = expected(corners_px)
    about_px = truth_px.copy()
    about_px[:, 0] += (guessed_shear - SHEAR) * (corners_px[:, 1] - 90.0)
    seen = (truth_px > 12.0).all(axis=1) & (truth_px[:, 0] < 305.0)
    plain_px, plain_good = followed(left, right, corners_px, about_px.astype(np.float32), levels=0)
    found_px, good = Slant(corners_px, about_px.astype(np.float32)).matched(left, right)
    plain, slanted = (
        np.median(np.abs(px[ok & seen, 0] - truth_px[ok & seen, 0]))
        for px, ok in ((plain_px, plain_good), (found_px, good))
    )
    assert (good & seen).sum() > 60
    assert slanted < (0.5 if guessed_shear == SHEAR else 0.8) * plain
    assert np.abs(np.median(found_px[good & seen] - truth_px[good & seen], axis=0)).max() < 0.03


def test_matches_of_another_surface_do_not_bend_the_slant() -> None:
    left, right = both_eyes(8)
    corners_px = corners(left)
    truth_px = expected(corners_px)
    about_px = truth_px.astype(np.float32)
    wrong = np.arange(len(about_px)) % 4 == 0
    about_px[wrong, 0] -= 15.0
    seen = (truth_px > 12.0).all(axis=1) & (truth_px[:, 0] < 305.0) & ~wrong
    found_px, good = Slant(corners_px, about_px).matched(left, right)
    assert np.median(np.abs(found_px[good & seen] - truth_px[good & seen])) < 0.05


@pytest.mark.parametrize("count", [1, 2])
def test_few_corners_tell_a_shift(count: int) -> None:
    left, right = both_eyes(9)
    corners_px = corners(left)
    near = np.argsort(np.hypot(*(corners_px - np.array((160.0, 90.0))).T))[:count]
    truth_px = expected(corners_px[near])
    found_px, good = Slant(corners_px[near], truth_px.astype(np.float32)).matched(left, right)
    assert good.all()
    assert np.abs(found_px - truth_px).max() < 0.5

"""Corners and the pictures they are found in: spread, faint or differently bright, and alike along a row."""

import cv2
import numpy as np
import pytest

from messages.arrays import GreyImage
from perception.motion.corners import corners, detail, is_ambiguous
from perception.motion.sheared import Shear


def texture(seed: int, height: int = 720, width: int = 1280) -> GreyImage:
    noise = np.random.default_rng(seed).standard_normal((height, width)).astype(np.float32)
    surface = cv2.GaussianBlur(noise, (0, 0), 6.0)
    grey: GreyImage = np.clip(120.0 + 20.0 * surface / surface.std(), 0, 255).astype(np.uint8)
    return grey


def test_corners_are_spread_over_the_picture_however_uneven_its_contrast() -> None:
    picture = texture(1)
    bold = picture.copy()
    bold[:180] = np.clip((picture[:180].astype(np.float32) - 120.0) * 4.0 + 120.0, 0, 255).astype(np.uint8)
    found = corners(detail(bold, 4))
    rows, _ = np.histogram(found[:, 1], bins=4, range=(0, 180))
    columns, _ = np.histogram(found[:, 0], bins=4, range=(0, 320))
    assert len(found) > 60
    assert min(rows.min(), columns.min()) > len(found) / 8


def test_a_uniform_picture_has_none() -> None:
    assert len(corners(detail(np.full((720, 1280), 90, np.uint8), 4))) == 0


@pytest.mark.parametrize("contrast", [1.0, 0.1])
def test_brightness_and_shade_do_not_pass_for_a_motion(contrast: float) -> None:
    picture = 120.0 + contrast * (texture(2).astype(np.float32) - 120.0)
    shade = np.linspace(1.0, 0.8, 1280, dtype=np.float32)[None]
    moved = np.roll(picture, 12, axis=1) * shade
    one, other = (detail(np.rint(each).astype(np.uint8), 4) for each in (picture, moved))
    points_px = corners(one)
    points_px = points_px[points_px[:, 0] < 300]
    found_px, good = Shear(points_px, points_px).tracked(one, other, levels=2)
    error_px = (found_px - points_px - np.array([3.0, 0.0]))[good]
    assert good.mean() > 0.8
    assert np.abs(np.median(error_px, axis=0)).max() < 0.02 / contrast**0.5


def test_what_the_window_sees_only_in_part_is_not_found() -> None:
    picture = texture(4)
    one, other = (detail(each, 4) for each in (picture, np.roll(picture, 24, axis=0)))
    points_px = corners(one)
    _, good = Shear(points_px, points_px + np.array([0.0, 6.0], np.float32)).tracked(one, other, levels=0)
    in_part = points_px[:, 1] + 6.0 > 175.0
    assert in_part.sum() >= 5
    assert not good[in_part].any()
    assert good[points_px[:, 1] < 160.0].mean() > 0.8


def test_tiles_are_alike_along_a_row_and_ground_is_not() -> None:
    tiles = np.tile(np.pad(np.full((28, 28), 60, np.uint8), 4), (5, 9))[:, :320]
    rough = detail(texture(3), 4)
    for picture, ambiguous in ((tiles, True), (rough, False)):
        found = [is_ambiguous(picture, picture, corner, corner) for corner in corners(picture)]
        assert np.mean(found) > 0.9 if ambiguous else np.mean(found) < 0.1


def test_floorboards_along_the_rows_look_alike_there_and_yet_do_not_come_back() -> None:
    """Most of their corners lie on joints, and have their like along the joint: no two of them at the same distance."""
    grain = np.random.default_rng(5).standard_normal((720, 1280)).astype(np.float32)
    joints = np.where(np.arange(720) % 56 < 4, -40.0, 0.0)[:, None]
    wavy = np.asarray(cv2.GaussianBlur(grain, (0, 0), 24.0, sigmaY=6.0))
    boards = 128.0 + joints + 5.0 * wavy / wavy.std()
    picture = detail(np.clip(boards, 0, 255).astype(np.uint8), 4)
    found = [is_ambiguous(picture, picture, corner, corner) for corner in corners(picture)]
    assert len(found) > 60
    assert np.mean(found) < 0.2

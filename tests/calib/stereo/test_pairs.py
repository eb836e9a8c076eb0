"""Folders of other people's pictures: which eye a file is of, and what is refused in one line."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.stereo.pairs import read_pairs
from messages import UserError

GREY = np.tile(np.arange(0, 240, 20, dtype=np.uint8), (8, 1))


def write(path: Path, value: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((8, 12), value, np.uint8))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("left01.jpg", "right01.jpg"),
        ("left_00.png", "right_00.png"),
        ("leftcamera/Im_L_1.png", "rightcamera/Im_R_1.png"),
        ("imgLeft01.png", "imgRight01.png"),
        ("stereoL01.bmp", "stereoR01.bmp"),
        ("01_L.png", "01_R.png"),
        ("LEFT/IMG_1.tif", "RIGHT/IMG_1.tif"),
        ("left1.png", "right1.jpg"),
        ("bright_left1.png", "bright_right1.png"),
        ("cam0/1.png", "cam1/1.png"),
        ("cam1_05.png", "cam2_05.png"),
        ("cam0_left_1.png", "cam1_right_1.png"),
        ("image_00/data/0001.png", "image_01/data/0001.png"),
        ("calib_left_img_0.png", "calib_right_img_0.png"),
    ],
)
def test_names_tell_the_eyes(tmp_path: Path, left: str, right: str) -> None:
    write(tmp_path / left, 40)
    write(tmp_path / right, 200)
    (tmp_path / "notes.txt").write_text("left", encoding="utf-8")
    (pair,) = read_pairs(tmp_path)
    assert pair.left.mean() < 60.0
    assert pair.right.mean() > 180.0


def test_deep_and_coloured_pictures_become_grey_ones(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "left1.tif"), GREY.astype(np.uint16) * 16)  # twelve bits in sixteen
    cv2.imwrite(str(tmp_path / "right1.tif"), cv2.merge((GREY, GREY, GREY)))
    (pair,) = read_pairs(tmp_path)
    assert pair.left.dtype == pair.right.dtype == np.uint8
    assert (pair.left.min(), pair.left.max()) == (0, 255)
    np.testing.assert_array_equal(pair.right, GREY)


def test_both_eyes_in_one_picture(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "1.png"), np.hstack((GREY, 255 - GREY)))
    (pair,) = read_pairs(tmp_path, side_by_side=True)
    np.testing.assert_array_equal(pair.right, 255 - pair.left)


def test_what_holds_no_pairs_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no picture and no video"):
        next(read_pairs(tmp_path))
    write(tmp_path / "leftover1.png", 1)
    write(tmp_path / "rightmost1.png", 1)
    with pytest.raises(UserError, match="of 2 files none are a pair; name them"):
        next(read_pairs(tmp_path))
    write(tmp_path / "left1.png", 1)
    cv2.imwrite(str(tmp_path / "right1.png"), np.zeros((4, 6), np.uint8))
    with pytest.raises(UserError, match="1 is 12x8 and 6x4 px, allowed 12x8 for all and both eyes"):
        next(read_pairs(tmp_path))

"""Rectified pixels must show the same ray as the raw pixels that they are taken from, in both eyes."""

import cv2
import numpy as np
import pytest

from messages import Lens, Pose, StereoCalibration, matrix3
from messages.arrays import FloatArray
from perception.depth.rectify import Rectifier, Window


def stereo_pair(row_time_s: float = 0.0) -> StereoCalibration:
    def lens(fx: float, cx: float, cy: float) -> Lens:
        return Lens(
            width_px=1280,
            height_px=720,
            fx_px=fx,
            fy_px=fx * 1.001,
            cx_px=cx,
            cy_px=cy,
            distortion=(-0.17, 0.027, 0.0005, -0.0003, 0.0),
        )

    R_RL, _ = cv2.Rodrigues(np.radians([0.2, 0.5, -0.1]))
    return StereoCalibration(
        left=lens(699.0, 652.0, 349.0),
        right=lens(701.5, 633.0, 366.0),
        X_RL=Pose(R=matrix3(R_RL), p_m=(-0.12, 0.0006, -0.0004)),
        row_time_s=row_time_s,
    )


def project(points_L: FloatArray, stereo: StereoCalibration, eye: str) -> FloatArray:
    lens = stereo.left if eye == "left" else stereo.right
    R, p = (np.eye(3), np.zeros(3)) if eye == "left" else (np.array(stereo.X_RL.R), np.array(stereo.X_RL.p_m))
    K = np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1]])
    pixels, _ = cv2.projectPoints(points_L, cv2.Rodrigues(R)[0], p, K, np.array(lens.distortion))
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


@pytest.mark.parametrize("divisor", [1, 2, 4])
def test_a_point_is_found_where_the_rectified_geometry_says(divisor: int) -> None:
    stereo = stereo_pair()
    rectifier = Rectifier(stereo, divisor)
    # an image whose grey value is its own column, or row, shows from which raw pixel a rectified one was taken
    columns = np.tile(np.linspace(0, 255, 1280), (720, 1)).astype(np.uint8)
    point_C = np.array([[0.1, 0.2, 1.3]])
    point_L = point_C @ rectifier.R_LC.T
    u = rectifier.f_px * point_C[0, 0] / point_C[0, 2] + rectifier.cx_px
    v = rectifier.f_px * point_C[0, 1] / point_C[0, 2] + rectifier.cy_px
    disparity = rectifier.f_px * rectifier.baseline_m / point_C[0, 2]
    window = Window(round(v), round(v) + 1, round(u), round(u) + 1)
    left, right = rectifier.rectify(columns, columns, window, shift_px=round(disparity))
    grey_per_px = 255 / 1279
    assert left[0, 0] / grey_per_px == pytest.approx(project(point_L, stereo, "left")[0, 0], abs=8)
    assert right[0, 0] / grey_per_px == pytest.approx(project(point_L, stereo, "right")[0, 0], abs=8)


def test_rows_agree_between_the_eyes() -> None:
    stereo = stereo_pair()
    rectifier = Rectifier(stereo, 2)
    points_L = np.random.default_rng(1).uniform([-0.8, -0.4, 1.0], [0.8, 0.6, 3.0], size=(200, 3))
    for maps, eye in ((rectifier.left_maps, "left"), (rectifier.right_maps, "right")):
        points_C = points_L @ rectifier.R_LC
        shift = 0.0 if eye == "left" else rectifier.f_px * rectifier.baseline_m / points_C[:, 2]
        u = rectifier.f_px * points_C[:, 0] / points_C[:, 2] + rectifier.cx_px - shift
        v = rectifier.f_px * points_C[:, 1] / points_C[:, 2] + rectifier.cy_px
        inside = (u > 1) & (u < 638) & (v > 1) & (v < 358)
        raw = [cv2.remap(m, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR).reshape(-1) for m in maps]
        found = 2 * (np.stack(raw, axis=-1) + 0.5) - 0.5
        assert np.abs(found - project(points_L, stereo, eye))[inside].max() < 0.02


def test_row_times_follow_the_raw_rows() -> None:
    rectifier = Rectifier(stereo_pair(row_time_s=20e-6), 2)
    middle = rectifier.row_time_s[rectifier.height_px // 2, rectifier.width_px // 2]
    assert abs(middle) < 20e-6 * 30
    assert rectifier.row_time_s[-1, 320] - rectifier.row_time_s[0, 320] == pytest.approx(20e-6 * 718, rel=0.1)


def test_columns_outside_the_right_image_are_black() -> None:
    rectifier = Rectifier(stereo_pair(), 2)
    white = np.full((720, 1280), 255, np.uint8)
    _, right = rectifier.rectify(white, white, Window(100, 110, 0, 50), shift_px=30)
    assert right.shape == (10, 50)
    assert not right[:, :30].any()
    assert right[:, 31:].all()


@pytest.mark.parametrize("divisor", [1, 2, 4])
def test_of_a_part_of_the_picture_nothing_is_left_of_the_one_before(divisor: int) -> None:
    chance, rectifier = np.random.default_rng(2), Rectifier(stereo_pair(), divisor)
    before, now = (chance.integers(0, 256, (720, 1280), dtype=np.uint8) for _ in range(2))
    whole = Window(0, rectifier.height_px, 0, rectifier.width_px)
    expected = rectifier.rectify(now, now, whole, 0)
    for _ in range(20):
        (top, bottom), (left, right) = (
            sorted(chance.choice(size + 1, 2, replace=False).tolist())
            for size in (rectifier.height_px, rectifier.width_px)
        )
        rectifier.rectify(before, before, whole, 0)
        part = rectifier.rectify(now, now, Window(top, bottom, left, right), 0)
        for found, all_of_it in zip(part, expected, strict=True):
            np.testing.assert_array_equal(found, all_of_it[top:bottom, left:right])

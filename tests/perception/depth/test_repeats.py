"""A floor seen by an exact pair: tiles all alike have rivals where the geometry puts them, others have none."""

import cv2
import numpy as np
import pytest

from messages import Lens, Pose, StereoCalibration, matrix3
from messages.arrays import FloatArray, GreyImage
from perception.depth.rectify import Rectifier
from perception.depth.repeats import NO_REPEATS, Repeats, Rival, find_repeats

HEIGHT_M = 0.95
PITCH_RAD = np.radians(45.0)
BASELINE_M, F_PX, SIZE_PX = 0.12, 350.0, (640, 360)
REGION_H = np.array([[x, y, -HEIGHT_M] for x in (0.4, 1.0) for y in (-0.3, 0.3)])


def pair() -> StereoCalibration:
    lens = Lens(
        width_px=SIZE_PX[0], height_px=SIZE_PX[1], fx_px=F_PX, fy_px=F_PX,
        cx_px=(SIZE_PX[0] - 1) / 2, cy_px=(SIZE_PX[1] - 1) / 2, distortion=(0.0,) * 5,
    )  # fmt: skip
    return StereoCalibration(left=lens, right=lens, X_RL=Pose(R=matrix3(np.eye(3)), p_m=(-BASELINE_M, 0.0, 0.0)))


def R_HC() -> FloatArray:
    c, s = np.cos(PITCH_RAD), np.sin(PITCH_RAD)
    return np.array([[0.0, -s, c], [-1.0, 0.0, 0.0], [0.0, -c, -s]])


def seen(yaw_rad: float, tile_m: float, variation: float) -> tuple[GreyImage, GreyImage]:
    """Return both eyes' pictures of square tiles with soft joints, turned by `yaw_rad`, and sensor noise."""
    rng = np.random.default_rng(5)
    greys = rng.normal(0.0, variation, (4096,))
    noise = np.random.default_rng(6)
    v, u = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
    rays_C = np.stack(((u - 319.5) / F_PX, (v - 179.5) / F_PX, np.ones(u.shape)), axis=-1)
    pictures = []
    for offset_m in (0.0, -BASELINE_M):
        rays = rays_C @ R_HC().T
        ground = rays[..., :2] * (-HEIGHT_M / np.minimum(rays[..., 2], -0.05))[..., None] + [0.0, offset_m]
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        tiled = ground @ np.array([[c, -s], [s, c]]) / tile_m
        joint = np.exp(-(((tiled - np.rint(tiled)) / 0.12) ** 2)).max(axis=-1)
        cell = np.floor(tiled).astype(np.int64)
        surface = 165.0 + greys[(cell[..., 0] * 57 + cell[..., 1] * 131) % 4096]
        grey = surface * (1.0 - joint) + 92.0 * joint + noise.normal(0.0, 1.5, u.shape)
        pictures.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    return pictures[0], pictures[1]


def found(pictures: tuple[GreyImage, GreyImage], height_m: float = HEIGHT_M) -> Repeats:
    rectifier = Rectifier(pair(), 1)
    theta_H = rectifier.f_px * rectifier.baseline_m / height_m * np.array([0.0, 0.0, -1.0])
    return find_repeats(rectifier, pictures, REGION_H @ R_HC(), R_HC().T @ theta_H)


@pytest.mark.parametrize("tile_m", [0.025, 0.06])
def test_tiles_all_alike_have_rivals_a_tile_away(tile_m: float) -> None:
    repeats = found(seen(0.0, tile_m, 0.0))
    for ratio in (1.0 + tile_m / BASELINE_M, 1.0 - tile_m / BASELINE_M):
        assert min(abs(rival.ratio - ratio) for rival in repeats.rivals) < 0.015
    assert repeats.standing_out() is None


def test_where_the_rows_cross_the_tiles_askew_the_ground_stands_out() -> None:
    repeats = found(seen(np.radians(5.0), 0.025, 0.0))
    assert repeats.rivals
    assert repeats.standing_out() == 1.0


@pytest.mark.parametrize("yaw_deg", [5.0, 10.0, 15.0])
def test_from_a_plane_a_tile_off_the_ground_stands_out(yaw_deg: float) -> None:
    askew = seen(np.radians(yaw_deg), 0.025, 0.0)
    for off in (1.0 + 0.025 / BASELINE_M, 1.0 - 0.025 / BASELINE_M):
        assert found(askew, HEIGHT_M / off).standing_out() == pytest.approx(1.0 / off, abs=0.015)


def test_tiles_of_different_prints_stand_out() -> None:
    assert found(seen(0.0, 0.025, 8.0)).standing_out() == 1.0


def test_a_floor_of_its_own_and_one_with_joints_across_the_walk_alone_have_no_rivals() -> None:
    rng = np.random.default_rng(7)
    plain = rng.integers(60, 200, (SIZE_PX[1], SIZE_PX[0])).astype(np.uint8)
    striped = np.where(np.arange(SIZE_PX[1])[:, None] % 12 < 3, 60, 150) + rng.normal(0.0, 3.0, plain.shape)
    for picture in (plain, striped.astype(np.uint8)):
        assert found((picture, picture)).rivals == ()


def test_a_smooth_floor_is_still_alike_a_little_further_and_repeats_nothing() -> None:
    rng = np.random.default_rng(8)
    blurred = cv2.GaussianBlur(rng.uniform(-1.0, 1.0, (SIZE_PX[1], SIZE_PX[0])), (0, 0), 6.0)
    smooth = np.clip(128.0 + 30.0 * blurred / np.std(blurred), 0.0, 255.0).astype(np.uint8)
    assert found((smooth, smooth)).of_the_floor().rivals == ()


def test_a_region_out_of_the_picture_has_no_rivals() -> None:
    rectifier = Rectifier(pair(), 1)
    corners_C = np.array([[0.9, 0.0, 1.0], [1.2, 0.3, 1.0]])
    assert find_repeats(rectifier, seen(0.0, 0.025, 0.0), corners_C, np.array([0.0, 0.0, 36.0])) == NO_REPEATS


def test_which_stands_out() -> None:
    assert Repeats(0.1, (Rival(1.2, 0.15),)).standing_out() is None
    assert Repeats(0.1, (Rival(1.2, 0.25),)).standing_out() == 1.0
    assert Repeats(0.1, (Rival(1.2, 0.02), Rival(0.8, 0.09))).standing_out() == 1.2
    assert Repeats(0.1, (Rival(1.2, 0.02), Rival(0.8, 0.03))).standing_out() is None
    assert Repeats(0.1, (Rival(1.6, 0.1),)).within((0.7, 1.4)).standing_out() == 1.0

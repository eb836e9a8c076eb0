"""What a rendered, exact pair shows of a path: on a checkered floor that the rows cross askew, and over a drop."""

import numpy as np
import pytest

from messages import Lens, Pose, StereoCalibration, matrix3
from messages.arrays import FloatArray, GreyImage
from perception.depth.stereo_camera import StereoCamera
from perception.terrain.path_matching import PathSettings, match_path
from perception.terrain.path_points import PathPoints, find_points

HEIGHT_M, DROP_M, LIP_M, CHECK_M, ASKEW_RAD = 0.85, 0.15, 1.0, 0.018, 0.3
BASELINE_M, F_PX, SIZE_PX = 0.12, 350.0, (640, 360)
HALF = np.sqrt(0.5)
R_HC = np.array([[0.0, -HALF, HALF], [-1.0, 0.0, 0.0], [0.0, -HALF, -HALF]])
NEARNESS_H = np.array([0.0, 0.0, -1.0 / HEIGHT_M])


def camera() -> StereoCamera:
    lens = Lens(
        width_px=SIZE_PX[0], height_px=SIZE_PX[1], fx_px=F_PX, fy_px=F_PX,
        cx_px=(SIZE_PX[0] - 1) / 2, cy_px=(SIZE_PX[1] - 1) / 2, distortion=(0.0,) * 5,
    )  # fmt: skip
    X_RL = Pose(R=matrix3(np.eye(3)), p_m=(-BASELINE_M, 0.0, 0.0))
    return StereoCamera(StereoCalibration(left=lens, right=lens, X_RL=X_RL))


def checkered(ground_m: FloatArray) -> FloatArray:
    """Return the grey of places x, y on the ground (..., 2), with soft borders between the squares."""
    c, s = np.cos(ASKEW_RAD), np.sin(ASKEW_RAD)
    waves = np.sin(ground_m @ np.array([[c, -s], [s, c]]) * np.pi / CHECK_M)
    grey: FloatArray = 130.0 + 60.0 * np.tanh(4.0 * waves[..., 0] * waves[..., 1])
    return grey


def pictures(drop_m: float) -> tuple[GreyImage, GreyImage]:
    """Return both eyes' pictures of ground that lies `drop_m` lower behind LIP_M."""
    noise = np.random.default_rng(3)
    v, u = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
    rays_C = np.stack(((u - 319.5) / F_PX, (v - 179.5) / F_PX, np.ones(u.shape)), axis=-1)
    both = []
    for right_m in (0.0, BASELINE_M):
        rays = rays_C @ R_HC.T
        upper, lower = (
            rays[..., :2] * (-h / np.minimum(rays[..., 2], -0.05))[..., None] for h in (HEIGHT_M, HEIGHT_M + drop_m)
        )
        on_upper = upper[..., 0] < LIP_M
        ground = np.where(on_upper[..., None], upper, lower) - [0.0, right_m]
        face = ~on_upper & (lower[..., 0] < LIP_M)
        grey = np.where(face, 60.0, checkered(ground)) + noise.normal(0.0, 1.5, u.shape)
        both.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    return both[0], both[1]


def seen(drop_m: float, nearness_H: FloatArray | None) -> PathPoints:
    eyes, images, path = camera(), pictures(drop_m), PathSettings()
    matched = match_path(eyes, images, R_HC, HEIGHT_M, path)
    return find_points(eyes, images, matched, R_HC, np.zeros(3), 0.0, HEIGHT_M, path, nearness_H=nearness_H)


def test_squares_that_are_matched_one_too_far_or_too_near_are_the_ground_that_is_known() -> None:
    off = [np.abs(seen(0.0, known).z_m + HEIGHT_M) > 0.05 for known in (None, NEARNESS_H)]
    assert off[0].mean() > 0.05  # what the matcher makes of them
    assert off[1].mean() < 0.005


def test_ground_that_is_found_again_is_as_exact_as_it_was_matched() -> None:
    too_low = NEARNESS_H / 1.01
    points = seen(0.0, too_low)
    assert float(np.median(points.z_m)) == pytest.approx(-HEIGHT_M, abs=0.003)


def test_a_drop_is_no_ground_however_checkered() -> None:
    points = seen(DROP_M, NEARNESS_H)
    beyond = points.where(points.x_m > LIP_M + 0.3)
    assert float(np.mean(np.abs(beyond.z_m + HEIGHT_M + DROP_M) < 0.02)) > 0.7


def test_what_lies_far_below_is_not_taken_for_something_above() -> None:
    points = seen(2.0, None)
    beyond = points.where(points.x_m > LIP_M + 0.1)
    assert np.count_nonzero(beyond.z_m > 0.1 - HEIGHT_M) < 10  # 61 where it is not looked for so deep
    assert beyond.z_m.min() > -HEIGHT_M - PathSettings().below_m

"""Depth images as disparities along rays, and the ground fitted to them."""

import cv2
import msgspec
import numpy as np
import pytest

from messages import DepthCalibration, Lens, Reason, Residual
from messages.arrays import DepthImage
from perception.depth.depth_camera import DepthCamera
from perception.depth.rectify import intrinsics
from perception.ground.foothold import FootholdSettings
from perception.ground.meter import GroundMeasurement, GroundMeter
from perception.ground.plane import Plane

WIDTH, HEIGHT, F_PX = 320, 240, 210.0
PINHOLE = Lens(
    width_px=WIDTH, height_px=HEIGHT, fx_px=F_PX, fy_px=F_PX, cx_px=158.0, cy_px=121.0, distortion=(0.0,) * 4
)
DEPTH = DepthCalibration(lens=PINHOLE, baseline_m=0.05)
BENT = msgspec.structs.replace(PINHOLE, distortion=(-0.17, 0.03, 0.0004, -0.0008, 0.0))
PITCH = np.deg2rad(45.0)
R_HC = np.array([[0.0, -np.sin(PITCH), np.cos(PITCH)], [-1.0, 0.0, 0.0], [0.0, -np.cos(PITCH), -np.sin(PITCH)]])
GROUND = Plane((0.08, -0.05), 0.93)
REGION = FootholdSettings().region


def depth_of(plane: Plane, lens: Lens, step_m: float = 0.001) -> DepthImage:
    """The image of a plane: where a pixel's ray, found by cv2 alone, meets it."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    pixels = np.stack((u, v), axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT, 50, 0.0)
    xy = cv2.undistortPoints(pixels, intrinsics(lens), np.array(lens.distortion), criteria=criteria)
    rays_H = np.concatenate((xy.reshape(-1, 2), np.ones((HEIGHT * WIDTH, 1))), axis=1) @ R_HC.T
    down = rays_H[:, 0] * plane.gradient[0] + rays_H[:, 1] * plane.gradient[1] - rays_H[:, 2]
    z_m = np.divide(plane.height_m, down, out=np.zeros_like(down), where=down > 0.05)
    steps: DepthImage = np.rint(z_m / step_m).reshape(HEIGHT, WIDTH).astype(np.uint16)
    return steps


def measure(depth: DepthCalibration, image: DepthImage, residual: Residual | None = None) -> GroundMeasurement:
    meter = GroundMeter(depth, residual or Residual())
    return meter.measure((image,), R_HC, np.zeros(3), 0.0, REGION, None)


def test_disparities_are_inverse_depth_and_unknown_where_there_is_none() -> None:
    image = np.full((HEIGHT, WIDTH), 1500, np.uint16)
    image[100:110, 150:160] = 0
    points_C = np.array([[-0.1, -0.1, 1.5], [0.1, 0.1, 1.5], [0.0, 0.0, 1.5]])
    patch = DepthCamera(DEPTH).find_disparities((image,), points_C)
    assert patch is not None
    known = np.isfinite(patch.disparity_px)
    np.testing.assert_allclose(patch.disparity_px[known], F_PX * 0.05 / 1.5, rtol=1e-12)
    hole = (np.abs(patch.rays_C[..., 0] * F_PX + 158.0 - 154.5) < 5) & (
        np.abs(patch.rays_C[..., 1] * F_PX + 121.0 - 104.5) < 5
    )
    np.testing.assert_array_equal(~known, hole)


@pytest.mark.parametrize("lens", [PINHOLE, BENT], ids=["pinhole", "bent"])
def test_rays_are_those_that_the_lens_projects_onto_the_pixels(lens: Lens) -> None:
    camera = DepthCamera(msgspec.structs.replace(DEPTH, lens=lens))
    corners = np.array([[-0.7, -0.5, 1.0], [0.7, 0.5, 1.0], [0.0, 0.0, 1.0]])
    patch = camera.find_disparities((np.ones((HEIGHT, WIDTH), np.uint16),), corners)
    assert patch is not None
    rows, columns = patch.disparity_px.shape
    projected, _ = cv2.projectPoints(
        patch.rays_C.reshape(-1, 3), np.zeros(3), np.zeros(3), intrinsics(lens), np.array(lens.distortion)
    )
    found = projected.reshape(rows, columns, 2)
    np.testing.assert_allclose(np.diff(found[..., 0], axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(np.diff(found[..., 1], axis=0), 1.0, atol=1e-6)
    np.testing.assert_allclose(found, np.rint(found), atol=1e-6)


def test_a_point_beside_the_picture_is_not_in_view() -> None:
    image = np.ones((HEIGHT, WIDTH), np.uint16)
    assert DepthCamera(DEPTH).find_disparities((image,), np.array([[0.0, 0.0, 1.0], [0.9, 0.0, 1.0]])) is None


@pytest.mark.parametrize("lens", [PINHOLE, BENT], ids=["pinhole", "bent"])
def test_the_ground_is_that_of_the_depths(lens: Lens) -> None:
    depth = msgspec.structs.replace(DEPTH, lens=lens)
    found = measure(depth, depth_of(GROUND, lens))
    assert found.fit is not None
    assert found.matched_share == 1.0
    np.testing.assert_allclose(found.fit.plane.gradient, GROUND.gradient, atol=2e-4)
    assert found.fit.plane.height_m == pytest.approx(GROUND.height_m, abs=2e-4)


def test_the_step_is_the_calibrations() -> None:
    depth = msgspec.structs.replace(DEPTH, step_m=0.00025)
    found = measure(depth, depth_of(GROUND, PINHOLE, step_m=0.00025))
    assert found.fit is not None
    assert found.fit.plane.height_m == pytest.approx(GROUND.height_m, abs=1e-4)


def test_an_uncertain_scale_makes_the_height_uncertain_and_nothing_else() -> None:
    image = depth_of(GROUND, PINHOLE)
    sure, unsure = (
        measure(msgspec.structs.replace(DEPTH, scale_residual=scale), image).lasting_cov for scale in (0.0, 0.01)
    )
    added = unsure - sure
    assert added[2, 2] == pytest.approx((0.01 * GROUND.height_m) ** 2, rel=1e-3)
    added[2, 2] = 0.0
    np.testing.assert_array_equal(added, 0.0)


def test_a_toe_in_within_its_residual_is_covered() -> None:
    toe_in_rad = np.deg2rad(0.02)
    exact = depth_of(GROUND, PINHOLE)
    inverse = np.divide(1e3, exact, out=np.zeros(exact.shape), where=exact > 0) + toe_in_rad / DEPTH.baseline_m
    bent = np.where(exact > 0, np.rint(1e3 / np.maximum(inverse, 1e-3)), 0.0).astype(np.uint16)
    found = measure(DEPTH, bent, Residual(toe_in_rad=toe_in_rad))
    assert found.fit is not None
    error = found.fit.plane.abh - GROUND.abh
    assert abs(error[2]) > 0.003
    assert np.all(np.abs(error) < 1.2 * np.sqrt(np.diag(found.lasting_cov)) + 5e-4)


def test_an_image_with_too_little_depth_is_refused() -> None:
    image = depth_of(GROUND, PINHOLE)
    image[:, np.random.default_rng(1).random(WIDTH) < 0.8] = 0
    assert measure(DEPTH, image).reason is Reason.LOW_TEXTURE
    assert measure(DEPTH, np.zeros((HEIGHT, WIDTH), np.uint16)).reason is Reason.LOW_TEXTURE

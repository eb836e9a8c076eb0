"""What the region holds besides one plane widens what is said of the plane."""

import numpy as np
import pytest

from messages.arrays import FloatArray, IntArray
from perception.ground.foothold import FootholdSettings
from perception.ground.plane import Plane, PlaneFit
from perception.ground.relief import relief_cov

REGION = FootholdSettings().region
FIT = PlaneFit(Plane((0.0, 0.0), 0.95), np.eye(3) * 1e-4, noise_px=0.2, inlier_share=1.0)


def points(rise_at_the_ends_m: float) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.float64]], float]:
    """Return points in H on ground that bends upwards by c₂ ξ², and c₂."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0.4, 1.0, 61), np.linspace(-0.3, 0.3, 31)))
    xi = (x - REGION.ahead_m) / REGION.half_length_m
    return np.column_stack((x, y, -FIT.plane.height_m + rise_at_the_ends_m * xi**2)), rise_at_the_ends_m


def widened(points_H: FloatArray, block: IntArray | None = None, locking_px: float = 0.0) -> FloatArray:
    count = len(points_H)
    block = np.arange(count) if block is None else block
    return relief_cov(FIT, points_H, np.full(count, 38.0), np.zeros(count), block, REGION, locking_px)


@pytest.mark.parametrize("rise_mm", [-12.0, 0.5, 12.0])
def test_every_bend_widens_the_slope_about_the_middle_of_the_region(rise_mm: float) -> None:
    points_H, c2_m = points(1e-3 * rise_mm)
    cov = widened(points_H)
    variance = 4.0 / 3.0 * (c2_m / REGION.half_length_m) ** 2  # the mean square of 2 c₂ ξ / l
    assert cov[0, 0] == pytest.approx(variance, rel=1e-6)
    at_the_middle = np.array([-REGION.ahead_m, 0.0, 1.0])
    assert at_the_middle @ cov @ at_the_middle == pytest.approx(0.0, abs=1e-12)


def test_a_plane_is_not_widened() -> None:
    points_H, _ = points(0.0)
    np.testing.assert_allclose(widened(points_H), 0.0, atol=1e-18)


def test_what_the_matchers_errors_make_of_a_bend_is_taken_off() -> None:
    rng = np.random.default_rng(4)
    points_H, _ = points(0.0)
    block = np.arange(len(points_H)) // 61 * 8 + np.arange(len(points_H)) % 61 // 8
    known, unknown = [], []
    for _ in range(200):
        error_m = 0.002 * rng.normal(size=block.max() + 1)[block]
        noisy = points_H + np.array([0.0, 0.0, 1.0]) * error_m[:, None]
        known.append(widened(noisy, block)[0, 0])
        unknown.append(widened(noisy)[0, 0])
    # of a normal c₂ with variance v the mean of c₂² − v, where that is above 0, is 0.48 v
    assert np.mean(known) == pytest.approx(0.48 * np.mean(unknown), rel=0.3)


def test_a_bend_as_small_as_pixel_locking_makes_widens_nothing_and_a_ramps_foot_as_before() -> None:
    locking_m = FIT.plane.height_m * 0.05 / 38.0
    assert widened(points(0.9 * locking_m)[0], locking_px=0.05)[0, 0] == 0.0
    foot = points(0.012)[0]
    assert widened(foot, locking_px=0.05)[0, 0] == pytest.approx(widened(foot)[0, 0], rel=0.02)

"""What the region holds besides one plane widens what is said of the plane."""

import numpy as np
import pytest

from perception.ground.foothold import FootholdSettings
from perception.ground.plane import Plane, PlaneFit
from perception.ground.relief import relief_cov

REGION = FootholdSettings()
FIT = PlaneFit(Plane((0.0, 0.0), 0.95), np.eye(3) * 1e-4, noise_px=0.2, inlier_share=1.0)


def points(rise_at_the_ends_m: float) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.float64]], float]:
    """Return points in H on ground that bends upwards by c₂ ξ², and c₂."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0.4, 1.0, 61), np.linspace(-0.3, 0.3, 31)))
    xi = (x - REGION.ahead_m) / REGION.half_length_m
    return np.column_stack((x, y, -FIT.plane.height_m + rise_at_the_ends_m * xi**2)), rise_at_the_ends_m


@pytest.mark.parametrize("rise_mm", [-12.0, 0.5, 12.0])
def test_every_bend_widens_the_slope_about_the_middle_of_the_region(rise_mm: float) -> None:
    points_H, c2_m = points(1e-3 * rise_mm)
    cov = relief_cov(FIT, points_H, np.zeros(len(points_H)), np.arange(len(points_H)), REGION)
    variance = 4.0 / 3.0 * (c2_m / REGION.half_length_m) ** 2  # the mean square of 2 c₂ ξ / l
    assert cov[0, 0] == pytest.approx(variance, rel=1e-6)
    at_the_middle = np.array([-REGION.ahead_m, 0.0, 1.0])
    assert at_the_middle @ cov @ at_the_middle == pytest.approx(0.0, abs=1e-12)


def test_a_plane_is_not_widened() -> None:
    points_H, _ = points(0.0)
    np.testing.assert_allclose(
        relief_cov(FIT, points_H, np.zeros(len(points_H)), np.arange(len(points_H)), REGION), 0.0, atol=1e-18
    )


def test_a_bend_that_chance_makes_is_taken_off() -> None:
    rng = np.random.default_rng(4)
    points_H, _ = points(0.0)
    block = np.arange(len(points_H)) // 61  # each row of the grid errs alike
    found, by_chance = [], []
    for _ in range(60):
        error_m = 0.002 * rng.normal(size=block[-1] + 1)[block] * np.sin(np.arange(len(points_H)))
        noisy = points_H + np.array([0.0, 0.0, 1.0]) * error_m[:, None]
        found.append(relief_cov(FIT, noisy, np.zeros(len(noisy)), block, REGION)[0, 0])
        whole = relief_cov(FIT, noisy, np.zeros(len(noisy)), np.zeros_like(block), REGION)
        by_chance.append(whole[0, 0])  # one block whose errors sum to nothing: no chance is known of
    assert np.mean(found) < 0.6 * np.mean(by_chance)

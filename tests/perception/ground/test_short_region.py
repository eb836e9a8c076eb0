"""A short region far ahead: of noisy disparities its plane leans to neither side on the average; borders widen it."""

import numpy as np
import pytest

from messages import Residual
from perception.ground.meter import GroundMeter, Pixels, beside_borders
from perception.ground.region import FootholdRegion
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

HEIGHT_M, NOISE_PX = 0.95, 0.25
REGION = FootholdRegion(
    ahead_m=1.6,
    left_m=0.0,
    half_length_m=0.17,
    half_width_m=0.2,
    nominal_height_m=HEIGHT_M,
    height_margin_m=0.15,
    step_m=0.1,
    bounded=True,
)


def test_the_plane_of_a_short_region_far_ahead_does_not_rise() -> None:
    meter = GroundMeter(SimulatedWearer(1, scenario("level"), 10_000_000_000).calibration.stereo, Residual())
    fB_px_m = meter.camera.f_px * meter.camera.baseline_m
    slopes_deg = []
    for seed in range(20):
        chance = np.random.default_rng(seed)
        x_m, y_m = chance.uniform(1.3, 1.9, 3000), chance.uniform(-0.25, 0.25, 3000)
        rays_H = np.stack((x_m, y_m, np.full(3000, -HEIGHT_M)), axis=-1) / np.hypot(x_m, HEIGHT_M)[:, None]
        disparity_px = fB_px_m / np.hypot(x_m, HEIGHT_M) + chance.normal(0.0, NOISE_PX, 3000)
        points_H = rays_H * (fB_px_m / disparity_px)[:, None]
        _, fit = meter._fitted(Pixels(rays_H, disparity_px, points_H, np.arange(3000)), REGION, 0.0, None)
        assert fit is not None
        slopes_deg.append(np.degrees(fit.plane.gradient[0]))
    assert abs(np.mean(slopes_deg)) < 0.2


def test_a_border_widens_both_slopes_and_the_ground_at_the_middle_stays_as_it_is() -> None:
    cov = beside_borders(REGION)
    at_the_middle = np.array([REGION.ahead_m, REGION.left_m, -1.0])
    assert at_the_middle @ cov @ at_the_middle == pytest.approx(0.0, abs=1e-12)
    narrow = beside_borders(REGION.narrowed())
    assert narrow[1, 1] == pytest.approx(4.0 * cov[1, 1])
    assert narrow[0, 0] == pytest.approx(cov[0, 0])
    assert 0.0 < cov[1, 1] < cov[0, 0]

"""How much a sole may slope otherwise than the region's plane: bumps of known slope, even ground, and walks on both."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.pipeline import Pipeline
from lab.evaluation.terrain_score import SIGMAS, WRONG_SLOPE_RAD
from messages import GroundPlane, Status
from messages.arrays import FloatArray
from perception.ground.cells import RegionCells
from perception.ground.foothold import FootholdSettings
from perception.ground.plane import Plane, PlaneFit
from perception.ground.relief import bumps_cov
from perception.ground.sole import SOLE_M, about, sole_slope_cov
from sim_rig.walk.terrain_walks import STANDING_S, terrain_walk
from sim_rig.wearer import SimulatedWearer

REGION = FootholdSettings().region
X, Y = (grid.ravel() for grid in np.meshgrid(np.arange(0.405, 1.0, 0.01), np.arange(-0.295, 0.3, 0.01)))
START_NS = 10_000_000_000
DISPARITY_PX = np.full(len(X), 38.0)


def slope_cov(rise_m: FloatArray) -> FloatArray:
    return sole_slope_cov(RegionCells(np.column_stack((X, Y, rise_m)), REGION), rise_m)


def test_where_few_soles_are_seen_slopes_are_as_usual() -> None:
    usual, short = 0.06, np.abs(X - REGION.ahead_m) < 0.07
    level = np.column_stack((X, Y, 0.0 * X))
    cells = RegionCells(level[short], replace(REGION, half_length_m=0.07))
    np.testing.assert_allclose(sole_slope_cov(cells, 0.0 * X[short], usual), usual**2 * np.eye(2))
    assert sole_slope_cov(RegionCells(level, REGION), 0.0 * X, usual).max() < 0.1 * usual**2


@settings(max_examples=25, deadline=None, derandomize=True)
@given(amplitude_m=st.floats(0.005, 0.05), wave_m=st.floats(0.3, 0.6), phase=st.floats(0.0, 6.28))
def test_waves_across_the_way_slope_soles_as_their_own_slope_averaged_over_a_sole(
    amplitude_m: float, wave_m: float, phase: float
) -> None:
    k = 2.0 * np.pi / wave_m
    cov = slope_cov(amplitude_m * np.sin(k * X + phase))
    middles_m = 0.4 + 0.5 * SOLE_M + 0.04 * np.arange(11)
    beside_m = np.linspace(-0.5, 0.5, 101) * SOLE_M
    waves = amplitude_m * np.sin(k * (middles_m[:, None] + beside_m) + phase)
    wanted = np.mean((waves @ beside_m / (beside_m @ beside_m)) ** 2)
    assert cov[0, 0] == pytest.approx(wanted, rel=0.1, abs=1e-5)
    assert cov[1, 1] < 1e-9


def test_a_plane_slopes_no_sole_and_neither_does_what_is_seen_of_no_whole_sole() -> None:
    np.testing.assert_allclose(slope_cov(np.zeros(len(X))), 0.0, atol=1e-15)
    strip = np.abs(Y) < 0.04
    cells = RegionCells(np.column_stack((X, Y, X))[strip], REGION)
    np.testing.assert_array_equal(sole_slope_cov(cells, X[strip]), 0.0)


def test_slopes_tip_the_plane_about_the_middle_of_the_region() -> None:
    cov = about(REGION.ahead_m, REGION.left_m, np.diag([0.01, 0.02]))
    middle = np.array([-REGION.ahead_m, -REGION.left_m, 1.0])
    assert middle @ cov @ middle == pytest.approx(0.0, abs=1e-12)
    assert np.diag(cov)[:2] == pytest.approx([0.01, 0.02])


@pytest.mark.parametrize(("bump_m", "widens"), [(0.0, False), (0.010, True)])
def test_bumps_widen_the_slopes_of_a_plane_and_the_matchers_noise_does_not(bump_m: float, widens: bool) -> None:
    """Its errors are alike over some 6 cm, and larger towards the camera than across."""
    chance = np.random.default_rng(5)
    place = (X // 0.06 * 100 + (Y + 0.3) // 0.06).astype(np.intp)
    rise_m = 0.002 * chance.standard_normal(place.max() + 1)[place] + bump_m * np.sin(20.0 * X) * np.cos(18.0 * Y)
    fit = PlaneFit(Plane((0.0, 0.0), 0.95), np.eye(3) * 1e-4, noise_px=0.2, inlier_share=1.0)
    points_H = np.column_stack((X, Y, rise_m - 0.95))
    cov = bumps_cov(fit, points_H, DISPARITY_PX, rise_m * 40.0, REGION)
    assert bool(cov[0, 0] > np.radians(1.0) ** 2) is widens
    assert cov[0, 0] == pytest.approx(cov[1, 1])


@pytest.mark.long
def test_what_is_said_on_rough_ground_is_hardly_ever_wrong_and_valid() -> None:
    """Bumps of 19 mm: a quarter of the frames was, when a plane's slopes counted as a sole's.

    What is left are frames in which bumps as high as the noise of faint texture are told from neither.
    """
    walk = terrain_walk(10)
    wearer = SimulatedWearer(10, walk.scenario, START_NS)
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    told = [each for message in wearer.offline_inputs(6.0) for each in pipeline.step(message)]
    grounds = [each for each in told if isinstance(each, GroundPlane) and each.status is Status.VALID]
    grounds = [each for each in grounds if each.t_exposure_ns > START_NS + 1e9 * STANDING_S]
    assert len(grounds) > 40
    wrong = sum(slopes_are_wrong(ground, wearer) for ground in grounds)
    assert wrong < 0.06 * len(grounds)


def slopes_are_wrong(ground: GroundPlane, wearer: SimulatedWearer) -> bool:
    under = wearer.surface(ground.t_exposure_ns, ground.ahead_m, ground.left_m)
    off = (ground.slope_sagittal_rad - under.slope_sagittal_rad, ground.slope_frontal_rad - under.slope_frontal_rad)
    variances = (ground.covariance[0], ground.covariance[3])
    return any(abs(e) > max(WRONG_SLOPE_RAD, SIGMAS * var**0.5) for e, var in zip(off, variances, strict=True))

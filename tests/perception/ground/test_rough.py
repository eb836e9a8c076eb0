"""Rough ground has a plane with its bumps as uncertainty; steps, flights, smooth ground and clutter are none."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.pipeline import Pipeline
from lab.faults.criteria import errors_of
from messages import GroundPlane, Status
from messages.arrays import FloatArray
from perception.ground.foothold import FootholdSettings
from perception.ground.plane import PlaneFit
from perception.ground.rough import is_scatter, rough_plane
from sim_rig.walk.relief import Relief
from sim_rig.walk.scenario import Pace, over_level
from sim_rig.walk.world import World
from sim_rig.wearer import SimulatedWearer

REGION = FootholdSettings().region
START_NS, SECOND_NS = 10_000_000_000, 1_000_000_000
X, Y = (grid.ravel() for grid in np.meshgrid(np.arange(0.405, 1.0, 0.01), np.arange(-0.295, 0.3, 0.01)))


def plane_of(z_m: FloatArray, *, noise_m: float = 0.002, known: bool = False) -> PlaneFit | None:
    z_m = z_m + np.random.default_rng(1).normal(0.0, noise_m, z_m.shape) - 0.95
    return rough_plane(np.column_stack((X, Y, z_m)), np.full(len(X), 40.0), REGION, known=known)


def bumps(rms_m: float, phase: float = 0.3) -> FloatArray:
    shape = np.sin(20.0 * X + phase) * np.cos(18.0 * Y - phase)
    sized: FloatArray = rms_m * shape / float(shape.std())
    return sized


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    rms_m=st.floats(0.012, 0.05),
    phase=st.floats(0.0, 3.0),
    a=st.floats(-0.15, 0.15),
    b=st.floats(-0.15, 0.15),
)
def test_the_plane_through_bumps_is_that_of_least_squares_and_as_uncertain_as_they_are_high(
    rms_m: float, phase: float, a: float, b: float
) -> None:
    z = bumps(rms_m, phase) + a * X + b * Y
    fit = plane_of(z)
    assert fit is not None
    design = np.column_stack((X, Y, np.ones_like(X)))
    wanted = np.linalg.lstsq(design, z)[0]
    np.testing.assert_allclose((*fit.plane.gradient, 0.95 - fit.plane.height_m), wanted, atol=0.01)
    assert fit.rough_m == pytest.approx(np.std(z - design @ wanted), rel=0.15)
    middle = np.array([-0.7, 0.0, 1.0])  # of the height of the region's middle
    assert np.sqrt(middle @ fit.covariance @ middle) == pytest.approx(fit.rough_m, rel=0.2)
    assert np.linalg.eigvalsh(fit.covariance).min() > 0.0


@pytest.mark.parametrize("high_m", [0.0, 0.02])
def test_what_lies_off_a_plane_scatters_on_even_ground_and_not_at_a_step_or_on_bumps(high_m: float) -> None:
    noise_m = np.random.default_rng(2).normal(0.0, 0.006, X.shape)
    for high, scatters in ((high_m * (X > 0.7), high_m == 0.0), (bumps(high_m or 1e-9), high_m == 0.0)):
        rise_m = high - high.mean() + noise_m
        assert is_scatter(np.column_stack((X, Y, rise_m - 0.95)), rise_m, REGION) is scatters


def test_smooth_ground_is_not_rough() -> None:
    assert plane_of(0.05 * X) is None


@pytest.mark.parametrize("yaw_deg", [0.0, 17.0, -33.0, 90.0])
@pytest.mark.parametrize(("rise_m", "tread_m"), [(0.06, 1.0), (0.17, 1.0), (-0.12, 1.0), (0.17, 0.28), (-0.2, 0.3)])
def test_steps_and_flights_are_not_rough(rise_m: float, tread_m: float, yaw_deg: float) -> None:
    yaw = np.radians(yaw_deg)
    along = (X - 0.7) * np.cos(yaw) + Y * np.sin(yaw)
    assert plane_of(rise_m * np.floor(along / tread_m + 0.02)) is None


def test_clutter_and_what_is_hardly_seen_are_not_rough() -> None:
    assert plane_of(np.zeros_like(X), noise_m=0.05) is None
    points = np.column_stack((X, Y, bumps(0.03) - 0.95))[X < 0.62]
    assert rough_plane(points, np.full(len(points), 40.0), REGION, known=False) is None


def test_where_the_path_is_known_to_be_rough_a_single_bump_that_looks_like_a_step_is_none() -> None:
    bump = 0.06 / (1.0 + np.exp(-(X - 0.75) / 0.02))
    assert plane_of(bump) is None
    fit = plane_of(bump, known=True)
    assert fit is not None
    assert np.sqrt(fit.covariance[0, 0]) > 0.05  # a sole on it slopes otherwise than the region


@pytest.mark.parametrize(("thing_m", "left_out"), [(0.15, True), (0.26, False)])
def test_a_small_thing_among_known_bumps_is_left_out_and_a_large_one_makes_the_plane_unsure(
    thing_m: float, left_out: bool
) -> None:
    thing = 0.2 * ((np.abs(X - 0.7) < 0.5 * thing_m) & (np.abs(Y) < 0.5 * thing_m))
    fit, bare = plane_of(bumps(0.015) + thing, known=True), plane_of(bumps(0.015), known=True)
    assert plane_of(bumps(0.015) + thing) is None
    assert fit is not None
    assert bare is not None
    assert (fit.rough_m < 1.3 * bare.rough_m) is left_out
    off_m, middle = fit.plane.abh - bare.plane.abh, np.array([-0.7, 0.0, 1.0])
    assert abs(middle @ off_m) < np.sqrt(middle @ fit.covariance @ middle)
    assert (np.abs(off_m[:2]) < np.sqrt(np.diag(fit.covariance)[:2])).all()


@pytest.mark.long
@pytest.mark.parametrize("seed", [3, 6])
def test_on_bumps_of_5_cm_no_valid_ground_is_wrong_and_most_is_valid(seed: int) -> None:
    bare = over_level(Pace(), "bumps", "nothing on it")
    walk = replace(bare, world=World(bare.world.lap, Relief.of_rms(0.05, 0.15, 7)))
    wearer = SimulatedWearer(seed, walk, START_NS)
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    told = [each for message in wearer.offline_inputs(6.0) for each in pipeline.step(message)]
    grounds = [each for each in told if isinstance(each, GroundPlane) and each.t_exposure_ns > START_NS + 2 * SECOND_NS]
    valid = [each for each in grounds if each.status is Status.VALID]
    assert len(valid) > 0.7 * len(grounds)
    assert sum(errors_of(ground, wearer.truth_of(ground)).wrong for ground in valid) == 0

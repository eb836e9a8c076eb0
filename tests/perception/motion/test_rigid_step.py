"""The rigid motion of points: found to the noise, whatever else moves, and honest about itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages.arrays import FloatArray
from perception.motion.inner_motion import InnerMotion, steady_motion
from perception.motion.rigid_step import PointsInStep, RigidStep, RigidStepSettings, solve

SETTINGS = RigidStepSettings(f_px=175.0)
STEP_S, NOISE_PX, BASELINE_M = 0.05, 0.1, 0.12
KNOWN = np.diag(np.repeat((0.01**2, 0.1**2), 3))
"""The covariance of what is foretold."""


def ground(chance: np.random.Generator, count: int) -> FloatArray:
    """Return points (count, 3) in C of ground about 1.3 m ahead of a camera that looks down at 45°."""
    rays = np.column_stack((chance.uniform(-0.7, 0.7, count), chance.uniform(-0.45, 0.45, count), np.ones(count)))
    points: FloatArray = rays * (0.95 / (0.7071 * (rays[:, 1] + 1.0)))[:, None]
    return points


def seen(chance: np.random.Generator, points: PointsInStep, rates: FloatArray) -> FloatArray:
    moved_C = points.moved(rates)
    noise = chance.normal(0.0, NOISE_PX / SETTINGS.f_px, (moved_C.shape[1], 2))
    noisy: FloatArray = (moved_C[:2] / moved_C[2]).T + noise
    return noisy


def in_step(points_C: FloatArray, inner: InnerMotion) -> PointsInStep:
    rows_s = 0.016 * (points_C[:, 1] / points_C[:, 2])
    return PointsInStep(points_C, BASELINE_M / points_C[:, 2], rows_s, STEP_S + 0.5 * rows_s, inner)


def measured(chance: np.random.Generator, points_C: FloatArray) -> FloatArray:
    """Return the points where a noisy disparity has them."""
    disparity = BASELINE_M / points_C[:, 2]
    noisy: FloatArray = (
        points_C * (disparity / (disparity + chance.normal(0.0, NOISE_PX / SETTINGS.f_px, len(disparity))))[:, None]
    )
    return noisy


def walk(seed: int) -> InnerMotion:
    return steady_motion(np.concatenate((np.random.default_rng([seed, 1]).normal(0.0, 0.5, 3), (0.0, 0.3, 1.0))))


def scene(seed: int, count: int = 80) -> tuple[np.random.Generator, FloatArray, PointsInStep]:
    """Return chance, points (count, 3) and how they move on a walk."""
    chance = np.random.default_rng(seed)
    points_C = ground(chance, count)
    return chance, points_C, in_step(points_C, walk(seed))


def square(found: RigidStep, rates: FloatArray) -> float:
    """Return χ² of six."""
    error = found.rates - rates
    return float(error @ np.linalg.solve(found.covariance, error))


def test_the_stated_covariance_is_that_of_the_errors() -> None:
    squares = []
    for seed in range(60):
        chance, points_C, points = scene(seed)
        rates = chance.normal(0.0, np.sqrt(np.diag(KNOWN)))
        shown = seen(chance, points, rates)
        found = solve(in_step(measured(chance, points_C), walk(seed)), shown, KNOWN, SETTINGS)
        assert found is not None
        assert found.likely
        squares.append(square(found, rates))
    assert 0.7 < np.mean(squares) / 6.0 < 1.5


@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.0, 0.6))
@settings(max_examples=40, deadline=None)
def test_what_stays_with_the_wearer_does_not_mislead(seed: int, share: float) -> None:
    chance, points_C, points = scene(seed)
    rates = chance.normal(0.0, 0.5 * np.sqrt(np.diag(KNOWN)))
    shown = seen(chance, points, rates)
    worn = chance.random(len(shown)) < share
    shown[worn] = points_C[worn, :2] / points_C[worn, 2:]
    found = solve(points, shown, KNOWN, SETTINGS)
    assert found is not None
    assert np.abs(found.rates[3:] - rates[3:]).max() < 0.1
    assert np.abs(found.rates[:3] - rates[:3]).max() < 0.08


def test_of_two_motions_half_a_pixel_apart_the_one_that_is_foretold_is_told() -> None:
    """What fits both is neither's, and turns: a wearer sets off at 0.15 m/s, and 45 % of the points with them."""
    foretold = np.diag(np.repeat((0.002**2, 0.003**2), 3))
    squares = []
    for seed in range(20):
        chance = np.random.default_rng(seed)
        points_C = ground(chance, 80)
        points_C = points_C[np.argsort(points_C[:, 1] / points_C[:, 2])]
        points = in_step(points_C, steady_motion(np.array([0.0, 0.0, 0.0, 0.0, 0.045, 0.15])))
        rates = chance.normal(0.0, np.sqrt(np.diag(foretold)))
        moved_C = points.moved(rates)
        shown = (moved_C[:2] / moved_C[2]).T
        shown[:36] = points_C[:36, :2] / points_C[:36, 2:]
        shown += chance.normal(0.0, 0.05 / SETTINGS.f_px, shown.shape)
        found = solve(points, shown, foretold, SETTINGS)
        assert found is not None
        squares.append(square(found, rates) / 6.0)
    assert max(squares) < 6.0


@pytest.mark.parametrize("rate_radps", [0.3, 1.0, 2.0])
def test_a_motion_that_all_points_share_wins_over_what_was_foretold(rate_radps: float) -> None:
    chance, _, points = scene(3)
    rates = np.array([0.0, rate_radps, 0.0, 0.1, 0.0, -0.2])
    found = solve(points, seen(chance, points, rates), KNOWN, SETTINGS)
    assert found is not None
    assert not found.likely
    assert square(found, rates) < 40.0


def test_few_points_do_not_refute_what_was_foretold_and_fewer_tell_nothing() -> None:
    rates = np.array([0.0, 1.0, 0.0, 0.1, 0.0, -0.2])
    chance, _, points = scene(4, count=20)
    assert solve(points, seen(chance, points, rates), KNOWN, SETTINGS) is None
    assert solve(points, seen(chance, points, np.zeros(6)), KNOWN, SETTINGS) is not None
    chance, _, points = scene(4, count=10)
    assert solve(points, seen(chance, points, np.zeros(6)), KNOWN, SETTINGS) is None


def test_points_that_share_no_motion_tell_nothing() -> None:
    chance, _, points = scene(5)
    assert solve(points, chance.uniform(-0.5, 0.5, (80, 2)), None, SETTINGS) is None
    behind = in_step(ground(chance, 30) * np.array([1.0, 1.0, -1.0]), steady_motion(np.zeros(6)))
    assert solve(behind, np.zeros((30, 2)), None, SETTINGS) is None

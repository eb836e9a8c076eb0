"""Corners that follow what a floor mirrors err alike, and their noise does not tell by how much; corners of another
instant err as well, but by rows."""

from itertools import pairwise

import numpy as np
import pytest

from messages.arrays import FloatArray
from perception.motion.inner_motion import steady_motion
from perception.motion.mirrored import LEAST_CORNERS, Disagreement, Mirrored, disagreement
from perception.motion.rigid_step import RigidStep, solve
from tests.perception.motion.test_rigid_step import KNOWN, SETTINGS, STEP_S, ground, in_step, measured, scene, seen

FRAMES = 40
ONWARDS = steady_motion(np.array((0.0, 0.0, 0.0, 0.0, 0.8, 0.8)))
SHARE = 0.8
"""Of the corners, in whose window something mirrored moves."""


def steps(*, mirrored: bool) -> list[RigidStep]:
    """Return steps whose motion is what was foretold; where the floor mirrors lamps, corners with one lag behind along
    the way by up to 2 px, most of them by little."""
    found = []
    for seed in range(FRAMES):
        chance, points_C, _ = scene(seed, 60)
        points = in_step(points_C, ONWARDS)
        shown = seen(chance, points, np.zeros(6))
        if mirrored:
            lag_px = np.where(chance.random(len(shown)) < SHARE, chance.exponential(0.7, len(shown)), 0.0)
            shown[:, 1] -= np.minimum(lag_px, 2.0) / SETTINGS.f_px
        step = solve(in_step(measured(chance, points_C), ONWARDS), shown, KNOWN, SETTINGS)
        assert step is not None
        found.append(step)
    return found


def torn_steps() -> list[RigidStep]:
    """Return steps of a camera that sways, of whose pictures the lower half is always that of the frame before."""
    found = []
    for seed in range(FRAMES):
        chance, points_C, _ = scene(seed, 100)
        points = in_step(points_C, ONWARDS)
        sway, before = (
            np.array((0.15 * np.sin(1.6 * k), 0.1 * np.cos(1.6 * k), 0.0, 0.0, 0.0, 0.0)) for k in (seed, seed - 1)
        )
        shown = seen(chance, points, sway)
        lower = points_C[:, 1] > 0.08 * points_C[:, 2]
        shown[lower] = seen(chance, points, before)[lower]
        step = solve(in_step(measured(chance, points_C), ONWARDS), shown, KNOWN, SETTINGS)
        if step is not None:
            found.append(step)
    return found


def covariances(found: list[RigidStep], *, alike: bool) -> FloatArray:
    """Return what each step states (n, 6, 6), of turn and travel at a metre's depth."""
    floor, stated = Mirrored(), []
    for step in found:
        floor.add(step.disagreeing, step.noise)
        c = floor.common_error / STEP_S if alike else 0.0
        stated.append(step.covariance + c**2 * np.eye(6))
    return np.array(stated)


def sigmas_of_the_mean(found: list[RigidStep], *, alike: bool) -> float:
    """Return by how many deviations the mean turn of all but the first steps is off, as one finds who takes their
    errors for independent."""
    errors = np.array([step.rates[:3] for step in found])[10:]
    stated = covariances(found, alike=alike)[10:, :3, :3].mean(axis=0) / len(errors)
    return float(np.sqrt(errors.mean(axis=0) @ np.linalg.solve(stated, errors.mean(axis=0)) / 3.0))


def test_on_a_floor_that_mirrors_lamps_errors_that_corners_share_are_stated() -> None:
    found = steps(mirrored=True)
    assert sigmas_of_the_mean(found, alike=False) > 2.5
    assert sigmas_of_the_mean(found, alike=True) < 1.5


def test_on_any_other_floor_it_is_what_it_was() -> None:
    found = steps(mirrored=False)
    np.testing.assert_array_equal(covariances(found, alike=True), covariances(found, alike=False))


def test_in_torn_pictures_nothing_is_allowed_for() -> None:
    found = torn_steps()
    assert len(found) > 0.5 * FRAMES
    assert np.mean([step.disagreeing.share for step in found]) > 2.0 * Mirrored.usual_share
    np.testing.assert_array_equal(covariances(found, alike=True), covariances(found, alike=False))


def test_how_rows_divide_those_that_disagree() -> None:
    rows = np.random.default_rng(3).permutation(40).astype(np.float64)
    assert disagreement(rows < 20, rows) == Disagreement(0.5, 1.0)
    assert disagreement(rows >= 26, rows) == Disagreement(0.65, 1.0)
    assert disagreement(rows % 2 == 0, rows).by_rows < 0.15
    assert disagreement(rows >= 0, rows) == Disagreement(0.0, 0.0)
    few = LEAST_CORNERS - 1
    assert disagreement(rows[:few] < 0, rows[:few]) == Disagreement(1.0, 0.0)
    assert disagreement(rows[:0] < 0, rows[:0]) == Disagreement(0.0, 0.0)


def test_corners_are_said_to_err_alike_by_more_the_more_of_them_disagree_and_the_larger_their_noise() -> None:
    def after(disagreeing: float, noise: float) -> float:
        floor = Mirrored()
        for _ in range(50):
            floor.add(Disagreement(disagreeing, by_rows=0.4), noise)
        return floor.common_error

    assert after(Mirrored.usual_share, 1e-3) == 0.0
    told = [after(share, 1e-3) for share in (0.12, 0.2, 0.3)]
    assert all(less < more for less, more in pairwise(told))
    assert after(0.2, 2e-3) == pytest.approx(2.0 * after(0.2, 1e-3), rel=1e-3)


def test_a_body_beside_the_ground_is_no_disagreement() -> None:
    """A trolley moves with the wearer: its corners are farther from the ground's motion than any that disagree."""
    chance = np.random.default_rng(5)
    points_C = np.vstack((ground(chance, 50), ground(chance, 20) * 0.6))
    points = in_step(points_C, ONWARDS)
    shown = seen(chance, points, np.zeros(6))
    shown[50:] = points_C[50:, :2] / points_C[50:, 2:]
    step = solve(points, shown, KNOWN, SETTINGS)
    assert step is not None
    assert step.disagreeing.share < Mirrored.usual_share

"""What stands on the ground is left out of it; a step is not, however it is met."""

import numpy as np
import pytest

from messages.arrays import BoolArray, FloatArray
from perception.ground.foothold import FootholdSettings
from perception.ground.things import is_ground

REGION = FootholdSettings().region


def ground() -> FloatArray:
    x, y = np.meshgrid(np.arange(0.405, 1.0, 0.01), np.arange(-0.295, 0.3, 0.01))
    return np.column_stack((x.ravel(), y.ravel(), np.random.default_rng(3).normal(0.0, 0.003, x.size)))


def told(points: FloatArray) -> BoolArray:
    return is_ground(points, points[:, 2], np.abs(points[:, 2]) < 0.012, REGION)


def test_a_level_region_is_all_ground() -> None:
    assert told(ground()).all()


@pytest.mark.parametrize("left_m", [-0.2, 0.0, 0.15])
@pytest.mark.parametrize("ahead_m", [0.5, 0.7, 0.9])
def test_a_post_and_its_surroundings_are_left_out(ahead_m: float, left_m: float) -> None:
    points = ground()
    points = points[~((np.abs(points[:, 1] - left_m) < 0.05) & (points[:, 0] > ahead_m))]  # hidden behind it
    z, y = (each.ravel() for each in np.meshgrid(np.arange(0.01, 0.25, 0.01), left_m + np.arange(-0.045, 0.05, 0.01)))
    post = np.column_stack((np.full(len(z), ahead_m), y, z))
    both = np.vstack((points, post))
    found = told(both)
    assert not found[len(points) :][z > 0.03].any()
    assert found[: len(points)].mean() > 0.85


def test_a_pair_of_shoes_is_left_out() -> None:
    points = ground()
    on_shoe = (np.abs(points[:, 0] - 0.7) < 0.13) & (np.abs(np.abs(points[:, 1]) - 0.07) < 0.05)
    points[on_shoe, 2] += 0.09
    assert not told(points)[on_shoe].any()


@pytest.mark.parametrize("rise_m", [0.06, 0.15, -0.15])
@pytest.mark.parametrize("yaw_deg", [-35.0, -10.0, 0.0, 20.0, 35.0, 90.0])
@pytest.mark.parametrize("from_m", [0.6, 0.72, 0.8])
def test_a_step_is_ground(rise_m: float, yaw_deg: float, from_m: float) -> None:
    points, yaw = ground(), np.radians(yaw_deg)
    along = (points[:, 0] - 0.7) * np.cos(yaw) + points[:, 1] * np.sin(yaw)
    points[along > from_m - 0.7, 2] += rise_m
    assert told(points).all()


def test_chance_matches_below_the_ground_are_left_out_and_a_hole_is_not() -> None:
    points, chance = ground(), np.random.default_rng(5)
    there = (points[:, 0] < 0.55) & (chance.random(len(points)) < 0.3)
    scattered = points.copy()
    scattered[there, 2] -= chance.uniform(0.04, 0.25, there.sum())
    assert not told(scattered)[there].any()
    step_down = points.copy()
    step_down[points[:, 0] < 0.55, 2] -= 0.15
    assert told(step_down).all()


def test_bumps_of_rough_ground_are_ground() -> None:
    points = ground()
    points[:, 2] = 0.03 * np.sin(25.0 * points[:, 0]) * np.cos(22.0 * points[:, 1])
    assert told(points).all()


def test_where_most_would_be_a_thing_all_may_be_ground() -> None:
    points = ground()
    points[points[:, 0] < 0.74, 2] += np.random.default_rng(1).uniform(0.03, 0.25, (points[:, 0] < 0.74).sum())
    assert told(points).all()

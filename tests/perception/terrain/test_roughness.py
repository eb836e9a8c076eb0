"""Roughness of paths whose geometry is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.terrain.kinds import ROUGH_M
from perception.terrain.path_points import PathPoints
from perception.terrain.profile import profile_of
from perception.terrain.roughness import Roughness
from perception.terrain.surfaces import find_surfaces
from tests.bench.path_scene import flight, points_seen

WIDTH_M = 0.5


def added(roughness: Roughness, points: PathPoints, yaw_rad: float = 0.0, ahead_m: float = 0.0) -> float:
    profile = profile_of(points, yaw_rad, WIDTH_M)
    roughness.add(points, profile, find_surfaces(profile), yaw_rad, ahead_m)
    return roughness.rough_m


def bumpy(rms_m: float, way_m: float = 0.0) -> PathPoints:
    ground = points_seen([(-1.0, 0.0, 6.0, 0.0)])
    bumps = 2.0 * np.sin((ground.x_m + way_m) / 0.06) * np.sin(ground.y_m / 0.06)
    return replace(ground, z_m=ground.z_m + rms_m * bumps)


def shared_noise(points: PathPoints, seed: int, rms_m: float) -> PathPoints:
    """Return points of which those within 5 cm of each other err alike, as where little texture is matched."""
    cell = np.unique(np.floor(np.stack((points.x_m, points.y_m)) / 0.05), axis=1, return_inverse=True)[1].ravel()
    errors = np.random.default_rng(seed).standard_normal(cell.max() + 1)[cell]
    return replace(points, z_m=points.z_m + rms_m * errors)


@pytest.mark.parametrize("rms_m", [0.012, 0.03])
def test_bumps_across_the_path_are_roughness(rms_m: float) -> None:
    assert added(Roughness(), bumpy(rms_m)) > max(0.4 * rms_m, ROUGH_M)


def test_stairs_are_none() -> None:
    assert added(Roughness(), points_seen(flight(0.6, 0.15, 0.3, 3), yaw_rad=0.2), 0.2) < 0.5 * ROUGH_M


def test_a_riser_that_crosses_the_path_askew_does_not_tilt_the_floor_before_it() -> None:
    """Its middle stands over the floor on one side of the path and under what the profile says there on the other."""
    below = points_seen(flight(1.0, 0.19, 0.3, 3), yaw_rad=math.radians(8.0))
    assert added(Roughness(), below) < 0.5 * ROUGH_M


@pytest.mark.parametrize("noise_px", [0.05, 0.1, 0.15])
def test_the_matchers_noise_on_ground_far_below_is_none(noise_px: float) -> None:
    """From a landing one looks down on the next: its distance makes the noise larger, not the ground rough."""
    below: list[tuple[float, float, float, float]] = [(-1.0, -0.35, 6.0, -0.35)]
    assert added(Roughness(), points_seen(below, noise_px=noise_px)) < ROUGH_M


def test_the_foot_of_a_ramp_met_at_an_angle_is_none() -> None:
    slope = math.tan(math.radians(10.0))
    ramp = points_seen([(-1.0, 0.0, 0.8, 0.0), (0.8, 0.0, 4.0, 3.2 * slope)], yaw_rad=math.radians(30.0))
    assert added(Roughness(), ramp) < ROUGH_M


def test_what_hides_the_ground_for_a_few_frames_changes_nothing() -> None:
    roughness = Roughness()
    even, leg = points_seen([(-1.0, 0.0, 6.0, 0.0)]), bumpy(0.03)
    for _ in range(9):
        added(roughness, even)
    assert max(added(roughness, leg) for _ in range(4)) < ROUGH_M
    for _ in range(5):
        added(roughness, leg)
    assert roughness.rough_m > ROUGH_M


def test_a_surface_that_shows_little_is_not_rough_by_its_noise() -> None:
    """Pixels side by side share what they are matched by, and so their errors: half of those of a pixel, as here."""
    even = points_seen([(-1.0, 0.0, 6.0, 0.0)])
    own = 0.012 * np.random.default_rng(3).standard_normal(len(even.z_m))
    noisy = shared_noise(replace(even, z_m=even.z_m + own), 4, 0.006)
    assert added(Roughness(), noisy) < ROUGH_M


def test_chance_matches_far_off_the_ground_are_no_bumps() -> None:
    even = points_seen([(-1.0, 0.0, 6.0, 0.0)])
    chance = np.random.default_rng(4).random(len(even.z_m)) < 0.25
    assert added(Roughness(), replace(even, z_m=even.z_m + 0.3 * chance)) < ROUGH_M


def test_rough_ground_stays_so_for_a_second_where_most_frames_show_too_little() -> None:
    roughness, bumps = Roughness(), bumpy(0.03)
    for _ in range(4):
        added(roughness, bumps)
    untold = [added(roughness, bumps.where(bumps.y_m > 0.2)) for _ in range(30)]
    assert untold[20] > ROUGH_M
    assert untold[-1] == 0.0


def test_without_points_nothing_is_known() -> None:
    assert added(Roughness(), PathPoints(*(np.empty(0) for _ in range(6)))) == 0.0


def test_while_the_camera_walks_only_what_stays_on_the_ground_is_rough() -> None:
    """Errors that neighbouring points share pass for bumps while it stands: they repeat themselves then."""
    walks, stands, even = Roughness(), Roughness(), points_seen([(-1.0, 0.0, 6.0, 0.0)])
    for k in range(9):
        added(walks, shared_noise(even, k, 0.006), ahead_m=0.06)
        added(stands, shared_noise(even, 0, 0.006))
    assert walks.rough_m < ROUGH_M < stands.rough_m


def test_low_bumps_are_rough_under_noise_that_is_larger() -> None:
    walks = Roughness()
    for k in range(9):
        added(walks, shared_noise(bumpy(0.006, 0.06 * k), k, 0.006), ahead_m=0.06)
    assert walks.rough_m > ROUGH_M


def test_frames_between_which_the_way_is_not_known_are_not_compared() -> None:
    walks, even = Roughness(), points_seen([(-1.0, 0.0, 6.0, 0.0)])
    for k in range(9):
        walks.lose_way()
        added(walks, shared_noise(even, k, 0.006), ahead_m=0.06)
    assert walks.rough_m > ROUGH_M

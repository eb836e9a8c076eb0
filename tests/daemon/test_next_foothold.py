"""A rendered walk through the whole pipeline: where and when the prosthetic foot lands, and the ground under it."""

import math

import numpy as np
import pytest

from daemon.pipeline import Pipeline
from messages import GroundPlane, Reason, Side, Status, Terrain, full_matrix
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.terrain_walks import STANDING_S, terrain_walk
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
AHEAD_S = 0.25

Told = list[tuple[GroundPlane, Terrain]]


def walked(seed: int, side: Side) -> tuple[SimulatedWearer, Told]:
    """Return who walked, and ground and terrain of each frame once the walk has begun."""
    walk = terrain_walk(seed)
    wearer = SimulatedWearer(seed, walk.scenario, START_NS)
    pipeline, told = Pipeline(wearer.calibration, FootholdSettings(side=side)), []
    grounds: dict[int, GroundPlane] = {}
    for message in wearer.offline_inputs(walk.seconds):
        for estimate in pipeline.step(message):
            if isinstance(estimate, GroundPlane):
                grounds[estimate.t_exposure_ns] = estimate
            elif isinstance(estimate, Terrain) and estimate.t_exposure_ns > START_NS + 1e9 * STANDING_S:
                told.append((grounds[estimate.t_exposure_ns], estimate))
    return wearer, told


@pytest.mark.long
def test_on_level_ground_the_landing_is_known_a_quarter_of_a_second_before() -> None:
    wearer, told = walked(14, Side.LEFT)
    off: dict[int, tuple[float, float, float]] = {}
    for _, terrain in told:
        truth = wearer.terrain(terrain.t_exposure_ns, Side.LEFT)
        true, said = truth.foothold, terrain.foothold
        assert true is not None
        ahead_s = 1e-9 * (true.t_land_ns - truth.t_true_ns)
        if AHEAD_S <= ahead_s < AHEAD_S + 0.05 and math.isfinite(said.ahead_m):
            assert said.side is Side.LEFT
            late_s = said.time_to_contact_s - ahead_s
            off[true.t_land_ns] = (said.ahead_m - true.ahead_m, said.left_m - true.left_m, late_s)
    assert len(off) >= 5
    ahead_m, left_m, late_s = np.abs(list(off.values())).mean(axis=0)
    assert ahead_m < 0.06
    assert left_m < 0.04
    assert late_s < 0.03


@pytest.mark.long
@pytest.mark.parametrize(("seed", "way"), [(15, 1.0), (6, -1.0)])
def test_on_stairs_the_plane_is_that_of_the_tread_on_which_the_foot_lands(seed: int, way: float) -> None:
    wearer, told = walked(seed, Side.RIGHT)
    off_m, deviations_m, rises_m = [], [], []
    for ground, terrain in told:
        said = terrain.foothold
        if ground.status is not Status.VALID or not math.isfinite(said.height_m):
            continue
        under = wearer.surface(ground.t_exposure_ns, said.ahead_m, said.left_m)
        if not 0.02 < under.from_edge_m < 0.35:
            continue
        place = np.array([-said.ahead_m, -said.left_m, 1.0])
        plane = (math.tan(said.slope_sagittal_rad), math.tan(said.slope_frontal_rad), said.height_m)
        off_m.append(float(place @ plane) - under.below_m)
        deviations_m.append(math.sqrt(float(place @ full_matrix(ground.covariance) @ place)))
        rises_m.append(said.rise_m)
    assert len(off_m) > 40
    assert np.abs(off_m).mean() < 0.006
    assert np.mean(np.array(deviations_m) < 0.015) > 0.9
    assert np.mean(np.abs(off_m) < 4.0 * np.array(deviations_m)) > 0.99
    assert way * np.nanmedian(rises_m) > 0.1


@pytest.mark.long
def test_who_stands_above_stairs_has_no_ground_that_is_hidden() -> None:
    _, told = walked(12, Side.RIGHT)
    assert all(ground.reason is Reason.OCCLUDED for ground, _ in told[3:])
    assert all(math.isnan(terrain.foothold.ahead_m) for _, terrain in told)

"""What the foothold says of the ground: beside a change of the slope, and beyond the surface that was measured."""

import math
from dataclasses import replace

import numpy as np
import pytest

from messages import GroundPlane, Side, TerrainKind
from perception.gait.gait import Gait, NextSteps
from perception.gait.landing import Landing
from perception.terrain.path_ahead import PathAhead
from perception.terrain.surfaces import Surface
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer
from tests.bench.told_ground import told_edge, told_ground, told_terrain

LEVEL = Surface(0.9, 2.0, 1.4, -0.9, 0.0, 0.001, 0.001)
RAMP_TO_LEVEL = PathAhead(surfaces=(Surface(0.3, 0.9, 0.6, -0.87, -0.1, 0.001, 0.001), LEVEL))
LEVEL_ALONE = PathAhead(surfaces=(LEVEL,))


def ground_at(frame: int, ahead_m: float = 0.8) -> GroundPlane:
    return told_ground(frame, 0.9, (1e-8, 0.0, 0.0, 1e-8, 0.0, 1e-8), ahead_m)


def gait() -> Gait:
    return Gait(SimulatedWearer(1, scenario("level"), 0).calibration, np.eye(3), Side.RIGHT)


def landing_at(ahead_m: float) -> NextSteps:
    return NextSteps(Landing(ahead_m, 0.03, 0.0, 0.02, 0.4, 0.02, 0.6))


def test_a_bend_that_has_passed_out_of_the_picture_is_told_until_the_foot_is_there() -> None:
    walk = gait()

    def slopes_sd_rad(frame: int, path: PathAhead) -> tuple[float, float]:
        told = walk.foothold(landing_at(0.8), ground_at(frame), path, TerrainKind.LEVEL)
        return told.slope_sagittal_sd_rad, told.slope_frontal_sd_rad

    beside = [slopes_sd_rad(frame, RAMP_TO_LEVEL) for frame in range(20)]
    after = [slopes_sd_rad(frame, LEVEL_ALONE) for frame in range(20, 50)]
    for along, across in (*beside, after[20]):
        assert math.isclose(along, 0.05, rel_tol=1e-3)
        assert math.isclose(across, 0.47 * 0.05, rel_tol=1e-3)
    assert max(after[-1]) < 1e-3


@pytest.mark.parametrize(("edge_m", "known"), [(0.75, False), (0.95, True), (None, True)])
def test_no_height_is_told_beyond_an_edge_that_the_frame_itself_shows(edge_m: float | None, known: bool) -> None:
    terrain = told_terrain(TerrainKind.LEVEL, () if edge_m is None else (told_edge(edge_m, -0.18),))
    path = PathAhead(surfaces=(replace(LEVEL, from_m=0.3),))
    told = gait().with_foothold(terrain, landing_at(0.82), ground_at(0, ahead_m=0.7), path)
    assert math.isfinite(told.foothold.height_m) is known


def test_no_height_is_told_beyond_the_end_of_a_surface() -> None:
    path = PathAhead(surfaces=(replace(LEVEL, from_m=0.3, to_m=0.8),))
    for ahead_m, known in ((0.78, True), (0.82, False)):
        told = gait().foothold(landing_at(ahead_m), ground_at(0, ahead_m=0.7), path, TerrainKind.LEVEL)
        assert math.isfinite(told.height_m) is known


def test_beyond_the_region_what_slope_nobody_could_see_yet_is_stated() -> None:
    path = PathAhead(surfaces=(replace(LEVEL, from_m=0.3),))
    stated = []
    for ahead_m in (0.94, 1.2, 1.6):
        terrain = gait().with_foothold(told_terrain(TerrainKind.LEVEL, ()), landing_at(ahead_m), ground_at(0), path)
        foothold = terrain.foothold
        stated.append((foothold.slope_sagittal_sd_rad, foothold.slope_frontal_sd_rad, foothold.rise_sd_m))
    assert stated[0][0] < 1e-3
    for ahead_m, (along, across, _) in zip((1.2, 1.6), stated[1:], strict=True):
        assert along == pytest.approx(0.5 * path.hidden_bend(ahead_m, 0.0), rel=0.01)
        assert across == pytest.approx(along, rel=0.01)
    assert stated[2][0] > 2.0 * stated[1][0] > 4e-3

"""Rendered walks through the whole pipeline: the terrain that is told of them, against the truth."""

import math

import pytest

from daemon.pipeline import Pipeline
from messages import GroundPlane, Reason, Status, Terrain, TerrainKind
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.walk.terrain_walks import terrain_walk
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "kind"), [(1, TerrainKind.STAIRS_UP), (12, TerrainKind.STAIRS_DOWN)], ids=["below stairs", "above stairs"]
)
def test_edges_before_a_flight_are_told_where_they_are(seed: int, kind: TerrainKind) -> None:
    walk = terrain_walk(seed)
    wearer = SimulatedWearer(seed, walk.scenario, START_NS)
    pipeline, checked, kinds = Pipeline(wearer.calibration, FootholdSettings()), 0, list[TerrainKind]()
    for message in wearer.offline_inputs(3.5):
        for told in pipeline.step(message):
            if not isinstance(told, Terrain) or told.t_exposure_ns < START_NS + 2_000_000_000:
                continue
            assert told.status is Status.VALID
            kinds.append(told.kind)
            for edge in told.edges:
                true = min(wearer.terrain(told.t_exposure_ns).edges, key=lambda e: abs(e.distance_m - edge.distance_m))
                assert edge.distance_m == pytest.approx(true.distance_m, abs=0.05)
                assert math.copysign(1.0, edge.rise_m) == math.copysign(1.0, true.rise_m)
                if edge.bound_only:
                    assert true.rise_m <= edge.rise_m + 0.01
                else:
                    assert edge.rise_m == pytest.approx(true.rise_m, abs=0.03)
                checked += 1
    assert checked > 20
    assert max(set(kinds), key=kinds.count) is kind


@pytest.mark.long
def test_on_tiles_all_alike_no_path_is_told_that_is_tiles_off_nor_does_the_ground_follow_one() -> None:
    """The floor is level; two tiles further along the rows the path lies 0.7 m deeper."""
    wearer = SimulatedWearer(1, scenario("mosaic-2.5cm"), START_NS)
    pipeline, refused, valid = Pipeline(wearer.calibration, FootholdSettings()), 0, 0
    for message in wearer.offline_inputs(4.6):
        for told in pipeline.step(message):
            if isinstance(told, Terrain) and told.status is Status.VALID:
                assert (told.kind, told.edges) == (TerrainKind.LEVEL, ())
            elif isinstance(told, Terrain):
                refused += told.reason is Reason.LOW_TEXTURE
            elif isinstance(told, GroundPlane) and told.status is Status.VALID:
                assert told.height_m == pytest.approx(wearer.truth_of(told).height_m, abs=0.02)
                valid += 1
    assert refused > 30
    assert valid > 25

"""The simple estimators of the ground ahead on profiles made up by hand, and on one walk of the rig."""

from collections.abc import Callable

import numpy as np
import pytest

from lab.baselines.elevation_grid import GridTerrain
from lab.baselines.terrain_peers import ColumnMedians, jumps, kind_of, medians
from lab.evaluation.terrain_said import TerrainEstimator
from messages import Calibration
from messages.arrays import FloatArray
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

PLACES: FloatArray = np.linspace(0.31, 2.49, 110)


def profile(*steps: tuple[float, float]) -> FloatArray:
    """Return the heights (110,) of level ground 0.9 m below that rises by each (at, rise)."""
    heights: FloatArray = np.full(110, -0.9)
    for at, rise in steps:
        heights[at < PLACES] += rise
    return heights


def test_medians_bear_outliers_and_leave_out_what_is_hardly_seen() -> None:
    x = np.repeat(PLACES[:4], 9)
    z = np.repeat([-0.9, -0.8, -0.7, -0.6], 9)
    z[[0, 1, 9, 10, 30, 31, 32, 33]] = (3.0, -5.0, 7.0, 0.0, *[np.nan] * 4)
    d, heights = medians(x, z)
    np.testing.assert_allclose(d, PLACES[:3])
    np.testing.assert_allclose(heights, [-0.9, -0.8, -0.7])


@pytest.mark.parametrize(
    "steps", [((1.0, 0.15),), ((1.0, -0.15),), ((0.8, 0.17), (1.1, 0.17)), ((0.7, -0.12), (1.3, 0.08))]
)
def test_jumps_are_edges_with_their_rises(steps: tuple[tuple[float, float], ...]) -> None:
    edges = jumps(PLACES, profile(*steps))
    assert [edge.distance_m for edge in edges] == pytest.approx([at for at, _ in steps], abs=0.011)
    assert [edge.rise_m for edge in edges] == pytest.approx([rise for _, rise in steps])


def test_what_a_lip_hides_is_skipped_and_slopes_are_no_edges() -> None:
    z = profile((1.0, -0.15))
    seen = (PLACES < 1.0) | (PLACES > 1.2)
    (edge,) = jumps(PLACES[seen], z[seen])
    assert edge.distance_m == pytest.approx(1.0, abs=0.011)
    assert edge.rise_m == pytest.approx(-0.15)
    assert jumps(PLACES, -0.9 + 0.2 * PLACES) == ()
    assert jumps(PLACES[:1], PLACES[:1]) == jumps(PLACES[:0], PLACES[:0]) == ()


@pytest.mark.parametrize(
    ("z", "kind"),
    [
        (profile(), "level"),
        (profile((0.6, 0.1)), "step_up"),
        (profile((1.2, 0.1)), "level"),
        (profile((0.6, -0.1), (0.9, -0.1)), "stairs_down"),
        (-0.9 + 0.1 * PLACES, "ramp_up"),
        (-0.9 - 0.1 * PLACES, "ramp_down"),
        (-0.9 + 0.02 * np.sin(25.0 * PLACES), "rough"),
    ],
)
def test_kinds_follow_edges_slope_and_roughness(z: FloatArray, kind: str) -> None:
    assert kind_of(PLACES, z, jumps(PLACES, z)) == kind


@pytest.mark.parametrize("peer", [ColumnMedians, GridTerrain])
def test_before_a_kerb_the_rig_and_its_peers_agree(peer: Callable[[Calibration], TerrainEstimator]) -> None:
    ground = WorldBuilder().level(0.8, "gravel").step(0.14, "kerbstone").level(6.0, "brick").step(-0.14, "kerbstone")
    walk = Scenario("kerb", "", ground.level(2.0, "gravel").build(), (Stand(60.0),), hip_height_m=0.9)
    wearer = SimulatedWearer(5, walk, 10_000_000_000)
    estimator = peer(wearer.calibration)
    said = [terrain for message in wearer.offline_inputs(1.7) for terrain in estimator.step(message)]
    assert said
    true = wearer.terrain(said[-1].t_exposure_ns)
    assert said[-1].kind == true.kind == "step_up"
    (edge,) = said[-1].edges
    assert edge.distance_m == pytest.approx(true.edges[0].distance_m, abs=0.03)
    assert edge.rise_m == pytest.approx(0.14, abs=0.015)
    assert said[-1].foothold is not None
    assert said[-1].foothold.height_m == pytest.approx(wearer.surface(true.t_exposure_ns, 0.7, 0.0).below_m, abs=0.01)

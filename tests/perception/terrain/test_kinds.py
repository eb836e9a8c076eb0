"""What kind of ground edges and surfaces make."""

import math
from dataclasses import replace

import pytest

from messages import TerrainKind
from perception.terrain.edges import Edge
from perception.terrain.kinds import higher_than_bumps, kind_of
from perception.terrain.path_ahead import PathAhead
from tests.perception.terrain.test_memory import RISER, STRAIGHT_ON


def edges(*at: tuple[float, float]) -> list[Edge]:
    return [replace(RISER, distance_m=distance_m, rise_m=rise_m) for distance_m, rise_m in at]


@pytest.mark.parametrize(
    ("slope_deg", "kind"),
    [(0.0, TerrainKind.LEVEL), (4.0, TerrainKind.RAMP_UP), (-4.0, TerrainKind.RAMP_DOWN)],
)
def test_without_edges_the_slope_decides(slope_deg: float, kind: TerrainKind) -> None:
    found, probability = kind_of([replace(STRAIGHT_ON, slope=math.tan(math.radians(slope_deg)))], [], 0.001)
    assert found is kind
    assert probability > 0.95


def test_near_the_bound_it_is_not_sure() -> None:
    found, probability = kind_of([replace(STRAIGHT_ON, slope=math.tan(math.radians(1.5)))], [], 0.001)
    assert found in (TerrainKind.LEVEL, TerrainKind.RAMP_UP)
    assert probability == pytest.approx(0.5, abs=0.05)


def test_on_rough_ground_neither_bends_nor_edges_as_high_as_bumps_are_borders() -> None:
    rising = replace(STRAIGHT_ON, from_m=STRAIGHT_ON.to_m, to_m=STRAIGHT_ON.to_m + 1.0, slope=0.1)
    path = PathAhead(tuple(higher_than_bumps(edges((0.7, 0.06), (1.2, 0.3)), 0.12)), (STRAIGHT_ON, rising))
    assert path.borders_m(0.0) == pytest.approx([1.2, STRAIGHT_ON.to_m])
    assert replace(path, rough=True).borders_m(0.0) == [1.2]


def test_bumps_are_rough() -> None:
    assert kind_of([STRAIGHT_ON], edges((0.7, 0.06)), 0.012)[0] is TerrainKind.ROUGH


@pytest.mark.parametrize(
    ("at", "kind"),
    [
        ([(0.7, 0.12)], TerrainKind.STEP_UP),
        ([(0.7, -0.12)], TerrainKind.STEP_DOWN),
        ([(0.5, 0.17), (0.8, 0.17)], TerrainKind.STAIRS_UP),
        ([(0.5, -0.17), (0.8, -0.17), (1.1, -0.17)], TerrainKind.STAIRS_DOWN),
        ([(0.4, 0.12), (0.8, -0.12)], TerrainKind.STEP_DOWN),
        ([(1.6, 0.17), (1.9, 0.17)], TerrainKind.LEVEL),
    ],
)
def test_edges_decide_near_them(at: list[tuple[float, float]], kind: TerrainKind) -> None:
    assert kind_of([STRAIGHT_ON], edges(*at), 0.001)[0] is kind


def test_where_nothing_is_seen_nothing_is_said() -> None:
    assert kind_of([], [], 0.0) == (TerrainKind.UNKNOWN, 1.0)

"""Drops of a flight told together: what is far is told as what is near, and what is near as it is measured."""

from dataclasses import replace

import pytest

from perception.terrain.edges import Edge
from perception.terrain.flight import drops_alike

FB_PX_M = 42.0
DROP = Edge(0.6, 0.005, -0.17, 0.003, 0.0, 0.01)


def drops(*rises_m: float, tread_m: float = 0.3) -> list[Edge]:
    return [replace(DROP, distance_m=0.6 + k * tread_m, rise_m=rise_m) for k, rise_m in enumerate(rises_m)]


def told(edges: list[Edge]) -> list[Edge]:
    return drops_alike(edges, 0.95, FB_PX_M)


def test_a_far_drop_that_errs_is_told_as_those_before_it_and_how_far_it_may_err_is_stated() -> None:
    *near, far = told(drops(-0.17, -0.17, -0.17, -0.17, -0.145))
    assert [edge.rise_m for edge in near] == pytest.approx([-0.17] * 4, abs=1e-6)
    assert -0.17 < far.rise_m < -0.157
    assert abs(far.rise_m + 0.17) < 2.0 * far.rise_sd_m
    assert near[0].rise_sd_m < 0.006


def test_a_near_drop_that_is_no_like_the_others_is_told_as_it_is() -> None:
    edges = [replace(edge, distance_m=edge.distance_m - 0.75) for edge in drops(-0.17, -0.17, -0.17, -0.10)]
    last = told(edges)[-1]
    assert last.distance_m == pytest.approx(0.75)
    assert last.rise_m == pytest.approx(-0.10, abs=0.008)


@pytest.mark.parametrize(
    "edges",
    [
        drops(0.17, 0.17, 0.17, 0.14),
        drops(-0.17, -0.17, -0.14, tread_m=0.6),
        [*drops(-0.17, -0.17), replace(DROP, distance_m=1.2, rise_m=-0.08, bound_only=True)],
        drops(-0.17, 0.1, -0.14),
    ],
)
def test_risers_up_bounds_and_what_is_no_flight_are_told_as_they_are_measured(edges: list[Edge]) -> None:
    assert [edge.rise_m for edge in told(edges)] == [edge.rise_m for edge in edges]
    assert [edge.rise_sd_m for edge in told(edges) if edge.rise_m > 0.0] == [e.rise_sd_m for e in edges if e.rise_m > 0]

"""What kind of ground the path is: by its edges, where there are some, else by slope and roughness of its surfaces."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from messages import TerrainKind
from perception.terrain.edges import FLIGHT_M, Edge
from perception.terrain.surfaces import Surface

FROM_M, TO_M = 0.3, 1.0
"""Of the path ahead, this part tells the kind."""
BESIDE_EDGE_M = 0.35
"""So far from an edge the ground is that of a step, or of a flight."""
RAMP_RAD = math.radians(1.5)
ROUGH_M = 0.0022
"""Ground that varies by more across the path, one σ, is rough (`roughness`)."""


def kind_of(
    surfaces: Sequence[Surface], edges: Sequence[Edge], rough_m: float, *, undulates: bool = False
) -> tuple[TerrainKind, float]:
    """Return the kind of most of the path from FROM_M to TO_M, and the probability of it.

    `rough_m` is how much the ground varies across the path, one σ; `undulates` whether it does along it.

    The probability is the share of that part that is of this kind, each place by how far its surface is from a bound.
    """
    edges = higher_than_bumps(edges, _OVER_BUMPS * rough_m)
    votes = dict.fromkeys(TerrainKind, 0.0)
    for at_m in np.arange(FROM_M + 0.5 * _CELL_M, TO_M, _CELL_M).tolist():
        for kind, share in _kinds_at(at_m, surfaces, edges, undulates or rough_m > ROUGH_M).items():
            votes[kind] += share
    total = sum(votes.values())
    kind = max(votes, key=votes.__getitem__)
    seen = {each: vote for each, vote in votes.items() if each is not TerrainKind.UNKNOWN}
    if sum(seen.values()) >= _LEAST_SEEN * total:
        kind = max(seen, key=seen.__getitem__)
        total = sum(seen.values())
    return kind, votes[kind] / total


def higher_than_bumps(edges: Sequence[Edge], bumps_m: float) -> list[Edge]:
    """Return those of `edges` that are higher than bumps of `bumps_m`."""
    return [edge for edge in edges if abs(edge.rise_m) > bumps_m]


def _kinds_at(at_m: float, surfaces: Sequence[Surface], edges: Sequence[Edge], rough: bool) -> dict[TerrainKind, float]:
    """Return the kinds that the path may be at a place, with their probabilities."""
    beside = [
        (abs(at_m - middle_m), kind) for kind, middle_m, half_m in _reaches(edges) if abs(at_m - middle_m) <= half_m
    ]
    if beside:
        return {min(beside)[1]: 1.0}
    if rough:
        return {TerrainKind.ROUGH: 1.0}
    there = [s for s in surfaces if s.from_m - _BETWEEN_M <= at_m <= s.to_m + _BETWEEN_M]
    if not there:
        return {TerrainKind.UNKNOWN: 1.0}
    surface = min(there, key=lambda s: max(s.from_m - at_m, at_m - s.to_m))
    slope_rad, sd_rad = math.atan(surface.slope), surface.slope_sd + _SLOPE_COMMON_RAD
    up = 0.5 * math.erfc((RAMP_RAD - slope_rad) / (math.sqrt(2.0) * sd_rad))
    down = 0.5 * math.erfc((RAMP_RAD + slope_rad) / (math.sqrt(2.0) * sd_rad))
    return {TerrainKind.RAMP_UP: up, TerrainKind.RAMP_DOWN: down, TerrainKind.LEVEL: max(0.0, 1.0 - up - down)}


def _reaches(edges: Sequence[Edge]) -> list[tuple[TerrainKind, float, float]]:
    """Return for each edge and each flight the kind, the middle and half the length of the path that it makes its
    own."""
    kinds = [_kind_of_edge(edges, place) for place in range(len(edges))]
    alone = [(kind, edge.distance_m, BESIDE_EDGE_M) for kind, edge in zip(kinds, edges, strict=True)]
    flights = [
        (kind, 0.5 * (one.distance_m + other.distance_m), 0.5 * (other.distance_m - one.distance_m) + BESIDE_EDGE_M)
        for (kind, one), (other_kind, other) in pairwise(zip(kinds, edges, strict=True))
        if kind is other_kind and kind in _FLIGHTS and other.distance_m - one.distance_m < FLIGHT_M
    ]
    return flights + alone


def _kind_of_edge(edges: Sequence[Edge], place: int) -> TerrainKind:
    edge = edges[place]
    beside = (*edges[max(0, place - 1) : place], *edges[place + 1 : place + 2])
    flight = any(
        abs(other.distance_m - edge.distance_m) < FLIGHT_M and other.rise_m * edge.rise_m > 0.0 for other in beside
    )
    if edge.rise_m > 0.0:
        return TerrainKind.STAIRS_UP if flight else TerrainKind.STEP_UP
    return TerrainKind.STAIRS_DOWN if flight else TerrainKind.STEP_DOWN


_FLIGHTS = (TerrainKind.STAIRS_UP, TerrainKind.STAIRS_DOWN)
_CELL_M = 0.05
_BETWEEN_M = 0.06
_LEAST_SEEN = 0.3
_OVER_BUMPS = 20.0
_SLOPE_COMMON_RAD = math.radians(0.3)

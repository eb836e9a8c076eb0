"""The drops of one flight of stairs, told together.

Behind a falling lip a strip of the next tread is seen, the narrower the farther it is, and over its borders the matcher
draws on what is beside it. An error of δ px moves what lies h below the optical centre, s away, by

    e = h s δ / (f B),                                                                                          (1)

up or down, in every frame alike. But stairs are built with risers that are alike to σ_r. With r_k the drop measured, of
the variance P_k + e_k², and m the mean of the drops before it, of the variance σ_m², it is told as

    r = (r_k / (P_k + e_k²) + m / (σ_m² + σ_r²)) / (1 / (P_k + e_k²) + 1 / (σ_m² + σ_r²)),                      (2)

unless both contradict each other.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from perception.terrain.edges import FLIGHT_M, RISERS_APART_M, Edge, common_sd_m


def drops_alike(edges: Sequence[Edge], height_m: float, fB_px_m: float) -> list[Edge]:
    """Return `edges`, in their order along the path, with the drops of a flight as (2) has them, and their deviations.

    The camera is `height_m` above the ground before the first that is ahead.
    """
    told: list[Edge] = []
    flight: list[Edge] = []
    for edge in edges:
        goes_on = bool(flight) and edge.distance_m - flight[-1].distance_m < FLIGHT_M
        if edge.rise_m > 0.0 or edge.bound_only or not goes_on:
            flight = []
        height_m -= edge.rise_m if edge.distance_m > 0.0 else 0.0
        if edge.rise_m < 0.0 and not edge.bound_only:
            edge = _like_those_before(_with_common(edge, height_m, fB_px_m), flight)
            flight.append(edge)
        told.append(edge)
    return told


def _with_common(drop: Edge, height_m: float, fB_px_m: float) -> Edge:
    """Return a drop with the deviation (1) beside its own; the ground below it lies `height_m` below the camera."""
    return replace(drop, rise_sd_m=math.hypot(drop.rise_sd_m, common_sd_m(height_m, drop.distance_m, fB_px_m)))


def _like_those_before(drop: Edge, flight: Sequence[Edge]) -> Edge:
    if len(flight) < _LEAST_DROPS:
        return drop
    weights = [each.rise_sd_m**-2 for each in flight]
    mean_m = sum(weight * each.rise_m for weight, each in zip(weights, flight, strict=True)) / sum(weights)
    prior, own = 1.0 / (1.0 / sum(weights) + RISERS_APART_M**2), drop.rise_sd_m**-2
    if (drop.rise_m - mean_m) ** 2 > _CONTRADICTS**2 * (1.0 / own + 1.0 / prior):
        return drop
    rise_m = (own * drop.rise_m + prior * mean_m) / (own + prior)
    return replace(drop, rise_m=rise_m, rise_sd_m=(own + prior) ** -0.5)


_CONTRADICTS = 2.5
"""Deviations: the last riser of a flight may be another."""
_LEAST_DROPS = 2
"""Before it: a kerb and a step make no flight."""

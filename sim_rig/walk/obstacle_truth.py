"""What is true of the things on the path: where the nearest part of each is, and how high it stands."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray
from sim_rig.walk.own_legs import OwnLegs
from sim_rig.walk.standing_things import Standing
from sim_rig.walk.things import Placed, Thing, Worn
from sim_rig.walk.walker_ahead import WalkerAhead
from sim_rig.walk.walking_aids import Rollator, WhiteCane
from sim_rig.walk.world import World

FROM_GROUND_M = 0.30
"""A block that begins higher over the ground stands on another one, or is carried."""
ONE_THING_M = 0.20
"""Blocks of one thing whose nearest parts are no farther apart along the path are told as one obstacle."""

WITH_THE_WEARER = (OwnLegs, Worn, Rollator, WhiteCane, WalkerAhead)


@dataclass(frozen=True)
class ObstacleTruth:
    """A thing on the path in H: its nearest part there, and how high it rises over the ground.

    `stands` says that it stays where it is, so that it must be told; one that moves with the wearer must not.
    """

    distance_m: float
    left_m: float
    height_m: float
    stands: bool
    moves_with_wearer: bool


def obstacle_of(
    thing: Thing, placed: Iterable[Placed], eye_W: FloatArray, ahead: FloatArray, half_width_m: float, world: World
) -> list[ObstacleTruth]:
    """Return what of a `thing`, whose blocks are `placed` at one instant, stands on the path, by distance.

    The path, `half_width_m` wide to either side, runs along `ahead` (2,) in W from the point below `eye_W` (3,).
    """
    parts: list[tuple[float, float, float]] = []
    for block in placed:
        part = _nearest_part(block, eye_W, ahead, half_width_m, world)
        if part is not None:
            parts.append(part)
    obstacles: list[ObstacleTruth] = []
    for distance_m, left_m, height_m in sorted(parts):
        if obstacles and distance_m - obstacles[-1].distance_m < ONE_THING_M:
            before = obstacles[-1]
            obstacles[-1] = ObstacleTruth(
                before.distance_m,
                before.left_m,
                max(before.height_m, height_m),
                before.stands,
                before.moves_with_wearer,
            )
        else:
            stands, follows = isinstance(thing, Standing), isinstance(thing, WITH_THE_WEARER)
            obstacles.append(ObstacleTruth(distance_m, left_m, height_m, stands, follows))
    return obstacles


def _nearest_part(
    placed: Placed, eye_W: FloatArray, ahead: FloatArray, half_width_m: float, world: World
) -> tuple[float, float, float] | None:
    """Return distance and y of a block's nearest part on the path, and the height of its top over the ground."""
    half_m = 0.5 * np.array(placed.block.size_m)
    corners = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij")).reshape(3, -1).T * half_m
    corners_W = placed.p_WT_m[0] + corners @ placed.R_WT[0].T
    ground_m = float(world.heights(placed.p_WT_m[0, :1])[0])
    if corners_W[:, 2].min() - ground_m > FROM_GROUND_M:
        return None
    u = np.linspace(-1.0, 1.0, _SAMPLES)
    foot = np.stack(np.meshgrid(u, u, indexing="ij"), axis=-1).reshape(-1, 2) * half_m[:2]
    bottom_W = placed.p_WT_m[0] + np.column_stack((foot, np.full(len(foot), -half_m[2]))) @ placed.R_WT[0].T
    off = bottom_W[:, :2] - eye_W[:2]
    x, y = off @ ahead, off @ np.array((-ahead[1], ahead[0]))
    on_path = np.abs(y) < half_width_m
    if not on_path.any():
        return None
    distance_m = float(x[on_path].min())
    left_m = float(y[on_path][x[on_path] < distance_m + _NEAREST_PART_M].mean())
    return distance_m, left_m, float(corners_W[:, 2].max()) - ground_m


_SAMPLES = 21
_NEAREST_PART_M = 0.03

"""What else is in the picture besides the ground: blocks that the wearer carries or pushes, and people who cross.

Every thing is made of blocks. A block has a frame T, its origin the block's centre, whose pose in W is a function of
time, so that each row of a rolling shutter finds it where it was at that row's instant.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from messages import Vec3
from messages.arrays import BoolArray, FloatArray, IntArray
from sim_rig.walk.footholds import Footholds
from sim_rig.walk.gait import CAMERA_PITCH_RAD, Gait, Motion
from sim_rig.walk.world import World


@dataclass(frozen=True)
class Block:
    """A cuboid of `size_m` along x, y, z of its frame T; all faces show `texture`, at `texel_m` a texel."""

    size_m: Vec3
    texture: str
    texel_m: float = 0.001


@dataclass(frozen=True)
class Placed:
    """A block at n instants: R_WT (n, 3, 3), and p_WT_m (n, 3) of its centre."""

    block: Block
    R_WT: FloatArray
    p_WT_m: FloatArray

    def hides(self, eye_W: FloatArray, point_W: FloatArray) -> BoolArray:
        """Return (n,) whether the block cuts the straight line from `eye_W` (n, 3) to `point_W` (n, 3), instant by
        instant."""
        half_m = 0.5 * np.array(self.block.size_m)
        eye_T = np.einsum("nij,ni->nj", self.R_WT, eye_W - self.p_WT_m)
        ray_T = np.einsum("nij,ni->nj", self.R_WT, point_W - eye_W)
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (-half_m - eye_T) / ray_T, (half_m - eye_T) / ray_T
        # a ray along a face: inside the slab for ever, or never
        beside = (ray_T == 0) & (np.abs(eye_T) > half_m)
        enter = np.where(ray_T == 0, np.where(beside, np.inf, -np.inf), np.fmin(one, other)).max(axis=1)
        leave = np.where(ray_T == 0, np.inf, np.fmax(one, other)).min(axis=1)
        hidden: BoolArray = (enter < leave) & (leave > 0) & (enter < 1)
        return hidden


@dataclass(frozen=True)
class Walker:
    """Who is walking, and over what; `seed` draws who else is about."""

    gait: Gait
    world: World
    seed: int

    @cached_property
    def footholds(self) -> Footholds:
        """Where and when the feet land."""
        return Footholds(self.world, self.gait, self.seed)


class Thing(Protocol):
    """Something in the picture."""

    def placed(self, walker: Walker, t_ns: IntArray, motion: Motion) -> Iterable[Placed]:
        """Return its blocks at the instants `t_ns` (n,), at which the wearer's motion is `motion`."""


@dataclass(frozen=True)
class Worn:
    """A block fixed to the unit, so that it rests in the picture: its centre in B, its axes turned from B's about y.

    `pitch_rad` > 0 turns x downwards; −45° makes the axes of a unit that is worn as it should be level.
    """

    block: Block
    p_BT_m: Vec3
    pitch_rad: float = 0.0

    def placed(self, walker: Walker, t_ns: IntArray, motion: Motion) -> Iterable[Placed]:  # noqa: ARG002
        """Return the block where the unit carries it."""
        R_BT = turned("y", self.pitch_rad)
        return [Placed(self.block, motion.R_WB @ R_BT, motion.p_WB_m + motion.R_WB @ np.array(self.p_BT_m))]


def turned(axis: str, angle_rad: float) -> FloatArray:
    """Return the rotation (3, 3) by `angle_rad` about y or z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    if axis == "y":
        return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def facing(motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return ahead and to the left (n, 3) in W, both level, of who moves as `motion`."""
    forward = motion.R_WB[:, :, 0] * (1.0, 1.0, 0.0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    return forward, np.stack((-forward[:, 1], forward[:, 0], np.zeros(len(forward))), axis=1)


def pointing(up: FloatArray, leftward: FloatArray) -> FloatArray:
    """Return rotations (n, 3, 3) with z along `up` (n, 3) and y as nearly along `leftward` (n, 3) as that allows."""
    z = up / np.linalg.norm(up, axis=1, keepdims=True)
    x = np.cross(leftward, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack((x, np.cross(z, x), z), axis=2)


def carried(block: Block, ahead_m: float, left_m: float, up_m: float) -> Worn:
    """Return `block`, level and fixed to the unit, with its centre so far ahead of, left of and above B's origin."""
    c, s = np.cos(CAMERA_PITCH_RAD), np.sin(CAMERA_PITCH_RAD)
    return Worn(block, (c * ahead_m - s * up_m, left_m, s * ahead_m + c * up_m), -CAMERA_PITCH_RAD)


TRAY: tuple[Thing, ...] = (carried(Block((0.40, 2.4, 0.40), "print", 0.0025), 1.05, 0.0, -0.30),)
"""A patterned board across the upper quarter of both pictures."""
TROLLEY: tuple[Thing, ...] = (
    carried(Block((0.50, 0.56, 0.40), "print"), 1.05, 0.0, -0.30),
    carried(Block((0.04, 0.04, 0.55), "steel"), 0.95, 0.25, -0.65),
    carried(Block((0.04, 0.04, 0.55), "steel"), 0.95, -0.25, -0.65),
)
"""A basket on two posts, ahead of the wearer and fixed to the belt."""
BAG: tuple[Thing, ...] = (carried(Block((0.34, 0.16, 0.32), "print"), 0.25, 0.30, -0.58),)
"""A bag at the left side."""

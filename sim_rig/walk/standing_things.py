"""Things that stand on the ground beside the middle of the wearer's way: posts, and pairs of shoes."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from messages import Vec3
from messages.arrays import IntArray
from sim_rig.walk.gait import Motion
from sim_rig.walk.things import Block, Placed, Walker


@dataclass(frozen=True)
class Standing:
    """The same thing every `every_m` along x of W from `first_m` on, `left_m` beside the way, on either side in turn.

    `parts` are its blocks, each with its centre from the point on the ground that the thing stands on.
    """

    parts: tuple[tuple[Block, Vec3], ...]
    first_m: float = 2.0
    every_m: float = 2.5
    left_m: float = 0.14

    def placed(self, walker: Walker, t_ns: IntArray, motion: Motion) -> Iterable[Placed]:
        """Yield the blocks that are at most `_SEEN_M` away."""
        R_WT = np.broadcast_to(np.eye(3), (len(t_ns), 3, 3))
        here_m = float(motion.p_WB_m[:, 0].mean())
        first = max(0, math.ceil((here_m - _SEEN_M - self.first_m) / self.every_m))
        last = math.floor((here_m + _SEEN_M - self.first_m) / self.every_m)
        for k in range(first, last + 1):
            x, y = self.first_m + k * self.every_m, self.left_m * (1.0 if k % 2 else -1.0)
            foot_W = np.array((x, y, float(walker.world.heights(np.array([x]))[0])))
            for block, centre_m in self.parts:
                yield Placed(block, R_WT, np.broadcast_to(foot_W + np.array(centre_m), (len(t_ns), 3)))


_POST, _SHOE = Block((0.09, 0.09, 0.80), "print"), Block((0.27, 0.10, 0.09), "leather")

POSTS = Standing(((_POST, (0.0, 0.0, 0.40)),))
SHOES = Standing(((_SHOE, (0.0, 0.07, 0.045)), (_SHOE, (0.04, -0.07, 0.045))))

_SEEN_M = 4.0

"""A person who walks ahead of the wearer, the same way."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from messages.arrays import IntArray
from sim_rig.walk.gait import Motion
from sim_rig.walk.things import Block, Placed, Walker, facing, pointing

_TRUNK, _LEG, _SHOE = (
    Block((0.24, 0.44, 0.70), "jacket"),
    Block((0.14, 0.14, 0.80), "trousers"),
    Block((0.28, 0.10, 0.08), "leather"),
)
_HALF_STEP_M, _STRIDE_HZ, _NEARER_M, _WAVE_HZ = 0.26, 0.85, 0.15, 0.11


@dataclass(frozen=True)
class WalkerAhead:
    """Two legs, shoes and a trunk `ahead_m` before the wearer, `left_m` beside the way, now nearer, now farther.

    The legs swing to and fro while the wearer walks or stands alike.
    """

    ahead_m: float = 1.8
    left_m: float = 0.0

    def placed(self, walker: Walker, t_ns: IntArray, motion: Motion) -> Iterable[Placed]:
        """Yield the blocks, upright, on the ground that each of them is over."""
        since_s = (t_ns - walker.gait.start_ns).astype(np.float64) * 1e-9
        forward, leftward = facing(motion)
        upright = pointing(np.broadcast_to((0.0, 0.0, 1.0), forward.shape), leftward)
        ahead_m = self.ahead_m + _NEARER_M * np.sin(2 * np.pi * _WAVE_HZ * since_s + walker.seed)
        stride_m = _HALF_STEP_M * np.sin(2 * np.pi * _STRIDE_HZ * since_s + 2.0 * walker.seed)
        parts = [(_TRUNK, ahead_m, 0.0, _LEG.size_m[2] + 0.5 * _TRUNK.size_m[2])]
        for side, at_m in ((0.10, ahead_m + stride_m), (-0.10, ahead_m - stride_m)):
            parts += [(_LEG, at_m, side, 0.5 * _LEG.size_m[2]), (_SHOE, at_m + 0.06, side, 0.5 * _SHOE.size_m[2])]
        for block, at_m, left_m, up_m in parts:
            centre = motion.p_WB_m + at_m[:, None] * forward + (self.left_m + left_m) * leftward
            centre[:, 2] = walker.world.heights(centre[:, 0]) + up_m
            yield Placed(block, upright, centre)

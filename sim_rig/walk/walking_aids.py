"""What a wearer walks with: a rollator that rolls ahead, a white cane that sweeps the ground."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from messages.arrays import IntArray
from sim_rig.walk.gait import Motion
from sim_rig.walk.things import Block, Placed, Walker, facing, pointing, turned

_POST, _BAR, _BASKET = (
    Block((0.03, 0.03, 0.84), "steel"),
    Block((0.03, 0.54, 0.03), "steel"),
    Block((0.20, 0.36, 0.16), "print"),
)
_PARTS = (
    *((_POST, (ahead_m, left_m, 0.44)) for ahead_m in (0.20, 0.62) for left_m in (-0.27, 0.27)),
    (_BAR, (0.62, 0.0, 0.30)),
    (_BASKET, (0.70, 0.0, 0.66)),
)
"""Each part's centre ahead of, left of and above the ground below the wearer."""

_CANE = Block((0.013, 0.013, 1.25), "cane", 0.0013)
_HAND_M, _TIP_AHEAD_M, _SWEEP_M, _SWEEP_HZ = (0.28, -0.12, -0.12), 1.0, 0.42, 0.9


@dataclass(frozen=True)
class Rollator:
    """A frame on wheels with a basket. It follows where the wearer is led, and not how the hip bobs and sways."""

    def placed(self, walker: Walker, t_ns: IntArray, motion: Motion) -> Iterable[Placed]:  # noqa: ARG002
        """Yield posts, bar and basket."""
        gait = walker.gait
        lap, t_lap_s = np.divmod(np.maximum(1e-9 * (t_ns - gait.start_ns), 0.0), gait.lap_s)
        course = gait.course(t_lap_s)
        xy_W = course.xy_m + lap[:, None] * gait.lap_advance_m
        R_WT = np.stack([turned("z", float(heading)) for heading in course.heading_rad])
        origin_W = np.column_stack((xy_W, walker.world.heights(xy_W[:, 0])))
        for block, centre_m in _PARTS:
            yield Placed(block, R_WT, origin_W + R_WT @ np.array(centre_m))


@dataclass(frozen=True)
class WhiteCane:
    """A white cane held ahead, whose tip sweeps over the ground from side to side once a stride."""

    def placed(self, walker: Walker, t_ns: IntArray, motion: Motion) -> Iterable[Placed]:
        """Return the cane."""
        forward, leftward = facing(motion)
        ahead_m, left_m, up_m = _HAND_M
        hand = motion.p_WB_m + ahead_m * forward + left_m * leftward + np.array((0.0, 0.0, up_m))
        aside_m = _SWEEP_M * np.sin(2e-9 * np.pi * _SWEEP_HZ * (t_ns - walker.gait.start_ns))
        tip = motion.p_WB_m + _TIP_AHEAD_M * forward + aside_m[:, None] * leftward
        tip[:, 2] = walker.world.heights(tip[:, 0])
        R_WT = pointing(hand - tip, leftward)
        return [Placed(_CANE, R_WT, tip + 0.5 * _CANE.size_m[2] * R_WT[:, :, 2])]

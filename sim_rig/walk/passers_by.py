"""People who cross the wearer's way."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray, IntArray
from sim_rig.walk.gait import Motion
from sim_rig.walk.things import Block, Placed, Walker, turned

_TRUNK, _LEG = Block((0.26, 0.44, 0.75), "jacket"), Block((0.15, 0.15, 0.85), "trousers")
_HALF_STEP_M, _STRIDE_HZ = 0.28, 0.9


@dataclass(frozen=True)
class PassersBy:
    """People who cross the wearer's way, from either side in turn, one every `every_s` on average.

    Each is two legs and a trunk that move as one, at a steady speed, `ahead_m` before the wearer where they meet.
    """

    every_s: float = 1.8
    first_s: float = 0.8
    ahead_m: tuple[float, float] = (1.25, 2.6)
    speed_mps: tuple[float, float] = (0.7, 1.8)

    def placed(self, walker: Walker, t_ns: IntArray, motion: Motion) -> Iterable[Placed]:  # noqa: ARG002
        """Yield the blocks of those who are within 4 s of meeting the wearer."""
        since_start_s = (t_ns - walker.gait.start_ns).astype(np.float64) * 1e-9
        latest = int((float(since_start_s.max()) - self.first_s) / self.every_s + 4)
        for k in range(max(0, latest - 8), max(0, latest) + 1):
            yield from self._person(k, walker, since_start_s)

    def _person(self, k: int, walker: Walker, since_start_s: FloatArray) -> Iterable[Placed]:
        rng = np.random.default_rng([walker.seed, 14, k])
        met_s = self.first_s + (k + rng.uniform(-0.3, 0.3)) * self.every_s
        ahead_m, speed_mps = rng.uniform(*self.ahead_m), rng.uniform(*self.speed_mps)
        aside = (1.0 if k % 2 else -1.0) * np.pi / 2 + rng.uniform(-0.5, 0.5)
        met = walker.gait.at(np.array([walker.gait.start_ns + round(1e9 * met_s)])).p_WB_m[0]
        gone_m = speed_mps * (since_start_s - met_s)
        x, y = met[0] + ahead_m + gone_m * np.cos(aside), met[1] + gone_m * np.sin(aside)
        z = walker.world.heights(np.array([met[0] + ahead_m]))[0]
        R_WT = np.broadcast_to(turned("z", aside), (len(x), 3, 3))
        stride_m, hips_m = _HALF_STEP_M * np.sin(2 * np.pi * _STRIDE_HZ * since_start_s + k), _LEG.size_m[2]

        def at(ahead: FloatArray | float, left_m: float, up_m: float) -> FloatArray:
            offset_W = R_WT[:, :, 0] * np.broadcast_to(ahead, x.shape)[:, None] + R_WT[:, :, 1] * left_m
            centre_W: FloatArray = offset_W + np.stack((x, y, np.full_like(x, z + up_m)), axis=1)
            return centre_W

        yield Placed(_TRUNK, R_WT, at(0.0, 0.0, hips_m + 0.5 * _TRUNK.size_m[2]))
        yield Placed(_LEG, R_WT, at(stride_m, 0.11, 0.5 * hips_m))
        yield Placed(_LEG, R_WT, at(-stride_m, -0.11, 0.5 * hips_m))

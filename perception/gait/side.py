"""Which foot landed, by the hip's own motion.

The hip sways over the standing foot (Perry, Burnfield, Gait Analysis: 4 cm from side to side), so at a contact it is on
its way to the side of the foot that lands; and it turns with the leg that swings forward: to the right while the left
one swings.
"""

import math

import numpy as np

from perception.gait.trail import HipTrail


def left_landed(trail: HipTrail, before: float, now: float) -> float:
    """Return how clearly the left foot landed at row `now`, after the contact of row `before`.

    From −2 (surely the right one) to 2; 0 where nothing tells, as on the spot.
    """
    first, last = round(before), round(now) + 1
    speed_mps = trail.speed_W_mps(first, last)
    ahead_mps = speed_mps.mean(axis=0)
    length_mps = float(np.hypot(*ahead_mps))
    if length_mps < _LEAST_SPEED_MPS:
        return 0.0
    left = np.array([-ahead_mps[1], ahead_mps[0]]) / length_mps
    sway_mps = float(left @ (speed_mps[-4:].mean(axis=0) - speed_mps[:4].mean(axis=0)))
    turn_radps = trail.rate_W_radps(first, last)[:, 2]
    eighth = len(turn_radps) // 8 + 1
    ends, middle = np.concatenate((turn_radps[:eighth], turn_radps[-eighth:])), turn_radps[2 * eighth : -2 * eighth]
    swing_radps = float(ends.mean() - middle.mean()) if len(middle) else 0.0
    return math.tanh(sway_mps / _SWAY_MPS) + math.tanh(swing_radps / _SWING_RADPS)


_LEAST_SPEED_MPS = 0.2
_SWAY_MPS, _SWING_RADPS = 0.15, 0.3

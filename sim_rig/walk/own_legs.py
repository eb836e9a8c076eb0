"""The wearer's own legs, which swing through the bottom of the picture: thigh, shin and foot of each side.

A foot stands where it landed (`footholds`) until it swings to its next place in an arc. Hip and ankle then leave the
knee one place: in front of the line between them, at the distance that the lengths of thigh and shin ask for.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray, IntArray
from sim_rig.walk.footholds import Foothold
from sim_rig.walk.gait import Motion
from sim_rig.walk.things import Block, Placed, Walker, facing, pointing

HIP_BEHIND_M, HIP_ASIDE_M, HIP_BELOW_M = 0.06, 0.09, 0.07  # from the unit at the front of the belt
_SWING_SHARE, _LONGEST_SWING_S = 0.38, 0.45  # of the time from one landing of a foot to its next
_LIFT_M = 0.10
_ANKLE_BEHIND_M, _ANKLE_ABOVE_M = 0.06, 0.09  # from the foot's middle on the ground
_TOES_DOWN_RAD, _TOES_UP_RAD = np.deg2rad(35.0), np.deg2rad(15.0)  # in mid-swing and where the heel lands


TOE_AHEAD_M = 0.135  # of the sole's middle

_THIGH, _SHIN = Block((0.14, 0.13, 0.41), "trousers"), Block((0.10, 0.10, 0.40), "trousers")
_FOOT = Block((2 * TOE_AHEAD_M, 0.10, 0.08), "leather")
_NEXT_NS = 1_000  # from one landing to the next one's side, for stamps are rounded


@dataclass(frozen=True)
class OwnLegs:
    """The wearer's legs."""

    def placed(self, walker: Walker, t_ns: IntArray, motion: Motion) -> Iterable[Placed]:
        """Yield thigh, shin and foot of either side."""
        forward, leftward = facing(motion)
        for side in (1.0, -1.0):
            hip = motion.p_WB_m - HIP_BEHIND_M * forward + side * HIP_ASIDE_M * leftward - (0.0, 0.0, HIP_BELOW_M)
            sole, pitch_rad = _sole(walker, t_ns, hip, left=side > 0)
            R_foot = _tipped(forward, leftward, pitch_rad)
            yield Placed(_FOOT, R_foot, sole + 0.5 * _FOOT.size_m[2] * R_foot[:, :, 2])
            ankle = sole - _ANKLE_BEHIND_M * R_foot[:, :, 0] + _ANKLE_ABOVE_M * R_foot[:, :, 2]
            knee, ankle = _knee(hip, ankle, forward, _THIGH.size_m[2], _SHIN.size_m[2])
            for block, top, bottom in ((_THIGH, hip, knee), (_SHIN, knee, ankle)):
                yield Placed(block, pointing(top - bottom, leftward), 0.5 * (top + bottom))


def swing_s(stride_s: float) -> float:
    """Return for how long a foot swings before it lands, of the time since its last landing."""
    return min(_SWING_SHARE * stride_s, _LONGEST_SWING_S)


def gone_of(swung: FloatArray) -> FloatArray:
    """Return the share of its way (n,) that a foot has gone at these shares of its swing (n,)."""
    gone: FloatArray = swung - np.sin(2 * np.pi * swung) / (2 * np.pi)
    return gone


def _sole(walker: Walker, t_ns: IntArray, hip: FloatArray, *, left: bool) -> tuple[FloatArray, FloatArray]:
    """Return where the middle of the sole is in W (n, 3), and by how much (n,) the toes point down."""
    before, after = _landings(walker, int(t_ns[len(t_ns) // 2]), left=left)
    under_hip = np.column_stack((hip[:, :2], walker.world.heights(hip[:, 0])))
    if after is None:
        return under_hip, np.zeros(len(hip))
    stride_s = np.inf if before is None else 1e-9 * (after.t_land_ns - before.t_land_ns)
    swung = np.clip(1.0 + 1e-9 * (t_ns - after.t_land_ns) / swing_s(stride_s), 0.0, 1.0)
    gone = gone_of(swung)
    start = under_hip if before is None else before.p_WF_m
    sole = start + gone[:, None] * (after.p_WF_m - start)
    sole[:, 2] += _LIFT_M * np.sin(np.pi * swung) ** 2
    down = _TOES_DOWN_RAD * np.sin(np.pi * swung) ** 2 - _TOES_UP_RAD * swung**4 * (swung < 1.0)
    return sole, down


def _landings(walker: Walker, t_ns: int, *, left: bool) -> tuple[Foothold | None, Foothold | None]:
    """Return the last landing of the left or right foot and its next one; None where there is none."""
    before, after = walker.footholds.last_before(t_ns), walker.footholds.next_after(t_ns)
    while before is not None and before.left != left:
        before = walker.footholds.last_before(before.t_land_ns - _NEXT_NS)
    while after is not None and after.left != left:
        after = walker.footholds.next_after(after.t_land_ns + _NEXT_NS)
    return before, after


def _knee(
    hip: FloatArray, ankle: FloatArray, forward: FloatArray, thigh_m: float, shin_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return the knee (n, 3) and the ankle (n, 3), drawn towards the hip where the leg is too short to reach it."""
    down = ankle - hip
    distance = np.linalg.norm(down, axis=1, keepdims=True)
    down /= distance
    distance = np.minimum(distance, thigh_m + shin_m)
    along = (thigh_m**2 - shin_m**2 + distance**2) / (2 * distance)
    bent = np.sqrt(np.maximum(thigh_m**2 - along**2, 0.0))
    ahead = forward - (forward * down).sum(axis=1, keepdims=True) * down
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return hip + along * down + bent * ahead, hip + distance * down


def _tipped(forward: FloatArray, leftward: FloatArray, down_rad: FloatArray) -> FloatArray:
    """Return rotations (n, 3, 3) with x along `forward` (n, 3) but tipped down by `down_rad` (n,), y `leftward`."""
    x = forward * np.cos(down_rad)[:, None] - np.array((0.0, 0.0, 1.0)) * np.sin(down_rad)[:, None]
    return np.stack((x, leftward, np.cross(x, leftward)), axis=2)

"""What the wearer's leg does to the ankle of a prosthesis, from the rig's walk: how the shank leans, load and swing.

While the foot stands, the shank leans as hip and planned ankle ask for, the knee bent where the leg is longer than
their distance; the wearer leans on the ankle along the line from the hip. Load after Perry and Burnfield, Gait
Analysis: two humps of about the body's weight, and about half of it in standing. While the foot swings, the leg leads
the ankle over the ground to where the foot lands.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import PchipInterpolator

from messages.arrays import FloatArray, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.prosthesis.foot import ANKLE_ABOVE_M, ANKLE_BEHIND_M, BALL_M, HEEL_M, STEP_NS, STEP_S, TOE_M
from sim_rig.prosthesis.profile import Profile
from sim_rig.walk.footholds import Foothold, Footholds
from sim_rig.walk.gait import Gait
from sim_rig.walk.own_legs import HIP_BEHIND_M, HIP_BELOW_M, gone_of, swing_s

SWING_N_PER_M: Final = 30e3
SWING_NS_PER_M: Final = 600.0
"""How stiffly the leg leads the ankle while the foot swings."""
STANCE_NS_PER_M: Final = 250.0

_BESIDE_RISER_M = 0.012
_TOE_REACHES_M = TOE_M[0] - ANKLE_BEHIND_M + _BESIDE_RISER_M
_HEEL_REACHES_M = ANKLE_BEHIND_M - HEEL_M[0] + _BESIDE_RISER_M
_LONGEST_STEPS = round(1.0 / STEP_S)
_SPARE_LEG = 1.005
_STRAIGHT_M = 0.008
_CLEARANCE_M, _LEAST_LIFT_M, _MOST_LIFT_M = 0.015, 0.05, 0.40
_LATENESSES = (0.0, 0.15, 0.3, 0.45)
_LEAVING, _LANDING = 0.2, 0.9
_FREED = 0.12  # of a swing: until then the foot only rises, lest the toe catches
_LOAD_S, _HALF_S = 0.13, 0.12
_STANDS_S = 0.45
_LANDING_LOAD, _PRESSED_M = 0.12, 0.003


@dataclass(frozen=True)
class Piece:
    """A part of a stance or of a swing: steps `first` to `end`, one value of each list a step.

    `foothold` is where the foot stands, None before it first landed, or where the swing leads; `share` of the stance or
    swing; leg: force on the ankle (stance) or place and speed to which it is led (swing), x and z each.
    """

    first: int
    end: int
    swings: bool
    foothold: Foothold | None
    share: list[float]
    shank_rad: list[float]
    shank_radps: list[float]
    leg_x: list[float]
    leg_z: list[float]
    speed_x_mps: list[float]
    speed_z_mps: list[float]


class WearersLeg:
    """The leg of a wearer of `mass_kg` who walks as `gait` with these `footholds`; `left` is the prosthesis's side."""

    def __init__(self, gait: Gait, footholds: Footholds, ground: Profile, mass_kg: float, *, left: bool) -> None:
        self._gait, self._footholds, self._ground, self._left = gait, footholds, ground, left
        self._weight_n = mass_kg * STANDARD_GRAVITY_MPS2
        self.start_ns = gait.start_ns
        hip, ankle = self._hip(np.array([self.start_ns])), self.planned_ankle(None)
        self._length_m = _SPARE_LEG * 0.5 * math.hypot(hip[0, 0] - ankle[0], hip[0, 1] - ankle[1])

    def planned_ankle(self, foothold: Foothold | None) -> tuple[float, float]:
        """Return where the ankle is (x, z) when the foot rests on a foothold, or under the hip before the walk."""
        if foothold is None:
            x_m = float(self._hip(np.array([self.start_ns]))[0, 0])
            slope_rad = self._ground.slope_rad(x_m)
            return x_m, self._ground.height_m(x_m) + ANKLE_ABOVE_M / math.cos(slope_rad)
        slope_rad = foothold.slope_rad
        cos, sin = math.cos(slope_rad), math.sin(slope_rad)
        x_m, z_m = self.put_m(foothold)
        return x_m - ANKLE_BEHIND_M * cos - ANKLE_ABOVE_M * sin, z_m - ANKLE_BEHIND_M * sin + ANKLE_ABOVE_M * cos

    def put_m(self, foothold: Foothold) -> tuple[float, float]:
        """Return where the wearer puts the middle of the sole (x, z): on the foothold, but not into a riser."""
        x_m, z_m = float(foothold.p_WF_m[0]), float(foothold.p_WF_m[2])
        behind_m, ahead_m = self._ground.walls_m(x_m)
        free_m = max(min(x_m, ahead_m - _TOE_REACHES_M), behind_m + _HEEL_REACHES_M)
        return free_m, z_m + math.tan(foothold.slope_rad) * (free_m - x_m)

    def piece(self, first: int, ankle_m: tuple[float, float], shank_rad: float, landing_rad: float) -> Piece:
        """Return what the leg does from step `first` on, when the ankle is where it is and the shank leans so.

        `landing_rad` is the ankle's angle in swing, with which the foot is to land.
        """
        t_ns = self._time_ns(first)
        landed, following = self._last(t_ns), self._footholds.next_after(t_ns, self._left)
        stride_s = math.inf
        if following is not None and landed is not None:
            stride_s = 1e-9 * (following.t_land_ns - landed.t_land_ns)
        off_ns = None if following is None else following.t_land_ns - round(1e9 * swing_s(stride_s))
        if following is not None and off_ns is not None and t_ns >= off_ns:
            end = self._step_of(following.t_land_ns)
            return self._swing(first, end, following, ankle_m, shank_rad, landing_rad)
        end = first + _LONGEST_STEPS if off_ns is None else min(self._step_of(off_ns), first + _LONGEST_STEPS)
        return self._stance(first, max(end, first + 1), landed, off_ns)

    def _stance(self, first: int, end: int, landed: Foothold | None, off_ns: int | None) -> Piece:
        t_ns = self._times_ns(first, end)
        shank = self.shank_rad(t_ns, landed)
        x, z = self.planned_ankle(landed)
        down = np.array((x, z)) - self._hip(t_ns)
        load_n = self._weight_n * self._load(t_ns, landed, off_ns)
        from_ns = self.start_ns if landed is None else landed.t_land_ns
        until_ns = t_ns[-1] if off_ns is None else off_ns
        share = (t_ns - from_ns) / max(until_ns - from_ns, 1)
        leg_x, leg_z = load_n * down[:, 0] / -down[:, 1], -load_n
        nothing = [0.0] * (end - first)
        rate = _rates(shank)
        return Piece(
            first,
            end,
            False,
            landed,
            share.tolist(),
            shank.tolist(),
            rate.tolist(),
            leg_x.tolist(),
            leg_z.tolist(),
            nothing,
            nothing,
        )

    def _swing(
        self,
        first: int,
        end: int,
        foothold: Foothold,
        ankle_m: tuple[float, float],
        shank_rad: float,
        landing_rad: float,
    ) -> Piece:
        end = max(end, first + 2)
        share = np.arange(1, end - first + 1) / (end - first)
        lands_rad = float(self.shank_rad(np.array([foothold.t_land_ns]), foothold)[0])
        shank = shank_rad + (lands_rad - shank_rad) * gone_of(np.minimum(share / 0.75, 1.0))
        x, z = self._way(share, ankle_m, foothold, landing_rad - shank)
        return Piece(
            first,
            end,
            True,
            foothold,
            share.tolist(),
            shank.tolist(),
            _rates(shank).tolist(),
            x.tolist(),
            z.tolist(),
            _rates(x).tolist(),
            _rates(z).tolist(),
        )

    def _way(
        self, share: FloatArray, from_m: tuple[float, float], foothold: Foothold, pitch_rad: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the way of the ankle: as low as heel and toe allow, first up and then ahead, or first ahead.

        It ends where the foot, pitched by `pitch_rad` (n,) on its way, presses on the ground.
        """
        to_m = self._landing_ankle(foothold, float(pitch_rad[-1]))
        ways = [self._lifted(share, from_m, to_m, pitch_rad, late) for late in _LATENESSES]
        x, z, _ = min(ways, key=lambda way: way[2])
        return x, z

    def _lifted(
        self,
        share: FloatArray,
        from_m: tuple[float, float],
        to_m: tuple[float, float],
        pitch_rad: FloatArray,
        late: float,
    ) -> tuple[FloatArray, FloatArray, float]:
        """Return a way that goes up first, or down last, by the share `late` of the swing, and how high its arc is."""
        sooner = (share / (1.0 - late), (share - late) / (1.0 - late))
        on, up = sooner[::-1] if to_m[1] > from_m[1] else sooner
        on = (on - _FREED) / (1.0 - _FREED)
        x = from_m[0] + (to_m[0] - from_m[0]) * gone_of(np.clip(on, 0.0, 1.0))
        z = from_m[1] + (to_m[1] - from_m[1]) * gone_of(np.clip(up, 0.0, 1.0))
        arc = np.sin(np.pi * share) ** 2
        inner = (share > _LEAVING) & (share < _LANDING)
        short = np.max([self._below(x[inner], z[inner], pitch_rad[inner], point) for point in (HEEL_M, TOE_M)], axis=0)
        lift_m = min(max(float(np.max(short / arc[inner])), _LEAST_LIFT_M), _MOST_LIFT_M)
        return x, z + lift_m * arc, lift_m

    def _below(self, x: FloatArray, z: FloatArray, pitch_rad: FloatArray, point_m: tuple[float, float]) -> FloatArray:
        """Return by how much (n,) a point of the foot is lower than it should be when the ankle is at (x, z)."""
        (ahead_m, up_m), cos, sin = point_m, np.cos(pitch_rad), np.sin(pitch_rad)
        ground_m = np.array([self._ground.height_m(each) for each in x + ahead_m * cos - up_m * sin])
        below: FloatArray = ground_m + _CLEARANCE_M - (z + ahead_m * sin + up_m * cos)
        return below

    def _landing_ankle(self, foothold: Foothold, pitch_rad: float) -> tuple[float, float]:
        """Return where the ankle is when a foot of that pitch touches the ground with the end that is lower, and this
        end will stay where it is."""
        rests_rad = foothold.slope_rad
        ahead_m, up_m = HEEL_M if pitch_rad > rests_rad else BALL_M
        x_m, z_m = self.planned_ankle(foothold)
        for angle_rad, sign in ((rests_rad, 1.0), (pitch_rad, -1.0)):
            cos, sin = math.cos(angle_rad), math.sin(angle_rad)
            x_m += sign * (ahead_m * cos - up_m * sin)
            z_m += sign * (ahead_m * sin + up_m * cos)
        return x_m, z_m - _PRESSED_M

    def shank_rad(self, t_ns: IntArray, foothold: Foothold | None) -> FloatArray:
        """Return by how much the shank leans forward (n,) over a planned ankle, thigh and shank of one length."""
        line = self._hip(t_ns) - self.planned_ankle(foothold)
        distance = np.hypot(line[:, 0], line[:, 1])
        short = 2.0 * self._length_m - distance
        short = _STRAIGHT_M * np.logaddexp(0.0, short / _STRAIGHT_M)  # a knee that never quite locks
        bent = np.arccos(np.clip(1.0 - short / (2.0 * self._length_m), -1.0, 1.0))
        lean: FloatArray = np.arctan2(line[:, 0], line[:, 1]) + bent
        return lean

    def _load(self, t_ns: IntArray, landed: Foothold | None, off_ns: int | None) -> FloatArray:
        """Return the share (n,) of the weight that the leg bears."""
        t = 1e-9 * (t_ns - self.start_ns)
        points = [(-10.0, 0.5), (-9.0, 0.5)]
        if landed is not None:
            t0 = 1e-9 * (landed.t_land_ns - self.start_ns)
            other = self._footholds.next_after(landed.t_land_ns, not self._left)
            single = t0 + 0.5 if other is None else 1e-9 * (other.t_land_ns - self.start_ns)
            single = max(single, t0 + 2.0 * _LOAD_S)
            points = [(t0, _LANDING_LOAD), (t0 + _LOAD_S, 1.05), (0.5 * (t0 + _LOAD_S + single), 0.82), (single, 1.05)]
        off = math.inf if off_ns is None else 1e-9 * (off_ns - self.start_ns)
        last = points[-1][0]
        if off - last > _STANDS_S:
            points.append((last + 0.3, 0.5))
            if math.isfinite(off):
                points.append((off - _HALF_S, 0.5))
        end = off if math.isfinite(off) else float(t[-1]) + 10.0
        points.append((max(end, points[-1][0] + 1e-3), 0.0 if math.isfinite(off) else 0.5))
        times, shares = zip(*points, strict=True)
        load: FloatArray = PchipInterpolator(times, shares)(t)
        return load

    def _last(self, t_ns: int) -> Foothold | None:
        """Return where the prosthetic foot landed last."""
        landed = self._footholds.last_before(t_ns)
        while landed is not None and landed.left != self._left:
            landed = self._footholds.last_before(landed.t_land_ns - STEP_NS)
        return landed

    def _hip(self, t_ns: IntArray) -> FloatArray:
        """Return the hip joint's x and z (n, 2)."""
        p_m = self._gait.at(t_ns).p_WB_m
        hip: FloatArray = p_m[:, (0, 2)] - (HIP_BEHIND_M, HIP_BELOW_M)
        return hip

    def _times_ns(self, first: int, end: int) -> IntArray:
        times: IntArray = self.start_ns + np.arange(first, end, dtype=np.int64) * STEP_NS
        return times

    def _time_ns(self, step: int) -> int:
        return self.start_ns + step * STEP_NS

    def _step_of(self, t_ns: int) -> int:
        return -((self.start_ns - t_ns) // STEP_NS)


def _rates(values: FloatArray) -> FloatArray:
    rates: FloatArray = np.gradient(values, STEP_S) if len(values) > 1 else np.zeros_like(values)
    return rates

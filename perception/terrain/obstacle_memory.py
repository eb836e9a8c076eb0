"""The obstacles of the last seconds, fixed in W while the wearer walks past them.

Told is what several frames saw where it was expected, what came from ahead, and what does not move with the wearer: own
feet appear near, a trolley or a cane stays where it is relative to the wearer. So does who walks ahead at the same
pace, and is not in the way.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray
from perception.terrain.obstacles import Obstacle
from perception.terrain.way import Way


@dataclass(frozen=True)
class ObstacleSettings:
    """An obstacle is told once `confirmed` frames saw it, and either `way_m` were walked or `standing_s` went by.

    In `steady_share` of the frames that saw it, and in `confirmed` but one, it was within `steady_m` of where it was
    expected: chance matches, as on tiles or faint texture, jump from frame to frame. It must have been seen beyond
    `from_ahead_m`, where own feet never are. It is forgotten once `missed` frames that should have seen it did not, or
    one if it moves, `behind_m` behind, or unseen for `unseen_s`.
    What is seen within `same_m` of where it was is the same; of two within `one_m` one is told.
    """

    confirmed: int = 3
    way_m: float = 0.2
    standing_s: float = 0.5
    from_ahead_m: float = 0.80
    missed: int = 3
    behind_m: float = 0.30
    unseen_s: float = 3.0
    same_m: float = 0.20
    steady_m: float = 0.08
    steady_share: float = 0.6
    one_m: float = 0.30
    most: int = 12


@dataclass
class _Known:
    """One thing: in W (2,) where it was first seen and last, and the mean of that; where the wearer was at first.

    `last_H_m` (2,) is where it was seen last, relative to the wearer of then, and
    `v_W_mps` (2,) its velocity then; `steady` counts the frames that saw it where it was expected.
    """

    first_W_m: FloatArray
    last_W_m: FloatArray
    last_H_m: FloatArray
    mean_W_m: FloatArray
    v_W_mps: FloatArray
    height_m: float
    wearer_W_m: FloatArray
    first_ns: int
    newest_ns: int
    farthest_m: float
    seen: int = 1
    steady: int = 0
    missed: int = 0
    moves: bool = False


class ObstacleMemory:
    """Remembers obstacles from frame to frame; `update` takes one frame. The path is `half_width_m` wide to either
    side."""

    def __init__(self, half_width_m: float, settings: ObstacleSettings | None = None) -> None:
        self._half_width_m = half_width_m
        self._settings = settings or ObstacleSettings()
        self._known: list[_Known] = []
        self._way = Way()

    def __len__(self) -> int:
        return len(self._known)

    def update(self, t_ns: int, v_W_mps: FloatArray, heading_rad: float, found: Sequence[Obstacle]) -> list[Obstacle]:
        """Return the confirmed obstacles in H, by distance, after a frame at `t_ns` has shown those that were `found`.

        `v_W_mps` (2,) is the camera's horizontal velocity then.
        """
        if self._way.move(t_ns, v_W_mps) is None:
            self._known.clear()
        R_WH = np.array(
            [[math.cos(heading_rad), -math.sin(heading_rad)], [math.sin(heading_rad), math.cos(heading_rad)]]
        )
        unmatched = list(found)
        for known in self._known:
            expected_H = R_WH.T @ (known.last_W_m - self._way.p_W_m)
            near = [each for each in unmatched if _apart_m(each, expected_H, known.last_H_m) < self._settings.same_m]
            if near:
                nearest = min(near, key=lambda each: _apart_m(each, expected_H, known.last_H_m))
                unmatched.remove(nearest)
                predicted_H = expected_H + self._since_s(known) * R_WH.T @ known.v_W_mps
                known.steady += _apart_m(nearest, expected_H, known.last_H_m, predicted_H) < self._settings.steady_m
                self._fuse(known, nearest, R_WH)
            elif _IN_VIEW_M[0] < expected_H[0] < _IN_VIEW_M[1] and abs(expected_H[1]) < _IN_VIEW_HALF_M:
                known.missed += 1
        self._known += [self._new(each, R_WH) for each in unmatched]
        self._forget(R_WH)
        told: list[Obstacle] = []
        for known in sorted(self._known, key=lambda known: -known.seen):
            x, y = R_WH.T @ (known.mean_W_m - self._way.p_W_m)
            beside = any(_apart_m(other, np.array((x, y))) < self._settings.one_m for other in told)
            if self._is_told(known) and not beside and abs(y) < self._half_width_m:
                told.append(Obstacle(float(x), float(y), known.height_m))
        return sorted(told, key=lambda each: each.distance_m)

    def _new(self, seen: Obstacle, R_WH: FloatArray) -> _Known:
        assert self._way.t_ns is not None
        at_H_m = np.array((seen.distance_m, seen.left_m))
        at_W_m = self._way.p_W_m + R_WH @ at_H_m
        return _Known(
            at_W_m,
            at_W_m,
            at_H_m,
            at_W_m,
            np.zeros(2),
            seen.height_m,
            self._way.p_W_m,
            self._way.t_ns,
            self._way.t_ns,
            seen.distance_m,
        )

    def _fuse(self, known: _Known, seen: Obstacle, R_WH: FloatArray) -> None:
        now = self._new(seen, R_WH)
        known.seen += 1
        gain = max(_LEAST_GAIN, 1.0 / known.seen)
        off_W_m = now.last_W_m - known.mean_W_m
        known.moves = known.moves or math.hypot(*off_W_m) > _MOVED_M
        known.mean_W_m = known.mean_W_m + (1.0 if known.moves else gain) * off_W_m
        known.height_m += gain * (seen.height_m - known.height_m)
        known.farthest_m = max(known.farthest_m, seen.distance_m)
        known.v_W_mps = (now.last_W_m - known.last_W_m) / self._since_s(known)
        known.last_W_m, known.last_H_m, known.newest_ns, known.missed = now.last_W_m, now.last_H_m, now.first_ns, 0

    def _since_s(self, known: _Known) -> float:
        assert self._way.t_ns is not None
        return 1e-9 * (self._way.t_ns - known.newest_ns)

    def _is_told(self, known: _Known) -> bool:
        assert self._way.t_ns is not None
        limits = self._settings
        way = self._way.p_W_m - known.wearer_W_m
        square_m2 = float(way @ way)
        walked = square_m2 > limits.way_m**2
        along = float((known.last_W_m - known.first_W_m) @ way) / square_m2 if walked else 0.0
        return (
            known.steady >= limits.confirmed - 1
            and known.steady >= limits.steady_share * known.seen
            and known.farthest_m > limits.from_ahead_m
            and (walked or 1e-9 * (self._way.t_ns - known.first_ns) > limits.standing_s)
            and along < _CARRIED
        )

    def _forget(self, R_WH: FloatArray) -> None:
        limits = self._settings

        def stays(known: _Known) -> bool:
            ahead_m = float((R_WH.T @ (known.mean_W_m - self._way.p_W_m))[0])
            missed = limits.missed if not known.moves else 1
            return known.missed < missed and ahead_m > -limits.behind_m and self._since_s(known) < limits.unseen_s

        self._known = [known for known in self._known if stays(known)][-limits.most :]


def _apart_m(seen: Obstacle, *places_H_m: FloatArray) -> float:
    """Return how far from the nearest of these places (2,) it was seen: where it stood, or stayed with the wearer."""
    return min(math.hypot(seen.distance_m - float(x), seen.left_m - float(y)) for x, y in places_H_m)


_LEAST_GAIN = 0.25
_CARRIED = 0.5
"""What has come along by more than this share of the wearer's way moves with the wearer."""
_MOVED_M = 0.10
_IN_VIEW_M = (0.45, 2.3)
_IN_VIEW_HALF_M = 0.25

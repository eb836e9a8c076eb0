"""The hip's own motion over the last seconds, a hundred times a second: where it was, how fast it rose, swayed and
turned."""

from collections.abc import Callable

import numpy as np

from messages import Vec3
from messages.arrays import FloatArray
from perception.attitude.history import AttitudeAt
from perception.so3 import matrix_from_quaternion

PERIOD_NS = 10_000_000


class HipTrail:
    """Ring of the hip's motion on a grid of `PERIOD_NS`, filled up to each frame's exposure.

    `p_BC_m` (3,) is the place of the left optical centre in B, whose way over the ground is kept.
    """

    length = 320

    def __init__(self, p_BC_m: FloatArray) -> None:
        self._p_BC_m = p_BC_m
        self._rows = np.zeros((self.length, _COLUMNS))
        self._count = 0
        self._t0_ns = 0
        self._p_W_m = np.zeros(2)
        self._v_W_mps = np.zeros(2)
        self._height_m = 0.0
        self._rise_mps = 0.0

    def clear(self) -> None:
        """Forget everything: the heading of what comes may be another one."""
        self._count = 0

    def extend(self, until_ns: int, at: Callable[[int], AttitudeAt | None]) -> bool:
        """Take the motion up to `until_ns`; `at` tells the attitude of an instant.

        Return False where a gap began a new trail.
        """
        newest_ns = self.newest_ns
        if newest_ns is None or not 0 <= until_ns - newest_ns <= _LONGEST_GAP_NS:
            self._begin(until_ns, at)
            return False
        for t_ns in range(newest_ns + PERIOD_NS, until_ns + 1, PERIOD_NS):
            attitude = at(t_ns)
            if attitude is None:
                self._begin(until_ns, at)
                return False
            self._append(attitude)
        return True

    @property
    def newest_ns(self) -> int | None:
        """Return the time of the newest row."""
        return self._t0_ns + (self._count - 1) * PERIOD_NS if self._count else None

    def t_ns(self, index: float) -> int:
        """Return the time of a row by its number, counted from the trail's beginning; between two, the time there."""
        return self._t0_ns + round(index * PERIOD_NS)

    def index(self, t_ns: float) -> float:
        """Return the number of the row at `t_ns`."""
        return (t_ns - self._t0_ns) / PERIOD_NS

    def height_at_m(self, t_ns: int) -> float:
        """Return how far the left optical centre is, just after the newest row, above where the trail began."""
        since_s = 1e-9 * (t_ns - (self.newest_ns or t_ns))
        return self._height_m + since_s * self._rise_mps

    @property
    def count(self) -> int:
        """Return how many rows there have been since the trail began."""
        return self._count

    @property
    def first(self) -> int:
        """Return the number of the oldest row that is kept."""
        return max(0, self._count - self.length)

    def place_m(self, first: int, last: int) -> FloatArray:
        """Return the way over the ground in W (n, 2) of rows `first` to `last`, without the last one."""
        return self._slice(first, last)[:, 0:2]

    def rise_mps(self, first: int, last: int) -> FloatArray:
        """Return how fast the hip rises (n,)."""
        return self._slice(first, last)[:, 2]

    def speed_W_mps(self, first: int, last: int) -> FloatArray:
        """Return the horizontal velocity in W (n, 2)."""
        return self._slice(first, last)[:, 3:5]

    def rate_W_radps(self, first: int, last: int) -> FloatArray:
        """Return the angular rate in W (n, 3)."""
        return self._slice(first, last)[:, 5:8]

    def _slice(self, first: int, last: int) -> FloatArray:
        rows: FloatArray = self._rows[np.arange(max(first, self.first), min(last, self._count)) % self.length]
        return rows

    def _begin(self, at_ns: int, at: Callable[[int], AttitudeAt | None]) -> None:
        self._count, self._t0_ns = 0, at_ns
        attitude = at(at_ns)
        if attitude is not None:
            self._p_W_m = np.zeros(2)
            self._append(attitude)

    def _append(self, attitude: AttitudeAt) -> None:
        R_WB = matrix_from_quaternion(attitude.q_WB)
        w_W = R_WB @ np.array(attitude.w_WB_B)
        v_W = np.array(attitude.v_W_mps) + np.array(_cross(w_W.tolist(), (R_WB @ self._p_BC_m).tolist()))
        if self._count:
            self._p_W_m = self._p_W_m + 0.5e-9 * PERIOD_NS * (self._v_W_mps + v_W[:2])
            self._height_m += 0.5e-9 * PERIOD_NS * (self._rise_mps + float(v_W[2]))
        self._v_W_mps, self._rise_mps = v_W[:2], float(v_W[2])
        row = self._rows[self._count % self.length]
        row[0:2], row[2], row[3:5], row[5:8] = self._p_W_m, attitude.v_W_mps[2], v_W[:2], w_W
        self._count += 1


def _cross(a: list[float], b: list[float]) -> Vec3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


_COLUMNS = 8
_LONGEST_GAP_NS = 400_000_000

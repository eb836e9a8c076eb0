"""The attitudes of the last second, and the attitude at any instant between them."""

from bisect import bisect_left
from collections import deque
from operator import itemgetter
from typing import NamedTuple

from messages import Quaternion, Vec3
from messages.arrays import FloatArray
from perception import so3, vec3


class OutsideHistoryError(LookupError):
    """No attitude is known at the instant asked for."""


class AttitudeAt(NamedTuple):
    """Attitude, angular rate (rad/s, in B) and the bob of a walk (m/s, upwards, about its mean) at one instant.

    `rotation_cov_W` (3, 3), rad², is that of the small rotation in W between the attitude and the truth; `v_W_mps` the
    velocity, 0 before the start.
    """

    t_ns: int
    q_WB: Quaternion
    w_WB_B: Vec3
    vertical_swing_mps: float
    rotation_cov_W: FloatArray
    v_W_mps: Vec3 = vec3.ZERO

    @property
    def R_WB(self) -> FloatArray:
        """Return the attitude as a matrix, (3, 3)."""
        return so3.matrix_from_quaternion(self.q_WB)


class AttitudeHistory:
    """Ring of attitudes by time; one older than `length_s` before the newest leaves.

    Between two neighbours at most `longest_step_s` apart the attitude is interpolated (slerp, the rate linearly), with
    the covariance of the earlier, which a correction in between has not made smaller; after the newest it is
    extrapolated at the newest rate for `reach_s`, half a sample period at 100 Hz.
    """

    def __init__(self, length_s: float = 1.0, reach_s: float = 0.005, longest_step_s: float = 0.1) -> None:
        self._length_ns = round(1e9 * length_s)
        self._reach_ns = round(1e9 * reach_s)
        self._longest_step_ns = round(1e9 * longest_step_s)
        self._ring: deque[AttitudeAt] = deque()

    def __len__(self) -> int:
        return len(self._ring)

    @property
    def newest_ns(self) -> int | None:
        """Return the time of the newest attitude, or None if there is none."""
        return self._ring[-1].t_ns if self._ring else None

    @property
    def newest(self) -> AttitudeAt:
        """Return the newest attitude. Raises IndexError if there is none."""
        return self._ring[-1]

    def clear(self) -> None:
        """Remove everything, as after a new start of the filter, whose yaw starts anew."""
        self._ring.clear()

    def drop_after(self, t_ns: int) -> None:
        """Forget what is later than `t_ns`: it will be told again."""
        while self._ring and self._ring[-1].t_ns > t_ns:
            self._ring.pop()

    def append(self, attitude: AttitudeAt) -> None:
        """Take the newest attitude. Raises ValueError where it is not later than the one before it."""
        t_ns = attitude.t_ns
        if self._ring and t_ns <= self._ring[-1].t_ns:
            raise ValueError(f"attitude at {t_ns} ns: must be later than the newest, at {self._ring[-1].t_ns} ns")
        self._ring.append(attitude)
        while self._ring[0].t_ns < t_ns - self._length_ns:
            self._ring.popleft()

    def at(self, t_ns: int) -> AttitudeAt:
        """Return the attitude at `t_ns`.

        Raises OutsideHistoryError before the oldest, more than `reach_s` after the newest, or inside a gap.
        """
        if not self._ring:
            raise OutsideHistoryError(f"no attitude at {t_ns} ns: the history is empty")
        newest = self._ring[-1]
        if t_ns >= newest.t_ns:
            return self._extrapolated(newest, t_ns)
        index = bisect_left(self._ring, t_ns, key=itemgetter(0))
        after = self._ring[index]
        if after.t_ns == t_ns:
            return after
        if index == 0:
            raise OutsideHistoryError(f"no attitude at {t_ns} ns: the oldest is at {after.t_ns} ns")
        before = self._ring[index - 1]
        if after.t_ns - before.t_ns > self._longest_step_ns:
            raise OutsideHistoryError(f"no attitude at {t_ns} ns: a gap from {before.t_ns} to {after.t_ns} ns")
        return _between(before, after, t_ns)

    def after(self, t_ns: int) -> list[AttitudeAt]:
        """Return all that is later than `t_ns`, in order."""
        later: list[AttitudeAt] = []
        for attitude in reversed(self._ring):
            if attitude.t_ns <= t_ns:
                break
            later.append(attitude)
        later.reverse()
        return later

    def _extrapolated(self, newest: AttitudeAt, t_ns: int) -> AttitudeAt:
        if t_ns - newest.t_ns > self._reach_ns:
            raise OutsideHistoryError(
                f"no attitude at {t_ns} ns: the newest is at {newest.t_ns} ns and reaches {self._reach_ns} ns farther"
            )
        dt_s = 1e-9 * (t_ns - newest.t_ns)
        turn = so3.quaternion_from_rotvec(vec3.scaled(newest.w_WB_B, dt_s))
        return newest._replace(t_ns=t_ns, q_WB=so3.positive(so3.multiply(newest.q_WB, turn)))


def _between(before: AttitudeAt, after: AttitudeAt, t_ns: int) -> AttitudeAt:
    share = (t_ns - before.t_ns) / (after.t_ns - before.t_ns)
    rate = vec3.between(before.w_WB_B, after.w_WB_B, share)
    vertical_swing_mps = before.vertical_swing_mps + share * (after.vertical_swing_mps - before.vertical_swing_mps)
    v_W_mps = vec3.between(before.v_W_mps, after.v_W_mps, share)
    q_WB = so3.slerp(before.q_WB, after.q_WB, share)
    return AttitudeAt(t_ns, q_WB, rate, vertical_swing_mps, before.rotation_cov_W, v_W_mps)

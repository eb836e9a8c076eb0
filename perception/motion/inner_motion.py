"""How the camera moved within one step, row by row, as the IMU felt it: the shape of the motion, not its size.

A rolling shutter exposes one row after another, so a step between two pictures is as many motions as there are pairs of
rows. Between them the rate may change by more than what is measured. From samples w, sf of the IMU, in B at t = 0,

    R(t) = ∫ R [w − w₀]× dt,   p(t) = ∬ (R sf − sf₀) dt² + v t + (R(t) − 1) l                        (1)

with velocity v and the samples at rest, w₀ and sf₀, as they are foretold, and l where in B the camera is. What (1)
lacks over a step, a constant rate and a constant velocity, is left to what the camera sees.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from messages import Quaternion, Vec3
from messages.arrays import FloatArray
from perception import so3, vec3
from perception.attitude.foretold import MotionForetold
from perception.motion.sampled import integral, interpolated


@dataclass(frozen=True)
class InnerMotion:
    """R (m, 3, 3) and p (m, 3) of (1) in C as it was at t = 0, known at `t_s` (m,).

    `foretold` (6, 6) is the covariance of the constant rate and velocity by which it may be off, None where nothing is
    foretold; `noise` (6,) are the deviations of a mean rate and a mean velocity that follow from a shape that is not
    quite this. `acceleration_sd` (6,) are those of a constant angular and a constant linear acceleration by which it
    may be off, None where the shape is known.
    """

    t_s: FloatArray
    R: FloatArray
    p_m: FloatArray
    foretold: FloatArray | None
    noise: FloatArray
    acceleration_sd: FloatArray | None

    def at(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return R (n, 3, 3) and p (n, 3) at `t_s` (n,): on the line between two samples, which are close together."""
        poses = interpolated(t_s, self.t_s, np.concatenate((self.R.reshape(-1, 9), self.p_m), axis=1))
        return poses[:, :9].reshape(-1, 3, 3), poses[:, 9:]


def steady_motion(rates: FloatArray) -> InnerMotion:
    """Return the motion at constant `rates` (6,), angular first, for as long as any step lasts."""
    R = so3.matrices_from_rotvecs(np.outer(_STEADY_S, rates[:3]))
    return InnerMotion(_STEADY_S, R, np.outer(_STEADY_S, rates[3:]), None, _STEADY_NOISE, _STEADY_ACCELERATION_SD)


class RecentSamples:
    """Calibrated samples of the last `LENGTH_NS`; `R_BC` (3, 3) and `p_BC_m` say where the camera is."""

    LENGTH_NS = 400_000_000
    LONGEST_GAP_NS = 35_000_000
    """Between samples: two may be missing at 100 Hz."""

    def __init__(self, R_BC: FloatArray, p_BC_m: Vec3) -> None:
        self._R_BC = R_BC
        self._p_BC_m = np.array(p_BC_m)
        self._samples: deque[tuple[int, Vec3, Vec3]] = deque()

    def add(self, t_ns: int, sf_B_mps2: Vec3, w_B_radps: Vec3) -> None:
        """Take one sample, later than the one before it."""
        self._samples.append((t_ns, sf_B_mps2, w_B_radps))
        while t_ns - self._samples[0][0] > self.LENGTH_NS:
            self._samples.popleft()

    def inner_motion(
        self, t_ns: int, until_ns: int, margin_ns: int, foretold: MotionForetold | None, v_C_mps: FloatArray
    ) -> InnerMotion | None:
        """Return (1) from `margin_ns` before `t_ns`, its t = 0, to as long after `until_ns`; None where samples are
        missing. After the newest sample rate and specific force stay as they are.

        Where only the vertical is foretold, the velocity is `v_C_mps` (3,) at t = 0; where nothing is, throughout.
        """
        samples = self._around(t_ns - margin_ns, until_ns + margin_ns, until_ns)
        if samples is None:
            return None
        known = foretold if foretold is not None and samples[0][0] <= foretold.t_ns else None
        at_rest = vec3.ZERO if known is None or known.covariance is None else known.w_at_rest_radps
        q = so3.IDENTITY
        quaternions = [q]
        for (before_ns, _, w_before), (after_ns, _, w_after) in pairwise(samples):
            rate = vec3.minus(vec3.between(w_before, w_after, 0.5), at_rest)
            q = so3.multiply(q, so3.quaternion_from_rotvec(vec3.scaled(rate, 1e-9 * (after_ns - before_ns))))
            quaternions.append(q)
        sampled_s = [1e-9 * (each[0] - t_ns) for each in samples]
        beginning = so3.conjugate(_at(sampled_s, quaternions, 0.0))
        turned = [so3.multiply(beginning, q) for q in quaternions]
        times_s = np.array(sampled_s)
        R = np.array([so3.rows_from_quaternion(q) for q in turned]).reshape(-1, 3, 3)
        p_C = (R @ self._p_BC_m - self._p_BC_m) @ self._R_BC
        R_C = self._R_BC.T @ R @ self._R_BC
        if known is None:
            return _turns_only(times_s, R_C, p_C + np.outer(times_s, v_C_mps))
        foretold_s = 1e-9 * (known.t_ns - t_ns)
        R_then = so3.matrix_from_quaternion(_at(sampled_s, turned, foretold_s))
        sf_B = np.array([sf for _, sf, _ in samples])
        acceleration = (R @ sf_B[:, :, None])[:, :, 0] - R_then @ known.sf_at_rest_mps2
        gained = integral(times_s, acceleration)
        if known.covariance is None:
            way = integral(times_s, _less_that_at(0.0, times_s, gained) @ self._R_BC + v_C_mps)
            return _turns_only(times_s, R_C, p_C + _less_that_at(0.0, times_s, way))
        velocity = R_then @ known.v_B_mps + _less_that_at(foretold_s, times_s, gained)
        p_C += _less_that_at(0.0, times_s, integral(times_s, velocity)) @ self._R_BC
        covariance = so3.pair_covariance_turned(self._R_BC.T @ R_then, known.covariance)
        return InnerMotion(times_s, R_C, p_C, covariance, np.zeros(6), None)

    def _around(self, from_ns: int, to_ns: int, known_to_ns: int) -> list[tuple[int, Vec3, Vec3]] | None:
        """Return the samples from the last one before `from_ns` on, the newest repeated at `to_ns` if that is later."""
        samples = list(self._samples)
        while len(samples) > 2 and samples[1][0] <= from_ns:
            samples.pop(0)
        if len(samples) < 2 or samples[0][0] > from_ns or samples[-1][0] < known_to_ns - self.LONGEST_GAP_NS:
            return None
        if any(after[0] - before[0] > self.LONGEST_GAP_NS for before, after in pairwise(samples)):
            return None
        newest_ns, sf_B, w_B = samples[-1]
        return samples if newest_ns >= to_ns else [*samples, (to_ns, sf_B, w_B)]


def _turns_only(times_s: FloatArray, R: FloatArray, p_m: FloatArray) -> InnerMotion:
    return InnerMotion(times_s, R, p_m, None, _TURNS_ONLY_NOISE, _TURNS_ONLY_ACCELERATION_SD)


def _at(times_s: Sequence[float], quaternions: Sequence[Quaternion], t_s: float) -> Quaternion:
    after = min(max(bisect_left(times_s, t_s), 1), len(times_s) - 1)
    share = (t_s - times_s[after - 1]) / (times_s[after] - times_s[after - 1])
    return so3.slerp(quaternions[after - 1], quaternions[after], share)


def _less_that_at(t_s: float, times_s: FloatArray, values: FloatArray) -> FloatArray:
    return values - interpolated(np.array(t_s), times_s, values)


_STEADY_S = np.linspace(-0.02, 0.16, 19)
"""From rows before a step to rows after the longest."""
_STEADY_NOISE = np.repeat((0.06, 0.03), 3)
"""rad/s and m/s: what the steps of a walk are off by where their rates are taken as constant."""
_TURNS_ONLY_NOISE = np.repeat((0.005, 0.01), 3)
"""rad/s and m/s: where only the velocity is."""
_STEADY_ACCELERATION_SD, _TURNS_ONLY_ACCELERATION_SD = np.repeat((3.0, 3.0), 3), np.repeat((0.2, 3.0), 3)
"""rad/s² and m/s²: of a walker; 3 m/s² is also what of gravity counts as motion where the vertical is off by 18°."""

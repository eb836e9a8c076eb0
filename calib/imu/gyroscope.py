"""Bias, scale and cross-axis terms of a gyroscope: what it carries from one rest to the next must be gravity.

Between two rests the corrected rate M (w − b) turns the vertical u, which the accelerometer tells at both:

    u₁ = R(M) u₂ + n,   R(M) = Π exp(M (w_i − b) dt)                                                (1)

Turns about the vertical tell nothing of that axis [Tedaldi, Pretto, Menegatti, ICRA 2014, where the same is done]. The
bias goes from that of the one rest to that of the other. As with the accelerometer, what the turns do not tell is not
supported.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from calib.imu.log import ImuLog
from calib.imu.rests import Rest
from messages.arrays import BoolArray, FloatArray
from messages.constants import NORMAL_95

PRIOR_STD = np.where(np.eye(3, dtype=np.bool_), 0.5, 0.05).ravel()
"""Of M: counts may be stated wrongly by a third; axes lie in the chip to some degrees."""
SUPPORTED_STD = 0.005
"""0.5 % of scale, 0.3° of an axis."""
_LONGEST_S = 60.0
_LEAST_TURN = math.radians(15.0)
_NOISE_RADPS_RTHZ = math.radians(0.01)
_BIAS_STD_RADPS = math.radians(0.02)
"""By which the bias differs between two rests and on the way: also its sensitivity to g."""
_DIRECTION_STD_RAD = 1e-3
"""Of a rest's vertical: what the accelerometer's calibration leaves."""
_LEAST_FREEDOM = 6
_ROUNDS = 12
_LEAST_TURNS, _CLEARLY = 4, 0.1


@dataclass(frozen=True)
class GyroscopeFit:
    """M (3, 3) and bias (3,) rad/s of (1), deviations and half-widths of 95 % intervals of both, and which values are
    supported. `carried_rad` (n,) is by how much each turn misses the next rest's vertical, `before_rad` the same with
    M = 1; `signs` those of the accelerometer's axes with which both sensors would agree, where they do not."""

    matrix: FloatArray
    bias: FloatArray
    matrix_std: FloatArray
    matrix_half_width: FloatArray
    bias_std: FloatArray
    supported: BoolArray
    carried_rad: FloatArray
    before_rad: FloatArray
    signs: tuple[float, float, float] | None


@dataclass(frozen=True)
class _Turn:
    """One way from rest to rest: verticals before and after (3,), rates less their bias (k, 3), steps (k,) s."""

    before: FloatArray
    after: FloatArray
    w: FloatArray
    dt_s: FloatArray
    std: float


def fit_gyroscope(
    logs: Sequence[ImuLog], rests: Sequence[Rest], directions: FloatArray, usable: BoolArray
) -> GyroscopeFit | None:
    """Return what the rests and the ways between them tell; `directions` (n, 3) are the verticals in the rests, of
    which those are `usable` whose accelerometer axes are supported. None where no log has a gyroscope in known units.
    """
    resting = [rest for rest in rests if logs[rest.log].gyro_is_scaled]
    if not resting:
        return None
    weights = np.array([rest.seconds for rest in resting])
    biases = np.array([rest.w for rest in resting])
    bias = weights @ biases / weights.sum()
    noise = math.sqrt(float(weights @ np.array([rest.w_std**2 for rest in resting])) / weights.sum() / len(resting))
    scatter = biases.std(axis=0, ddof=1) if len(resting) > 1 else np.full(3, _BIAS_STD_RADPS)
    bias_std = np.hypot(scatter / math.sqrt(len(resting)), noise)
    turns = _turns(logs, rests, directions, usable)
    M = np.eye(3)
    before = _missed(turns, M)[0]
    found, covariance, times = _solved(turns, M)
    missed, _ = _missed(turns, found)
    signs = _signs(turns, missed)
    std = np.sqrt(np.diag(covariance)).reshape(3, 3)
    return GyroscopeFit(
        matrix=found,
        bias=bias,
        matrix_std=std,
        matrix_half_width=times * std,
        bias_std=bias_std,
        supported=(std < SUPPORTED_STD) & (signs is None),
        carried_rad=np.linalg.norm(missed.reshape(-1, 3), axis=1),
        before_rad=np.linalg.norm(before.reshape(-1, 3), axis=1),
        signs=signs,
    )


def _turns(logs: Sequence[ImuLog], rests: Sequence[Rest], directions: FloatArray, usable: BoolArray) -> list[_Turn]:
    found = []
    for k, (first, second) in enumerate(pairwise(rests)):
        log = logs[first.log]
        if first.log != second.log or not log.gyro_is_scaled or not (usable[k] and usable[k + 1]):
            continue
        start, stop = first.last - 1, second.first
        t_s = log.t_s[start : stop + 1]
        moving_s = float(t_s[-1] - t_s[0])
        share = ((t_s[:-1] - t_s[0]) / moving_s)[:, None]
        rate = 0.5 * (log.w[start:stop] + log.w[start + 1 : stop + 1]) - (first.w + share * (second.w - first.w))
        turned = float((np.linalg.norm(rate, axis=1) * np.diff(t_s)).sum())
        if moving_s > _LONGEST_S or turned < _LEAST_TURN:
            continue
        noise, drift = _NOISE_RADPS_RTHZ**2 * moving_s, (_BIAS_STD_RADPS * moving_s) ** 2
        std = math.sqrt(noise + drift + 2.0 * _DIRECTION_STD_RAD**2)
        found.append(_Turn(directions[k], directions[k + 1], rate, np.diff(t_s), std))
    return found


def _solved(turns: list[_Turn], start: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return M (3, 3), the covariance (9, 9) of its entries and the factor of their 95 % intervals."""
    M = start
    prior = np.diag(PRIOR_STD**-2.0)
    std = np.repeat([turn.std for turn in turns], 3)
    normal = prior
    for _ in range(_ROUNDS):
        missed, J = _missed(turns, M)
        Jw = J / std[:, None]
        normal = Jw.T @ Jw + prior
        step = np.linalg.solve(normal, -Jw.T @ (missed / std) - prior @ (M - np.eye(3)).ravel())
        M = M + step.reshape(3, 3)
        if np.abs(step).max() < 1e-9:
            break
    missed, J = _missed(turns, M)
    Jw = J / std[:, None]
    freedom = 2.0 * len(turns) - float(np.trace(np.linalg.solve(normal, Jw.T @ Jw)))
    variance, times = 1.0, NORMAL_95
    if freedom >= _LEAST_FREEDOM:
        variance, times = float(((missed / std) ** 2).sum()) / freedom, float(student.ppf(0.975, freedom))
    return M, np.linalg.inv(Jw.T @ Jw / max(variance, 1e-12) + prior), times


def _missed(turns: list[_Turn], M: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what (1) leaves (3 n,), in the frame before each turn, and its derivatives (3 n, 9) by M, row by row."""
    missed, rows = np.empty(3 * len(turns)), np.empty((3 * len(turns), 9))
    for k, turn in enumerate(turns):
        steps = Rotation.from_rotvec(turn.w @ M.T * turn.dt_s[:, None])
        R = _running(steps)
        carried = R[-1] @ turn.after
        missed[3 * k : 3 * k + 3] = carried - turn.before
        weighted = turn.w * turn.dt_s[:, None]
        turned = np.einsum("nij,nk->ijk", R[:-1], weighted).reshape(3, 9)
        rows[3 * k : 3 * k + 3] = -_skew(carried) @ turned
    return missed, rows


def _running(steps: Rotation) -> FloatArray:
    """Return the products of the rotations up to each (n + 1, 3, 3), the first the identity, by doubling."""
    R: FloatArray = np.concatenate((np.eye(3)[None], steps.as_matrix()))
    reach = 1
    while reach < len(R):
        R[reach:] = R[:-reach] @ R[reach:]
        reach *= 2
    return R


def _skew(v: FloatArray) -> FloatArray:
    x, y, z = v
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def _signs(turns: list[_Turn], missed: FloatArray) -> tuple[float, float, float] | None:
    """Return the signs of the accelerometer's axes with which the turns agree far better; None where they do as it is.

    Of axes with signs S the vertical turns by −S w.
    """
    if len(turns) < _LEAST_TURNS:
        return None
    best: tuple[float, float, float] | None = None
    least = _CLEARLY * float((missed**2).sum())
    for signs in product((1.0, -1.0), repeat=3):
        turned = [_Turn(turn.before, turn.after, -turn.w * signs, turn.dt_s, turn.std) for turn in turns]
        squares = float((_missed(turned, np.eye(3))[0] ** 2).sum())
        if squares < least and np.prod(signs) < 0.0:
            least, best = squares, (signs[0], signs[1], signs[2])
    return best

"""Where the foot lands: the way of the hip until then, half a step ahead of it and half a step's width beside it.

A turn goes on as it went over the last stride. In axes that turn with it the way walked, ahead and to the left, is

    s(τ) = c_0 + c_1 τ + c_2 g(τ) + Σ_k a_k cos kθ + b_k sin kθ,   k = 1, 2,                                  (1)

τ the time from now on, g the way of a unit acceleration, which does not last, θ the phase of the stride: the hip goes
faster and slower once a step (k = 2), who limps once a stride too, and it sways once a stride (k = 1). What of (1) is
no ripple goes on. c_2 and the ripple have priors, which bound them while a stride tells little.

How far ahead of the camera the foot strikes no picture tells: it strikes when the hip is midway between the feet
(Perry, Burnfield, Gait Analysis), half a step's length, speed by step time, ahead of the hip; the camera at the front
of the belt is about as far ahead of the hip joint as the sole's middle is of the ankle. Feet are put down about 11 cm
apart and scatter by 2 to 3 cm (Owings, Grabiner, J. Biomechanics 37, 2004, and their references).
"""

import math
from typing import NamedTuple

import numpy as np

from messages.arrays import FloatArray
from perception.gait.trail import PERIOD_NS
from perception.gait.watch import GaitWatch, NextContact
from perception.terrain.path_ahead import PathAhead


class Landing(NamedTuple):
    """Where and when a foot will land: `ahead_m` and `left_m` of the left optical centre along x and y of H, `time_s`
    after the frame; each with one σ. `step_m` is the length of a step."""

    ahead_m: float
    ahead_sd_m: float
    left_m: float
    left_sd_m: float
    time_s: float
    time_sd_s: float
    step_m: float


def next_landing(gait: GaitWatch, t_ns: int, heading_rad: float, left: bool, middle_left_m: float) -> Landing | None:
    """Return where the left or right foot lands next, seen from H at `t_ns`, of this heading in W.

    `middle_left_m` is how far to the left of the left optical centre the middle of the wearer is taken to be. None
    where no walk is seen.
    """
    contact = gait.next_contact(left)
    if contact is None:
        return None
    way = _way(gait, contact)
    if way is None:
        return None
    tau_s = contact.rows * _ROW_S
    since_s = 1e-9 * (t_ns - gait.trail.t_ns(gait.trail.count - 1))
    hip_W, velocity_W = way.at(tau_s)
    hip_W = hip_W - since_s * gait.trail.speed_W_mps(gait.trail.count - 1, gait.trail.count)[0]
    speed_mps = float(np.hypot(*velocity_W))
    if speed_mps < _LEAST_SPEED_MPS:
        return None
    forward = velocity_W / speed_mps
    leftward = np.array([-forward[1], forward[0]])
    step_m = speed_mps * contact.step * _ROW_S
    beside_m = _HALF_WIDTH_M if left else -_HALF_WIDTH_M
    place_W = hip_W + 0.5 * step_m * forward + beside_m * leftward
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    time_sd_s = contact.sigma * _ROW_S
    sd_ahead_m, sd_left_m = way.sd_m(tau_s)
    return Landing(
        ahead_m=float(c * place_W[0] + s * place_W[1]),
        ahead_sd_m=math.hypot(
            sd_ahead_m,
            speed_mps * time_sd_s,
            _LEAD_SIGMA * step_m,
            _SCATTER_AHEAD_M,
            _CHANGE_S2 * float(way.c[0, 2]),
        ),
        left_m=float(c * place_W[1] - s * place_W[0]) + middle_left_m,
        left_sd_m=math.hypot(
            sd_left_m, _SCATTER_ACROSS_M, _HALF_WIDTH_SIGMA_M, _TURN_M_S * way.turn_radps * (1.0 + tau_s)
        ),
        time_s=tau_s - since_s,
        time_sd_s=time_sd_s,
        step_m=step_m,
    )


def off_edges(landing: Landing, path: PathAhead) -> Landing:
    """Return a landing as far from the edges of `path` as feet are put: half a foot, or in the middle of a tread."""
    borders_m = [edge.distance_m - landing.left_m * math.tan(edge.yaw_rad) for edge in path.edges]
    before_m = max((at for at in borders_m if at <= landing.ahead_m), default=-math.inf)
    behind_m = min((at for at in borders_m if at > landing.ahead_m), default=math.inf)
    off_m = min(_HALF_FOOT_M, 0.5 * (behind_m - before_m))
    return landing._replace(ahead_m=min(max(landing.ahead_m, before_m + off_m), behind_m - off_m))


class _Way(NamedTuple):
    """(1), fitted, from the hip's place now on, along `axes` (2, 2), whose columns are ahead and to the left in W and
    turn by `turn_radps`; `cov` (2, 3, 3) is that of the two rows of `c` (2, 3)."""

    axes: FloatArray
    turn_radps: float
    c: FloatArray
    cov: FloatArray

    def at(self, tau_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the place and the velocity in W (2,) each."""
        lasts_s = min(tau_s, self._lasts_s)
        gone_m, rate_mps = self.c @ _terms(tau_s, lasts_s), self.c @ np.array([0.0, 1.0, lasts_s])
        turned_rad = self.turn_radps * tau_s
        place_m: FloatArray = self.axes @ _turned(0.5 * turned_rad) @ gone_m
        velocity_mps: FloatArray = self.axes @ _turned(turned_rad) @ rate_mps
        return place_m, velocity_mps

    @property
    def _lasts_s(self) -> float:
        """Return for how long an acceleration lasts; who slows down does so no further than to a part of the speed."""
        speed_mps, acceleration_mps2 = float(self.c[0, 1]), float(self.c[0, 2])
        if acceleration_mps2 >= 0.0:
            return _LASTS_S
        return min(_LASTS_S, max(0.0, (1.0 - _LEAST_LEFT) * speed_mps / -acceleration_mps2))

    def sd_m(self, tau_s: float) -> tuple[float, float]:
        """Return one σ of the place, ahead and to the left."""
        terms = _terms(tau_s, min(tau_s, self._lasts_s))
        along, across = (math.sqrt(float(terms @ cov @ terms)) for cov in self.cov)
        return along, across


def _way(gait: GaitWatch, contact: NextContact) -> _Way | None:
    trail = gait.trail
    first = max(trail.first, trail.count - round(_WINDOW_STEPS * contact.step))
    if trail.count - first < _LEAST_STEPS * contact.step:
        return None
    rows = np.arange(first, trail.count)
    tau_s = (rows - rows[-1]) * _ROW_S
    stride = min(len(rows), round(2.0 * contact.step))
    turn_radps = float(trail.rate_W_radps(trail.count - stride, trail.count)[:, 2].mean())
    speed = trail.speed_W_mps(first, trail.count)
    straight_mps = (speed[:, 0] + 1j * speed[:, 1]) * np.exp(-1j * turn_radps * tau_s)
    mean_mps = straight_mps[-stride:].mean()
    if abs(mean_mps) < _LEAST_SPEED_MPS:
        return None
    way_m = np.cumsum(straight_mps * (abs(mean_mps) / mean_mps)) * _ROW_S
    way_m -= way_m[-1]
    theta = gait.theta_at(rows.astype(np.float64))
    ripple = (np.cos(theta), np.sin(theta), np.cos(2.0 * theta), np.sin(2.0 * theta))
    design = np.column_stack((np.ones_like(tau_s), tau_s, 0.5 * tau_s**2, *ripple))
    told = design.T @ design / _NOISE_M**2
    c, cov = np.empty((2, 3)), np.empty((2, 3, 3))
    for axis, gone_m in enumerate((way_m.real, way_m.imag)):
        inverse = np.linalg.inv(told + _PRIOR[axis])
        c[axis] = (inverse @ (design.T @ gone_m) / _NOISE_M**2)[:3]
        cov[axis] = inverse[:3, :3]
    x, y = mean_mps.real / abs(mean_mps), mean_mps.imag / abs(mean_mps)
    return _Way(np.array([[x, -y], [y, x]]), turn_radps, c, cov)


def _turned(angle_rad: float) -> FloatArray:
    """Return the rotation (2, 2) to the left."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s], [s, c]])


def _terms(tau_s: float, lasts_s: float) -> FloatArray:
    return np.array([1.0, tau_s, 0.5 * lasts_s**2 + lasts_s * (tau_s - lasts_s)])


_ROW_S = 1e-9 * PERIOD_NS
_HALF_FOOT_M = 0.10
_WINDOW_STEPS, _LEAST_STEPS = 2.2, 1.5
_LASTS_S = 0.5
_LEAST_LEFT = 0.5
_LEAST_SPEED_MPS = 0.25
_NOISE_M = 0.01
"""What (1) misses of a way, as alike as neighbouring rows are."""
_PRIOR = np.array([np.diag([0.0, 0.0, *(sigma**-2 for sigma in sigmas)]) for sigmas in (
    (1.0, 0.012, 0.012, 0.012, 0.012),  # m/s², m, m, m, m ahead
    (0.3, 0.025, 0.025, 0.004, 0.004),  # to the left
)])  # fmt: skip
_HALF_WIDTH_M, _HALF_WIDTH_SIGMA_M = 0.055, 0.012
_LEAD_SIGMA = 0.03
_SCATTER_AHEAD_M, _SCATTER_ACROSS_M = 0.025, 0.02
_CHANGE_S2, _TURN_M_S = 0.06, 0.08
"""So far off is a foothold, 1 σ, for each m/s² by which the speed changes and each rad/s of a turn: neither lasts."""

"""Where the foot lands: the way of the hip until then, half a step ahead of it and half a step's width beside it.

A turn goes on as it went over the last stride. In axes that turn with it the way ahead is told by the speed and its
change (`speed`), and that to the left is

    s(τ) = c_0 + c_1 τ + c_2 g(τ) + Σ_k a_k cos kθ + b_k sin kθ,   k = 1, 2,                                  (1)

τ the time from now on, g the way of a unit acceleration, which does not last, θ the phase of the stride: the hip sways
once a stride (k = 1). What of (1) is no ripple goes on. c_2 and the ripple have priors, which bound them while a stride
tells little.

How far ahead of the camera the foot strikes no picture tells: it strikes when the hip is midway between the feet
(Perry, Burnfield, Gait Analysis), half a step's length ahead of the hip; the camera at the front of the belt is about
as far ahead of the hip joint as the sole's middle is of the ankle. Whoever goes faster takes longer steps and more of
them: the length of a step over their rate, the walk ratio, stays (Sekiya, Nagasaki, Furuna, J. Human Movement Studies
30, 1996). With the speed v̄ and the time T of a step over the last stride, a step at the speed v is as long as

    l = T √(v v̄).                                                                                               (2)

Feet are put down about 11 cm apart and scatter by 2 to 3 cm (Owings, Grabiner, J. Biomechanics 37, 2004, and their
references).
"""

import math
from typing import NamedTuple

import numpy as np

from messages.arrays import FloatArray
from perception.gait.speed import Gone
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
    if way.ahead.speed_mps < _LEAST_SPEED_MPS:
        return None
    forward = velocity_W / speed_mps
    leftward = np.array([-forward[1], forward[0]])
    step_m = contact.step * _ROW_S * math.sqrt(way.ahead.speed_mps * way.mean_mps)  # (2)
    beside_m = _HALF_WIDTH_M if left else -_HALF_WIDTH_M
    place_W = hip_W + 0.5 * step_m * forward + beside_m * leftward
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    time_sd_s = contact.sigma * _ROW_S
    by = np.array([1.0, 0.25 * step_m / way.ahead.speed_mps])
    return Landing(
        ahead_m=float(c * place_W[0] + s * place_W[1]),
        ahead_sd_m=math.hypot(
            math.sqrt(float(by @ way.ahead.cov @ by)), speed_mps * time_sd_s, _LEAD_SIGMA * step_m, _SCATTER_AHEAD_M
        ),
        left_m=float(c * place_W[1] - s * place_W[0]) + middle_left_m,
        left_sd_m=math.hypot(
            way.left_sd_m(tau_s),
            _SCATTER_ACROSS_M,
            _HALF_WIDTH_SIGMA_M,
            _TURN_M_S * way.turn_radps * (1.0 + tau_s),
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
    """The way from the hip's place now on, along `axes` (2, 2), whose columns are ahead and to the left in W and turn
    by `turn_radps`: `ahead` at the contact, and to the left (1), fitted, with `c` (3,) of covariance `cov` (3, 3).
    `mean_mps` is the speed over the last stride."""

    axes: FloatArray
    turn_radps: float
    mean_mps: float
    ahead: Gone
    c: FloatArray
    cov: FloatArray

    def at(self, tau_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the place and the velocity in W (2,) each, at the contact, `tau_s` from now."""
        gone_m = np.array([self.ahead.way_m, self.c @ _terms(tau_s)])
        rate_mps = np.array([self.ahead.speed_mps, self.c @ np.array([0.0, 1.0, min(tau_s, _LASTS_S)])])
        turned_rad = self.turn_radps * tau_s
        place_m: FloatArray = self.axes @ _turned(0.5 * turned_rad) @ gone_m
        velocity_mps: FloatArray = self.axes @ _turned(turned_rad) @ rate_mps
        return place_m, velocity_mps

    def left_sd_m(self, tau_s: float) -> float:
        """Return one σ of the place to the left."""
        terms = _terms(tau_s)
        return math.sqrt(float(terms @ self.cov @ terms))


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
    left_m = np.cumsum((straight_mps * (abs(mean_mps) / mean_mps)).imag) * _ROW_S
    left_m -= left_m[-1]
    theta = gait.theta_at(rows.astype(np.float64))
    ripple = (np.cos(theta), np.sin(theta), np.cos(2.0 * theta), np.sin(2.0 * theta))
    design = np.column_stack((np.ones_like(tau_s), tau_s, 0.5 * tau_s**2, *ripple))
    cov = np.linalg.inv(design.T @ design / _NOISE_M**2 + _PRIOR)
    c = cov @ (design.T @ left_m) / _NOISE_M**2
    x, y = mean_mps.real / abs(mean_mps), mean_mps.imag / abs(mean_mps)
    axes = np.array([[x, -y], [y, x]])
    return _Way(axes, turn_radps, float(abs(mean_mps)), gait.gone(contact.rows), c[:3], cov[:3, :3])


def _turned(angle_rad: float) -> FloatArray:
    """Return the rotation (2, 2) to the left."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s], [s, c]])


def _terms(tau_s: float) -> FloatArray:
    lasts_s = min(tau_s, _LASTS_S)
    return np.array([1.0, tau_s, 0.5 * lasts_s**2 + lasts_s * (tau_s - lasts_s)])


_ROW_S = 1e-9 * PERIOD_NS
_HALF_FOOT_M = 0.10
_WINDOW_STEPS, _LEAST_STEPS = 2.2, 1.5
_LASTS_S = 0.5
_LEAST_SPEED_MPS = 0.25
_NOISE_M = 0.01
"""What (1) misses of a way, as alike as neighbouring rows are."""
_PRIOR = np.diag([0.0, 0.0, *(sigma**-2 for sigma in (0.3, 0.025, 0.025, 0.004, 0.004))])  # m/s², m, m, m, m
_HALF_WIDTH_M, _HALF_WIDTH_SIGMA_M = 0.055, 0.012
_LEAD_SIGMA = 0.03
_SCATTER_AHEAD_M, _SCATTER_ACROSS_M = 0.025, 0.02
_TURN_M_S = 0.08
"""So far off is a foothold, 1 σ, for each rad/s of a turn, which does not last."""

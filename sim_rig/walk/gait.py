"""How the hip of a walking person moves, in closed form, so that specific force and angular rate are exact.

Six generalised coordinates q = (x, y, z, roll, pitch, yaw) are sums of several kinds of term, each with its exact
derivatives, on top of a planned way over the ground (`legs`):

- gait (`hip_terms`): sinusoids of the step phase φ (one cycle a step, a heel strike at every whole number), faded in
  and out with the walk. φ lags behind the planned one or leads it where steps take unequal times: by chance, or a limp;
- heel strikes: damped bursts u(τ) = A τ³ exp(−τ/τ_d) sin(2πfτ), three times continuously differentiable at onset;
- posture: sitting down, stumbling, and sway in the time since start, millimetres and tenths of a degree below 1 Hz.

Frames: W with z up, x ahead and y left of a wearer who has not turned; B the IMU. R_WB = Rz(yaw) Ry(pitch) Rx(roll) ·
R_worn, where R_worn pitches the device by 45° and a few degrees of the belt's own tilt. The six coordinates are those
of B's origin. Where the ground itself moves (`ride`), W moves with it: only the IMU measures that.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from messages.arrays import BoolArray, FloatArray, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.walk.hip_terms import PITCH, YAW, Bursts, HipMotion, Terms, X, Z, of_phase
from sim_rig.walk.legs import Leg, plan
from sim_rig.walk.ramps import Derivatives, with_derivatives
from sim_rig.walk.ride import Ride, Riding
from sim_rig.walk.world import World

GRAVITY_W_MPS2 = np.array([0.0, 0.0, -STANDARD_GRAVITY_MPS2])
CAMERA_PITCH_RAD = np.deg2rad(45.0)

_GROUND_SIGMA_M = 0.25
_GROUND_GRID_M = 0.05

_LIMP_LATE_STEPS = 0.12  # of a full limp: so much of a step's time later the foot lands on one side
_LIMP_SOFTENS = 0.4  # and so much softer
_MOST_UNTIMELY_STEPS = 0.1


@dataclass(frozen=True)
class Motion:
    """The state of B at n instants: p_WB, v_WB, a_WB (n, 3) in W; R_WB (n, 3, 3); w_WB_B (n, 3) in B; standing (n,)."""

    p_WB_m: FloatArray
    v_WB_mps: FloatArray
    a_WB_mps2: FloatArray
    R_WB: FloatArray
    w_WB_B_radps: FloatArray
    standing: BoolArray

    @property
    def sf_B_mps2(self) -> FloatArray:
        """Return the specific force (n, 3) in B, on ground that is at rest: acceleration less gravity."""
        return _into_B(self.R_WB, self.a_WB_mps2 - GRAVITY_W_MPS2)


@dataclass(frozen=True)
class Habits:
    """How a wearer walks.

    With a full `limp`, 1, one foot lands later by 12 % of a step's time, and the hip drops by 2 cm and 4° on that side;
    0 is none. The time of each landing differs by `step_scatter_s` (1 σ).
    """

    limp: float = 0.0
    step_scatter_s: float = 0.0


EVEN = Habits()


class Course(NamedTuple):
    """Where the hip is led at n instants of a lap: x and y (n, 2), heading (n,), length of a step (n,)."""

    xy_m: FloatArray
    heading_rad: FloatArray
    step_m: FloatArray


class Gait:
    """The motion of one wearer over `world`: the `legs` make one lap, repeated without end from `start_ns` on.

    A lap begins and ends standing, at x = 0 and at a whole number of laps of the world. Before `start_ns` the wearer
    stands. The course is turned by `course_rad` (> 0 to the left) from x. `seed` draws the wearer's amplitudes
    (± 10 %), phases of sway, how the belt sits and when each foot lands. If it `repeats`, the sway, too, is that of the
    lap before.
    """

    def __init__(
        self,
        world: World,
        legs: tuple[Leg, ...],
        hip_height_m: float,
        seed: int,
        start_ns: int,
        *,
        habits: Habits = EVEN,
        ride: Ride | None = None,
        course_rad: float = 0.0,
        repeats: bool = False,
    ) -> None:
        rng = np.random.default_rng([seed, 2])
        self.start_ns = start_ns
        self._hip_height_m = hip_height_m
        self._world_m = world.length_m
        planned = plan(legs)
        self.lap_s = planned.lap_s
        self._pace = with_derivatives(planned.pace)
        path, heading = _on_course(planned.path, planned.heading, course_rad)
        self._path = with_derivatives(path)
        self._heading = with_derivatives(heading)
        self._lean, self._sink, self._back = map(with_derivatives, (planned.lean, planned.sink, planned.back))
        self.lap_advance_m: FloatArray = path(self.lap_s)
        self._ground = with_derivatives(_smoothed_ground(world))
        chance = np.random.default_rng([seed, 12])
        self._phase = with_derivatives(_step_phase(planned.pace, habits, chance))
        self.strike_s, self._strike_strength = self._strikes(habits)
        self._gait_terms = Terms.gait(rng)
        self._sway_terms = Terms.sway(rng, self.lap_s if repeats else None)
        self._limp_terms = Terms.limp(chance, habits.limp) if habits.limp else None
        self._bursts = Bursts()
        belt = np.deg2rad(rng.uniform((-2.0, -3.0, -2.0), (2.0, 3.0, 2.0)))
        self._R_worn = _rotations(belt[None] + (0.0, CAMERA_PITCH_RAD, 0.0))[0]
        self._riding = Riding(ride) if ride is not None else None

    def imu(self, t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return sf_B (n, 3) in m/s² and w_WB_B (n, 3) in rad/s at the instants `t_ns` (n,), with the ride's share."""
        motion = self.at(t_ns)
        if self._riding is None:
            return motion.sf_B_mps2, motion.w_WB_B_radps
        floor = self._riding.at(self._since_start_s(t_ns))
        a_W = floor.acceleration_mps2(motion.p_WB_m, motion.v_WB_mps, motion.a_WB_mps2)
        w_B = motion.w_WB_B_radps + _into_B(motion.R_WB, floor.w_radps)
        return _into_B(motion.R_WB, a_W - GRAVITY_W_MPS2), w_B

    def at(self, t_ns: IntArray) -> Motion:
        """Return the motion, over the ground, at the instants `t_ns` (n,) of CLOCK_MONOTONIC."""
        t = self._since_start_s(t_ns)
        lap, t_lap = np.divmod(np.maximum(t, 0.0), self.lap_s)
        q, dq, ddq = self._hip(t, t_lap)
        heading = _evaluated(self._heading, t_lap)
        for k, (each, turned) in enumerate(zip((q, dq, ddq), _turned(q, dq, ddq, heading), strict=True)):
            each[:, :2] = turned
            each[:, YAW] += heading[k]

        (xy, dxy, ddxy) = _evaluated(self._path, t_lap)
        g, dg, ddg = _evaluated(self._ground, np.mod(xy[:, 0], self._world_m))
        p, v, a = q[:, :3].copy(), dq[:, :3].copy(), ddq[:, :3].copy()
        p[:, :2] += xy + lap[:, None] * self.lap_advance_m
        v[:, :2] += dxy
        a[:, :2] += ddxy
        p[:, 2] += g + self._hip_height_m
        v[:, 2] += dg * dxy[:, 0]
        a[:, 2] += ddg * dxy[:, 0] ** 2 + dg * ddxy[:, 0]
        return Motion(
            p_WB_m=p,
            v_WB_mps=v,
            a_WB_mps2=a,
            R_WB=_rotations(q[:, 3:]) @ self._R_worn,
            w_WB_B_radps=_body_rates(q[:, 3:], dq[:, 3:]) @ self._R_worn,
            standing=self._stands(t_lap),
        )

    def course(self, t_lap_s: FloatArray) -> Course:
        """Return where the hip is led at the instants (n,) of a lap, without what the steps add."""
        way_rate, phase_rate = self._pace[1](t_lap_s)[:, :2].T
        step_m = np.divide(way_rate, phase_rate, out=np.zeros_like(way_rate), where=phase_rate > 0.0)
        return Course(self._path[0](t_lap_s), self._heading[0](t_lap_s), step_m)

    def _since_start_s(self, t_ns: IntArray) -> FloatArray:
        return (np.asarray(t_ns) - self.start_ns).astype(np.float64) * 1e-9

    def _hip(self, t: FloatArray, t_lap: FloatArray) -> HipMotion:
        """Return q, q̇, q̈ (n, 6) without the way: ahead, to the left and up of where the wearer is led."""
        (_, planned, fade), (_, dplanned, dfade), (_, ddplanned, ddfade) = (p(t_lap).T for p in self._pace)
        phi, dphi, ddphi = of_phase(_evaluated(self._phase, planned), dplanned, ddplanned)
        q, dq, ddq = self._gait_terms.faded(phi, dphi, ddphi, fade, dfade, ddfade)
        added = [self._sway_terms.of_time(t), self._heel_strikes(t_lap)]
        if self._limp_terms is not None:
            added.append(self._limp_terms.faded(phi, dphi, ddphi, fade, dfade, ddfade))
        for terms in added:
            q, dq, ddq = q + terms[0], dq + terms[1], ddq + terms[2]
        for axis, sign, posture in ((PITCH, 1.0, self._lean), (Z, -1.0, self._sink), (X, -1.0, self._back)):
            for each, value in zip((q, dq, ddq), _evaluated(posture, t_lap), strict=True):
                each[:, axis] += sign * value
        return q, dq, ddq

    def _stands(self, t_lap: FloatArray) -> BoolArray:
        upright = (np.abs(self._sink[0](t_lap)) < _UPRIGHT) & (np.abs(self._lean[0](t_lap)) < _UPRIGHT)
        standing: BoolArray = upright & (self._pace[0](t_lap)[:, 2] == 0.0)
        return standing

    def _strikes(self, habits: Habits) -> tuple[FloatArray, FloatArray]:
        """Return when, within a lap, the heels strike (n,), and how hard (n,)."""
        t = np.arange(0.0, self.lap_s, 1e-3)
        phi = self._phase[0](self._pace[0](t)[:, 1])
        strike_s = np.interp(np.arange(1, int(phi[-1]) + 1), phi, t)
        strength: FloatArray = self._pace[0](strike_s)[:, 2]
        strength[_LATE_SIDE::2] *= 1.0 - _LIMP_SOFTENS * habits.limp
        return strike_s, strength

    def _heel_strikes(self, t_lap: FloatArray) -> HipMotion:
        latest = np.searchsorted(self.strike_s, t_lap, side="right") - 1
        q, dq, ddq = self._bursts.none(len(t_lap))
        if len(self.strike_s) == 0:
            return q, dq, ddq
        for index in (latest, latest - 1):
            struck, strike = index >= 0, np.maximum(index, 0)
            strength = np.where(struck, self._strike_strength[strike], 0.0)
            side = np.where(index % 2 == 0, 1.0, -1.0)
            terms = self._bursts.after(np.where(struck, t_lap - self.strike_s[strike], 0.0), strength, side)
            q, dq, ddq = q + terms[0], dq + terms[1], ddq + terms[2]
        return q, dq, ddq


def _step_phase(pace: PPoly, habits: Habits, chance: np.random.Generator) -> PPoly:
    """Return the step phase over the planned one: whole numbers are reached early or late by a part of a step."""
    if not habits.limp and not habits.step_scatter_s:
        return PPoly(np.array([[1.0], [0.0]]), np.array([0.0, 1.0]))
    t = np.arange(0.0, pace.x[-1], 1e-2)
    planned = pace(t)[:, 1]
    steps = np.arange(-1, int(planned[-1]) + 2)
    step_hz = np.interp(steps, planned, pace.derivative(1)(t)[:, 1])
    scatter = habits.step_scatter_s * step_hz * chance.standard_normal(len(steps))
    late = np.clip(scatter, -_MOST_UNTIMELY_STEPS, _MOST_UNTIMELY_STEPS)
    late[2 + _LATE_SIDE :: 2] += _LIMP_LATE_STEPS * habits.limp
    late[[0, 1, -2, -1]] = 0.0
    spline = CubicSpline(steps + late, steps.astype(np.float64), bc_type="natural")
    return PPoly(spline.c, spline.x)


def _on_course(path: PPoly, heading: PPoly, course_rad: float) -> tuple[PPoly, PPoly]:
    """Return the way (x, y) and the heading turned by `course_rad` to the left."""
    if not course_rad:
        return path, heading
    turned = path.c @ np.array([[np.cos(course_rad), np.sin(course_rad)], [-np.sin(course_rad), np.cos(course_rad)]])
    constant = np.zeros_like(heading.c)
    constant[-1] = course_rad
    return PPoly(turned, path.x), PPoly(heading.c + constant, heading.x)


def _evaluated(quantity: Derivatives, at: FloatArray) -> HipMotion:
    """Return a quantity and its two derivatives."""
    value, rate, acceleration = (derivative(at) for derivative in quantity)
    return value, rate, acceleration


def _turned(q: FloatArray, dq: FloatArray, ddq: FloatArray, heading: HipMotion) -> HipMotion:
    """Return x and y (n, 2), and their derivatives, of what is ahead and to the left of one who heads that way."""
    psi, dpsi, ddpsi = heading
    z, dz, ddz = (each[:, 0] + 1j * each[:, 1] for each in (q, dq, ddq))
    direction = np.exp(1j * psi)
    turned = (
        z * direction,
        (dz + 1j * dpsi * z) * direction,
        (ddz + 2j * dpsi * dz + (1j * ddpsi - dpsi**2) * z) * direction,
    )
    xy, dxy, ddxy = (np.stack((each.real, each.imag), axis=1) for each in turned)
    return xy, dxy, ddxy


def _into_B(R_WB: FloatArray, vector_W: FloatArray) -> FloatArray:
    vector_B: FloatArray = np.einsum("nij,ni->nj", R_WB, vector_W)
    return vector_B


def _smoothed_ground(world: World) -> PPoly:
    """Return the height the hip follows: the profile seen through a Gaussian, as a quintic spline over one lap."""
    margin = round(6 * _GROUND_SIGMA_M / _GROUND_GRID_M)
    cells = max(round(world.length_m / _GROUND_GRID_M), 2 * margin)
    grid_m = world.length_m / cells
    x = np.arange(-2 * margin, cells + 2 * margin + 1, dtype=np.float64) * grid_m
    heights = gaussian_filter1d(world.heights(x), _GROUND_SIGMA_M / grid_m)
    inner = slice(margin, -margin)
    spline = make_interp_spline(x[inner], heights[inner], k=5)
    ground: PPoly = PPoly.from_spline((spline.t, spline.c, spline.k))
    return ground


def _rotations(rpy: FloatArray) -> FloatArray:
    """Return Rz(yaw) Ry(pitch) Rx(roll), (n, 3, 3), of (roll, pitch, yaw) (n, 3)."""
    matrices: FloatArray = Rotation.from_euler("ZYX", rpy[:, ::-1]).as_matrix()
    return matrices


def _body_rates(rpy: FloatArray, rates: FloatArray) -> FloatArray:
    """Return the angular rate (n, 3), in the rotated frame, of Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, _ = rpy.T
    droll, dpitch, dyaw = rates.T
    return np.stack(
        (
            droll - dyaw * np.sin(pitch),
            dpitch * np.cos(roll) + dyaw * np.sin(roll) * np.cos(pitch),
            -dpitch * np.sin(roll) + dyaw * np.cos(roll) * np.cos(pitch),
        ),
        axis=-1,
    )


_LATE_SIDE = 0
"""The first step of a lap, and every other one from there on, is that of the lame leg."""

_UPRIGHT = 1e-9

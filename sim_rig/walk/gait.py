"""How the hip of a walking person moves, in closed form, so that specific force and angular rate are exact.

Six generalised coordinates q = (x, y, z, roll, pitch, yaw) are sums of three kinds of term, each with its exact
derivatives, on top of a planned walk over the ground:

- gait: sinusoids of the step phase φ (one cycle a step, a heel strike at every whole number), faded in and out with
  the walk. Amplitudes are those of comfortable walking in the gait literature (Perry & Burnfield, Gait Analysis;
  Winter, Biomechanics and Motor Control): the pelvis travels 4 to 5 cm up and down once a step and 4 cm sideways
  once a stride, tilts 4 to 5° and lists 6° in total and turns ±5°; forward speed ripples by 10 to 15 %;
- heel strikes: damped bursts u(τ) = A τ³ exp(−τ/τ_d) sin(2πfτ), three times continuously differentiable at onset;
- posture sway in the time since start, standing or walking: millimetres and tenths of a degree below 1 Hz.

Frames: W with x ahead, y left, z up; B the IMU. R_WB = Rz(yaw) Ry(pitch) Rx(roll) · R_worn, where R_worn pitches the
device by 45° and a few degrees of the belt's own tilt. The six coordinates are those of B's origin.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly, make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from messages.arrays import BoolArray, FloatArray, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.walk.world import World

GRAVITY_W_MPS2 = np.array([0.0, 0.0, -STANDARD_GRAVITY_MPS2])
CAMERA_PITCH_RAD = np.deg2rad(45.0)

_X, _Y, _Z, _ROLL, _PITCH, _YAW = range(6)

# Axis, amplitude (m or °), cycles a step, phase in cycles: q = amplitude · sin(2π (cycles · φ + phase)).
_GAIT = (
    (_Z, 0.022, 1.0, -0.25),  # lowest at double support
    (_Z, 0.002, 2.0, 0.10),
    (_Y, 0.020, 0.5, 0.00),  # over the standing foot at mid-stance
    (_X, 0.012, 1.0, 0.05),
    (_PITCH, 2.4, 1.0, 0.15),
    (_PITCH, 0.3, 2.0, 0.40),
    (_ROLL, 3.0, 0.5, 0.03),
    (_ROLL, 0.4, 1.5, 0.20),
    (_YAW, 5.0, 0.5, 0.25),  # the leading side is ahead at heel strike
)
# Axis, peak (m/s² or °/s), frequency, decay time, whether left and right differ in sign.
_STRIKES = (
    (_Z, 4.0, 14.0, 0.022, False),
    (_Z, 1.5, 26.0, 0.012, False),
    (_X, -2.0, 11.0, 0.025, False),
    (_Y, 1.2, 13.0, 0.020, True),
    (_PITCH, 12.0, 12.0, 0.024, False),
    (_ROLL, 8.0, 13.0, 0.022, True),
)
# Axis, amplitude (m or °), frequency.
_SWAY = (
    (_X, 0.003, 0.27),
    (_X, 0.001, 0.83),
    (_Y, 0.002, 0.21),
    (_Z, 0.0005, 0.29),
    (_PITCH, 0.2, 0.31),
    (_ROLL, 0.15, 0.23),
    (_YAW, 0.8, 0.11),
)

_BLEND_S = 1.0
_SMOOTHSTEP = (6.0, -15.0, 10.0, 0.0, 0.0, 0.0)  # 6τ⁵ − 15τ⁴ + 10τ³: first and second derivative 0 at both ends
_GROUND_SIGMA_M = 0.25
_GROUND_GRID_M = 0.05


@dataclass(frozen=True)
class Walk:
    """Walk on to `to_x_m` of the lap at `speed_mps` with `step_hz` steps a second."""

    to_x_m: float
    speed_mps: float
    step_hz: float


@dataclass(frozen=True)
class Stand:
    """Stand still."""

    duration_s: float


Leg = Walk | Stand


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
        """Return the specific force (n, 3) in B: acceleration less gravity."""
        sf_B: FloatArray = np.einsum("nij,ni->nj", self.R_WB, self.a_WB_mps2 - GRAVITY_W_MPS2)
        return sf_B


class Gait:
    """The motion of one wearer over `world`: the `legs` make one lap, repeated without end from `start_ns` on.

    A lap begins and ends standing, at x = 0 and at 0 or one lap of the world. Before `start_ns` the wearer stands.
    `seed` draws the wearer's amplitudes (± 10 %), phases of sway and how the belt sits.
    """

    def __init__(self, world: World, legs: tuple[Leg, ...], hip_height_m: float, seed: int, start_ns: int) -> None:
        rng = np.random.default_rng([seed, 2])
        self._start_ns = start_ns
        self._hip_height_m = hip_height_m
        self._lap_x_m = world.length_m
        plan = _plan(legs)
        self._lap_s = float(plan.x[-1])
        self._plan = (plan, plan.derivative(1), plan.derivative(2))
        self._lap_advance_m = float(plan(self._lap_s)[0])
        ground = _smoothed_ground(world)
        self._ground = (ground, ground.derivative(1), ground.derivative(2))
        self._strike_s, self._strike_strength = _strikes(plan)
        self._gait_terms = _Terms.gait(rng)
        self._sway_terms = _Terms.sway(rng)
        self._bursts = _Bursts()
        belt = np.deg2rad(rng.uniform((-2.0, -3.0, -2.0), (2.0, 3.0, 2.0)))
        self._R_worn = _rotations(belt[None] + (0.0, CAMERA_PITCH_RAD, 0.0))[0]

    def imu(self, t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return sf_B (n, 3) in m/s² and w_WB_B (n, 3) in rad/s at the instants `t_ns` (n,)."""
        motion = self.at(t_ns)
        return motion.sf_B_mps2, motion.w_WB_B_radps

    def at(self, t_ns: IntArray) -> Motion:
        """Return the motion at the instants `t_ns` (n,) of CLOCK_MONOTONIC."""
        t = (np.asarray(t_ns) - self._start_ns).astype(np.float64) * 1e-9
        lap, t_lap = np.divmod(np.maximum(t, 0.0), self._lap_s)
        (s, phi, fade), (ds, dphi, dfade), (dds, ddphi, ddfade) = (p(t_lap).T for p in self._plan)

        q, dq, ddq = self._gait_terms.faded(phi, dphi, ddphi, fade, dfade, ddfade)
        for terms in (self._sway_terms.of_time(t), self._heel_strikes(t_lap)):
            q, dq, ddq = q + terms[0], dq + terms[1], ddq + terms[2]

        x_lap = np.mod(s, self._lap_x_m)
        g, dg, ddg = (ground(x_lap) for ground in self._ground)
        p, v, a = q[:, :3].copy(), dq[:, :3].copy(), ddq[:, :3].copy()
        p[:, 0] += s + lap * self._lap_advance_m
        v[:, 0] += ds
        a[:, 0] += dds
        p[:, 2] += g + self._hip_height_m
        v[:, 2] += dg * ds
        a[:, 2] += ddg * ds**2 + dg * dds
        return Motion(
            p_WB_m=p,
            v_WB_mps=v,
            a_WB_mps2=a,
            R_WB=_rotations(q[:, 3:]) @ self._R_worn,
            w_WB_B_radps=_body_rates(q[:, 3:], dq[:, 3:]) @ self._R_worn,
            standing=fade == 0.0,
        )

    def _heel_strikes(self, t_lap: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        latest = np.searchsorted(self._strike_s, t_lap, side="right") - 1
        q, dq, ddq = self._bursts.none(len(t_lap))
        for index in (latest, latest - 1):
            struck, strike = index >= 0, np.maximum(index, 0)
            strength = np.where(struck, self._strike_strength[strike], 0.0)
            side = np.where(index % 2 == 0, 1.0, -1.0)
            terms = self._bursts.after(np.where(struck, t_lap - self._strike_s[strike], 0.0), strength, side)
            q, dq, ddq = q + terms[0], dq + terms[1], ddq + terms[2]
        return q, dq, ddq


class _Terms:
    """K sinusoids, each moving one of the six coordinates."""

    def __init__(self, axis: list[int], amplitude: FloatArray, cycles: FloatArray, phase: FloatArray) -> None:
        radians = np.where(np.array(axis) >= _ROLL, np.deg2rad(1.0), 1.0)
        self._to_q = np.zeros((len(axis), 6))
        self._to_q[np.arange(len(axis)), axis] = amplitude * radians
        self._rate = 2 * np.pi * cycles
        self._phase = 2 * np.pi * phase

    @classmethod
    def gait(cls, rng: np.random.Generator) -> "_Terms":
        axis, amplitude, cycles, phase = zip(*_GAIT, strict=True)
        return cls(list(axis), np.array(amplitude) * _personal(rng, len(axis)), np.array(cycles), np.array(phase))

    @classmethod
    def sway(cls, rng: np.random.Generator) -> "_Terms":
        axis, amplitude, frequency_hz = zip(*_SWAY, strict=True)
        phase = rng.uniform(0.0, 1.0, len(axis))
        return cls(list(axis), np.array(amplitude) * _personal(rng, len(axis)), np.array(frequency_hz), phase)

    def of_time(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, q̇, q̈ (n, 6) of sinusoids in time."""
        angle = t[:, None] * self._rate + self._phase
        sin, cos = np.sin(angle), np.cos(angle)
        return sin @ self._to_q, (cos * self._rate) @ self._to_q, (-sin * self._rate**2) @ self._to_q

    def faded(
        self,
        phi: FloatArray,
        dphi: FloatArray,
        ddphi: FloatArray,
        fade: FloatArray,
        dfade: FloatArray,
        ddfade: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, q̇, q̈ (n, 6) of fade(t) · sin(rate · φ(t) + phase)."""
        angle = phi[:, None] * self._rate + self._phase
        sin, cos = np.sin(angle), np.cos(angle)
        dangle, ddangle = dphi[:, None] * self._rate, ddphi[:, None] * self._rate
        dsin = cos * dangle
        ddsin = cos * ddangle - sin * dangle**2
        a, da, dda = fade[:, None], dfade[:, None], ddfade[:, None]
        q = a * sin
        dq = da * sin + a * dsin
        ddq = dda * sin + 2 * da * dsin + a * ddsin
        return q @ self._to_q, dq @ self._to_q, ddq @ self._to_q


class _Bursts:
    """What a heel strike sends through the hip: u(τ) = A Im[τ³ exp(λτ)], λ = −1/τ_d + 2πf·i."""

    def __init__(self) -> None:
        axis, peak, frequency_hz, decay_s, alternates = (np.array(column) for column in zip(*_STRIKES, strict=True))
        self._lambda = -1.0 / decay_s + 2j * np.pi * frequency_hz
        self._alternates = alternates
        tau = np.arange(0.0, 0.3, 1e-4)
        _, rate, acceleration = self._shapes(tau)
        reached = np.where(axis >= _ROLL, np.abs(rate).max(axis=0), np.abs(acceleration).max(axis=0))
        self._to_q = np.zeros((len(axis), 6))
        self._to_q[np.arange(len(axis)), axis] = np.where(axis >= _ROLL, np.deg2rad(peak), peak) / reached

    @staticmethod
    def none(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        return np.zeros((n, 6)), np.zeros((n, 6)), np.zeros((n, 6))

    def after(
        self, tau: FloatArray, strength: FloatArray, side: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, q̇, q̈ (n, 6) at `tau` (n,) seconds after a strike of `strength` on `side` (±1)."""
        weight = strength[:, None] * np.where(self._alternates, side[:, None], 1.0)
        u, du, ddu = self._shapes(tau)
        return (weight * u) @ self._to_q, (weight * du) @ self._to_q, (weight * ddu) @ self._to_q

    def _shapes(self, tau: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        t, rate = tau[:, None], self._lambda
        wave = np.exp(rate * t)
        u = t**3 * wave
        du = (3 * t**2 + rate * t**3) * wave
        ddu = (6 * t + 6 * rate * t**2 + rate**2 * t**3) * wave
        return u.imag, du.imag, ddu.imag


def _personal(rng: np.random.Generator, count: int) -> FloatArray:
    return rng.uniform(0.9, 1.1, count)


def _plan(legs: tuple[Leg, ...]) -> PPoly:
    """Return distance (m), step phase (cycles) and fade (0 standing, 1 walking) of one lap, as polynomials in time.

    Speed, cadence and fade go from one leg's value to the next within `_BLEND_S`, so that distance is three times
    continuously differentiable. Raises ValueError where a leg is too short for that.
    """
    durations: list[float] = []
    ends: list[tuple[FloatArray, FloatArray]] = []

    def move(duration_s: float, before: FloatArray, after: FloatArray) -> None:
        durations.append(duration_s)
        ends.append((before, after))

    x_m = 0.0
    rates = np.zeros(3)
    for leg, following in zip(legs, (*legs[1:], None), strict=True):
        if isinstance(leg, Stand):
            move(leg.duration_s, rates, rates)
            continue
        wanted = np.array([leg.speed_mps, leg.step_hz, 1.0])
        stopping_m = 0.5 * _BLEND_S * leg.speed_mps if isinstance(following, Stand) else 0.0
        cruise_m = leg.to_x_m - x_m - 0.5 * _BLEND_S * (rates[0] + wanted[0]) - stopping_m
        if cruise_m < 0:
            raise ValueError(f"walk to x = {leg.to_x_m} m is {-cruise_m:.2f} m too short to change pace")
        move(_BLEND_S, rates, wanted)
        move(cruise_m / leg.speed_mps, wanted, wanted)
        rates = wanted
        if isinstance(following, Stand):
            move(_BLEND_S, wanted, np.zeros(3))
            rates = np.zeros(3)
        x_m = leg.to_x_m

    knots = np.concatenate(([0.0], np.cumsum(durations)))
    rate_c = np.zeros((6, len(durations), 3))
    for k, (duration_s, (before, after)) in enumerate(zip(durations, ends, strict=True)):
        rate_c[:, k] = np.outer(np.array(_SMOOTHSTEP) / duration_s ** np.arange(5, -1, -1), after - before)
        rate_c[5, k] += before
    travelled = PPoly(rate_c[:, :, :2], knots).antiderivative()
    fade_c = np.concatenate((np.zeros((1, len(durations), 1)), rate_c[:, :, 2:]))
    return PPoly(np.concatenate((travelled.c, fade_c), axis=2), knots)


def _strikes(plan: PPoly) -> tuple[FloatArray, FloatArray]:
    """Return when, within a lap, the heels strike (n,), and how hard (n,); never empty."""
    t = np.arange(0.0, plan.x[-1], 1e-3)
    phi = plan(t)[:, 1]
    strike_s = np.interp(np.arange(1, int(phi[-1]) + 1), phi, t)
    if len(strike_s) == 0:
        return np.zeros(1), np.zeros(1)
    return strike_s, plan(strike_s)[:, 2]


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

"""What each step, a limp and standing add to the six coordinates of the hip, with exact derivatives.

q = (x, y, z, roll, pitch, yaw) in m and rad. Amplitudes are those of comfortable walking in the gait literature (Perry
& Burnfield, Gait Analysis; Winter, Biomechanics and Motor Control): the pelvis travels 4 to 5 cm up and down once a
step and 4 cm sideways once a stride, tilts 4 to 5° and lists 6° in total and turns ±5°; forward speed ripples by 10 to
15 %.
"""

import numpy as np

from messages.arrays import FloatArray

X, Y, Z, ROLL, PITCH, YAW = range(6)
"""The generalised coordinates of the hip."""

# Axis, amplitude (m or °), cycles a step, phase in cycles: q = amplitude · sin(2π (cycles · φ + phase)). At odd φ the
# left foot lands.
_GAIT = (
    (Z, 0.022, 1.0, -0.25),  # lowest at double support
    (Z, 0.002, 2.0, 0.10),
    (Y, 0.020, 0.5, 0.50),  # over the standing foot at mid-stance
    (X, 0.012, 1.0, 0.05),
    (PITCH, 2.4, 1.0, 0.15),
    (PITCH, 0.3, 2.0, 0.40),
    (ROLL, 3.0, 0.5, 0.53),  # down on the side that swings
    (ROLL, 0.4, 1.5, 0.70),
    (YAW, 5.0, 0.5, 0.25),  # the leading side is ahead at heel strike
)
# Axis, peak (m/s² or °/s), frequency, decay time, whether left and right differ in sign.
_STRIKES = (
    (Z, 4.0, 14.0, 0.022, False),
    (Z, 1.5, 26.0, 0.012, False),
    (X, -2.0, 11.0, 0.025, False),
    (Y, 1.2, 13.0, 0.020, True),
    (PITCH, 12.0, 12.0, 0.024, False),
    (ROLL, 8.0, 13.0, 0.022, True),
)
# The same for a full limp.
_LIMP = (
    (Z, 0.010, 0.5, 0.25),  # the hip drops over the lame leg,
    (ROLL, 2.0, 0.5, 0.25),  # and lists towards it
    (X, 0.015, 0.5, 0.50),  # its steps are longer, or shorter, than the other's
    (PITCH, 1.0, 0.5, 0.10),
)
# Axis, amplitude (m or °), frequency.
_SWAY = (
    (X, 0.003, 0.27),
    (X, 0.001, 0.83),
    (Y, 0.002, 0.21),
    (Z, 0.0005, 0.29),
    (PITCH, 0.2, 0.31),
    (ROLL, 0.15, 0.23),
    (YAW, 0.8, 0.11),
)


HipMotion = tuple[FloatArray, FloatArray, FloatArray]
"""A quantity of n instants with its first and second derivative, such as q, q̇, q̈ (n, 6)."""


def of_phase(warped: HipMotion, dphi: FloatArray, ddphi: FloatArray) -> HipMotion:
    """Return a function of a phase, given with its derivatives by that phase, and its derivatives by time."""
    value, rate, curvature = warped
    return value, rate * dphi, rate * ddphi + curvature * dphi**2


class Terms:
    """K sinusoids, each moving one of the six coordinates."""

    def __init__(self, axis: list[int], amplitude: FloatArray, cycles: FloatArray, phase: FloatArray) -> None:
        radians = np.where(np.array(axis) >= ROLL, np.deg2rad(1.0), 1.0)
        self._to_q = np.zeros((len(axis), 6))
        self._to_q[np.arange(len(axis)), axis] = amplitude * radians
        self._rate = 2 * np.pi * cycles
        self._phase = 2 * np.pi * phase

    @classmethod
    def gait(cls, rng: np.random.Generator) -> "Terms":
        """Return what walking adds."""
        return cls._of_phase(_GAIT, _personal(rng, len(_GAIT)))

    @classmethod
    def limp(cls, rng: np.random.Generator, limp: float) -> "Terms":
        """Return what a limp of this size, 0 to 1, adds to the gait."""
        return cls._of_phase(_LIMP, limp * _personal(rng, len(_LIMP)))

    @classmethod
    def _of_phase(cls, rows: tuple[tuple[int, float, float, float], ...], share: FloatArray) -> "Terms":
        axis, amplitude, cycles, phase = zip(*rows, strict=True)
        return cls(list(axis), np.array(amplitude) * share, np.array(cycles), np.array(phase))

    @classmethod
    def sway(cls, rng: np.random.Generator, repeated_s: float | None = None) -> "Terms":
        """Return what nobody who stands or walks can avoid, with whole cycles in `repeated_s` if that is given."""
        axis, amplitude, frequencies = zip(*_SWAY, strict=True)
        frequency_hz = np.array(frequencies)
        if repeated_s is not None:
            frequency_hz = np.maximum(np.rint(frequency_hz * repeated_s), 1.0) / repeated_s
        phase = rng.uniform(0.0, 1.0, len(axis))
        return cls(list(axis), np.array(amplitude) * _personal(rng, len(axis)), frequency_hz, phase)

    def of_time(self, t: FloatArray) -> HipMotion:
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
    ) -> HipMotion:
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


class Bursts:
    """What a heel strike sends through the hip: u(τ) = A Im[τ³ exp(λτ)], λ = −1/τ_d + 2πf·i."""

    def __init__(self) -> None:
        axis, peak, frequency_hz, decay_s, alternates = (np.array(column) for column in zip(*_STRIKES, strict=True))
        self._lambda = -1.0 / decay_s + 2j * np.pi * frequency_hz
        self._alternates = alternates
        tau = np.arange(0.0, 0.3, 1e-4)
        _, rate, acceleration = self._shapes(tau)
        reached = np.where(axis >= ROLL, np.abs(rate).max(axis=0), np.abs(acceleration).max(axis=0))
        self._to_q = np.zeros((len(axis), 6))
        self._to_q[np.arange(len(axis)), axis] = np.where(axis >= ROLL, np.deg2rad(peak), peak) / reached

    @staticmethod
    def none(n: int) -> HipMotion:
        """Return q, q̇, q̈ (n, 6) of no strike."""
        return np.zeros((n, 6)), np.zeros((n, 6)), np.zeros((n, 6))

    def after(self, tau: FloatArray, strength: FloatArray, side: FloatArray) -> HipMotion:
        """Return q, q̇, q̈ (n, 6) at `tau` (n,) seconds after a strike of `strength` on `side` (±1)."""
        weight = strength[:, None] * np.where(self._alternates, side[:, None], 1.0)
        u, du, ddu = self._shapes(tau)
        return (weight * u) @ self._to_q, (weight * du) @ self._to_q, (weight * ddu) @ self._to_q

    def _shapes(self, tau: FloatArray) -> HipMotion:
        t, rate = tau[:, None], self._lambda
        wave = np.exp(rate * t)
        u = t**3 * wave
        du = (3 * t**2 + rate * t**3) * wave
        ddu = (6 * t + 6 * rate * t**2 + rate**2 * t**3) * wave
        return u.imag, du.imag, ddu.imag


def _personal(rng: np.random.Generator, count: int) -> FloatArray:
    return rng.uniform(0.9, 1.1, count)

"""Where in the stride the wearer is: one phase θ that all motions of the hip follow, each along a curve of its own.

θ grows by π from contact to contact. Channel c of the hip's motion (rise, sway and the three rates) is

    u_c = h(θ) · w_c + noise,      h(θ) = (1, cos θ, sin θ, … cos 4θ, sin 4θ)                                 (1)

with coefficients w_c learnt by recursive least squares that forgets. θ and its rate ω have a Kalman filter whose
measurements are all channels at once, by dh/dθ · w_c, and the contacts that the bob shows: there θ is a multiple of π.
So what disturbs one channel (a kerb, the bob; a turn, the yaw) does not take the phase with it, and a step that comes
late is seen while it is under way.
"""

import math

import numpy as np

from messages.arrays import FloatArray

CHANNELS = 5
"""Rise, sway to the left, roll, pitch and yaw rate."""


class StridePhase:
    """The filter of θ and ω (radians a row of the trail), and the curves of (1)."""

    def __init__(self, row: float, step: float) -> None:
        """Begin with a contact at `row` after one `step` before it."""
        self.row = row
        self.theta = 0.0
        self.omega = math.pi / step
        self.cov = np.diag([_PHASE_SIGMA**2, (0.08 * self.omega) ** 2])
        self._weights = np.zeros((_TERMS, CHANNELS))
        self._spread = [np.diag(_EVEN_SIGMA**2), np.diag(_ODD_SIGMA**2)]
        self._noise = _FIRST_NOISE.copy()
        self._usual = self.omega

    def advance(self, row: float) -> None:
        """Come to `row`."""
        rows = row - self.row
        if rows <= 0.0:
            return
        pull = 1.0 - math.exp(-rows / _USUAL_ROWS)
        self.theta += self.omega * rows
        self.omega += pull * (self._usual - self.omega)
        F = np.array([[1.0, rows], [0.0, 1.0 - pull]])
        self.cov = F @ self.cov @ F.T + np.diag([_PHASE_WALK**2 * rows, (_RATE_WALK * self.omega) ** 2 * rows])
        self.row = row

    def see(self, row: float, motion: FloatArray) -> None:
        """Take the hip's `motion` (CHANNELS,) at `row`, no earlier than the last one."""
        self.advance(row)
        h, dh = _harmonics(self.theta)
        off = motion - h @ self._weights
        slope = dh @ self._weights
        off = np.clip(off, -_CLIP * self._noise, _CLIP * self._noise)
        weight = 1.0 / (_ALIKE * self._noise**2)
        told = float(slope**2 @ weight)
        if told > 0.0:
            self._correct(float((slope * weight) @ off) / told, 1.0 / told)
            h, dh = _harmonics(self.theta)
            off = motion - h @ self._weights
        self._noise += _NOISE_FOLLOWS * (np.minimum(np.abs(off) * 1.25, 3.0 * self._noise) - self._noise)
        self._noise = np.maximum(self._noise, _LEAST_NOISE)
        clipped = np.clip(off, -2.0 * _CLIP * self._noise, 2.0 * _CLIP * self._noise)
        for group, channels in enumerate(_GROUPS):
            spread = self._spread[group]
            moved = spread @ h
            gain = moved / (_LEARNS_NOISE + h @ moved)
            self._weights[:, channels] += np.outer(gain, clipped[channels])
            self._spread[group] = (spread - np.outer(gain, moved)) / _FORGETS

    def contact(self, row: float) -> int | None:
        """Take a contact that the bob shows at `row`, a moment ago; return its number, or None where it contradicts."""
        then = self.theta - self.omega * (self.row - row)
        number = round(then / math.pi)
        off = number * math.pi - then
        if abs(off) > 3.0 * math.hypot(_CONTACT_SIGMA, math.sqrt(self.cov[0, 0])):
            return None
        self._usual += _USUAL_FOLLOWS * (self.omega - self._usual)
        self._correct(off, _CONTACT_SIGMA**2)
        return number

    def rows_to(self, number: int) -> tuple[float, float]:
        """Return in how many rows contact `number` comes, < 0 where it was, and one σ of that."""
        ahead = math.pi * number - self.theta
        rows = ahead / self.omega
        by = np.array([-1.0 / self.omega, -ahead / self.omega**2])
        walk = ((_RATE_WALK * rows) ** 2 / 3.0 + (_PHASE_WALK / self.omega) ** 2) * abs(rows)
        return rows, math.sqrt(float(by @ self.cov @ by) + walk)

    def _correct(self, off: float, variance: float) -> None:
        gain = self.cov[:, 0] / (self.cov[0, 0] + variance)
        self.theta += float(gain[0]) * off
        self.omega = min(max(self.omega + float(gain[1]) * off, _SLOWEST), _FASTEST)
        self.cov = self.cov - np.outer(gain, self.cov[0])


def _harmonics(theta: float) -> tuple[FloatArray, FloatArray]:
    """Return h of (1) and its derivative, (_TERMS,) each."""
    angle = _ORDER * theta
    c, s = np.cos(angle), np.sin(angle)
    h, dh = np.ones(_TERMS), np.zeros(_TERMS)
    h[1::2], h[2::2] = c, s
    dh[1::2], dh[2::2] = -_ORDER * s, _ORDER * c
    return h, dh


_ORDER = np.arange(1.0, 5.0)
_TERMS = 9
_GROUPS = (np.array([0, 3]), np.array([1, 2, 4]))
"""Rise and pitch repeat with each step, sway, roll and yaw with each stride."""
_EVEN_SIGMA = np.array([0.3, 0.1, 0.1, 1.0, 1.0, 0.05, 0.05, 0.5, 0.5])
_ODD_SIGMA = np.array([0.3, 1.0, 1.0, 0.1, 0.1, 0.5, 0.5, 0.05, 0.05])
_FIRST_NOISE = np.array([0.15, 0.15, 0.3, 0.3, 0.3])
_LEAST_NOISE = np.array([0.02, 0.02, 0.03, 0.03, 0.03])
_NOISE_FOLLOWS = 0.02
_LEARNS_NOISE = 0.5
_FORGETS = 0.995
_ALIKE = 6.0
_CLIP = 2.5
_PHASE_SIGMA = 0.15
_CONTACT_SIGMA = 0.10
_PHASE_WALK = 0.012
_RATE_WALK = 0.012
_USUAL_ROWS = 120.0
_USUAL_FOLLOWS = 0.3
_SLOWEST, _FASTEST = math.pi / 120.0, math.pi / 28.0

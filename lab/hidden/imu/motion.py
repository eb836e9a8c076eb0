"""A hand-moved sensor whose motion is known exactly at any time: for the hidden-effect cases of the IMU.

Six coordinates, three angles and three positions, are splines through random control points or sums of sines. Angles
are yaw ψ, pitch θ and roll φ, R = Rz(ψ) Ry(θ) Rx(φ) from sensor to world, z up. Turning rates follow from the angles'
rates (Diebel, Representing Attitude, 2006, eq. 73), accelerations from the derivatives of the same splines.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from messages.arrays import FloatArray

Curve = Callable[[FloatArray, int], FloatArray]
"""Six coordinates (n, 6), or their derivative of the order given, at times (n,)."""

_DEGREE: Final = 6
_STENCIL_S: Final = 2e-3
_FIRST: Final = np.array((-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0)) / 60.0
_SECOND: Final = np.array((2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0)) / 180.0


@dataclass(frozen=True, eq=False)
class Motion:
    """Six coordinates as a curve; `gravity_mps2` pulls down."""

    curve: Curve
    gravity_mps2: float
    arm_m: FloatArray

    def attitude(self, t_s: FloatArray) -> Rotation:
        """Return sensor to world."""
        return Rotation.from_euler("ZYX", self.curve(t_s, 0)[:, :3])

    def reference_position(self, t_s: FloatArray) -> FloatArray:
        """Return the point (n, 3) that the cameras follow."""
        return self.curve(t_s, 0)[:, 3:]

    def turning(self, t_s: FloatArray) -> FloatArray:
        """Return the rates (n, 3) about the sensor's axes."""
        _, pitch, roll = self.curve(t_s, 0)[:, :3].T
        d_yaw, d_pitch, d_roll = self.curve(t_s, 1)[:, :3].T
        return np.column_stack(
            (
                d_roll - d_yaw * np.sin(pitch),
                d_pitch * np.cos(roll) + d_yaw * np.cos(pitch) * np.sin(roll),
                d_yaw * np.cos(pitch) * np.cos(roll) - d_pitch * np.sin(roll),
            )
        )

    def turning_change(self, t_s: FloatArray) -> FloatArray:
        """Return the derivative (n, 3) of the rates, by seven points."""
        return self._stencilled(self.turning, _FIRST / _STENCIL_S, t_s)

    def specific_force(self, t_s: FloatArray, arm_m: FloatArray | None = None) -> FloatArray:
        """Return what an accelerometer reads (n, 3) that sits at `arm_m` (3,) from the followed point."""
        acceleration = self.curve(t_s, 2)[:, 3:] + np.array((0.0, 0.0, self.gravity_mps2))
        arm = self.arm_m if arm_m is None else arm_m
        if arm.any():
            acceleration = acceleration + self._stencilled(
                lambda t: self.attitude(t).apply(arm), _SECOND / _STENCIL_S**2, t_s
            )
        force: FloatArray = self.attitude(t_s).apply(acceleration, inverse=True)
        return force

    @staticmethod
    def _stencilled(function: Callable[[FloatArray], FloatArray], weights: FloatArray, t_s: FloatArray) -> FloatArray:
        total = np.zeros((len(t_s), 3))
        for k, weight in enumerate(weights):
            if weight:
                total += weight * function(t_s + (k - 3) * _STENCIL_S)
        return total


def hand_moved(random: np.random.Generator, seconds: float, swing: float) -> Curve:
    """Return a curve of strokes and rests: three splines, of long strokes, quick corrections and a tremor."""
    parts = []
    pauses = random.uniform(1.0, seconds - 4.0, 3)
    for spacing_s, angle_rad, way_m in ((0.28, 0.75, 0.11), (0.11, 0.07, 0.012), (0.045, 0.004, 0.0005)):
        count = int(seconds / spacing_s) + 4 * _DEGREE
        points = random.standard_normal((count, 6)) * np.repeat((angle_rad, way_m), 3) * swing
        times = (np.arange(count) - 2 * _DEGREE) * spacing_s
        still = (times < 1.5) | (times > seconds - 1.5)
        for begin in pauses:
            still |= (times > begin) & (times < begin + 2.0)
        points[still] = np.repeat(points[np.maximum(np.flatnonzero(~still).min(), 1)][None], still.sum(), axis=0) * 0.4
        knots = (np.arange(count + _DEGREE + 1) - 2.5 * _DEGREE) * spacing_s
        parts.append(BSpline(knots, points, _DEGREE))
    rest = np.concatenate((random.uniform(-0.5, 0.5, 3), random.uniform(-0.3, 0.3, 3)))

    def curve(t_s: FloatArray, order: int) -> FloatArray:
        total: FloatArray = sum((part(t_s, nu=order) for part in parts), np.zeros((len(t_s), 6)))
        return total + rest if order == 0 else total

    return curve


def swung(random: np.random.Generator, swing: float) -> Curve:
    """Return a curve of sines from 0.15 to 9 Hz that never repeats within the record."""
    f_hz = 0.15 * 60.0 ** ((np.arange(14) + random.random(14)) / 14.0)
    w = 2.0 * np.pi * f_hz
    amplitude = random.standard_normal((14, 6)) * np.minimum(1.0, (0.5 / f_hz) ** 1.7)[:, None]
    amplitude *= np.repeat((0.55, 0.07), 3) * swing
    phase = random.uniform(0.0, 2.0 * np.pi, (14, 6))
    rest = np.concatenate((random.uniform(-0.5, 0.5, 3), random.uniform(-0.3, 0.3, 3)))

    def curve(t_s: FloatArray, order: int) -> FloatArray:
        total = np.zeros((len(t_s), 6))
        for w_k, a_k, phase_k in zip(w, amplitude, phase, strict=True):
            total += a_k * w_k**order * np.cos(w_k * t_s[:, None] + phase_k + 0.5 * np.pi * order)
        return total + rest if order == 0 else total

    return curve

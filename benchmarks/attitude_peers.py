"""Mahony's and Madgwick's filters, six axes, written plainly from their papers for comparison."""

import math
from typing import Protocol

import numpy as np

from messages import Quaternion, Vec3
from messages.arrays import FloatArray
from perception import so3, vec3


class Peer(Protocol):
    """A filter that takes samples at a fixed rate and gives the attitude at the end of each sample's period."""

    q_WB: Quaternion

    def update(self, sf_B: Vec3, w_B: Vec3, dt_s: float) -> None:
        """Take one sample."""


class Mahony:
    """Explicit complementary filter: Mahony, Hamel, Pflimlin, IEEE TAC 53(5), 2008, Eq. 32."""

    def __init__(self, kp: float, ki: float) -> None:
        self._kp, self._ki = kp, ki
        self._bias: Vec3 = vec3.ZERO
        self.q_WB: Quaternion = so3.IDENTITY

    def update(self, sf_B: Vec3, w_B: Vec3, dt_s: float) -> None:
        """Turn by the gyroscope and towards the specific force in proportion to the angle between it and up."""
        rows = so3.rows_from_quaternion(self.q_WB)
        ux, uy, uz = rows[6:9]
        fx, fy, fz = vec3.scaled(sf_B, 1.0 / math.hypot(*sf_B))
        error = (fy * uz - fz * uy, fz * ux - fx * uz, fx * uy - fy * ux)
        self._bias = vec3.plus_scaled(self._bias, error, -self._ki * dt_s)
        w = vec3.plus_scaled(vec3.minus(w_B, self._bias), error, self._kp)
        self.q_WB = so3.normalised(so3.multiply(self.q_WB, so3.quaternion_from_rotvec(vec3.scaled(w, dt_s))))


class Madgwick:
    """Gradient descent filter: Madgwick, Harrison, Vaidyanathan, ICORR 2011, Eqs. 30 to 33, gravity alone."""

    def __init__(self, beta: float) -> None:
        self._beta = beta
        self.q_WB: Quaternion = so3.IDENTITY

    def update(self, sf_B: Vec3, w_B: Vec3, dt_s: float) -> None:
        """Step along the quaternion's derivative less beta times the normalised gradient of the error in gravity."""
        w, x, y, z = self.q_WB
        fx, fy, fz = vec3.scaled(sf_B, 1.0 / math.hypot(*sf_B))
        ex, ey, ez = 2.0 * (x * z - w * y) - fx, 2.0 * (w * x + y * z) - fy, 2.0 * (0.5 - x * x - y * y) - fz
        gradient = (
            -2.0 * y * ex + 2.0 * x * ey,
            2.0 * z * ex + 2.0 * w * ey - 4.0 * x * ez,
            -2.0 * w * ex + 2.0 * z * ey - 4.0 * y * ez,
            2.0 * x * ex + 2.0 * y * ey,
        )
        length = math.hypot(*gradient)
        step = self._beta / length if length > 0.0 else 0.0
        turning = so3.multiply(self.q_WB, (0.0, *vec3.scaled(w_B, 0.5)))
        dw, dx, dy, dz = (turn - step * slope for turn, slope in zip(turning, gradient, strict=True))
        self.q_WB = so3.normalised((w + dw * dt_s, x + dx * dt_s, y + dy * dt_s, z + dz * dt_s))


def attitudes(peer: Peer, sf_B: FloatArray, w_B: FloatArray, rate_hz: float) -> FloatArray:
    """Return the quaternions (n, 4) of a peer that starts level with, and free of the bias of, its first second."""
    first = slice(0, round(rate_hz))
    x, y, z = sf_B[first].mean(axis=0).tolist()
    peer.q_WB = so3.quaternion_from_up((x, y, z))
    w_B = w_B - w_B[first].mean(axis=0)
    quaternions = []
    for sf, w in zip(sf_B.tolist(), w_B.tolist(), strict=True):
        peer.update(tuple(sf), tuple(w), 1.0 / rate_hz)
        quaternions.append(peer.q_WB)
    return np.array(quaternions)

"""The plane over time: gradient in W, height under the camera, each with its covariance.

The gradient of the ground in W does not change while the wearer walks on it, so a Kalman filter with a small
process noise averages the frames; the height follows the hip and is re-measured by each frame. A frame that
contradicts the track (an edge: kerb, stair, foot of a ramp) starts a new one. The attitude's error is common to all
frames of a track until the attitude learns: a Kalman filter that goes from covariance P to P' corrects itself by
N(0, P − P'), and the track has it still.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.plane import Plane, PlaneFit

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TrackingSettings:
    """Process noise per square root of a second, and the bound on the squared innovation (χ², 3 degrees)."""

    gradient_per_sqrt_s: float = 0.02
    height_m_per_sqrt_s: float = 0.06
    attitude_jitter_rad: float = 0.003  # attitude error that changes from frame to frame
    gate: float = 16.3  # 0.1 % of frames on the track would exceed it
    longest_gap_s: float = 0.5


class PlaneTracker:
    """Kalman filter of (∂z/∂x, ∂z/∂y in W; height of the camera above the plane's intercept)."""

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        self._state: FloatArray | None = None
        self._cov: FloatArray = np.zeros((3, 3))
        self._attitude_cov_W: FloatArray = np.zeros((2, 2))
        self._t_ns = 0

    def predicted(self, t_ns: int, R_WH: FloatArray) -> Plane | None:
        """Return the plane in H as expected at `t_ns`, or None without a track younger than `longest_gap_s`."""
        if self._state is None or (t_ns - self._t_ns) * 1e-9 > self._settings.longest_gap_s:
            return None
        return _plane(_turn(R_WH).T @ self._state)

    def updated(
        self, t_ns: int, fit: PlaneFit, R_WH: FloatArray, attitude_cov_W: FloatArray
    ) -> tuple[Plane, FloatArray]:
        """Take one frame's plane in H; return the plane in H that the track now holds and its covariance (a, b, h).

        `attitude_cov_W` (2, 2), rad², is what the attitude's covariance means for the gradient in W. It is told apart:
        the covariance that is returned is without it.
        """
        turn = _turn(R_WH)
        seen = turn @ fit.plane.abh
        jitter = self._settings.attitude_jitter_rad**2
        seen_cov = turn @ fit.covariance @ turn.T + np.diag([jitter, jitter, 0.0])
        if self._state is None or self.predicted(t_ns, R_WH) is None:
            self._state, self._cov = seen, seen_cov
        else:
            prior = self._grown(t_ns)
            prior[:2, :2] += _positive_part(self._attitude_cov_W - attitude_cov_W)
            innovation, innovation_cov = seen - self._state, prior + seen_cov
            if innovation @ np.linalg.solve(innovation_cov, innovation) > self._settings.gate:
                self._state, self._cov = seen, seen_cov
            else:
                gain = np.linalg.solve(innovation_cov, prior).T
                self._state = self._state + gain @ innovation
                self._cov = (np.eye(3) - gain) @ prior
        self._t_ns, self._attitude_cov_W = t_ns, attitude_cov_W
        return _plane(turn.T @ self._state), turn.T @ self._cov @ turn

    def _grown(self, t_ns: int) -> FloatArray:
        dt_s = max(0.0, (t_ns - self._t_ns) * 1e-9)
        s = self._settings
        rates = np.array([s.gradient_per_sqrt_s, s.gradient_per_sqrt_s, s.height_m_per_sqrt_s])
        return self._cov + np.diag(rates**2 * dt_s)


def _positive_part(difference: FloatArray) -> FloatArray:
    """Return the symmetric matrix `difference` without its negative eigenvalues."""
    values, vectors = np.linalg.eigh(difference)
    positive: FloatArray = (vectors * np.clip(values, 0.0, None)) @ vectors.T
    return positive


def _plane(abh: FloatArray) -> Plane:
    return Plane((float(abh[0]), float(abh[1])), float(abh[2]))


def _turn(R_WH: FloatArray) -> FloatArray:
    """Return the (3, 3) matrix that takes (∂z/∂x, ∂z/∂y, height) from H to W, which differ by yaw alone."""
    turn = np.eye(3)
    turn[:2, :2] = R_WH[:2, :2]
    return turn

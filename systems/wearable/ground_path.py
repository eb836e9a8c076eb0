"""The ground as the camera should see it at any instant: θ of perception.ground.plane's Eq. (1), in C, over time.

A plane with the unit normal n, at the height h below the left optical centre, is seen by the ray r with disparity

    d(r) = r · θ,      θ = −f B / (h n_z) · R_WC^T n.                                                        (1)
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from messages import Calibration
from messages.arrays import BoolArray, FloatArray
from perception.depth.stereo_camera import StereoCamera
from systems.wearable.recording import Track

GRID_S = 0.005
"""Step of the ground's course over time: a fraction of the time in which a walker's attitude changes."""
_GAP_S = 0.06
"""Between a track's samples: over a longer gap a step's impact may be missing, and no spline tells it."""


class Smooth:
    """A track as a cubic spline (c values) that says NaN where its neighbours are farther than `_GAP_S` apart."""

    def __init__(self, t_s: FloatArray, values: FloatArray) -> None:
        known = np.isfinite(values).all(axis=1)
        self._t_s = t_s[known]
        self.spline = CubicSpline(self._t_s, values[known])

    def __call__(self, t_s: FloatArray, order: int = 0) -> FloatArray:
        """Return values (…, c), or their derivative of `order`, at `t_s` (…,)."""
        values: FloatArray = self.spline(t_s, order)
        values[~self.knows(t_s)] = np.nan
        return values

    def knows(self, t_s: FloatArray) -> BoolArray:
        """Return (…,): whether a sample stands close before and after."""
        after = np.searchsorted(self._t_s, t_s)
        inside = (after > 0) & (after < len(self._t_s))
        after = np.clip(after, 1, len(self._t_s) - 1)
        close: BoolArray = inside & (self._t_s[after] - self._t_s[after - 1] < _GAP_S)
        return close


@dataclass(frozen=True)
class Attitude:
    """R_WB over time as quaternions (w, x, y, z) of unit length, sign-continuous."""

    smooth: Smooth

    @staticmethod
    def of(t_s: FloatArray, q_WB: FloatArray) -> "Attitude":
        """Return the attitude that passes through q_WB (n, 4); rows of NaN are gaps."""
        known = np.isfinite(q_WB).all(axis=1)
        q = q_WB[known]
        turned = np.concatenate(([1.0], np.sign(np.einsum("ni,ni->n", q[1:], q[:-1]))))
        return Attitude(Smooth(t_s[known], q * np.cumprod(np.where(turned == 0.0, 1.0, turned))[:, None]))

    def R_WB(self, t_s: FloatArray) -> FloatArray:
        """Return (n, 3, 3)."""
        q = self.smooth(t_s)
        w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
        rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        return np.moveaxis(np.array(rows), -1, 0)

    def w_B_radps(self, t_s: FloatArray) -> FloatArray:
        """Return the angular rate (n, 3) in B: 2 q* ⊗ q̇."""
        q = self.smooth(t_s)
        dq = self.smooth(t_s, 1) / np.linalg.norm(q, axis=1, keepdims=True)
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
        w, v, dw, dv = q[:, :1], q[:, 1:], dq[:, :1], dq[:, 1:]
        rate: FloatArray = 2.0 * (w * dv - v * dw - np.cross(v, dv))
        return rate


class GroundPath:
    """θ of (1) over time, and the frames in which it stands."""

    def __init__(self, calibration: Calibration, camera: StereoCamera, ground: Track, attitude: Attitude) -> None:
        self.fB_px_m = camera.f_px * camera.baseline_m
        self.R_BC: FloatArray = np.array(calibration.X_BL.R) @ camera.R_EC
        self.attitude = attitude
        t_s = np.arange(ground.t_s[0], ground.t_s[-1] + GRID_S / 2, GRID_S)
        self.grid_s = t_s
        plane = Smooth(ground.t_s, ground.values)(t_s)
        n_W = plane[:, :3] / np.linalg.norm(plane[:, :3], axis=1, keepdims=True)
        self.R_WC: FloatArray = attitude.R_WB(t_s) @ self.R_BC
        n_C = np.einsum("nij,ni->nj", self.R_WC, n_W)
        self.height_m: FloatArray = plane[:, 3]
        theta = -self.fB_px_m / (self.height_m * n_W[:, 2])[:, None] * n_C
        self.theta = Smooth(t_s, theta)

    def theta_at(self, t_s: float) -> tuple[FloatArray, FloatArray]:
        """Return θ and its rate (3,) at one instant."""
        at = np.array([t_s])
        return self.theta(at)[0], self.theta(at, 1)[0]

"""Bias, scale and cross-axis terms of an accelerometer, from rests in several poses: gravity has one length.

With m the mean of a rest, b the bias and S symmetric,

    | S (m − b) | = g                                                                                       (1)

A rotation in front of S changes nothing in (1): B is the frame in which S is symmetric, the nearest to the chip's own
axes. What is known of such chips before stands beside the rests as a measurement of its own, so that what the poses do
not tell stays as wide as it was: such a value is not supported, and is left as it stands in the file.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from calib.imu.rests import Rest, faces_of
from messages.arrays import BoolArray, FloatArray
from messages.constants import NORMAL_95

NAMES = ("bias_x", "bias_y", "bias_z", "scale_x", "scale_y", "scale_z", "cross_xy", "cross_xz", "cross_yz")
"""Of the nine parameters: bias as a share of gravity; S − 1 on and off its diagonal."""
PRIOR_STD = np.array((0.1,) * 3 + (0.05,) * 3 + (0.02,) * 3)
"""What is known of any chip before: the MPU-6050's data sheet says ±50 to 80 mg, ±3 %, ±2 %."""
SUPPORTED_STD = np.array((0.005,) * 3 + (0.005,) * 3 + (0.005,) * 3)
"""A value is told by the poses if its deviation is smaller: 5 mg, 0.5 %, 0.3°."""
ASSUMED_STD = 1e-3
"""Of a rest's length, as a share of gravity, where there are too few to tell."""
_LEAST_FREEDOM = 4
_ROUNDS = 30
_ALONG = 0.3
"""The square of a direction's part along an axis from which on a rest tells of that axis."""


@dataclass(frozen=True)
class AccelerometerFit:
    """S (3, 3) and bias (3,), in the log's unit, of (1); of the nine parameters the values, deviations, half-widths of
    the 95 % intervals, and whether the poses support them. `norm` (n,) is each rest's length after calibration less 1,
    `norm_left_out` the same from all other rests, `directions` (n, 3) where up was."""

    matrix: FloatArray
    bias: FloatArray
    values: FloatArray
    std: FloatArray
    half_width: FloatArray
    supported: BoolArray
    norm: FloatArray
    norm_left_out: FloatArray
    norm_before: FloatArray
    directions: FloatArray
    covariance: FloatArray

    @property
    def axes_supported(self) -> BoolArray:
        """Return whether bias and scale of each axis (3,) are told apart."""
        return self.supported[:3] & self.supported[3:6]

    @property
    def on_supported_axes(self) -> BoolArray:
        """Return which rests (n,) do not hang on an axis that the poses do not support."""
        on: BoolArray = (self.directions**2)[:, ~self.axes_supported].sum(axis=1) < _ALONG
        return on

    @property
    def faces(self) -> dict[str, int]:
        """Return in how many rests each axis pointed up, and down."""
        return faces_of(self.directions)


def fit_accelerometer(rests: Sequence[Rest], gravity: float, gravity_std: float = 0.0) -> AccelerometerFit:
    """Return what the rests tell; `gravity` in the log's unit, `gravity_std` as a share of it."""
    means = np.array([rest.sf for rest in rests]) / gravity
    std = np.array([max(rest.sf_std / gravity, 1e-6) for rest in rests])
    x = np.zeros(9)
    for _ in range(_ROUNDS):
        norm, J = _linearised(x, means)
        A = np.concatenate((J / std[:, None], np.diag(1.0 / PRIOR_STD)))
        wanted = np.concatenate(((1.0 - norm) / std, -x / PRIOR_STD))
        step = np.linalg.lstsq(A, wanted, rcond=None)[0]
        x = x + step
        if np.abs(step).max() < 1e-10:
            break
    norm, J = _linearised(x, means)
    Jw = J / std[:, None]
    inverse = np.linalg.inv(Jw.T @ Jw + np.diag(PRIOR_STD**-2.0))
    leverage = np.einsum("ni,ij,nj->n", Jw, inverse, Jw)
    freedom = len(rests) - float(leverage.sum())
    variance, times = (ASSUMED_STD / float(np.median(std))) ** 2, NORMAL_95
    if freedom >= _LEAST_FREEDOM:
        variance, times = float((((1.0 - norm) / std) ** 2).sum()) / freedom, float(student.ppf(0.975, freedom))
    covariance = np.linalg.inv(Jw.T @ Jw / max(variance, 1e-12) + np.diag(PRIOR_STD**-2.0))
    common = np.zeros(9)
    common[3:6] = gravity_std
    covariance = covariance + np.outer(common, common)
    deviation = np.sqrt(np.diag(covariance))
    half_width = times * deviation if freedom >= 1 else np.minimum(times * deviation, NORMAL_95 * PRIOR_STD)
    S = _matrix(x)
    told = (means - x[:3]) @ S.T
    length = np.linalg.norm(told, axis=1)
    return AccelerometerFit(
        matrix=S,
        bias=x[:3] * gravity,
        values=x,
        std=deviation,
        half_width=half_width,
        supported=deviation < SUPPORTED_STD,
        norm=length - 1.0,
        norm_left_out=(length - 1.0) / np.maximum(1e-3, 1.0 - leverage),
        norm_before=np.linalg.norm(means, axis=1) - 1.0,
        directions=told / length[:, None],
        covariance=covariance,
    )


def _matrix(x: FloatArray) -> FloatArray:
    sx, sy, sz, xy, xz, yz = x[3:]
    return np.array(((1.0 + sx, xy, xz), (xy, 1.0 + sy, yz), (xz, yz, 1.0 + sz)))


def _linearised(x: FloatArray, means: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lengths (n,) of (1), in units of g, and their derivatives (n, 9)."""
    S = _matrix(x)
    from_bias = means - x[:3]
    told = from_bias @ S.T
    norm = np.linalg.norm(told, axis=1)
    up = told / norm[:, None]
    a, b, c = from_bias.T
    u, v, w = up.T
    by_matrix = np.stack((u * a, v * b, w * c, u * b + v * a, u * c + w * a, v * c + w * b), axis=-1)
    return norm, np.concatenate((-up @ S, by_matrix), axis=1)


def rms_g(values: FloatArray) -> float:
    """Return the root mean square of lengths, NaN of none."""
    return math.sqrt(float((values**2).mean())) if len(values) else math.nan

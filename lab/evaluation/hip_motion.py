"""An IMU on the hip of someone who stands, walks, turns and stops, with exact truth, and the noise of an MPU-6050."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import convolve1d
from scipy.spatial.transform import Rotation

from messages.arrays import BoolArray, FloatArray, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2

G_W_MPS2 = np.array((0.0, 0.0, -STANDARD_GRAVITY_MPS2))
_FINE_HZ = 1000


@dataclass(frozen=True)
class Motion:
    """Times (n,) in ns; specific force and angular rate in B, (n, 3); true attitude R_WB, (n, 3, 3)."""

    t_ns: IntArray
    sf_B: FloatArray
    w_B: FloatArray
    R_WB: FloatArray

    def between(self, start_s: float, stop_s: float) -> "Motion":
        """Return the samples from `start_s` to `stop_s` after the first."""
        t_s = 1e-9 * (self.t_ns - self.t_ns[0])
        return self.of((t_s >= start_s) & (t_s < stop_s))

    def of(self, chosen: BoolArray) -> "Motion":
        """Return the chosen samples."""
        return Motion(self.t_ns[chosen], self.sf_B[chosen], self.w_B[chosen], self.R_WB[chosen])


def hip_motion(bouts_s: list[tuple[float, float]], seconds: float, seed: int, rate_hz: int = 100) -> Motion:
    """Walk at 1.0 to 1.4 m/s in each of `bouts_s` (start, end), turn now and then; stand and sway otherwise.

    The IMU is pitched 45° down. Steps of 1.9 Hz swing the hip by 0.1 to 0.3 m/s on every axis, left and right differ,
    and each heel strike rings at 22 Hz with 7 m/s². Samples are means over their period, at least 10 ms, as behind
    the chip's 44 Hz filter, stamped at the middle. `rate_hz` divides 1000.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * _FINE_HZ)) / _FINE_HZ
    speed, heading = np.zeros_like(t), np.zeros_like(t)
    for start, end in bouts_s:
        speed += rng.uniform(1.0, 1.4) * (_ramp(t, start, 1.0) - _ramp(t, end, 1.0))
        for turn in np.arange(start + 3.0, end - 3.0, 6.0):
            heading += rng.choice((-1.0, 1.0)) * rng.choice((0.8, 1.6, 3.1)) * _ramp(t, turn, rng.uniform(1.5, 3.0))
    stride = speed / 1.2
    phase = np.cumsum(2.0 * math.pi * 0.95 * np.maximum(stride, 0.5)) / _FINE_HZ
    step = 2.0 * phase
    since_strike_s = np.mod(step / (2.0 * math.pi), 1.0) / 1.9
    ring = stride * np.exp(-since_strike_s / 0.03) * np.sin(2.0 * math.pi * 22.0 * since_strike_s)

    ahead = speed + 0.15 * stride * (np.sin(step + 1.5) + 0.25 * np.sin(phase + 2.0)) - 0.03 * ring
    left = 0.13 * stride * (np.sin(phase) + 0.2 * np.sin(3.0 * phase + 0.4))
    up = 0.22 * stride * (np.sin(step + 0.3) + 0.25 * np.sin(phase + 0.5)) - 0.05 * ring
    c, s = np.cos(heading), np.sin(heading)
    sway = [0.005 * _sway(t, 0.3, rng) for _ in range(2)]
    v_W = np.stack((ahead * c - left * s + sway[0], ahead * s + left * c + sway[1], up), axis=1)
    yaw = heading + np.radians(6.0 * stride * np.sin(phase + 0.7) + 0.15 * _sway(t, 0.2, rng))
    pitch = np.radians(45.0 + 3.0 * stride * np.sin(step + 0.9) + 0.5 * ring + 0.12 * _sway(t, 0.3, rng))
    roll = np.radians(4.0 * stride * np.sin(phase + 0.2) + 0.1 * _sway(t, 0.25, rng))

    R_WB = Rotation.from_euler("ZYX", np.stack((yaw, pitch, roll), axis=1))
    w_B = np.zeros((t.size, 3))
    w_B[1:-1] = 0.5 * _FINE_HZ * (R_WB[:-2].inv() * R_WB[2:]).as_rotvec()
    a_W = np.gradient(v_W, axis=0) * _FINE_HZ
    sf_B = R_WB.inv().apply(a_W - G_W_MPS2)
    every = _FINE_HZ // rate_hz
    box = max(every, 10) + 1
    kept = np.arange(box, t.size - box, every)
    t_ns = np.round(1e9 * t[kept]).astype(np.int64) + 7_000_000_000
    return Motion(t_ns, _averaged(sf_B, box)[kept], _averaged(w_B, box)[kept], R_WB.as_matrix()[kept])


def with_mpu6050_noise(
    motion: Motion, seed: int, gyro_bias_dps: float = 0.3, sf_bias_mps2: float = 0.0, scale: float = 0.0
) -> Motion:
    """Return `motion` as an MPU-6050 behind its 44 Hz filter measures it; biases and scale errors are 1 σ, drawn."""
    rng = np.random.default_rng(seed)
    rate_hz = 1e9 / float(np.median(np.diff(motion.t_ns)))
    per_sample = math.sqrt(min(rate_hz / 2.0, 44.0))
    shape = motion.w_B.shape
    gyro_matrix = np.eye(3) + scale * rng.standard_normal((3, 3))
    w_B = motion.w_B @ gyro_matrix.T + np.radians(gyro_bias_dps) * rng.standard_normal(3)
    w_B = w_B + np.radians(0.005) * per_sample * rng.standard_normal(shape)
    sf_B = motion.sf_B + 400e-6 * STANDARD_GRAVITY_MPS2 * per_sample * rng.standard_normal(shape)
    return replace(motion, sf_B=sf_B + sf_bias_mps2 * rng.standard_normal(3), w_B=w_B)


def _averaged(signal: FloatArray, box: int) -> FloatArray:
    """Return the running mean over `box` − 1 steps, trapezoidal, centred."""
    weights = np.ones(box)
    weights[0] = weights[-1] = 0.5
    averaged: FloatArray = convolve1d(signal, weights / weights.sum(), axis=0)
    return averaged


def _ramp(t: FloatArray, start: float, duration: float) -> FloatArray:
    x = np.clip((t - start) / duration, 0.0, 1.0)
    ramp: FloatArray = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    return ramp


def _sway(t: FloatArray, frequency_hz: float, rng: np.random.Generator) -> FloatArray:
    parts = (np.sin(2.0 * math.pi * frequency_hz * k * t + rng.uniform(0.0, 6.28)) / k for k in (1.0, 1.7, 2.9))
    sway: FloatArray = np.sum(list(parts), axis=0)
    return sway

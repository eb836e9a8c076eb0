"""BROAD (Laidig, Caruso, Cereatti, Seel, Data 6(7):72, 2021): a hand-moved IMU with optical truth, at 95.24 Hz.

Samples are means of three and stamped at the middle one. The inclination error is the angle between the estimated and
the true vertical, over the samples that count: `movement`, where the cameras see the body.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_erosion, gaussian_filter1d
from scipy.spatial.transform import Rotation

from lab.evaluation.attitude import up_B_of
from messages.arrays import BoolArray, FloatArray, IntArray

TUNING = ("01", "10", "18", "26")
HELD_OUT = ("07", "15", "24", "32")
_BLOCK = 3


@dataclass(frozen=True)
class Trial:
    """sf_B (n, 3) m/s² and w_B (n, 3) rad/s at t_s (n,), counted (n,); the cameras' q_WB (m, 4)
    and the unaveraged rate (m, 3) at 285.7 Hz."""

    name: str
    rate_hz: float
    t_s: FloatArray
    sf_B: FloatArray
    w_B: FloatArray
    counted: BoolArray
    camera_hz: float
    camera_q_WB: FloatArray
    raw_w_B: FloatArray

    @property
    def t_ns(self) -> IntArray:
        """Return the times of the samples in ns."""
        return np.round(1e9 * self.t_s).astype(np.int64)

    def true_up_B(self, offset_s: float) -> FloatArray:
        """Return the vertical in B (n, 3), `offset_s` after each sample, interpolated; NaN where it was not seen."""
        position = np.clip((self.t_s + offset_s) * self.camera_hz, 0.0, len(self.camera_q_WB) - 1.001)
        index = np.floor(position).astype(int)
        share = (position - index)[:, np.newaxis]
        up_B = (1.0 - share) * up_B_of(self.camera_q_WB[index]) + share * up_B_of(self.camera_q_WB[index + 1])
        return np.asarray(up_B / np.linalg.norm(up_B, axis=1, keepdims=True), dtype=np.float64)

    def inclination_error_rad(self, up_B: FloatArray, offset_s: float) -> FloatArray:
        """Return the angle between `up_B` (n, 3) and the truth `offset_s` later, at the samples that count."""
        truth = self.true_up_B(offset_s)
        chosen = self.counted & ~np.isnan(truth[:, 0])
        half_chord = 0.5 * np.linalg.norm(up_B[chosen] - truth[chosen], axis=1)
        return np.asarray(2.0 * np.arcsin(np.clip(half_chord, 0.0, 1.0)), dtype=np.float64)

    def imu_delay_s(self) -> float:
        """Return by how much the gyroscope lags the cameras, from the two rates alone.

        Least squares of w_IMU(t) = A w_camera(t) + b − delay · ẇ_camera(t), both smoothed alike.
        """
        seen = ~np.isnan(self.camera_q_WB[:, 0])
        w, x, y, z = np.where(seen[:, np.newaxis], self.camera_q_WB, (1.0, 0.0, 0.0, 0.0)).T
        R_WB = Rotation.from_quat(np.stack((x, y, z, w), axis=1))
        camera = gaussian_filter1d((R_WB[:-1].inv() * R_WB[1:]).as_rotvec() * self.camera_hz, 4.0, axis=0)
        imu = gaussian_filter1d(0.5 * (self.raw_w_B[:-1] + self.raw_w_B[1:]), 4.0, axis=0)
        change = np.gradient(camera, axis=0) * self.camera_hz
        moving = np.linalg.norm(camera, axis=1) > 0.2
        chosen = np.asarray(binary_erosion(seen[:-1] & seen[1:], iterations=40)) & moving
        design = np.zeros((3 * int(chosen.sum()), 13))
        for i in range(3):
            design[i::3, 3 * i : 3 * i + 3] = camera[chosen]
            design[i::3, 9 + i] = 1.0
            design[i::3, 12] = -change[chosen, i]
        solution = np.linalg.lstsq(design, imu[chosen].ravel(), rcond=None)[0]
        return float(solution[12])


def trials(folder: Path) -> list[Trial]:
    """Return the trials in `folder`, by name."""
    return [_trial(path) for path in sorted(folder.glob("*.npz"))]


def _trial(path: Path) -> Trial:
    with np.load(path) as data:
        camera_hz = float(data["sampling_rate"])
        count = len(data["gyr"]) // _BLOCK * _BLOCK
        middle = slice(_BLOCK // 2, count, _BLOCK)
        w_B = data["gyr"][:count].astype(np.float64)
        return Trial(
            name=path.stem,
            rate_hz=camera_hz / _BLOCK,
            t_s=np.arange(count)[middle] / camera_hz,
            sf_B=data["acc"][:count].astype(np.float64).reshape(-1, _BLOCK, 3).mean(axis=1),
            w_B=w_B.reshape(-1, _BLOCK, 3).mean(axis=1),
            counted=data["movement"][:count][middle],
            camera_hz=camera_hz,
            camera_q_WB=data["opt_quat"][:count].astype(np.float64),
            raw_w_B=w_B,
        )

"""The attitude by gyroscope and by accelerometer against the reference, by the simplest propagation of both.

R_WB is the reference's. What the sensors add to it is, to first order, a small rotation φ in W; two of them are kept:

    φ̇_g = R_WB (w − w_ref) − φ_g / T_g                                    gyroscope, forgetting in T_g            (1)
    (1 + T_a d/dt)² φ_a = e_z × (R_WB sf − a_ref − g e_z) / g              direction of gravity, over T_a          (2)

Both are linear in the sensors' errors, so that a bias or an acceleration acts through the same filters. Their times are
chosen where the sensors' noise, which is white, falls below that of the differentiated reference, which rises with the
frequency and with its square: so what is left is about as white as the frames are frequent, and a recording of a few
seconds holds as many independent numbers as it has frames.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from messages import Calibration, ImuSample
from messages.arrays import FloatArray, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception.attitude.imu_model import corrected
from systems.wearable.ground_path import Attitude, Smooth

GYRO_TIME_S, GRAVITY_TIME_S = 0.2, 0.08
"""T_g and T_a of (1) and (2); how they were chosen stands there."""
_STEP_S = 0.01
"""Of the grid on which (1) and (2) are run: the IMU's own period, an eighth of the shorter time."""
_ONSET_S = 0.2
"""Over which a room begins to accelerate: its instant then changes the prediction smoothly, and can be fitted."""
_LAST_SAMPLES = 24
"""Samples of the IMU at a recording's end that tell the line of its stamps: a quarter of a second."""
CHANNELS = ("gyro_roll_rad", "gyro_pitch_rad", "gravity_roll_rad", "gravity_pitch_rad")


@dataclass(frozen=True)
class Sensed:
    """The IMU's corrected samples: times (n,) in s, specific force (n, 3) and rate (n, 3) in B."""

    t_s: FloatArray
    sf_B: FloatArray
    w_B: FloatArray

    @staticmethod
    def of(samples: list[ImuSample], calibration: Calibration) -> "Sensed":
        """Return the samples after the unit's calibration."""
        values = [corrected(sample, calibration.imu) for sample in samples]
        return Sensed(
            _dated(np.array([sample.t_sample_ns for sample in samples], dtype=np.int64)),
            np.array([value.sf_B_mps2 for value in values]),
            np.array([value.w_WB_B_radps for value in values]),
        )


def _dated(stamp_ns: IntArray) -> FloatArray:
    """Return (n,) s: when the samples were taken, on the line that the recording's last stamps lie on.

    A chip samples evenly. A driver that only polls it learns the line's place and slope as it goes, and lays it anew by
    up to some milliseconds when it knows better; at the recording's end it knows best.
    """
    steps = np.diff(stamp_ns)
    periods = np.maximum(np.rint(steps / np.median(steps)), 1.0)
    place = np.concatenate(([0.0], np.cumsum(periods)))
    since_s = (stamp_ns - stamp_ns[-1]) * 1e-9
    period_s = float(np.median(np.diff(since_s)[-_LAST_SAMPLES:] / periods[-_LAST_SAMPLES:]))
    begin_s = float(np.median((since_s - period_s * place)[-_LAST_SAMPLES // 2 :]))
    dated: FloatArray = stamp_ns[-1] * 1e-9 + begin_s + period_s * place
    return dated


class Tilt:
    """(1) and (2) at the frames: what was measured, and what each error of a sensor would do."""

    def __init__(
        self, sensed: Sensed, attitude: Attitude, position: Smooth, R_WC: FloatArray, frame_s: FloatArray
    ) -> None:
        known = attitude.smooth.knows(sensed.t_s) & position.knows(sensed.t_s)
        t_s = sensed.t_s[known]
        R_WB = attitude.R_WB(t_s)
        self._grid_s = np.arange(t_s[0], t_s[-1], _STEP_S)
        self._sample_s = t_s
        self._frame_s = frame_s
        axis = R_WC[:, :, 2] / np.hypot(R_WC[:, 0, 2], R_WC[:, 1, 2])[:, None]
        self.ahead_W = np.stack((axis[:, 0], axis[:, 1]), axis=-1)
        self.left_W = np.stack((-axis[:, 1], axis[:, 0]), axis=-1)
        self.R_WB = R_WB
        turn = np.einsum("nij,nj->ni", R_WB, sensed.w_B[known] - attitude.w_B_radps(t_s))
        force = np.einsum("nij,nj->ni", R_WB, sensed.sf_B[known]) - position(t_s, 2)
        self.error = self._seen(turn[:, :2], force[:, :2])
        roll, pitch = -np.arcsin(R_WC[:, 2, 0]), np.arcsin(-R_WC[:, 2, 2])
        self.reference = np.stack((roll, pitch, roll, pitch), axis=-1)
        nothing = np.zeros((len(t_s), 2))
        turning, jerk = (
            np.einsum("nij,nj->ni", R_WB, np.gradient(values[known], t_s, axis=0))[:, :2]
            for values in (sensed.w_B, sensed.sf_B)
        )
        self.of_lateness = self._seen(-turning, -jerk)
        self.of_gyro_bias = [self._seen(R_WB[:, :2, axis], nothing) for axis in range(3)]
        self.of_acc_bias = [self._seen(nothing, R_WB[:, :2, axis]) for axis in range(3)]

    def of_acceleration(self, ahead_mps2: float, left_mps2: float, from_s: float) -> FloatArray:
        """Return (n, 4): what a room does that accelerates from `from_s` after the first frame on, in (2)."""
        ahead = self.ahead_W.mean(axis=0) / np.linalg.norm(self.ahead_W.mean(axis=0))
        a_W = ahead_mps2 * ahead + left_mps2 * np.array([-ahead[1], ahead[0]])
        began = np.clip((self._sample_s - self._frame_s[0] - from_s) / _ONSET_S + 0.5, 0.0, 1.0)
        return self._seen(np.zeros((len(began), 2)), np.outer(began, a_W))

    def _seen(self, turn_W: FloatArray, force_W: FloatArray) -> FloatArray:
        """Return (frames, 4) of an error of rate and one of specific force (samples, 2), level axes of W."""
        tilt = np.stack((force_W[:, 1], -force_W[:, 0]), axis=-1) / STANDARD_GRAVITY_MPS2
        phi_g = _forgetting(self._on_grid(turn_W), GYRO_TIME_S) * GYRO_TIME_S
        phi_a = _forgetting(_forgetting(self._on_grid(tilt), GRAVITY_TIME_S), GRAVITY_TIME_S)
        columns = []
        for phi in (phi_g, phi_a):
            at = np.stack([np.interp(self._frame_s, self._grid_s, phi[:, i]) for i in range(2)], axis=-1)
            columns += [np.einsum("ni,ni->n", at, self.ahead_W), np.einsum("ni,ni->n", at, self.left_W)]
        return np.stack(columns, axis=-1)

    def _on_grid(self, values: FloatArray) -> FloatArray:
        return np.stack([np.interp(self._grid_s, self._sample_s, column) for column in values.T], axis=-1)


def _forgetting(values: FloatArray, time_s: float) -> FloatArray:
    """Return the mean of `values` (n, c) over the past, weighted by exp(−age / time_s); zero before the first."""
    kept = np.exp(-_STEP_S / time_s)
    mean: FloatArray = lfilter([1.0 - kept], [1.0, -kept], values, axis=0)
    return mean

"""Does the IMU measure the motion that the camera sees? Judged over the last second, if there was motion enough."""

import enum
import math
from collections import deque
from dataclasses import dataclass
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from messages import Calibration, Reason, Vec3
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception.motion.comparison import (
    CameraMotion,
    ImuMotion,
    integral,
    interpolated,
    lag_of,
    rate_misfit,
    velocity_misfit,
)
from perception.motion.ego_motion import EgoMotion
from perception.motion.turn_balance import Turn, TurnBalance


@dataclass(frozen=True, kw_only=True)
class ConsistencySettings:
    """What is judged, and how far apart camera and IMU may be.

    A misfit is a contradiction beyond √(`noise`² + (`share` · swing)²), and agreement below `agreeing` of that: a
    changed sign doubles the swing. An axis of the accelerometer whose motion is small beside the others' is judged by
    its gain, which the change of sign takes from 1 to −1; `most_gain_error` is half way. No agreement follows from less
    swing than `least_*_swing`, unless the gain is known. Once the IMU has turned by `most_unobserved_rad`, to and fro,
    without a picture that shows motion, it is unknown whether it still agrees.
    """

    window_s: float = 1.0  # about a stride: every axis moves in it
    recent_s: float = 0.3  # of a window: shows first that the IMU agrees again
    least_steps: int = 9  # in a window: half of the frames of a second
    most_unobserved_rad: float = 0.8  # by then a wrong gyroscope has spoilt the attitude
    longest_lag_s: float = 0.1  # either way: two frames
    lag_grid_s: float = 0.01  # the IMU's period
    most_lag_s: float = 0.012  # an attitude so late errs by a degree at 1.5 rad/s
    most_lag_deviation_s: float = 0.003  # a quarter of that: else the lag is not known
    rate_noise_radps: float = 0.06  # of the camera's rates and of vibration
    rate_share: float = 0.2  # for errors that grow with the motion, as of a lens; a wrong sign leaves 2
    least_rate_swing_radps: float = 0.12  # twice the noise
    most_gyro_bias_radps: float = 0.15  # of a calibrated one
    most_mount_rad: float = math.radians(6.0)  # a camera knocked out of place, not one that swings a little
    most_mount_deviation_rad: float = math.radians(3.0)  # half of that: else the turn is not known
    velocity_noise_mps: float = 0.06  # of the camera's velocities and of the accelerometer, twice integrated
    velocity_share: float = 0.4  # for errors that grow with the motion, as of depth; a wrong sign leaves 2
    least_velocity_swing_mps: float = 0.04  # with less, even a wrong sign stays near the noise
    most_gain_error: float = 1.0
    most_gain_deviation: float = 0.6  # below `most_gain_error`: else the gain is not known
    least_gain_swing_mps: float = 0.015  # that an axis adds: with less, errors of the others pass for its gain
    gravity_mps2: float = STANDARD_GRAVITY_MPS2
    most_gravity_error_mps2: float = 0.3  # 3 % of gravity, beside what the calibration itself may be off by
    agreeing: float = 0.8  # of the bound of contradiction: a verdict does not change to and fro
    confirmations: int = 3  # windows in a row: one picture may mislead
    longest_gap_s: float = 0.035  # between samples: two may be missing at 100 Hz


class Verdict(enum.Enum):
    """What is known of one question."""

    UNKNOWN = "unknown"
    CONSISTENT = "consistent"
    INCONSISTENT = "inconsistent"


class Subject(str, enum.Enum):
    """What is judged, apart from each other."""

    TIME = "time"
    TURN = "turn"
    MOUNT = "mount"
    GYRO_X = "gyro-x"
    GYRO_Y = "gyro-y"
    GYRO_Z = "gyro-z"
    ACCEL_X = "accel-x"
    ACCEL_Y = "accel-y"
    ACCEL_Z = "accel-z"
    GRAVITY = "gravity"


class ConsistencyMonitor:
    """Takes the IMU's samples and the camera's motions, and keeps a verdict on each subject; `R_LC` (3, 3) is the
    rectification's."""

    def __init__(self, calibration: Calibration, R_LC: FloatArray, settings: ConsistencySettings | None = None) -> None:
        self.settings = settings or ConsistencySettings()
        self._imu = _ImuRecord(self.settings.window_s + 4.0 * self.settings.longest_lag_s)
        self._R_BC: FloatArray = np.array(calibration.X_BL.R) @ R_LC
        self._p_BC_m = np.array(calibration.X_BL.p_m)
        self._most_gravity_error_mps2 = self.settings.most_gravity_error_mps2 + _FAR_SIGMAS * (
            calibration.residual.specific_force_mps2 + calibration.residual.scale * self.settings.gravity_mps2
        )
        self._most_lag_s = self.settings.most_lag_s + _FAR_SIGMAS * calibration.residual.time_s
        self._steps: deque[EgoMotion] = deque()
        self._turns = TurnBalance()
        self._held = {subject: _HeldVerdict(self.settings.confirmations) for subject in (Subject.TIME, *_OF_IMU)}
        self._agreed_recently = True
        self._restart_due = False
        self._newest_sample_ns: int | None = None
        self._unobserved_rad: float | None = None  # from the first picture on

    @property
    def verdicts(self) -> dict[Subject, Verdict]:
        """Return what is known of each subject."""
        turn = Verdict.INCONSISTENT if self._turns.contradicted else Verdict.UNKNOWN
        return {Subject.TURN: turn, **{subject: held.verdict for subject, held in self._held.items()}}

    @property
    def reason(self) -> Reason:
        """Return TIME_INCONSISTENT or IMU_INCONSISTENT while something contradicts, else NONE."""
        if self._held[Subject.TIME].verdict is Verdict.INCONSISTENT:
            return Reason.TIME_INCONSISTENT
        contradicted = self._turns.contradicted or self._imu_contradicts
        return Reason.IMU_INCONSISTENT if contradicted else Reason.NONE

    @property
    def gyro_agrees(self) -> bool:
        """Return whether the gyroscope is known to agree with the camera, whatever the accelerometer does."""
        verdicts = self.verdicts
        turning = all(
            verdicts[subject] is not Verdict.INCONSISTENT for subject in (Subject.TURN, Subject.MOUNT, *_GYRO)
        )
        return turning and any(verdicts[subject] is Verdict.CONSISTENT for subject in _GYRO)

    @property
    def _imu_contradicts(self) -> bool:
        return any(self._held[subject].verdict is Verdict.INCONSISTENT for subject in _OF_IMU)

    def add_sample(self, t_ns: int, sf_B_mps2: Vec3, w_B_radps: Vec3) -> None:
        """Take one calibrated sample, later than the one before it; clipped ones are better left out."""
        self._imu.append(t_ns, sf_B_mps2, w_B_radps)
        if self._unobserved_rad is not None and self._newest_sample_ns is not None:
            self._unobserved_rad += 1e-9 * (t_ns - self._newest_sample_ns) * math.hypot(*w_B_radps)
        self._newest_sample_ns = t_ns

    def add_motion(self, motion: EgoMotion | None, newest: EgoMotion | None) -> bool:
        """Take what one frame told of the motion, None for nothing: of the step before last, and a guess at the last.

        Judges the turns at once. Returns whether what was estimated from the IMU until now should be discarded: it
        begins to agree again, as in `update_verdicts`, or it moved unobserved.
        """
        settings = self.settings
        unobserved = False
        if motion is None or (self._steps and not self._follows(motion)):
            self._steps.clear()
            self._turns.interrupt()
        restart = False
        if motion is not None:
            self._steps.append(motion)
            while motion.t_after_ns - self._steps[0].t_before_ns > _WINDOW_SLACK * 1e9 * (
                settings.window_s + 2.0 * settings.longest_lag_s
            ):
                self._steps.popleft()
            turn = self._turn(motion)
            if turn is None:
                self._turns.interrupt()
            else:
                restart = self._turns.add(turn)
                unobserved = (self._unobserved_rad or 0.0) > settings.most_unobserved_rad
                self._unobserved_rad = 0.0
        if restart or unobserved:
            self._restart_due, self._agreed_recently = False, True
        guess = None if newest is None else self._turn(newest)
        if guess is not None:
            self._turns.add_provisional(guess)
        return restart or unobserved

    def update_verdicts(self) -> bool:
        """Bring the verdicts on the last second up to date.

        Returns whether the IMU begins to agree again after a contradiction: what was estimated from it until now should
        then be discarded. That is soon after the fact, and before the verdict, which needs a whole window.
        """
        settings = self.settings
        # those at the end must wait until the lag can be looked for there
        known = [s for s in self._steps if self._imu.newest_s(s.t_after_ns) >= settings.longest_lag_s]
        if len(known) < settings.least_steps or known[-1].t_after_ns - known[0].t_before_ns < 1e9 * settings.window_s:
            return False
        return self._update_verdicts_on(known)

    def _turn(self, motion: EgoMotion) -> Turn | None:
        """Return the turns of one step, or None where samples are missing."""
        imu_rad = self._imu.turn(motion.t_before_ns, motion.t_after_ns, self.settings.longest_gap_s)
        if imu_rad is None:
            return None
        duration_s = 1e-9 * (motion.t_after_ns - motion.t_before_ns)
        return Turn(duration_s, imu_rad, self._R_BC @ motion.w_C_radps * duration_s)

    def _follows(self, motion: EgoMotion) -> bool:
        return abs(motion.t_before_ns - self._steps[-1].t_after_ns) < 1e9 * _MOST_APART_S

    def _update_verdicts_on(self, steps: list[EgoMotion]) -> bool:
        camera = self._camera_motion(steps, self.settings.window_s)
        imu = self._imu.around(steps[0].t_before_ns, camera, self.settings.longest_lag_s)
        if imu is None or np.diff(imu.t_s).max() > self.settings.longest_gap_s:
            return False
        contradicted = self._imu_contradicts
        for subject, result in self._compared(camera, imu).items():
            self._held[subject].update(result, self.settings.agreeing)
        if not self._imu_contradicts:
            restart, self._restart_due, self._agreed_recently = self._restart_due, False, True
            return restart
        results = self._compared(self._camera_motion(steps, self.settings.recent_s), imu)
        agrees = all(results[subject].ratio < 1.0 for subject in _OF_IMU)
        restart, self._agreed_recently = agrees and not self._agreed_recently, agrees
        self._restart_due = not restart and (self._restart_due or not agrees or not contradicted)
        return restart

    def _camera_motion(self, steps: list[EgoMotion], length_s: float) -> CameraMotion:
        """Return the last `length_s` of `steps`, times counted from the first of all."""
        epoch_ns, last_ns = steps[0].t_before_ns, steps[-1].t_after_ns
        recent = [s for s in steps if last_ns - s.t_before_ns <= 1e9 * (length_s + _MOST_APART_S)]
        return CameraMotion(
            from_s=1e-9 * np.array([s.t_before_ns - epoch_ns for s in recent]),
            to_s=1e-9 * np.array([s.t_after_ns - epoch_ns for s in recent]),
            w_B_radps=np.array([s.w_C_radps for s in recent]) @ self._R_BC.T,
            v_C_B_mps=np.array([s.v_C_mps for s in recent]) @ self._R_BC.T,
            p_BC_m=self._p_BC_m,
        )

    def _compared(self, camera: CameraMotion, imu: ImuMotion) -> "dict[Subject, _WindowResult]":
        """Return what one window says about each subject."""
        s = self.settings
        lag = lag_of(camera, imu, s.longest_lag_s, s.lag_grid_s)
        timed = lag.deviation_s < s.most_lag_deviation_s
        rates = rate_misfit(camera, imu, lag.lag_s if timed else 0.0)
        velocities = velocity_misfit(camera, imu, lag.lag_s if timed else 0.0)
        turning = rates.swing_radps > s.least_rate_swing_radps
        gyro = np.maximum(
            rates.misfit_radps / np.hypot(s.rate_noise_radps, s.rate_share * rates.swing_radps),
            np.abs(rates.bias_radps) / s.most_gyro_bias_radps,
        )
        gains_known = (velocities.gain_deviation < s.most_gain_deviation) & (
            velocities.gain_swing_mps > s.least_gain_swing_mps
        )
        telling = gains_known | (velocities.swing_mps > s.least_velocity_swing_mps)
        accelerometer = np.maximum(
            velocities.misfit_mps / np.hypot(s.velocity_noise_mps, s.velocity_share * velocities.swing_mps),
            np.where(gains_known, np.abs(velocities.gain - 1.0) / s.most_gain_error, 0.0),
        )
        mount_rad = np.abs(rates.mount_rad) - _FAR_SIGMAS * rates.mount_deviation_rad
        mount_known = bool((rates.mount_deviation_rad < s.most_mount_deviation_rad).all())
        timed = timed and bool(turning.any() and (gyro < 1.0).all())
        gravity_error_mps2 = abs(velocities.gravity_mps2 - s.gravity_mps2)
        return {
            Subject.TIME: _WindowResult(abs(lag.lag_s) / self._most_lag_s if timed else 0.0, timed),
            Subject.GRAVITY: _WindowResult(gravity_error_mps2 / self._most_gravity_error_mps2, bool(telling.any())),
            Subject.MOUNT: _WindowResult(max(0.0, float(mount_rad.max())) / s.most_mount_rad, mount_known),
            **{subject: _WindowResult(float(gyro[i]), bool(turning[i])) for i, subject in enumerate(_GYRO)},
            **{subject: _WindowResult(float(accelerometer[i]), bool(telling[i])) for i, subject in enumerate(_ACCEL)},
        }


class _WindowResult(NamedTuple):
    """How far one window's motion is from agreement, 1 being a contradiction, and whether it can prove agreement."""

    ratio: float
    informative: bool


_GYRO = (Subject.GYRO_X, Subject.GYRO_Y, Subject.GYRO_Z)
_ACCEL = (Subject.ACCEL_X, Subject.ACCEL_Y, Subject.ACCEL_Z)
_OF_IMU = (Subject.MOUNT, *_GYRO, *_ACCEL, Subject.GRAVITY)
_FAR_SIGMAS = 3.0
"""Deviations that an error of the calibration, or of an estimate, may have."""
_MOST_APART_S = 0.02
"""Between the end of one step and the beginning of the next, whose rows differ: less than half a frame."""
_WINDOW_SLACK = 1.2
"""Times what a window needs, which steps are kept for: frames come unevenly."""


class _HeldVerdict:
    """One verdict: it changes after some equal results in a row, and to CONSISTENT only by motion."""

    def __init__(self, confirmations: int) -> None:
        self.verdict = Verdict.UNKNOWN
        self._confirmations = confirmations
        self._agreements, self._contradictions = 0, 0

    def update(self, result: _WindowResult, agreeing: float) -> None:
        self._contradictions = self._contradictions + 1 if result.ratio >= 1.0 else 0
        self._agreements = self._agreements + 1 if result.ratio < agreeing and result.informative else 0
        if self._contradictions >= self._confirmations:
            self.verdict = Verdict.INCONSISTENT
        elif self._agreements >= self._confirmations:
            self.verdict = Verdict.CONSISTENT


class _ImuRecord:
    """The samples of the last `length_s`."""

    def __init__(self, length_s: float) -> None:
        self._length_ns = round(1e9 * length_s)
        self._times_ns: deque[int] = deque()
        self._values: deque[tuple[float, ...]] = deque()

    def append(self, t_ns: int, sf_B_mps2: Vec3, w_B_radps: Vec3) -> None:
        self._times_ns.append(t_ns)
        self._values.append((*sf_B_mps2, *w_B_radps))
        while t_ns - self._times_ns[0] > self._length_ns:
            self._times_ns.popleft()
            self._values.popleft()

    def newest_s(self, after_ns: int) -> float:
        """Return how long after `after_ns` the newest sample is."""
        return 1e-9 * (self._times_ns[-1] - after_ns) if self._times_ns else -math.inf

    def turn(self, from_ns: int, to_ns: int, longest_gap_s: float) -> FloatArray | None:
        """Return ∫ w dt (3,), or None where samples are farther apart than `longest_gap_s`."""
        count = 1 + sum(1 for _ in takewhile(lambda t_ns: t_ns > from_ns, reversed(self._times_ns)))
        latest = range(max(0, len(self._times_ns) - count), len(self._times_ns))
        t_s: FloatArray = 1e-9 * np.array([self._times_ns[k] - from_ns for k in latest], dtype=np.float64)
        step_s = np.array([0.0, 1e-9 * (to_ns - from_ns)])
        if len(t_s) < 2 or t_s[0] > step_s[0] or t_s[-1] < step_s[1] or np.diff(t_s).max() > longest_gap_s:
            return None
        angle = integral(t_s, np.array([self._values[k][3:] for k in latest]))
        before, after = interpolated(step_s, t_s, angle)
        turn: FloatArray = after - before
        return turn

    def around(self, epoch_ns: int, camera: CameraMotion, margin_s: float) -> ImuMotion | None:
        """Return the samples, times counted from `epoch_ns`, if they reach `margin_s` beyond `camera` on both sides."""
        t_s: FloatArray = 1e-9 * (np.array(self._times_ns, dtype=np.int64) - epoch_ns).astype(np.float64)
        if len(t_s) == 0 or t_s[0] > camera.from_s[0] - margin_s or t_s[-1] < camera.to_s[-1] + margin_s:
            return None
        values = np.array(self._values)
        return ImuMotion(t_s, values[:, :3], values[:, 3:])

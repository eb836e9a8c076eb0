"""How much later than its stamp the IMU measures what the camera sees: judged over a second, if it turned enough.

With ω the mean rates of the steps from t to t + Δt that the camera saw, turned into B,

    ω_k = (Θ(t + Δt + l) − Θ(t + l)) / Δt + b + c (t − t̄) + e_k,           Θ = ∫ w_measured dt               (1)

Bias b and a ground that turns ever faster, c, are those of least squares; the lag l is that of the least misfit e. All
else is judged by the innovations of the attitude filter, step by step. A lag is not: over a single step it is no
different from a change of the rate, and steps stamped so late are not where the filter looks for them.
"""

import math
from array import array
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from messages import Calibration, Vec3
from messages.arrays import FloatArray, column_rms
from perception.motion.ego_motion import EgoMotion
from perception.motion.sampled import integral, interpolated


@dataclass(frozen=True, kw_only=True)
class ClockLagSettings:
    """What is judged, and how far apart the clocks may be.

    A lag is known where it leaves no misfit beyond √(`rate_noise_radps`² + (`rate_share` · swing)²), some axis swings
    by `least_swing_radps` and its own deviation is below `most_deviation_s`. It contradicts beyond `most_s`, beside
    what the calibration leaves, and agrees below `agreeing` of that, after `confirmations` in a row.
    """

    window_s: float = 1.0  # about a stride: every axis moves in it
    least_steps: int = 9  # in a window: half of the frames of a second
    longest_s: float = 0.1  # either way: two frames
    grid_s: float = 0.01  # the IMU's period
    most_s: float = 0.012  # an attitude so late errs by a degree at 1.5 rad/s
    most_deviation_s: float = 0.003  # a quarter of that
    rate_noise_radps: float = 0.06  # of the camera's rates and of vibration
    rate_share: float = 0.2  # for errors that grow with the motion, as of a lens
    least_swing_radps: float = 0.12  # twice the noise
    agreeing: float = 0.8  # a verdict does not change to and fro
    confirmations: int = 3  # windows in a row: one picture may mislead
    longest_gap_s: float = 0.035  # between samples: two may be missing at 100 Hz


@dataclass(frozen=True)
class CameraTurns:
    """n steps, one after the other, as the camera saw them: from and to (n,), s on the IMU's clock, and their mean
    rates (n, 3) in B."""

    from_s: FloatArray
    to_s: FloatArray
    w_B_radps: FloatArray


@dataclass(frozen=True)
class ImuRates:
    """m calibrated samples: times (m,), s, and rates (m, 3) in B."""

    t_s: FloatArray
    w_B_radps: FloatArray


class Lag(NamedTuple):
    """l of (1) and its standard deviation, infinite where nothing turns; root mean squares (3,) on the axes of B of the
    rates' swing about a line and of e."""

    lag_s: float
    deviation_s: float
    swing_radps: FloatArray
    misfit_radps: FloatArray


class ClockLagMonitor:
    """Takes the IMU's samples and the camera's motions; `contradicts` while their clocks are apart. `R_LC` (3, 3) is
    the rectification's."""

    def __init__(self, calibration: Calibration, R_LC: FloatArray, settings: ClockLagSettings | None = None) -> None:
        self.settings = settings or ClockLagSettings()
        self.contradicts = False
        self._R_BC: FloatArray = np.array(calibration.X_BL.R) @ R_LC
        self._most_s = self.settings.most_s + _FAR_SIGMAS * calibration.residual.time_s
        self._length_ns = round(1e9 * (self.settings.window_s + 4.0 * self.settings.longest_s))
        self._times_ns, self._rates = array("q"), array("d")  # of samples; three rates each
        self._steps: deque[EgoMotion] = deque()
        self._agreements, self._contradictions = 0, 0

    def add_sample(self, t_ns: int, w_B_radps: Vec3) -> None:
        """Take one calibrated sample, later than the one before it; clipped ones are better left out."""
        self._times_ns.append(t_ns)
        self._rates.extend(w_B_radps)
        while t_ns - self._times_ns[0] > self._length_ns:
            del self._times_ns[:1], self._rates[:3]

    def add_motion(self, motion: EgoMotion | None) -> None:
        """Take what one frame told of the motion, None for nothing."""
        follows = self._steps and motion and abs(motion.t_before_ns - self._steps[-1].t_after_ns) < _MOST_APART_NS
        if not follows:
            self._steps.clear()
        if motion is None:
            return
        self._steps.append(motion)
        longest_s = _WINDOW_SLACK * (self.settings.window_s + 2.0 * self.settings.longest_s)
        while motion.t_after_ns - self._steps[0].t_before_ns > 1e9 * longest_s:
            self._steps.popleft()

    def update(self) -> None:
        """Bring the verdict on the last second up to date."""
        settings = self.settings
        if not self._times_ns:
            return
        newest_ns = self._times_ns[-1]  # the last steps must wait until the lag can be looked for there
        known_ns = newest_ns - 1e9 * settings.longest_s
        known = [step for step in self._steps if step.t_after_ns <= known_ns]
        if len(known) < settings.least_steps or known[-1].t_after_ns - known[0].t_before_ns < 1e9 * settings.window_s:
            return
        camera, imu = self._window(known)
        reaches = imu.t_s[0] <= camera.from_s[0] - settings.longest_s
        if reaches and (imu.t_s[1:] - imu.t_s[:-1]).max() <= settings.longest_gap_s:
            self._judge(lag_of(camera, imu, settings.longest_s, settings.grid_s))

    def _window(self, steps: list[EgoMotion]) -> tuple[CameraTurns, ImuRates]:
        """Return the last `window_s` of `steps`, and all samples, times counted from the first step."""
        epoch_ns = steps[0].t_before_ns
        from_ns = steps[-1].t_after_ns - (1e9 * self.settings.window_s + _MOST_APART_NS)
        recent = [step for step in steps if step.t_before_ns >= from_ns]
        camera = CameraTurns(
            from_s=1e-9 * np.array([step.t_before_ns - epoch_ns for step in recent]),
            to_s=1e-9 * np.array([step.t_after_ns - epoch_ns for step in recent]),
            w_B_radps=np.array([step.w_C_radps for step in recent]) @ self._R_BC.T,
        )
        t_s = 1e-9 * (np.array(self._times_ns) - epoch_ns)
        return camera, ImuRates(t_s, np.array(self._rates).reshape(-1, 3))

    def _judge(self, lag: Lag) -> None:
        s = self.settings
        turning = bool((lag.swing_radps > s.least_swing_radps).any())
        explained = (lag.misfit_radps < np.hypot(s.rate_noise_radps, s.rate_share * lag.swing_radps)).all()
        known = turning and bool(explained) and lag.deviation_s < s.most_deviation_s
        ratio = abs(lag.lag_s) / self._most_s if known else 0.0
        self._contradictions = self._contradictions + 1 if ratio >= 1.0 else 0
        self._agreements = self._agreements + 1 if known and ratio < s.agreeing else 0
        if self._contradictions >= s.confirmations:
            self.contradicts = True
        elif self._agreements >= s.confirmations:
            self.contradicts = False


def lag_of(camera: CameraTurns, imu: ImuRates, longest_s: float, grid_s: float) -> Lag:
    """Return l of (1): the best of a grid over ± `longest_s`, and the parabola through it and its neighbours.

    `imu` must reach `longest_s` farther than `camera` on both sides.
    """
    steps = round(longest_s / grid_s)
    lags_s: FloatArray = grid_s * np.arange(-steps, steps + 1, dtype=np.float64)
    angle = integral(imu.t_s, imu.w_B_radps)
    off_line = _off_line(camera)
    seen_radps = off_line @ camera.w_B_radps
    misfit = seen_radps[:, None] - _along(off_line, _mean_rates(camera, imu.t_s, angle, lags_s))
    cost = (misfit * misfit).sum(axis=(0, 2))
    best = min(max(int(np.argmin(cost)), 1), 2 * steps - 1)
    before, least, after = cost[best - 1 : best + 2].tolist()
    curvature = (before + after - 2.0 * least) / grid_s**2
    lag_s, deviation_s = 0.0, math.inf
    if curvature > 0.0:
        lag_s = lags_s[best] - (after - before) / (2.0 * grid_s * curvature)
        lag_s = float(np.clip(lag_s, -longest_s, longest_s))
        freedom = 3 * (len(camera.from_s) - 2) - 1
        deviation_s = math.sqrt(2.0 * least / freedom / curvature)
    felt_radps = _along(off_line, _mean_rates(camera, imu.t_s, angle, np.array([lag_s])))[:, 0]
    swing = np.maximum(column_rms(felt_radps), column_rms(seen_radps))
    return Lag(lag_s, deviation_s, swing, column_rms(felt_radps - seen_radps))


def _off_line(camera: CameraTurns) -> FloatArray:
    """Return what takes b and c of (1) off n values, (n, n)."""
    middle_s = 0.5 * (camera.from_s + camera.to_s)
    about_mean = middle_s - middle_s.mean()
    count = len(about_mean)
    off_line: FloatArray = np.eye(count) - 1.0 / count - np.outer(about_mean / (about_mean @ about_mean), about_mean)
    return off_line


def _along(off_line: FloatArray, rates: FloatArray) -> FloatArray:
    """Return `off_line` (n, n) times `rates` (n, lags, 3), step by step."""
    return (off_line @ rates.reshape(len(rates), -1)).reshape(rates.shape)


def _mean_rates(camera: CameraTurns, t_s: FloatArray, angle: FloatArray, lags_s: FloatArray) -> FloatArray:
    """Return the mean rates (n, lags, 3) during the steps, moved by `lags_s` (lags,), of Θ `angle` (m, 3) at `t_s`."""
    both_s = np.concatenate((camera.from_s, camera.to_s))[:, None] + lags_s
    before, after = np.split(interpolated(both_s, t_s, angle), 2)
    rates: FloatArray = (after - before) / (camera.to_s - camera.from_s)[:, None, None]
    return rates


_FAR_SIGMAS = 3.0
"""Deviations that an error of the calibration may have."""
_MOST_APART_NS = 20_000_000
"""Between the end of one step and the beginning of the next: less than half a frame."""
_WINDOW_SLACK = 1.2
"""Times what a window needs, which steps are kept for: frames come unevenly."""

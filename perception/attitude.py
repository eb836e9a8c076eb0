"""The attitude of the IMU from its own samples: start, rest, gaps and validity around the equations of the filter."""

import copy
import math
from dataclasses import replace

import numpy as np

from messages import Quaternion, Reason, Residual, Status, Vec3
from perception import so3, vec3
from perception.attitude_kalman import ROTATION, AttitudeKalman
from perception.attitude_state import AttitudeSettings, AttitudeState, Checkpoint, Sample
from perception.rest import Rest
from perception.so3 import Array

__all__ = ["AttitudeFilter", "AttitudeSettings", "AttitudeState"]


class AttitudeFilter:
    """Attitude, angular rate and sensor errors of the IMU, one calibrated sample at a time.

    `residual` is what the unit's calibration left behind, 1 σ: it bounds how far the accelerometer's bias and the
    gyroscope's matrix may be re-estimated, and how well the vertical can be known.

    It starts from the first second of rest or, without one, after `moving_start_s`, with a covariance that admits it.
    What rest taught in the moments before a walk was noticed is taken back.
    """

    def __init__(self, settings: AttitudeSettings, residual: Residual) -> None:
        self.settings = settings
        self._kalman = AttitudeKalman(settings, residual)
        self._state = self._kalman.new_state()
        self._least_tilt_var = (residual.specific_force_mps2 / settings.gravity_mps2) ** 2

    def save(self) -> AttitudeState:
        """Return a copy of the state; a filter of the same settings that restores it goes on as this one would."""
        return copy.deepcopy(self._state)

    def restore(self, state: AttitudeState) -> None:
        """Go on from `state`."""
        self._state = copy.deepcopy(state)

    @property
    def q_WB(self) -> Quaternion:
        """Return the attitude (w, x, y, z; w ≥ 0) at the last sample; NaN before the start."""
        return so3.positive(self._state.q_WB)

    @property
    def R_WB(self) -> Array:
        """Return the attitude at the last sample, (3, 3); NaN before the start."""
        return so3.matrix_from_quaternion(self._state.q_WB)

    @property
    def w_WB_B(self) -> Vec3:
        """Return the last sample's angular rate, rad/s, without bias and matrix error; NaN before the start."""
        if not self._state.started:
            return (math.nan, math.nan, math.nan)
        return self._kalman.rate(self._state, self._state.w_measured)

    @property
    def bob_mps(self) -> float:
        """Return how fast the IMU rises at the last sample, m/s, about the mean of the walk; 0 before the start."""
        return self._state.v_W[2] - self._state.drift_W[2]

    @property
    def gyro_bias(self) -> Vec3:
        """Return the gyroscope's bias in B, rad/s; zero until the first start."""
        return self._state.gyro_bias

    @property
    def rotation_cov_W(self) -> Array:
        """Return the covariance (3, 3), rad², of the small rotation in W between the estimate and the truth.

        The tilt is never claimed better than the calibration's residual of the accelerometer allows, whatever the
        motion seems to tell about it. Yaw counts from the start. NaN before it.
        """
        if not self._state.started:
            return np.full((3, 3), math.nan)
        covariance = np.array(self._state.covariance[ROTATION, ROTATION])
        for axis in (0, 1):
            covariance[axis, axis] = max(covariance[axis, axis], self._least_tilt_var)
        return covariance

    @property
    def at_rest(self) -> bool:
        """Return whether the wearer stands, swaying no more than one does."""
        return self._state.resting

    @property
    def status(self) -> Status:
        """Return VALID while samples come without a gap and the tilt is known to `usable_tilt_rad`, 1 σ."""
        if self.reason is Reason.NONE:
            return Status.VALID
        return Status.INVALID if self.reason is Reason.NO_IMU else Status.INITIALISING

    @property
    def reason(self) -> Reason:
        """Return why the status is not VALID."""
        state = self._state
        if not state.started and state.levelling.elapsed_s < self.settings.rest.time_s:
            return Reason.STARTING
        if state.after_gap:
            return Reason.NO_IMU
        knows_tilt = state.started and self.rotation_cov_W[(0, 1), (0, 1)].max() <= self.settings.usable_tilt_rad**2
        return Reason.NONE if knows_tilt else state.doubt

    def update(self, t_ns: int, sf_B: Vec3, w_B: Vec3, clipped: bool = False) -> None:
        """Take one calibrated sample: specific force in m/s² and angular rate in rad/s, in B, at `t_ns`.

        Raises ValueError, and changes nothing, where a value is not finite or time does not advance.
        """
        last_ns = self._state.t_ns
        if not all(map(math.isfinite, (*sf_B, *w_B))):
            raise ValueError(f"IMU sample at {t_ns} ns: sf_B {sf_B} m/s² and w_B {w_B} rad/s must be finite")
        if last_ns is not None and t_ns <= last_ns:
            raise ValueError(f"IMU sample at {t_ns} ns: must be later than the one before it, at {last_ns} ns")
        sample = Sample(t_ns, sf_B, w_B, clipped)
        rested = self._state.resting
        self._take(sample)
        self._remember(sample)
        if rested and not self._state.resting:
            self._take_back()

    def _take(self, sample: Sample) -> None:
        state, settings = self._state, self.settings
        dt_s = 0.0 if state.t_ns is None else 1e-9 * (sample.t_ns - state.t_ns)
        if dt_s > (settings.restart_s if state.started else settings.gap_s):
            state = self._state = self._kalman.forgotten(state, dt_s)
            dt_s = 0.0
        state.t_ns = sample.t_ns
        state.after_gap = dt_s > settings.gap_s
        if state.after_gap:
            state.rest = Rest()
        if state.after_gap or sample.clipped:
            state.doubt = Reason.NO_IMU
        state.rest.update(settings.rest, sample.sf_B, sample.w_B, dt_s)
        if state.started:
            self._kalman.integrate(state, sample, dt_s)
        else:
            self._level(state, sample, dt_s)

    def _level(self, state: AttitudeState, sample: Sample, dt_s: float) -> None:
        """Wait for rest, or long enough that the mean specific force of a motion points up."""
        levelling = state.levelling
        levelling.elapsed_s += dt_s
        turned = vec3.scaled(self._kalman.rate(state, sample.w_B), dt_s)
        levelling.q_SB = so3.multiply(levelling.q_SB, so3.quaternion_from_rotvec(turned))
        sf_S = so3.transform(so3.rows_from_quaternion(levelling.q_SB), sample.sf_B)
        levelling.sum_sf_S = vec3.plus_scaled(levelling.sum_sf_S, sf_S, dt_s)
        state.sf_measured, state.w_measured, state.usual_step_s = sample.sf_B, sample.w_B, dt_s
        if self._kalman.at_rest(state):
            self._kalman.start_at_rest(state)
        elif levelling.elapsed_s >= self.settings.moving_start_s:
            self._kalman.start_in_motion(state)

    def _remember(self, sample: Sample) -> None:
        """At rest keep the states of one and two `notice_s` ago, and the samples since."""
        state = self._state
        for checkpoint in state.checkpoints:
            checkpoint.since.append(sample)
        if state.resting:
            newest_ns = state.checkpoints[-1].state.t_ns if state.checkpoints else None
            if newest_ns is None or sample.t_ns - newest_ns >= 1e9 * self.settings.notice_s:
                now = copy.deepcopy(replace(state, checkpoints=[]))
                state.checkpoints = [*state.checkpoints[-1:], Checkpoint(now)]

    def _take_back(self) -> None:
        """Go over the last moments again, without rest: a walk had begun before it was noticed."""
        if self._state.checkpoints:
            past = self._state.checkpoints[0]
            self._state = past.state
            self._state.rest, self._state.resting = Rest(), False
            for sample in past.since:
                self._take(sample)

"""The attitude of the IMU from its own samples: start, rest, gaps and validity around the equations of the filter."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from messages import Quaternion, Reason, Residual, Status, Vec3
from messages.arrays import FloatArray
from perception import so3, vec3
from perception.attitude import beginning
from perception.attitude.accelerometer import follow_temperature
from perception.attitude.agreement import Innovation
from perception.attitude.camera_step import CameraStep, begin_step, measure_step
from perception.attitude.causes import distance_scale, doubt_distances, ground_is_plausible, has_slipped
from perception.attitude.foretold import MotionForetold, foretold
from perception.attitude.kalman import AttitudeKalman
from perception.attitude.movement import movement_covariance, unseen_travel
from perception.attitude.path_length import Travel
from perception.attitude.rest import Rest
from perception.attitude.sensor_errors import MountingErrors, SensorErrors
from perception.attitude.state import AttitudeSettings, AttitudeState, Checkpoint, GroundMotion, Levelling, Sample

__all__ = ["AttitudeFilter", "AttitudeSettings", "AttitudeState"]


class AttitudeFilter:
    """Attitude, angular rate and sensor errors of the IMU, one calibrated sample at a time.

    `residual` is what the unit's calibration left behind, 1 σ: it bounds how far the accelerometer's bias and the
    gyroscope's matrix may be re-estimated, and how well the vertical can be known.

    It starts from the first second of rest or, without one, from the motion of that second, with a covariance that
    admits it. After a gap longer than `gap_s` it goes on from how the IMU usually hangs on its wearer, and starts over
    where the samples refute that. What was learnt from rest in the moments before a walk was detected is undone.
    """

    def __init__(self, settings: AttitudeSettings, residual: Residual) -> None:
        self.settings = settings
        self._kalman = AttitudeKalman(settings, residual)
        self._state = self._kalman.new_state()

    def save(self) -> AttitudeState:
        """Return a copy of the state; a filter of the same settings that restores it goes on as this one would."""
        return self._state.copy()

    def restore(self, state: AttitudeState) -> None:
        """Go on from `state`."""
        self._state = state.copy()

    def reset(self, known: SensorErrors | None = None) -> None:
        """Start afresh, as before the first sample: attitude and motion are unknown again, of the sensors' errors is
        known what the calibration leaves, or `known`."""
        self._state = self._kalman.new_state(known)

    def carry_by_gyro(self, since: Sequence[Sample]) -> None:
        """Go on from the vertical that the gyroscope alone carries through the samples `since` the state, all valid.

        Of the motion nothing is left: what the accelerometer measured meanwhile is not used.
        """
        self._state = beginning.carried_by_gyro(self._kalman, self._state, since)

    def doubt_gyro(self, missing_rad: FloatArray) -> bool:
        """Let the next steps of the camera tell what has become of gyroscope and tilt since it was lost, or since they
        turned by `missing_rad` (3,) in W more than the gyroscope, or of a usual mounting that samples have not
        confirmed; return whether there is any tilt yet."""
        state = self._state
        if not state.started or state.clipped_s > self.settings.longest_clipping_s:
            return False
        state.levelling = None
        self._kalman.correct(state)
        beginning.doubt_gyro(self._kalman, state, missing_rad)
        return True

    def doubt_distances(self) -> None:
        """Let the next steps of the camera tell the scale of its distances, and hold them for wrong until then."""
        doubt_distances(self.settings.camera, self._state)

    def begin_camera_step(self) -> None:
        """Let a step of the camera begin at the last sample."""
        if self._state.started:
            begin_step(self._kalman, self._state)

    def end_camera_step(self, step: CameraStep, *, believed: bool = True) -> Innovation | None:
        """Take a step of the camera that ends at the last sample; the next one begins.

        Where the IMU's turns are not `believed`, nothing is corrected. Returns what it said; None where no step began.
        """
        if not self._state.started:
            return None
        innovation = measure_step(self._kalman, self._state, step, believed=believed)
        begin_step(self._kalman, self._state)
        return innovation

    @property
    def foretold(self) -> MotionForetold | None:
        """Return the motion over the ground that the camera should see next; None before the filter has begun."""
        return foretold(self._kalman, self._state)

    @property
    def t_ns(self) -> int | None:
        """Return the time of the last sample, None before the first."""
        return self._state.t_ns

    @property
    def ground(self) -> GroundMotion:
        """Return how the ground that the camera sees moves, as in a vehicle or lift."""
        return self._state.ground

    @property
    def distance_scale(self) -> float:
        """Return by what share the camera's distances are likely too long."""
        return distance_scale(self._kalman, self._state)

    @property
    def distances_are_plausible(self) -> bool:
        """Return whether that share may be what the calibration leaves."""
        return not self._state.distances_are_wrong

    @property
    def ground_is_plausible(self) -> bool:
        """Return whether the ground moves as one may: if not, the accelerometer is wrong."""
        return ground_is_plausible(self._kalman, self._state)

    @property
    def camera_has_slipped(self) -> bool:
        """Return whether the camera is known to have turned on its mount by more than the calibration allows."""
        return has_slipped(self._kalman, self._state)

    @property
    def q_WB(self) -> Quaternion:
        """Return the attitude (w, x, y, z; w ≥ 0) at the last sample; NaN before the start."""
        return so3.positive(self._state.q_WB)

    @property
    def R_WB(self) -> FloatArray:
        """Return the attitude at the last sample, (3, 3); NaN before the start."""
        return so3.matrix_from_quaternion(self._state.q_WB)

    @property
    def w_WB_B(self) -> Vec3:
        """Return the last sample's angular rate, rad/s, without bias and matrix error; NaN before the start."""
        if not self._state.started:
            return (math.nan, math.nan, math.nan)
        return self._kalman.rate(self._state, self._state.w_measured)

    @property
    def vertical_swing_mps(self) -> float:
        """Return how fast the IMU rises at the last sample, m/s, about the mean of the walk; 0 before the start."""
        return self._state.v_W[2] - self._state.drift_W[2]

    @property
    def gyro_bias(self) -> Vec3:
        """Return the gyroscope's bias in B, rad/s; zero until the first start."""
        return self._state.gyro_bias

    @property
    def v_W_mps(self) -> Vec3:
        """Return the velocity at the last sample, m/s, over the ground that the camera sees; 0 before the start."""
        return self._state.v_W

    @property
    def without_camera_s(self) -> float:
        """Return for how long no step of the camera has been used, until the last sample; infinite before the first."""
        return self._state.without_camera_s

    @property
    def movement_covariance(self) -> FloatArray:
        """Return the covariance (9, 9) that `Movement` describes, at the last sample; the filter has started."""
        return movement_covariance(self._kalman, self._state)

    def unseen_travel(self, lever_B_m: Vec3) -> Travel | None:
        """Return how far the samples carried a point of B since a step of the camera began; None where none has."""
        return unseen_travel(self._kalman, self._state, lever_B_m)

    @property
    def sensor_errors(self) -> SensorErrors:
        """Return what the sensors' errors are taken for, with their variances."""
        return self._kalman.sensor_errors(self._state)

    @property
    def mounting_errors(self) -> MountingErrors:
        """Return what the camera's steps told of its place in B, its clock and its distances."""
        return self._kalman.mounting_errors(self._state)

    @property
    def rotation_cov_W(self) -> FloatArray:
        """Return the covariance (3, 3), rad², of the small rotation in W between the estimate and the truth.

        The tilt is never claimed better than the calibration's residual of the accelerometer allows, whatever the
        motion seems to tell about it. Yaw counts from the start. NaN before it.
        """
        if not self._state.started:
            return np.full((3, 3), math.nan)
        return self._kalman.rotation_cov_W(self._state)

    @property
    def at_rest(self) -> bool:
        """Return whether the wearer stands, swaying no more than one does."""
        return self._state.resting

    @property
    def status(self) -> Status:
        """Return VALID while the tilt is known, from samples, to `usable_tilt_rad`, 1 σ."""
        return self.reason.status

    @property
    def reason(self) -> Reason:
        """Return why the status is not VALID."""
        state = self._state
        if state.clipped_s > self.settings.longest_clipping_s:
            return Reason.NO_IMU
        if state.levelling is None and self._kalman.knows_tilt(state, self.settings.usable_tilt_rad):
            return Reason.NONE
        if self.has_begun and self._kalman.unwatched_tilt_var(state) > 0.0:
            return Reason.UNCONFIRMED
        return state.reason_uncertain if state.started or state.reason_uncertain is Reason.NO_IMU else Reason.STARTING

    @property
    def has_begun(self) -> bool:
        """Return whether there is a tilt, however uncertain, that steps of the camera can correct."""
        state = self._state
        return state.started and state.levelling is None and state.clipped_s <= self.settings.longest_clipping_s

    def update(
        self, t_ns: int, sf_B: Vec3, w_B: Vec3, clipped: bool = False, temperature_degC: float = math.nan
    ) -> None:
        """Take one calibrated sample: specific force in m/s² and angular rate in rad/s, in B, at `t_ns`; and the die's
        temperature, NaN where that is not measured.

        Raises ValueError, and changes nothing, where a value is not finite or time does not advance.
        """
        last_ns = self._state.t_ns
        if not all(map(math.isfinite, (*sf_B, *w_B))):
            raise ValueError(f"IMU sample at {t_ns} ns: sf_B {sf_B} m/s² and w_B {w_B} rad/s must be finite")
        if last_ns is not None and t_ns <= last_ns:
            raise ValueError(f"IMU sample at {t_ns} ns: must be later than the one before it, at {last_ns} ns")
        sample = Sample(t_ns, sf_B, w_B, clipped, temperature_degC)
        rested = self._state.resting
        self._process(sample)
        self._checkpoint_rest(sample)
        if rested and not self._state.resting:
            self._redo_without_rest()

    def _process(self, sample: Sample) -> None:
        self._bound_clipping(sample)
        state, settings = self._state, self.settings
        dt_s = 0.0 if state.t_ns is None else 1e-9 * (sample.t_ns - state.t_ns)
        if state.t_ns is None or dt_s > settings.gap_s:
            state = self._start_after_gap(sample, dt_s)
            dt_s = 0.0
        state.t_ns = sample.t_ns
        if sample.clipped:
            state.reason_uncertain = Reason.NO_IMU
        if sample.clipped or dt_s > settings.detection_delay_s / 2:
            state.rest, state.pace_unknown_s = Rest(), settings.pace_unknown_s  # a walk may have begun unseen
        state.rest.update(settings.rest, sample.sf_B, sample.w_B, dt_s)
        follow_temperature(state, self._kalman.sf_per_K_mps2, sample.temperature_degC)
        rested = state.resting
        if not state.started:
            state.sf_measured, state.w_measured, state.usual_step_s = sample.sf_B, sample.w_B, dt_s
        elif dt_s > 0.0:
            self._kalman.integrate(state, sample, dt_s)
        if not rested and self._rest_is_better(state):
            beginning.start_at_rest(self._kalman, state)
            state.levelling = None
        elif state.levelling is not None:
            self._level(state, state.levelling, sample, dt_s)
        elif self._kalman.knows_tilt(state, settings.usable_tilt_rad):
            state.usual_mounting.update(settings.usual_mounting, self._up_B, dt_s)

    def _bound_clipping(self, sample: Sample) -> None:
        """Save the state from before samples were clipped; go back to it where that lasted for too long."""
        state = self._state
        if sample.clipped and state.before_clipping is None and state.t_ns is not None:
            state.before_clipping = replace(state, checkpoints=[]).copy()
        elif not sample.clipped and state.before_clipping is not None:
            if state.clipped_s > self.settings.longest_clipping_s:
                self._state = state.before_clipping.copy()
            state.before_clipping = None

    def _rest_is_better(self, state: AttitudeState) -> bool:
        """Return whether a rest just detected gives the vertical better than all before it."""
        return self._kalman.at_rest(state) and not self._kalman.knows_tilt(state, self.settings.usable_tilt_rad / 2)

    def _start_after_gap(self, sample: Sample, gap_s: float) -> AttitudeState:
        """Go on from the usual mounting, if it gives the vertical better than the motion to come, or wait for that."""
        settings, before = self.settings, self._state
        if before.t_ns is not None:
            before.reason_uncertain = Reason.NO_IMU
        before = beginning.after_gap(self._kalman, before, gap_s)
        state = self._state = beginning.after_gap(self._kalman, before, 0.0)
        state.levelling = Levelling(before)
        state.sf_measured, state.w_measured = sample.sf_B, sample.w_B
        tilt_rad = state.usual_mounting.tilt_rad(settings.usual_mounting, gap_s)
        if tilt_rad < settings.moving_start_tilt_rad:
            mean_up_B = state.usual_mounting.mean_up_B
            state.levelling.assumed_up_S = vec3.scaled(mean_up_B, 1.0 / math.hypot(*mean_up_B))
            state.levelling.assumed_var = tilt_rad**2
            beginning.start_in_motion(self._kalman, state, state.usual_mounting.mean_up_B, tilt_rad)
        return state

    def _level(self, state: AttitudeState, levelling: Levelling, sample: Sample, dt_s: float) -> None:
        """Gather the motion until it gives the vertical, by itself or by confirming the usual mounting."""
        settings = self.settings
        levelling.since.append(sample)
        levelling.elapsed_s += dt_s
        turned = vec3.scaled(self._kalman.rate(state, sample.w_B), dt_s)
        levelling.q_SB = so3.multiply(levelling.q_SB, so3.quaternion_from_rotvec(turned))
        sf_S = so3.transform(so3.rows_from_quaternion(levelling.q_SB), sample.sf_B)
        levelling.sum_sf_S = vec3.plus_scaled(levelling.sum_sf_S, sf_S, dt_s)
        if not state.started:
            if levelling.elapsed_s >= settings.rest.time_s:
                self._start_over(state, levelling)
            return
        known = self._kalman.knows_tilt(state, settings.usable_tilt_rad)
        refuted = (known or levelling.elapsed_s >= settings.rest.time_s) and self._is_refuted(state, levelling)
        if refuted or levelling.elapsed_s >= settings.confirm_within_s:
            self._start_over(state, levelling)
        elif known:
            state.levelling = None

    def _is_refuted(self, state: AttitudeState, levelling: Levelling) -> bool:
        """Return whether the samples moved the vertical farther from that of the usual mounting than was likely.

        Independent of each other, what is assumed and what is then known differ by the difference of their variances.
        """
        if levelling.assumed_up_S is None:
            return False
        up_S = so3.transform(so3.rows_from_quaternion(levelling.q_SB), self._up_B)
        known_var = state.covariance[0, 0] + state.covariance[1, 1]
        likely_var = max(0.0, 2.0 * levelling.assumed_var - known_var)
        return bool(math.dist(up_S, levelling.assumed_up_S) > self.settings.refuted_sigmas * math.sqrt(likely_var))

    def _start_over(self, state: AttitudeState, levelling: Levelling) -> None:
        """Start in motion at the first sample, level by the mean specific force, and go through all since again."""
        first = levelling.since[0]
        again = self._state = beginning.after_gap(self._kalman, levelling.before, 0.0)
        again.sf_measured, again.w_measured, again.usual_step_s = first.sf_B, first.w_B, state.usual_step_s
        up_S = vec3.minus(vec3.scaled(levelling.sum_sf_S, 1.0 / levelling.elapsed_s), again.sf_bias)
        beginning.start_in_motion(self._kalman, again, up_S, self.settings.moving_start_tilt_rad)
        for before, sample in pairwise(levelling.since):
            self._kalman.integrate(again, sample, 1e-9 * (sample.t_ns - before.t_ns))
        again.t_ns, again.rest = state.t_ns, state.rest

    @property
    def _up_B(self) -> Vec3:
        return so3.rows_from_quaternion(self._state.q_WB)[6:9]

    def _checkpoint_rest(self, sample: Sample) -> None:
        """At rest, unless the camera tells the motion, keep the states of one and two `detection_delay_s` ago, and all
        samples since."""
        state = self._state
        if self._kalman.follows_camera(state):
            state.checkpoints = []  # nothing is learnt from rest that would have to be undone
            return
        for checkpoint in state.checkpoints:
            checkpoint.since.append(sample)
        if state.resting:
            newest_ns = state.checkpoints[-1].state.t_ns if state.checkpoints else None
            if newest_ns is None or sample.t_ns - newest_ns >= 1e9 * self.settings.detection_delay_s:
                now = replace(state, checkpoints=[]).copy()
                state.checkpoints = [*state.checkpoints[-1:], Checkpoint(now)]

    def _redo_without_rest(self) -> None:
        """Go over the last moments again, without rest: a walk had begun before it was detected."""
        if self._state.checkpoints:
            past = self._state.checkpoints[0]
            self._state = past.state.copy()
            self._state.rest, self._state.resting = Rest(), False
            self._state.pace_unknown_s = self.settings.pace_unknown_s
            for sample in past.since:
                self._process(sample)

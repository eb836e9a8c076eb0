"""From IMU samples to the attitude at any instant of the last second, the filter's first second included."""

import math
from collections import deque

import numpy as np

from messages import (
    Attitude,
    Covariance3,
    ImuSample,
    Learnt,
    Reason,
    Status,
    UnitCalibration,
    upper_triangle,
    vec3,
)
from messages.arrays import FloatArray
from perception.attitude.agreement import Advice, Agreement, Innovation
from perception.attitude.camera_step import DOUBTFUL_RADPS, CameraStep
from perception.attitude.causes import doubt_distances
from perception.attitude.confirmation import Confirmation
from perception.attitude.filter import AttitudeFilter, AttitudeSettings, AttitudeState
from perception.attitude.foretold import MotionForetold
from perception.attitude.history import AttitudeAt, AttitudeHistory, OutsideHistoryError
from perception.attitude.imu_model import corrected
from perception.attitude.learnt import SensorLearning
from perception.attitude.movement import Movement
from perception.attitude.past_samples import PastSamples
from perception.attitude.path_length import PathLength, Travel
from perception.attitude.retrospect import Retrospect
from perception.attitude.sensor_errors import MountingErrors, SensorErrors
from perception.attitude.state import Sample
from perception.vec3 import minus


class AttitudeTrack:
    """The filter, its recent past and, once it has started, its start in retrospect.

    The filter needs a second at rest to know the gyroscope's bias; from there the samples of that second are
    integrated backwards, so that a frame exposed during it can still be placed.
    """

    def __init__(
        self, calibration: UnitCalibration, learnt: Learnt | None = None, settings: AttitudeSettings | None = None
    ) -> None:
        """Begin with what the unit has `learnt`; raises UserError where that does not belong to `calibration`."""
        self._imu = calibration.imu
        self._calibration_id = calibration.id
        self._time_std_s = calibration.residual.time_s
        self._filter = AttitudeFilter(settings or AttitudeSettings(), calibration.residual)
        self._history = AttitudeHistory(length_s=_HISTORY_S)
        self._longest_step_ns = round(1e9 * self._filter.settings.gap_s)
        self._before_start = Retrospect(self._longest_step_ns)
        self._newest_ns: int | None = None
        self._step_end: AttitudeState | None = None
        self._trial: AttitudeState | None = None
        self._agreement, self._confirmation = Agreement(), Confirmation()
        self._checkpoints: deque[tuple[int, AttitudeState]] = deque(maxlen=2)
        self._samples = PastSamples()
        self._path = PathLength()
        self._learning = SensorLearning(calibration, learnt)
        self._temperature_degC = math.nan

    @property
    def learnt(self) -> Learnt:
        """Return what is known of the sensors by now, of this run and those before it."""
        return self._learning.learnt

    @property
    def sensor_errors(self) -> SensorErrors | None:
        """Return what the filter takes the sensors' errors for now; None where nothing is known, or it contradicts."""
        return self._filter.sensor_errors if self._tells else None

    @property
    def mounting_errors(self) -> MountingErrors | None:
        """Return what the camera's steps tell of its place, clock and distances; None as for the sensors' errors."""
        return self._filter.mounting_errors if self._tells else None

    @property
    def _tells(self) -> bool:
        return self._filter.status is Status.VALID and self.contradiction is Reason.NONE

    @property
    def reason(self) -> Reason:
        """Return why there is no attitude now, or NONE."""
        return self._filter.reason

    def accepts(self, sample: ImuSample) -> bool:
        """Return whether `sample` is finite and later than the last one."""
        finite = all(map(math.isfinite, (*sample.sf_B_mps2, *sample.w_WB_B_radps)))
        return finite and (self._newest_ns is None or sample.t_sample_ns > self._newest_ns)

    def add_sample(self, sample: ImuSample) -> Attitude:
        """Take an acceptable sample and return the attitude at its time."""
        sf_B_mps2, w_B_radps = corrected(sample, self._imu)
        self._temperature_degC = sample.temperature_degC
        if self._newest_ns is None:
            self._filter.reset(self._learning.prior(sample.temperature_degC))
        calibrated = Sample(sample.t_sample_ns, sf_B_mps2, w_B_radps, sample.clipped, sample.temperature_degC)
        self._filter.update(*calibrated)
        self._newest_ns = sample.t_sample_ns
        self._samples.append(calibrated)
        rotation_cov_W = self._filter.rotation_cov_W
        if self._filter.has_begun:
            start = sample.t_sample_ns, self._filter.q_WB, self._filter.gyro_bias, rotation_cov_W
            for attitude in self._before_start.take(*start):
                self._history.append(attitude)
            self._history.append(self._attitude_at(sample.t_sample_ns))
        else:
            self._step_end = None
            # a new start has a new yaw: nothing of the track before it may be mixed with what follows
            self._history.clear()
            self._before_start.add(sample.t_sample_ns, w_B_radps)
        return self._message(sample.t_sample_ns, rotation_cov_W)

    @property
    def foretold(self) -> MotionForetold | None:
        """Return the motion over the ground at the newest sample that the camera should see; None where unknown. While
        the tilt is unconfirmed, it tells the vertical alone."""
        return self._filter.foretold if self._filter.reason in (Reason.NONE, Reason.UNCONFIRMED) else None

    @property
    def is_confirmed(self) -> bool:
        """Return whether steps of the camera bound what the gyroscope does, or never have."""
        pending = self._newest_ns is not None and self._confirmation.is_pending(self._newest_ns)
        return not pending and self._filter.reason is not Reason.UNCONFIRMED

    @property
    def is_watched(self) -> bool:
        """Return whether the last step of the camera is not missing, or there never was one."""
        return self.knows_velocity or math.isinf(self._filter.without_camera_s)

    @property
    def knows_velocity(self) -> bool:
        """Return whether a step of the camera has told the velocity of late; the accelerometer alone loses it."""
        return self._filter.without_camera_s < _WATCHED_S

    def is_watched_to(self, t_ns: int) -> bool:
        """Return whether a step of the camera that ends at `t_ns` has been accepted, or there never was any."""
        return self._confirmation.accepted_ns in (None, t_ns)

    @property
    def contradiction(self) -> Reason:
        """Return why IMU and camera may not be used together, or NONE."""
        found = self._filter
        if self._agreement.contradicted or not found.ground_is_plausible:
            return Reason.IMU_INCONSISTENT
        if found.camera_has_slipped:
            return Reason.CAMERA_SLIPPED
        return Reason.NONE if found.distances_are_plausible else Reason.DISTANCES_WRONG

    @property
    def ground_moves(self) -> bool:
        """Return whether the ground that the camera sees accelerates or turns, as a vehicle or lift does."""
        return self._filter.ground.moves

    @property
    def distance_scale(self) -> float:
        """Return by what share the camera's distances are likely too long."""
        return self._filter.distance_scale

    def doubt_distances(self) -> None:
        """Let the next steps tell the scale of the camera's distances, which hold for wrong until it is known: eyes may
        have moved, and back."""
        self._filter.doubt_distances()
        for _, state in self._checkpoints:
            doubt_distances(self._filter.settings.camera, state)
        self._step_end = self._trial = None

    def add_camera_step(self, step: CameraStep, *, sound: bool = True) -> None:
        """Correct the attitude by a step of the camera, and all attitudes since with it.

        The first one, and one that does not begin where the last ended or soon after, only says from when on. What the
        IMU gave while it contradicted the camera is discarded as in `roll_back`. Once none has been used for long,
        steps have to confirm each other first, and may only contradict the gyroscope until they have; one that is not
        `sound`, as pictures or clock are known to be wrong, confirms nothing.
        """
        if self._newest_ns is None or step.t_after_ns > self._newest_ns:
            return
        pending = self._confirmation.is_pending(step.t_after_ns)
        if pending and not self._agreement.contradicted:
            self._compare_turn(step, self._newest_ns)
        elif self._filter.has_begun:
            believed = not (pending or self._agreement.turn_contradicts)
            self._judge(self._take(step, self._newest_ns, sound=sound, believed=believed))
        if sound and (self._agreement.turn_is_off or pending):
            self._try(step, self._newest_ns)
        else:
            self._trial = None

    def check_turn(self, step: CameraStep) -> None:
        """Let a step that rests on wrong distances say whether its turn contradicts the gyroscope; it corrects
        nothing."""
        self._trial = None
        if self._newest_ns is not None and step.t_after_ns <= self._newest_ns:
            self._compare_turn(step, self._newest_ns)

    def _compare_turn(self, step: CameraStep, newest_ns: int) -> None:
        if self._filter.has_begun:
            innovation = self._take(step.turn_alone(), newest_ns, sound=False, believed=False)
            self._judge(None if innovation is None else innovation.turn_alone(DOUBTFUL_RADPS))

    def _judge(self, innovation: Innovation | None) -> None:
        """Go back to an earlier state where what steps say, the last of them this, contradicts the newest."""
        advice = Advice.KEEP if innovation is None else self._agreement.add(innovation)
        if advice is not Advice.KEEP:
            self.roll_back(gyro_agrees=advice is Advice.DISCARD_ALL_BUT_TURNS)

    def _take(self, step: CameraStep, newest_ns: int, *, sound: bool, believed: bool) -> Innovation | None:
        """Let the filter take a step and return what it said; where it is not `believed` it corrects nothing."""
        now, at_end = self._filter.save(), self._step_end
        if at_end is None or at_end.t_ns is None or not self._samples.reaches(at_end.t_ns):
            self._step_end = now
            self._path.interrupt(newest_ns, self._filter.settings.moving_start_speed_mps)
            return None
        if step.t_before_ns < at_end.t_ns - _OVERLAP_NS:
            return None
        self._filter.restore(at_end)
        self._history.drop_after(at_end.t_ns)
        if step.t_before_ns > at_end.t_ns + _OVERLAP_NS:
            self._agreement.interrupt()
            self._advance(step.t_before_ns)
            self._path.add_unseen(step.t_before_ns, self._filter.unseen_travel(step.p_BC_m))
            self._filter.begin_camera_step()
        self._advance(step.t_after_ns)
        innovation = self._end_camera_step(step, believed=believed)
        if sound and self._filter.without_camera_s == 0.0:
            self._confirmation.accept(step.t_after_ns)
        self._step_end = self._filter.save()
        self._advance(newest_ns)
        return innovation

    def _try(self, step: CameraStep, newest_ns: int) -> None:
        """Let a trial take a step: a filter that doubts gyroscope and tilt, and takes the other's place once its steps
        have confirmed each other."""
        now, trial = self._filter.save(), self._trial
        if trial is not None and trial.t_ns is not None and self._samples.reaches(trial.t_ns):
            begun = trial.q_WB_beginning is not None
            if step.t_before_ns < trial.t_ns - begun * _OVERLAP_NS:
                return
            one_piece = not begun or step.t_before_ns <= trial.t_ns + _OVERLAP_NS
            if one_piece and self._agrees(trial, step, begun=begun, moves=now.ground.moves):
                self._trial = self._filter.save()
                if not (self._confirmation.is_complete and self._agreement.may_agree(self._confirmation.fastest_radps)):
                    self._filter.restore(now)
                    return
                self._step_end, self._trial, self._agreement = self._trial, None, Agreement()
                self._confirmation.accept(step.t_after_ns)
                self._path.interrupt(step.t_after_ns, self._filter.settings.moving_start_speed_mps)
                self._history.clear()
                self._before_start.clear()
                self._history.append(self._attitude_at(step.t_after_ns))
                self._advance(newest_ns)
                return
        self._filter.restore(now)
        self._trial = None
        if self._filter.doubt_gyro(self._agreement.missing_rad):
            self._trial = self._filter.save()
            self._filter.restore(now)
            self._confirmation.begin()

    def _agrees(self, trial: AttitudeState, step: CameraStep, *, begun: bool, moves: bool) -> bool:
        """Go on from `trial`, in which the step has `begun` or begins later, to the end of the step; return whether
        that was accepted and usual. A ground that seems to move, and did not, may be an accelerometer that has become
        wrong meanwhile."""
        self._filter.restore(trial)
        if not begun:
            self._advance(step.t_before_ns, remembered=False)
            self._filter.begin_camera_step()
        self._advance(step.t_after_ns, remembered=False)
        innovation = self._filter.end_camera_step(step)
        if innovation is None or self._filter.without_camera_s > 0.0 or (self._filter.ground.moves and not moves):
            return False
        return self._confirmation.add(innovation)

    def _end_camera_step(self, step: CameraStep, *, believed: bool) -> Innovation | None:
        """Let the filter take the step that ends at its last sample, and lengthen the path by what is known of it."""
        unseen = self._filter.unseen_travel(step.p_BC_m)
        innovation = self._filter.end_camera_step(step, believed=believed)
        if self._filter.without_camera_s == 0.0:
            errors, noise_factor = self._filter.sensor_errors, self._filter.settings.camera.noise_factor
            self._path.add_step(step, self._filter.R_WB, noise_factor, errors.scale, math.sqrt(errors.scale_var))
        else:
            self._path.add_unseen(step.t_after_ns, unseen)
        return innovation

    def _advance(self, until_ns: int, *, remembered: bool = True) -> None:
        """Take the samples since the filter's state again, up to `until_ns`: between two, what lies on their line."""
        for sample in self._samples.from_to(self._filter.t_ns, until_ns):
            self._filter.update(*sample)
            if remembered and self._filter.has_begun:
                self._history.append(self._attitude_at(sample.t_ns))

    def _attitude_at(self, t_ns: int) -> AttitudeAt:
        found = self._filter
        swing_mps, v_W_mps = found.vertical_swing_mps, found.v_W_mps
        return AttitudeAt(t_ns, found.q_WB, found.w_WB_B, swing_mps, found.rotation_cov_W, v_W_mps)

    def checkpoint(self) -> None:
        """Save the filter's state, every `_CHECKPOINT_EVERY_S`, and learn of the sensors, while nothing contradicts."""
        if self._newest_ns is None or self._filter.status is not Status.VALID:
            return
        if not self._filter.ground.moves:
            self._learning.add(self._newest_ns, self._temperature_degC, self._filter.sensor_errors)
        if not self._checkpoints or self._newest_ns - self._checkpoints[-1][0] >= 1e9 * _CHECKPOINT_EVERY_S:
            self._checkpoints.append((self._newest_ns, self._filter.save()))

    def roll_back(self, *, gyro_agrees: bool = False) -> None:
        """Go back to the last checkpoint but one: the newest samples contradict the camera.

        It is as if all samples since had been missing; without a checkpoint only the calibration is left. The status is
        not VALID until the filter has started again and a step has been accepted, for it starts from what the same IMU
        measures. If the gyroscope agrees with the camera, its samples since carry the vertical of that checkpoint to
        the newest sample.
        """
        if not gyro_agrees:
            self._confirmation.demand()
        self._history.clear()
        self._before_start.clear()
        self._step_end = None
        self._learning.discard()
        if not self._checkpoints:
            self._filter.reset(self._learning.prior(self._temperature_degC))
            return
        checkpoint_ns, state = self._checkpoints[0]
        self._filter.restore(state)
        since = self._samples.unbroken_since(checkpoint_ns, self._longest_step_ns) if gyro_agrees else []
        if since:
            self._filter.carry_by_gyro(since)

    def at(self, t_ns: int) -> AttitudeAt | None:
        """Return attitude and rate at `t_ns`, or None if that is not between known samples or just after the newest, or
        while the tilt is not known; it is where it only `is_confirmed` no more."""
        if self._filter.reason not in (Reason.NONE, Reason.UNCONFIRMED):
            return None
        try:
            return self._history.at(t_ns)
        except OutsideHistoryError:
            return None

    @property
    def newest(self) -> AttitudeAt:
        """Return the attitude at the newest sample. Raises IndexError while there is none."""
        return self._history.newest

    def path_from(self, start: AttitudeAt) -> list[AttitudeAt]:
        """Return `start`, an attitude of the last moments, and all later ones."""
        return [start, *self._history.after(start.t_ns)]

    @property
    def motion_covariance(self) -> tuple[Covariance3, float]:
        """Return the covariance of the velocity in W at the newest sample, (m/s)², and the variance of the rate about
        the vertical, (rad/s)²; the filter has started."""
        covariance = self._filter.movement_covariance
        return upper_triangle(covariance[3:6, 3:6]), float(covariance[8, 8])

    def movement_at(self, attitude: AttitudeAt) -> Movement | None:
        """Return how the IMU moves where it has this attitude of the last moments; None where the camera sees nothing.

        The covariance is that of the newest sample and of what its neighbours tell of the change meanwhile: the instant
        is only known to the calibration's residual, and what rings at the edge of the sensor's bandwidth is lost in its
        filter and between two samples, by about a sixth of the second difference.
        """
        if self._filter.without_camera_s >= self._filter.settings.camera.fresh_s:
            return None
        R_WB, covariance = attitude.R_WB, self._filter.movement_covariance
        before, after = (self.at(attitude.t_ns + neighbour_ns) for neighbour_ns in (-_NEIGHBOUR_NS, _NEIGHBOUR_NS))
        if before is not None and after is not None:
            rates = [np.array((*each.v_W_mps, *(R_WB @ each.w_WB_B))) for each in (before, attitude, after)]
            late = (rates[2] - rates[0]) * self._time_std_s / (2e-9 * _NEIGHBOUR_NS)
            lost = (rates[2] - 2.0 * rates[1] + rates[0]) / 6.0
            covariance[3:, 3:] += np.outer(late, late) + np.outer(lost, lost)
        w_W_radps = minus(vec3(R_WB @ np.array(attitude.w_WB_B)), (0.0, 0.0, self._filter.ground.turn_radps))
        way = self._path.at(attitude.t_ns, Travel(np.array(attitude.v_W_mps), covariance[3:6, 3:6]))
        return Movement(R_WB, attitude.v_W_mps, w_W_radps, covariance, way, self._filter.ground.moves)

    def invalid_at(self, t_ns: int, reason: Reason = Reason.NO_IMU) -> Attitude:
        """Return the attitude that says only why there is none at `t_ns`."""
        return Attitude.invalid(t_sample_ns=t_ns, reason=reason, calibration_id=self._calibration_id)

    def _message(self, t_sample_ns: int, rotation_cov_W: FloatArray) -> Attitude:
        reason = self._filter.reason
        if reason is Reason.NONE and self._confirmation.is_due:
            reason = Reason.UNCONFIRMED
        if reason is not Reason.NONE:
            return self.invalid_at(t_sample_ns, reason)
        return Attitude(
            t_sample_ns=t_sample_ns,
            status=Status.VALID,
            reason=reason,
            q_WB=self._filter.q_WB,
            w_WB_B_radps=self._filter.w_WB_B,
            gyro_bias_B_radps=self._filter.gyro_bias,
            rotation_cov_W_rad2=upper_triangle(rotation_cov_W),
            calibration_id=self._calibration_id,
        )


_HISTORY_S = 2.0
_CHECKPOINT_EVERY_S = 2.0
_WATCHED_S = 0.15
"""Two frames and the samples since."""
_NEIGHBOUR_NS = 10_000_000
_OVERLAP_NS = 10_000_000
"""So much earlier than the end of the step before, or later, a step may begin: their rows' times differ."""

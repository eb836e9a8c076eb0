"""From IMU samples to the attitude at any instant of the last second, the filter's first second included."""

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from messages import Attitude, ImuSample, Reason, Status, UnitCalibration, Vec3, upper_triangle, vec3
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.filter import AttitudeFilter, AttitudeSettings, AttitudeState
from perception.attitude.history import AttitudeAt, AttitudeHistory, OutsideHistoryError
from perception.attitude.imu_model import corrected
from perception.attitude.state import Sample


class AttitudeTrack:
    """The filter, its recent past and, once it has started, its start in retrospect.

    The filter needs a second at rest to know the gyroscope's bias; from there the samples of that second are
    integrated backwards, so that a frame exposed during it can still be placed.
    """

    def __init__(self, calibration: UnitCalibration) -> None:
        self._imu = calibration.imu
        self._calibration_id = calibration.id
        self._filter = AttitudeFilter(AttitudeSettings(), calibration.residual)
        self._history = AttitudeHistory(length_s=_HISTORY_S)
        self._longest_step_ns = round(1e9 * self._filter.settings.gap_s)
        self._before_start: deque[tuple[int, Vec3]] = deque(maxlen=_MOST_BEFORE_START)
        self._newest_ns: int | None = None
        self._checkpoints: deque[tuple[int, AttitudeState]] = deque(maxlen=2)
        self._recent: deque[Sample] = deque(maxlen=_MOST_RECENT)

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
        self._filter.update(sample.t_sample_ns, sf_B_mps2, w_B_radps, clipped=sample.clipped)
        self._newest_ns = sample.t_sample_ns
        self._recent.append(Sample(sample.t_sample_ns, sf_B_mps2, w_B_radps, sample.clipped))
        state, rotation_cov_W = self._filter, self._filter.rotation_cov_W
        if state.status is Status.VALID:
            if self._before_start:
                self._add_attitudes_before_start(sample.t_sample_ns, rotation_cov_W)
            self._history.append(
                AttitudeAt(sample.t_sample_ns, state.q_WB, state.w_WB_B, state.vertical_swing_mps, rotation_cov_W)
            )
        else:
            # a new start has a new yaw: nothing of the track before it may be mixed with what follows
            self._history.clear()
            if self._before_start and sample.t_sample_ns - self._before_start[-1][0] > self._longest_step_ns:
                self._before_start.clear()
            self._before_start.append((sample.t_sample_ns, w_B_radps))
        return self._message(sample.t_sample_ns, rotation_cov_W)

    def checkpoint(self) -> None:
        """Save the state of the filter, every `_CHECKPOINT_EVERY_S`, while nothing contradicts it."""
        if self._newest_ns is None or self._filter.status is not Status.VALID:
            return
        if not self._checkpoints or self._newest_ns - self._checkpoints[-1][0] >= 1e9 * _CHECKPOINT_EVERY_S:
            self._checkpoints.append((self._newest_ns, self._filter.save()))

    def roll_back(self, *, gyro_agrees: bool = False) -> None:
        """Go back to the last checkpoint but one: the newest samples contradict the camera.

        It is as if all samples since had been missing; without a checkpoint only the calibration is left. The status is
        not VALID until the filter has started again. If the gyroscope agrees with the camera, its samples since carry
        the vertical of that checkpoint to the newest sample.
        """
        self._history.clear()
        self._before_start.clear()
        if not self._checkpoints:
            self._filter.reset()
            return
        checkpoint_ns, state = self._checkpoints[0]
        self._filter.restore(state)
        if gyro_agrees and self._recent[0].t_ns <= checkpoint_ns:
            since = [sample for sample in self._recent if sample.t_ns > checkpoint_ns]
            if since and self._is_whole(checkpoint_ns, since):
                self._filter.carry_by_gyro(since)

    def _is_whole(self, checkpoint_ns: int, since: Sequence[Sample]) -> bool:
        """Return whether no sample is clipped and none is missing for long."""
        times_ns = [checkpoint_ns, *(sample.t_ns for sample in since)]
        together = all(after - before <= self._longest_step_ns for before, after in pairwise(times_ns))
        return together and not any(sample.clipped for sample in since)

    def at(self, t_ns: int) -> AttitudeAt | None:
        """Return attitude and rate at `t_ns`, or None if that is not between known samples or just after the newest."""
        try:
            return self._history.at(t_ns)
        except OutsideHistoryError:
            return None

    def _add_attitudes_before_start(self, t_ns: int, rotation_cov_W: FloatArray) -> None:
        """Integrate backwards from the first attitude, R(t − dt) = R(t) exp(−w dt), and put the result in order."""
        q_WB, bias = self._filter.q_WB, self._filter.gyro_bias
        past: list[AttitudeAt] = []
        for t_before_ns, measured in reversed(self._before_start):
            w_B = vec3(np.subtract(measured, bias))
            dt_s = (t_ns - t_before_ns) * 1e-9
            q_WB = so3.positive(so3.multiply(q_WB, so3.quaternion_from_rotvec(vec3(np.multiply(w_B, -dt_s)))))
            past.append(AttitudeAt(t_before_ns, q_WB, w_B, 0.0, rotation_cov_W))
            t_ns = t_before_ns
        for attitude in reversed(past):
            self._history.append(attitude)
        self._before_start.clear()

    def invalid_at(self, t_ns: int, reason: Reason = Reason.NO_IMU) -> Attitude:
        """Return the attitude that says only why there is none at `t_ns`."""
        return Attitude.invalid(t_sample_ns=t_ns, reason=reason, calibration_id=self._calibration_id)

    def _message(self, t_sample_ns: int, rotation_cov_W: FloatArray) -> Attitude:
        reason = self._filter.reason
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


_MOST_BEFORE_START = 1024
_HISTORY_S = 2.0
_CHECKPOINT_EVERY_S = 2.0
_MOST_RECENT = 1024

"""Camera and IMU side by side, message by message: the motion that each of them measures.

And one eye beside the other: what they see of a corner must lie on one epipolar line.
"""

from typing import NamedTuple

from messages import Calibration, Frame, ImuSample, Reason, StereoFrame, UnitCalibration
from perception.attitude.imu_model import corrected
from perception.motion.consistency import ConsistencyMonitor, Subject, Verdict
from perception.motion.ego_motion import VisualOdometer


class Judgement(NamedTuple):
    """Why camera and IMU may not be used together, or NONE; and whether to discard what the IMU gave until now."""

    reason: Reason
    discard: bool


class MotionWatch:
    """Follows both, and says when they contradict each other.

    It needs pictures from two eyes: a depth camera's frames are ignored, and its reason stays NONE. The eyes
    are misaligned from the first pair that says so until `confirmations` in a row deny it: matching tolerates
    `most_skew_px`.
    """

    most_skew_px = 2.0  # raw pixels, up or down
    confirmations = 3  # frames: one good frame among bad ones is chance

    def __init__(self, calibration: UnitCalibration) -> None:
        self._imu = calibration.imu
        self._odometer: VisualOdometer | None = None
        self._monitor: ConsistencyMonitor | None = None
        self._aligned_frames = self.confirmations
        if isinstance(calibration, Calibration):
            self._odometer = VisualOdometer(calibration.stereo)
            self._monitor = ConsistencyMonitor(calibration, self._odometer.R_LC)

    @property
    def reason(self) -> Reason:
        """Return EYES_MISALIGNED, TIME_INCONSISTENT or IMU_INCONSISTENT while something contradicts, else NONE."""
        if self._aligned_frames < self.confirmations:
            return Reason.EYES_MISALIGNED
        return Reason.NONE if self._monitor is None else self._monitor.reason

    @property
    def contradictions(self) -> tuple[Subject, ...]:
        """Return what contradicts."""
        if self._monitor is None:
            return ()
        verdicts = self._monitor.verdicts
        return tuple(subject for subject in Subject if verdicts[subject] is Verdict.INCONSISTENT)

    @property
    def gyro_agrees(self) -> bool:
        """Return whether the gyroscope is known to agree with the camera."""
        return self._monitor is not None and self._monitor.gyro_agrees

    def add_sample(self, sample: ImuSample) -> None:
        """Take a finite sample, later than the one before it; a clipped one counts as missing."""
        if self._monitor is not None and not sample.clipped:
            self._monitor.add_sample(sample.t_sample_ns, *corrected(sample, self._imu))

    def add_frame(self, frame: Frame) -> Judgement:
        """Take a frame and judge its step."""
        if self._monitor is None or self._odometer is None or not isinstance(frame, StereoFrame):
            return Judgement(self.reason, discard=False)
        if frame.left.shape[::-1] != self._odometer.raw_size_px:
            return Judgement(self.reason, discard=False)
        motion = self._odometer.add_frame(frame.header.t_exposure_ns, frame.left, frame.right)
        discard = self._monitor.add_motion(motion, self._odometer.newest)
        return Judgement(self.reason, discard)

    def finish_frame(self) -> Judgement:
        """Judge the last second and prepare the next frame, once the estimate has left."""
        if self._monitor is None or self._odometer is None:
            return Judgement(self.reason, discard=False)
        self._odometer.prepare_next()
        self._check_alignment(self._odometer.skew_px)
        discard = self._monitor.update_verdicts()
        return Judgement(self.reason, discard)

    def _check_alignment(self, skew_px: float) -> None:
        if abs(skew_px) > self.most_skew_px:
            self._aligned_frames = 0
        elif abs(skew_px) <= self.most_skew_px:  # not where it is NaN
            self._aligned_frames += 1

"""Camera and IMU side by side, message by message: the motion that one sees, the motion that the other feels.

And one eye beside the other: what they see of a corner must lie on one epipolar line.
"""

from messages import Calibration, Frame, ImuSample, Reason, StereoFrame, UnitCalibration
from perception.attitude.imu_model import corrected
from perception.motion.consistency import ConsistencyMonitor, Subject, Verdict
from perception.motion.ego_motion import VisualOdometer


class MotionWatch:
    """Follows both, and says when they contradict each other.

    It needs pictures from two eyes: of a depth camera's frames it takes no notice, and its reason stays NONE. The eyes
    are misaligned from the first pair that says so until `confirmations` in a row deny it: matching bears
    `most_skew_px`.
    """

    most_skew_px = 2.0
    confirmations = 3

    def __init__(self, calibration: UnitCalibration) -> None:
        self._imu = calibration.imu
        self._odometer: VisualOdometer | None = None
        self._monitor: ConsistencyMonitor | None = None
        self._aligned = self.confirmations
        if isinstance(calibration, Calibration):
            self._odometer = VisualOdometer(calibration.stereo)
            self._monitor = ConsistencyMonitor(calibration, self._odometer.R_LC)

    @property
    def reason(self) -> Reason:
        """Return EYES_MISALIGNED, TIME_INCONSISTENT or IMU_INCONSISTENT while something contradicts, else NONE."""
        if self._aligned < self.confirmations:
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
    def turns_hold(self) -> bool:
        """Return whether the gyroscope is known to agree with the camera."""
        return self._monitor is not None and self._monitor.turns_hold

    def feel(self, sample: ImuSample) -> None:
        """Take a finite sample, later than the one before it; a clipped one counts as missing."""
        if self._monitor is not None and not sample.clipped:
            self._monitor.feel(sample.t_sample_ns, *corrected(sample, self._imu))

    def see(self, frame: Frame) -> bool:
        """Take a frame and judge its step; return whether what the IMU alone taught until now should be forgotten."""
        if self._monitor is None or self._odometer is None or not isinstance(frame, StereoFrame):
            return False
        if frame.left.shape[::-1] != self._odometer.raw_size_px:
            return False
        motion = self._odometer.see(frame.header.t_exposure_ns, frame.left, frame.right)
        return self._monitor.see(motion, self._odometer.newest)

    def judge(self) -> bool:
        """Judge the last second and get ready for the next frame, while nobody waits; return whether to forget."""
        if self._monitor is None or self._odometer is None:
            return False
        self._odometer.get_ready()
        self._align(self._odometer.skew_px)
        return self._monitor.judge()

    def _align(self, skew_px: float) -> None:
        if abs(skew_px) > self.most_skew_px:
            self._aligned = 0
        elif abs(skew_px) <= self.most_skew_px:  # not where it is NaN
            self._aligned += 1

"""Camera and IMU side by side, message by message: the motion that each of them measures."""

import numpy as np

from messages import Calibration, Frame, ImuSample, Reason, StereoFrame, UnitCalibration, vec3
from perception import so3
from perception.attitude.camera_step import CameraStep
from perception.attitude.foretold import MotionForetold
from perception.attitude.imu_model import corrected
from perception.depth.focal_lengths import UNWATCHED, FocalDifference
from perception.motion.clock_lag import ClockLagMonitor
from perception.motion.ego_motion import EgoMotion, VisualOdometer
from perception.motion.eyes import Eyes
from perception.motion.inner_motion import InnerMotion, RecentSamples


class MotionWatch:
    """Tells how the camera moved, and when its pictures may not be used with the IMU.

    It needs pictures from two eyes: a depth camera's frames are ignored, and its reason stays NONE.
    """

    def __init__(self, calibration: UnitCalibration) -> None:
        self._imu = calibration.imu
        self._eyes: Eyes | None = None
        self._were_wrong = False
        if isinstance(calibration, Calibration):
            self._eyes = Eyes(calibration)
            R_LC = self._eyes.odometer.R_LC
            self._clock = ClockLagMonitor(calibration, R_LC)
            self._R_BC = np.array(calibration.X_BL.R) @ R_LC
            self._p_BC_m = calibration.X_BL.p_m
            self._samples = RecentSamples(self._R_BC, self._p_BC_m)

    @property
    def reason(self) -> Reason:
        """Return EYES_MISALIGNED, DISTANCES_WRONG or TIME_INCONSISTENT while something contradicts, else NONE."""
        if self._eyes is None:
            return Reason.NONE
        if self._eyes.reason is Reason.NONE and (self._clock.contradicts or self._eyes.odometer.torn.contradicts):
            return Reason.TIME_INCONSISTENT
        return self._eyes.reason

    @property
    def step_is_sound(self) -> bool:
        """Return whether nothing contradicts the distances that the newest step rests on, nor those after it."""
        return self._eyes is None or not (self._were_wrong or self._eyes.reason is not Reason.NONE)

    @property
    def scale_is_doubtful(self) -> bool:
        """Return whether with the newest frame distances seem right again, by all but their scale."""
        return self._eyes is not None and self._eyes.scale_is_doubtful

    @property
    def focal_difference(self) -> FocalDifference:
        """Return what the eyes' rows tell of the difference between their focal lengths."""
        return UNWATCHED if self._eyes is None else self._eyes.focal_difference

    def add_sample(self, sample: ImuSample) -> None:
        """Take a finite sample, later than the one before it; a clipped one counts as missing."""
        if self._eyes is not None and not sample.clipped:
            sf_B_mps2, w_B_radps = corrected(sample, self._imu)
            self._samples.add(sample.t_sample_ns, sf_B_mps2, w_B_radps)
            self._clock.add_sample(sample.t_sample_ns, w_B_radps)

    def can_miss(self, t_exposure_ns: int) -> bool:
        """Return whether a frame of that time may be passed over: the next, as much later again, can be followed."""
        if self._eyes is None or self._eyes.odometer.t_before_ns is None:
            return True
        return 2e-9 * (t_exposure_ns - self._eyes.odometer.t_before_ns) < self._eyes.odometer.longest_step_s

    def add_frame(self, frame: Frame, foretold: MotionForetold | None = None) -> CameraStep | None:
        """Take a frame and return how the camera moved, where that is known from two eyes, sound or not.

        `foretold` is what is expected at the newest sample; it tells where to look, and what is not the ground.
        """
        if self._eyes is None or not isinstance(frame, StereoFrame):
            return None
        if frame.left.shape[::-1] != self._eyes.odometer.raw_size_px:
            return None
        t_ns = frame.header.t_exposure_ns
        inner = self._inner_motion(self._eyes.odometer, t_ns, foretold)
        self._were_wrong = self._eyes.reason is not Reason.NONE
        motion = self._eyes.add_frame(t_ns, frame.left, frame.right, inner)
        self._clock.add_motion(motion)
        return None if motion is None else self._step_in_B(motion)

    def _inner_motion(self, odometer: VisualOdometer, t_ns: int, foretold: MotionForetold | None) -> InnerMotion | None:
        if odometer.t_before_ns is None or t_ns <= odometer.t_before_ns:
            return None
        margin_ns = round(1e9 * odometer.longest_row_time_s)
        return self._samples.inner_motion(odometer.t_before_ns, t_ns, margin_ns, foretold, odometer.last_v_C_mps)

    def _step_in_B(self, motion: EgoMotion) -> CameraStep:
        duration_s = 1e-9 * (motion.t_after_ns - motion.t_before_ns)
        to_B = duration_s * self._R_BC
        return CameraStep(
            motion.t_before_ns,
            motion.t_after_ns,
            vec3(to_B @ motion.w_C_radps),
            vec3(to_B @ motion.v_C_mps),
            so3.pair_covariance_turned(to_B, motion.covariance),
            self._p_BC_m,
            motion.common_rad,
        )

    def judge_clock(self) -> None:
        """Judge the last second, samples up to the newest, once the estimate has left."""
        if self._eyes is not None:
            self._clock.update()

    def finish_frame(self) -> None:
        """Judge the eyes' rows and prepare the next frame: the same, whatever samples have come since this one."""
        if self._eyes is not None:
            self._eyes.finish_frame()

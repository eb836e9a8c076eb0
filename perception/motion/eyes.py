"""Two eyes that move together: how, and whether what they see of it contradicts their calibration.

By three signs, of which none needs the IMU or any idea of the ground: corners lie on other rows in one eye than in the
other (`eye_alignment`), all their distances jump between two pictures (`distance_jump`), or their distances are bent
across the picture (`bent_distances`).
"""

from messages import Calibration, Reason
from messages.arrays import GreyImage
from perception.depth.focal_lengths import FocalDifference
from perception.motion.bent_distances import BentDistances
from perception.motion.ego_motion import EgoMotion, VisualOdometer
from perception.motion.eye_alignment import EyeAlignment
from perception.motion.inner_motion import InnerMotion


class Eyes:
    """Follows the motion of one pair of eyes, and judges the distances that it rests on.

    `scale_is_doubtful` tells whether with the newest frame jumps were forgotten: distances are not bent since, but by
    their scale, which pictures do not tell, they may be wrong.
    """

    def __init__(self, calibration: Calibration) -> None:
        self.odometer = VisualOdometer(calibration.stereo)
        self._alignment = EyeAlignment(calibration.stereo.left.fx_px, calibration.residual.rows_rad)
        self._bent = BentDistances(calibration.residual)
        self.scale_is_doubtful = False

    @property
    def reason(self) -> Reason:
        """Return EYES_MISALIGNED or DISTANCES_WRONG while what they see contradicts the calibration, else NONE."""
        if self._alignment.contradicts:
            return Reason.EYES_MISALIGNED
        wrong = self.odometer.jumps.contradict or self._bent.contradicts
        return Reason.DISTANCES_WRONG if wrong else Reason.NONE

    @property
    def focal_difference(self) -> FocalDifference:
        """Return what the eyes' rows tell of the difference between their focal lengths."""
        return self._alignment.focal_difference

    @property
    def _common_error(self) -> float:
        """Return by about how much corners err alike: by half of what the floor moves at most. What is mirrored moves
        about half as fast, and while the wearer stands what disagrees is something else."""
        return min(self.odometer.common_error, 0.5 * self.odometer.moved)

    def add_frame(
        self, t_exposure_ns: int, left: GreyImage, right: GreyImage, inner: InnerMotion | None
    ) -> EgoMotion | None:
        """Take a pair and return the motion since the one before, as `VisualOdometer.add_frame` does, wrong or not."""
        motion = self.odometer.add_frame(t_exposure_ns, left, right, inner)
        jumps, self.scale_is_doubtful = self.odometer.jumps, False
        if jumps.jumped:
            self._bent.forget()
        elif motion is not None:
            self._bent.add(motion.bend, self._common_error)
        if jumps.contradict and (self._bent.is_straight or self._alignment.contradicts):  # or began at wrong distances
            jumps.forget()
            self.scale_is_doubtful = True
        return motion

    def finish_frame(self) -> None:
        """Find what to follow into the next frame, once the estimate has left."""
        self.odometer.prepare_next()
        self.scale_is_doubtful = False
        self._alignment.add(self.odometer.skew, self.odometer.moved, self._common_error)

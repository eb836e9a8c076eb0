"""Whether an estimate may be used, and why not."""

import enum


class Status(str, enum.Enum):
    """Whether a number may be used. Anything but VALID comes with NaN in place of the numbers."""

    INITIALISING = "initialising"
    VALID = "valid"
    INVALID = "invalid"


class Reason(str, enum.Enum):
    """Why an estimate is not valid."""

    NONE = "none"
    STARTING = "starting"  # the first second: at rest for the gyroscope's bias
    NOT_AT_REST = "not_at_rest"  # still starting, because the wearer moves
    NO_IMU = "no_imu"  # IMU samples stopped, or came too late for this frame
    NO_FRAME = "no_frame"  # frames stopped
    LOW_TEXTURE = "low_texture"  # too few pixels could be matched, or followed; or tiles all alike match anywhere
    NOT_PLANAR = "not_planar"  # no plane explains the foothold region, or only this one frame's
    TOO_STEEP = "too_steep"  # a plane, but no ground one can step on
    FOOTHOLD_OUT_OF_VIEW = "foothold_out_of_view"
    OUT_OF_RANGE = "out_of_range"  # nearer or farther than the search can match
    EYES_SWAPPED = "eyes_swapped"  # the pair only matches with left and right exchanged
    WRONG_SIZE = "wrong_size"  # the frame's size is not the calibration's
    FROZEN_FRAME = "frozen_frame"  # the camera repeats one picture
    TIME_INCONSISTENT = "time_inconsistent"  # its stamp contradicts arrival or IMU, or part of it is of another instant
    LATE = "late"  # computed so late that the wearer has moved on
    IMU_INCONSISTENT = "imu_inconsistent"  # the IMU measures another motion than the camera sees
    EYES_MISALIGNED = "eyes_misaligned"  # one eye is turned, or sees all higher or larger, than calibrated
    CAMERA_SLIPPED = "camera_slipped"  # the camera has turned on its mount: calibrate it to the IMU
    DISTANCES_WRONG = (
        "distances_wrong"  # bent across the picture, at once other ones, or of another scale than the IMU's: calibrate
    )
    VIEW_DEFORMED = "view_deformed"  # something before a lens moves part of its picture: clean the window
    UNCONFIRMED = "unconfirmed"  # no camera has checked the gyroscope for long, or not long enough since
    OCCLUDED = "occluded"  # the surface under the foothold is hidden behind a lip
    OVER_EXPOSED = "over_exposed"  # the foothold is white or black in the picture: there is nothing to match
    UNCERTAIN = "uncertain"  # of a set-point: the slope's deviation is too large to act on
    PHASE_CONTRADICTS = "phase_contradicts"  # of a set-point: the ankle's phase is not the one its eyes see
    NO_NEXT_STEP = "no_next_step"  # of a set-point: the wearer stands, or where the foot lands is not known
    NO_SET_POINT = "no_set_point"  # of a set-point: the table has none for this kind, or this slope, of ground

    @property
    def status(self) -> Status:
        """Return the status of an estimate for this reason."""
        if self is Reason.NONE:
            return Status.VALID
        return Status.INITIALISING if self in (Reason.STARTING, Reason.NOT_AT_REST) else Status.INVALID


OF_SET_POINTS = frozenset({Reason.UNCERTAIN, Reason.PHASE_CONTRADICTS, Reason.NO_NEXT_STEP, Reason.NO_SET_POINT})
"""Why there is no set-point though there is ground."""


def status_without_numbers(reason: Reason) -> Status:
    """Return the status of an estimate that has no numbers, for `reason`. Raises ValueError for `Reason.NONE`."""
    if reason is Reason.NONE:
        raise ValueError("an estimate without numbers says why: its reason is none")
    return reason.status

"""What comes out of `Pipeline.step`. Each estimate carries its capture time, a covariance, a status and the
calibration's id; `seq`, age, source and publishing time are added by the publishers (`Stamp`).
"""

import enum

import msgspec
import numpy as np

from messages.arrays import FloatArray
from messages.inputs import CanBusHealth, DropCause, Load, RecordingState, Vec3, ZenohHealth
from messages.reasons import Reason, Status, status_without_numbers
from messages.setpoint import Setpoint
from messages.terrain import Terrain

Quaternion = tuple[float, float, float, float]
Covariance3 = tuple[float, float, float, float, float, float]
"""Upper triangle (00, 01, 02, 11, 12, 22) of a symmetric 3×3 matrix."""

_NAN = float("nan")


def upper_triangle(symmetric: FloatArray) -> Covariance3:
    """Return a symmetric (3, 3) array as a message's covariance."""
    s: list[list[float]] = symmetric.tolist()
    return s[0][0], s[0][1], s[0][2], s[1][1], s[1][2], s[2][2]


def full_matrix(covariance: Covariance3) -> FloatArray:
    """Return a message's covariance as a symmetric (3, 3) array."""
    xx, xy, xz, yy, yz, zz = covariance
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class Attitude(msgspec.Struct, frozen=True, kw_only=True):
    """Orientation of the IMU at `t_sample_ns`.

    `q_WB` (w, x, y, z; w ≥ 0) takes vectors from B to W; the yaw of W is arbitrary. `rotation_cov_W_rad2` is the
    covariance of the small rotation, in W, between the estimate and the truth.
    """

    t_sample_ns: int
    status: Status
    reason: Reason
    q_WB: Quaternion
    w_WB_B_radps: Vec3
    gyro_bias_B_radps: Vec3
    rotation_cov_W_rad2: Covariance3
    calibration_id: str

    @classmethod
    def invalid(cls, *, t_sample_ns: int, reason: Reason, calibration_id: str) -> "Attitude":
        """Return the attitude that says only why there is none: NaN in place of every number.

        Raises ValueError for `Reason.NONE`.
        """
        return cls(
            t_sample_ns=t_sample_ns,
            status=status_without_numbers(reason),
            reason=reason,
            q_WB=(_NAN,) * 4,
            w_WB_B_radps=(_NAN,) * 3,
            gyro_bias_B_radps=(_NAN,) * 3,
            rotation_cov_W_rad2=(_NAN,) * 6,
            calibration_id=calibration_id,
        )

    def without_numbers(self, reason: Reason) -> "Attitude":
        """Return what is left of the estimate for a `reason` that is not NONE."""
        return Attitude.invalid(t_sample_ns=self.t_sample_ns, reason=reason, calibration_id=self.calibration_id)


class GroundPlane(msgspec.Struct, frozen=True, kw_only=True):
    """The ground at the next foothold, in the heading frame H of the frame exposed at `t_exposure_ns`.

    slope_sagittal_rad = atan ∂z/∂x (> 0: uphill ahead); slope_frontal_rad = atan ∂z/∂y (> 0: rises to the left);
    height_m: vertical distance from the left optical centre down to the plane (the thesis's z-intercept, Eq. 7).
    `ahead_m` and `left_m` are where, along x and y of H, the measured region's centre lies. `covariance` is that of
    (slope_sagittal_rad, slope_frontal_rad, height_m), attitude and calibration included.
    """

    t_exposure_ns: int
    frame_seq: int
    status: Status
    reason: Reason
    slope_sagittal_rad: float
    slope_frontal_rad: float
    height_m: float
    covariance: Covariance3
    ahead_m: float
    matched_share: float
    inlier_share: float
    disparity_noise_px: float
    calibration_id: str
    left_m: float = 0.0

    @classmethod
    def invalid(
        cls,
        *,
        t_exposure_ns: int,
        frame_seq: int,
        reason: Reason,
        ahead_m: float,
        calibration_id: str,
        matched_share: float = _NAN,
        left_m: float = 0.0,
    ) -> "GroundPlane":
        """Return the estimate that says only why there is none: NaN for the ground, its covariance and its fit.

        Raises ValueError for `Reason.NONE`.
        """
        return cls(
            t_exposure_ns=t_exposure_ns,
            frame_seq=frame_seq,
            status=status_without_numbers(reason),
            reason=reason,
            slope_sagittal_rad=_NAN,
            slope_frontal_rad=_NAN,
            height_m=_NAN,
            covariance=(_NAN,) * 6,
            ahead_m=ahead_m,
            matched_share=matched_share,
            inlier_share=_NAN,
            disparity_noise_px=_NAN,
            calibration_id=calibration_id,
            left_m=left_m,
        )

    def without_numbers(self, reason: Reason) -> "GroundPlane":
        """Return what is left of the estimate for a `reason` that is not NONE."""
        return GroundPlane.invalid(
            t_exposure_ns=self.t_exposure_ns,
            frame_seq=self.frame_seq,
            reason=reason,
            ahead_m=self.ahead_m,
            calibration_id=self.calibration_id,
            matched_share=self.matched_share,
            left_m=self.left_m,
        )


class PropagatedGround(msgspec.Struct, frozen=True, kw_only=True):
    """The last `GroundPlane`, carried by the IMU to the sample at `t_sample_ns`, in the heading frame H of that time.

    Slopes, `height_m` and `covariance` mean what they do in `GroundPlane`. `picture_age_s` is the time from its
    exposure to the sample; the covariance grows with it. Only the camera sees ground: this tells where the wearer is
    above the last that was seen.
    """

    t_sample_ns: int
    picture_age_s: float
    status: Status
    reason: Reason
    slope_sagittal_rad: float
    slope_frontal_rad: float
    height_m: float
    covariance: Covariance3
    calibration_id: str

    @classmethod
    def invalid(cls, *, t_sample_ns: int, reason: Reason, calibration_id: str) -> "PropagatedGround":
        """Return the estimate that says only why there is none: NaN in place of every number.

        Raises ValueError for `Reason.NONE`.
        """
        return cls(
            t_sample_ns=t_sample_ns,
            picture_age_s=_NAN,
            status=status_without_numbers(reason),
            reason=reason,
            slope_sagittal_rad=_NAN,
            slope_frontal_rad=_NAN,
            height_m=_NAN,
            covariance=(_NAN,) * 6,
            calibration_id=calibration_id,
        )

    def without_numbers(self, reason: Reason) -> "PropagatedGround":
        """Return what is left of the estimate for a `reason` that is not NONE."""
        return PropagatedGround.invalid(t_sample_ns=self.t_sample_ns, reason=reason, calibration_id=self.calibration_id)


class Motion(msgspec.Struct, frozen=True, kw_only=True):
    """How the wearer moves over the ground seen, in the heading frame H of the frame exposed at `t_exposure_ns`.

    Velocity is that of the left optical centre, origin of H; on a moving floor, a bus's or an escalator's, it counts
    from that floor. `distance_m` is the length of its horizontal path since the service started, as far as it was seen,
    in chords of 10 cm: swaying on the spot adds nothing. `velocity_cov_H`, (m/s)², and `rate_cov_H`, (rad/s)², are
    those of the two vectors; between them and the distance no covariance is told. LOW_TEXTURE says that the camera's
    own motion has not been followed for a moment, or, with a depth camera, ever. `ground_moves` says that the floor
    itself accelerates or turns, as a vehicle's or a lift's: the gyroscope alone then carries the vertical.
    """

    t_exposure_ns: int
    frame_seq: int
    status: Status
    reason: Reason
    velocity_H_mps: Vec3
    rate_H_radps: Vec3
    distance_m: float
    velocity_cov_H: Covariance3
    rate_cov_H: Covariance3
    distance_var_m2: float
    ground_moves: bool
    calibration_id: str

    @classmethod
    def invalid(cls, *, t_exposure_ns: int, frame_seq: int, reason: Reason, calibration_id: str) -> "Motion":
        """Return the estimate that says only why there is none: NaN in place of every number.

        Raises ValueError for `Reason.NONE`.
        """
        return cls(
            t_exposure_ns=t_exposure_ns,
            frame_seq=frame_seq,
            status=status_without_numbers(reason),
            reason=reason,
            velocity_H_mps=(_NAN,) * 3,
            rate_H_radps=(_NAN,) * 3,
            distance_m=_NAN,
            velocity_cov_H=(_NAN,) * 6,
            rate_cov_H=(_NAN,) * 6,
            distance_var_m2=_NAN,
            ground_moves=False,
            calibration_id=calibration_id,
        )

    def without_numbers(self, reason: Reason) -> "Motion":
        """Return what is left of the estimate for a `reason` that is not NONE."""
        return Motion.invalid(
            t_exposure_ns=self.t_exposure_ns,
            frame_seq=self.frame_seq,
            reason=reason,
            calibration_id=self.calibration_id,
        )


class Health(msgspec.Struct, frozen=True, kw_only=True):
    """Once a second: what arrived, what was lost and by which cause, since the start.

    `learnt_id` is the id of what the unit had learnt in earlier runs when this one began; empty if it was nothing.
    `height_off_m` is by how much lower the ground under the wearer lies, averaged over strides, than the wearer's
    height in the calibration says; NaN where that is not known. `height_contradicts` says that neither shoes nor
    posture explain it.
    """

    t_ns: int
    imu_samples: int
    imu_lost: int
    imu_clipped: int
    imu_refused: int
    imu_bus_errors: int
    imu_fifo_overflows: int
    imu_frames_refused: int
    imu_resets: int
    imu_edges_missed: int
    frames: int
    frames_valid: int
    frames_dropped: dict[DropCause, int]
    refused: dict[Reason, int]
    ankle_states: int
    inbox_dropped: int
    recorder_dropped: int
    recording: RecordingState = RecordingState.OFF
    can_errors: int
    can_bus: CanBusHealth
    zenoh_errors: int
    load: Load
    calibration_id: str
    learnt_id: str
    zenoh: ZenohHealth = ZenohHealth()
    height_off_m: float = _NAN
    height_contradicts: bool = False


Estimate = Attitude | GroundPlane | PropagatedGround | Motion | Terrain | Setpoint | Health


def capture_ns(estimate: Estimate) -> int:
    """Return the CLOCK_MONOTONIC instant for which `estimate` stands."""
    if isinstance(estimate, GroundPlane | Motion | Terrain | Setpoint):
        return estimate.t_exposure_ns
    return estimate.t_sample_ns if isinstance(estimate, Attitude | PropagatedGround) else estimate.t_ns


class Source(str, enum.Enum):
    """Where the data came from. A prosthesis acts on LIVE only."""

    LIVE = "live"
    REPLAY = "replay"
    SIMULATED = "simulated"


class Stamp(msgspec.Struct, frozen=True, kw_only=True):
    """What a publisher adds to an estimate; together they let a consumer refuse stale or simulated data."""

    device: str
    boot_id: str
    source: Source
    seq: int
    t_publish_ns: int
    age_s: float


class GroundTruth(msgspec.Struct, frozen=True, kw_only=True):
    """The rig's truth for one frame; recorded on its own topic and never read by the pipeline.

    `kind` is the kind of ground at the foothold; `transition` says that the foothold region spans an edge.
    """

    t_exposure_ns: int
    slope_sagittal_rad: float
    slope_frontal_rad: float
    height_m: float
    q_WB: Quaternion
    kind: str
    transition: bool
    standing: bool

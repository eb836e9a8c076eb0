"""Parameters and state of the attitude filter, kept apart from its equations."""

import math
from copy import copy
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from messages import Quaternion, Reason, Vec3
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception import so3, vec3
from perception.attitude.rest import Rest, RestSettings
from perception.attitude.usual_mounting import UsualMounting, UsualMountingSettings
from perception.so3 import Rows

_NAN_QUATERNION: Quaternion = (math.nan, math.nan, math.nan, math.nan)


@dataclass(frozen=True, kw_only=True)
class CameraStepSettings:
    """What a step of the camera is worth, and when it contradicts the IMU; 1 σ where nothing else is said."""

    noise_factor: float = 1.2  # times the deviations that the odometer states: steps share a picture
    scale: float = 0.004  # of its distances, beside what the toe-in leaves that far from the camera, in baselines
    range_per_baseline: float = 10.0
    # What the odometer itself errs by, however long it is followed, where it states so much noise; elsewhere in
    # proportion to that, for noise passes for depth: measured on the rig, 0.03 % at 4 mm/s, 0.25 % at 12 to 20.
    odometer_scale: float = 0.0008
    odometer_noise_mps: float = 0.006
    # Beyond so many standard deviations of calibration and odometer together distances are wrong, until within so many
    # again; what is within is corrected. The fewer, the smaller the errors that are told, and the more sound units are
    # refused, one in 370 here.
    wrong_scale_sigmas: float = 3.0
    right_scale_sigmas: float = 2.0
    doubtful_scale: float = 0.05  # of distances that have jumped, and which must be known so well to be right again:
    known_scale: float = 0.005
    # What samples lose of an acceleration, as a part of its second derivative: to the accelerometer's filter, two poles
    # alike with −3 dB at 44 Hz, 5.4e-6; to the lines between samples at 100 Hz, in both its sums, the rest. A walker's
    # bob would seem 0.2 % too small, distances as much too long.
    sf_lost_s2: float = 2.1e-5
    mount_rad: float = math.radians(0.05)  # of the camera in B, beside the calibration's residual
    mount_walk_rad_rts: float = math.radians(0.005)
    usual_sigmas: float = 3.0  # a step counts for no more of turn or travel
    doubtful_radps: float = 0.03  # a turn that errs by so much alike with others counts for half in a sum of turns
    lag_s: float = 0.0003  # of the camera's stamps, beside the calibration's residual
    refused_sigmas: float = 10.0  # a step beyond is not used: something else moves, or one of the two is wrong,
    counted_sigmas: float = 5.0  # and counts for this much at most among what contradicts
    # For this long after a step nothing else need bound the velocity, and the gyroscope's bias may change so much: it
    # warms up, or the wearer walks out into the cold.
    fresh_s: float = 0.25
    bias_walk_radps_rts: float = math.radians(0.05)
    # A covered camera's wearer still walks out into the cold. The bias may also have jumped, by `gyro_bias_radps`,
    # right after the last step: the tilt is stated the worse, until steps tell.
    covered_bias_walk_radps_rts: float = math.radians(0.1)
    # By so much a second steps lean over a walk, for so long all one way: measured on the rig's ramps, 0.03 to
    # 0.07 °/s. Where the ground moves nothing else holds the vertical: the gyroscope's bias then follows slowly.
    lean_radps: float = math.radians(0.04)
    lean_time_s: float = 4.0
    ground_bias_walk_radps_rts: float = math.radians(0.02)
    # A sum of innovations that fades contradicts beyond `far_sigmas`: the gyroscope's bias has jumped, and with it the
    # tilt; or the ground moves, accelerating so much horizontally, less upwards, or turning, for so long.
    memory_s: float = 1.0
    far_sigmas: float = 5.5
    explain_again_s: float = 0.3  # so long after a cause was found no other one is looked for
    jump_tilt_rad: float = math.radians(0.3)
    ground_mps2: float = 1.0
    ground_turn_radps: float = math.radians(20.0)
    ground_time_s: float = 5.0
    least_ground_turn_radps: float = math.radians(3.0)  # less is the gyroscope's bias
    ground_average_s: float = 10.0  # over which less, down to `ground_least_mps2`, becomes usual
    ground_least_mps2: float = 0.3
    ground_jump_mps: float = 0.2  # of velocity, and
    ground_jump_radps: float = math.radians(0.2)  # of the gyroscope's bias, until that was found
    ground_doubtful_s: float = 2.0  # so long a jump of that bias may have been taken for it
    # It is at rest again once it has moved less than this for so long.
    ground_at_rest_mps2: float = 0.18
    ground_at_rest_radps: float = math.radians(1.0)
    ground_at_rest_s: float = 3.0
    # It was the accelerometer's bias that jumped where that has, smoothed so long, stayed as near to one value in B for
    # so long as no vehicle's does, and would have led to such a speed. What is at rest accelerates less than the last.
    ground_smoothing_s: float = 1.0
    ground_steady_mps2: float = 0.35
    ground_steady_s: float = 20.0
    ground_steady_mps: float = 8.0
    ground_rest_mps2: float = 0.02
    # No ground accelerates, or has by then become, as fast as this along the axes of W: the accelerometer is wrong.
    # Nor does any turn its acceleration round, by more than so much, more often than so within about so long.
    reversal_mps2: float = 0.3
    most_reversals: float = 2.5
    few_reversals: float = 1.0  # it may be a ground again
    reversal_memory_s: float = 3.0
    most_ground_mps2: tuple[float, float, float] = (4.0, 4.0, 2.5)
    most_ground_mps: tuple[float, float, float] = (40.0, 40.0, 8.0)
    # A sum that fades more slowly tells of a camera that may have slipped by about `slip_rad`; it has where more than
    # `most_slip_rad` is known of that, beside what the calibration leaves.
    slip_memory_s: float = 3.0
    slip_sigmas: float = 4.0
    shared_radps: float = 0.005  # of a turn, one σ: what the steps of seconds of standing err by alike
    slip_rad: float = math.radians(2.0)
    most_slip_rad: float = math.radians(0.25)


@dataclass(frozen=True, kw_only=True)
class AttitudeSettings:
    """Parameters, all positive. `_rthz` is a noise density, `_rts` a random walk or an averaged value's deviation
    times √s; times do not depend on the sample rate. Noise from the MPU-6050's data sheet, motion of a person.

    Raises ValueError where one is not positive and finite.
    """

    gravity_mps2: float = STANDARD_GRAVITY_MPS2
    gravity_std_mps2: float = 0.015  # from place to place
    gyro_noise_radps_rthz: float = math.radians(0.01)
    gyro_bias_walk_radps_rts: float = math.radians(0.002)
    gyro_bias_radps: float = math.radians(2.0)  # what a change of temperature leaves of a calibrated bias
    sf_noise_mps2_rthz: float = 0.004
    sf_bias_walk_mps2_rts: float = 1e-4
    # Scale errors that no constant matrix explains act as noise in proportion to the motion, correlated this long; the
    # gyroscope's also in proportion to how that changes meanwhile.
    gyro_scale_time_s: float = 0.07
    sf_scale_time_s: float = 2.0
    # The velocity swings about a drift, which keeps to the heading: mean 0, correlated so long, on each horizontal axis
    # of the mean square of the velocity; an IMU that only turns or shakes in its place does not drift. The swing's mean
    # over T has the variance (floor² + time · mean square swing) / T, of the swing smoothed, since a fast one has a
    # smaller mean. Both are no less than their present square, for swings and walks begin.
    drift_floor_mps: float = 0.05
    drift_time_s: float = 60.0
    drift_average_s: float = 5.0
    drift_limit_mps: float = 3.0
    swing_floor_mps_rts: float = 0.2
    swing_time_s: float = 1.5
    swing_smoothing_s: float = 0.05
    most_swing_mps: float = 1.0  # more is an error's, not a person's
    swing_average_s: float = 3.0
    # At rest the drift is a standing wearer's sway, and nothing swings. The rate's mean over T has the variance
    # sway_rate² / T, or what its scatter about the mean, correlated over `sway_rate_time_s`, gives, if that is larger.
    rest: RestSettings = field(default_factory=RestSettings)
    sway_mps: float = 0.006
    sway_time_s: float = 0.5
    sway_swing_mps_rts: float = 0.01
    sway_rate_radps_rts: float = math.radians(0.35)
    sway_rate_time_s: float = 5.0
    # A walk begins this long, to twice this long, before it is detected.
    detection_delay_s: float = 0.1
    # A velocity that contradicts rest, or any walk, adds to the variance of the attitude.
    runaway_rad_rts: float = math.radians(0.5)
    # The specific force of a rest that is longer or shorter than gravity by so many standard deviations, and for so
    # long, longer than a lift takes to gain speed, tells that the accelerometer is worse than calibrated.
    excess_sigmas: float = 3.0
    excess_s: float = 10.0
    # A start from rest, and in motion: from the mean specific force, at some pace, somewhere in its swing. For
    # `pace_unknown_s`, also after a rest, the pace may change as much as it is unknown, within about `pace_time_s`: the
    # tilt does not yet tell a stop from a lean. Of a swing, what is slower than `pace_swing_time_s` then counts to it.
    rest_tilt_rad: float = math.radians(0.3)
    moving_start_tilt_rad: float = math.radians(15.0)
    moving_start_speed_mps: float = 1.2
    moving_start_swing_mps: float = 0.2
    pace_unknown_s: float = 5.0
    pace_time_s: float = 20.0
    pace_swing_time_s: float = 1.0
    # Missing samples: a motion strays from the trapezoid by `unseen_*` × the missing time, a hip's swing also by its
    # curvature / 12 × time³. Beyond `gap_s` the tilt is that of the usual mounting, to be confirmed within
    # `confirm_within_s` by samples that do not move it farther than `refuted_sigmas`.
    unseen_w_radps: float = math.radians(10.0)
    unseen_swing_radps3: float = math.radians(250.0)
    unseen_sf_mps2: float = 3.0
    gap_s: float = 0.15
    usual_mounting: UsualMountingSettings = field(default_factory=UsualMountingSettings)
    confirm_within_s: float = 3.0
    refuted_sigmas: float = 1.5
    # A clipped sample falls short of the truth by about this much. All that were clipped for longer are as missing.
    longest_clipping_s: float = 0.05
    clipped_w_radps: float = 2.0
    clipped_sf_mps2: float = 20.0
    correction_s: float = 0.04
    camera: CameraStepSettings = field(default_factory=CameraStepSettings)
    usable_tilt_rad: float = math.radians(3.0)

    def __post_init__(self) -> None:
        for settings in (self, self.rest, self.usual_mounting, self.camera):
            for each in fields(settings):
                value = getattr(settings, each.name)
                if isinstance(value, float) and not 0.0 < value < math.inf:
                    raise ValueError(
                        f"{type(settings).__name__}.{each.name} is {value}; it must be positive and finite"
                    )


class Sample(NamedTuple):
    """One calibrated sample: m/s² and rad/s, in B; the die's temperature is NaN where it is not measured."""

    t_ns: int
    sf_B: Vec3
    w_B: Vec3
    clipped: bool
    temperature_degC: float = math.nan


@dataclass
class Step:
    """What happened since the last correction, sample by sample."""

    elapsed_s: float = 0.0
    rows: list[Rows] = field(default_factory=list)
    rates: list[Vec3] = field(default_factory=list)
    dts_s: list[float] = field(default_factory=list)
    yaw_rad: float = 0.0
    rotation_var: float = 0.0
    velocity_var: float = 0.0


@dataclass
class Contradiction:
    """The fading sum (3,) of what innovations say of one cause, and its covariance (3, 3)."""

    total: FloatArray = field(default_factory=lambda: np.zeros(3))
    covariance: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass
class Contradictions:
    """What successive steps of the camera say against the state: of a turn, a travel, a camera that has slipped; and
    by what turn (3,) in W the gyroscope has fallen short of late."""

    turn: Contradiction = field(default_factory=Contradiction)
    travel: Contradiction = field(default_factory=Contradiction)
    slip: Contradiction = field(default_factory=Contradiction)
    missing_rad: FloatArray = field(default_factory=lambda: np.zeros(3))


@dataclass
class GroundMotion:
    """Whether the ground that the camera sees moves, as in a bus or lift: its acceleration in W, m/s², and what that
    has made of its velocity, m/s, its turn about the vertical, rad/s, and for how long it has hardly moved."""

    moves: bool = False
    acceleration_W: Vec3 = vec3.ZERO
    velocity_W: Vec3 = vec3.ZERO
    turn_radps: float = 0.0
    calm_s: float = 0.0
    moving_s: float = 0.0  # how long it has moved
    usual_square: float = 0.0  # of the horizontal acceleration on one axis, (m/s²)²
    extreme_W: Vec3 = vec3.ZERO  # the acceleration farthest in the direction of the last
    reversals: float = 0.0  # how often that has turned round, fading
    goes_to_and_fro: bool = False  # too often for any ground
    smooth_B: Vec3 = vec3.ZERO  # the acceleration in B, smoothed,
    steady_B: Vec3 = vec3.ZERO  # near which it has been
    steady_s: float = 0.0  # for so long,
    steady_gain_B: Vec3 = vec3.ZERO  # and what speed, m/s, that has made
    frozen_scale_var: float = 0.0  # variance of the scale of distances, which stays as it is meanwhile


@dataclass
class Levelling:
    """What happened since the first sample, S: rotation, and specific force integrated over time in S.

    `before` is the state before that sample; the usual mounting gave `assumed_up_S`, of length 1, as the vertical, with
    `assumed_var` on each axis.
    """

    before: "AttitudeState"
    elapsed_s: float = 0.0
    q_SB: Quaternion = so3.IDENTITY
    sum_sf_S: Vec3 = vec3.ZERO
    since: list[Sample] = field(default_factory=list)
    assumed_up_S: Vec3 | None = None
    assumed_var: float = 0.0


@dataclass
class AttitudeState:
    """The whole state of the filter; `covariance` is (39, 39), of the errors that `kalman` lists."""

    covariance: FloatArray
    rest: Rest = field(default_factory=Rest)
    t_ns: int | None = None
    usual_step_s: float = 0.0
    first_degC: float = math.nan  # the die's temperature at the first sample,
    most_warming_K: float = 0.0  # and how far from it that has been
    gyro_bias: Vec3 = vec3.ZERO
    sf_bias: Vec3 = vec3.ZERO
    gyro_matrix: Rows = (0.0,) * 9
    started: bool = False
    resting: bool = False
    reason_uncertain: Reason = Reason.NOT_AT_REST  # why the tilt is uncertain, whenever it is
    q_WB: Quaternion = _NAN_QUATERNION
    v_W: Vec3 = vec3.ZERO
    drift_W: Vec3 = vec3.ZERO
    smooth_swing_W: Vec3 = vec3.ZERO
    mean_square_swing: float = 0.0
    mean_square_speed: float = 0.0  # of the velocity on one horizontal axis, (m/s)²
    pace_unknown_s: float = 0.0  # so long the pace may still change freely
    w_measured: Vec3 = vec3.ZERO
    sf_measured: Vec3 = vec3.ZERO
    sf_W: Vec3 = vec3.ZERO
    travel_W: Vec3 = vec3.ZERO  # since the camera's step began
    q_WB_beginning: Quaternion | None = None  # the attitude then; None where no step has begun
    without_camera_s: float = math.inf  # time since the last step of the camera that was used,
    unwatched_s: float = 0.0  # and in motion, the tilt known: at rest the samples tell the gyroscope's bias
    scale: float = 0.0  # the camera's distances are (1 + scale) times the true ones
    odometer_scale: float = 0.0  # what the odometer that told it may err by, 1 σ, the mean of all steps by their
    scale_weight: float = 0.0  # weight
    distances_are_wrong: bool = False  # by more than the calibration leaves
    lag_s: float = 0.0  # so much later than their stamps are the camera's pictures
    v_W_beginning: Vec3 = vec3.ZERO  # velocity and rate when the camera's step began
    w_W_beginning: Vec3 = vec3.ZERO
    sf_W_beginning: Vec3 = vec3.ZERO  # and specific force
    mount_B: Vec3 = vec3.ZERO  # small turn of the camera in B from where the calibration has it
    ground: GroundMotion = field(default_factory=GroundMotion)
    contradictions: Contradictions = field(default_factory=Contradictions)
    explained_s: float = math.inf  # time since a cause was found
    usual_mounting: UsualMounting = field(default_factory=UsualMounting)
    step: Step = field(default_factory=Step)
    levelling: Levelling | None = None  # until the tilt is known from samples
    checkpoints: "list[Checkpoint]" = field(default_factory=list)
    excess_mps2: float = 0.0  # by which the specific force of all rests has at least been longer than gravity,
    excess_from_ns: int | None = None  # since then
    granted_mps2: float = 0.0  # so much of it is stated already
    before_clipping: "AttitudeState | None" = None  # while samples are clipped

    def copy(self) -> "AttitudeState":
        """Return a state that goes on independently of this one; what lies before is shared, and never changed."""
        other, step, found = copy(self), self.step, self.contradictions
        other.covariance = self.covariance.copy()
        other.rest, other.usual_mounting, other.ground = copy(self.rest), copy(self.usual_mounting), copy(self.ground)
        other.contradictions = Contradictions(copy(found.turn), copy(found.travel), copy(found.slip), found.missing_rad)
        other.step = copy(step)
        other.step.rows, other.step.rates, other.step.dts_s = [*step.rows], [*step.rates], [*step.dts_s]
        if self.levelling is not None:
            other.levelling = replace(self.levelling, since=[*self.levelling.since])
        other.checkpoints = [Checkpoint(each.state, [*each.since]) for each in self.checkpoints]
        return other

    @property
    def clipped_s(self) -> float:
        """Return for how long samples have been clipped without a break."""
        before = self.before_clipping
        return 0.0 if before is None or before.t_ns is None or self.t_ns is None else 1e-9 * (self.t_ns - before.t_ns)


@dataclass
class Checkpoint:
    """A state at rest, and the samples since."""

    state: AttitudeState
    since: list[Sample] = field(default_factory=list)

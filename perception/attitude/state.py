"""Parameters and state of the attitude filter, kept apart from its equations."""

import math
from dataclasses import dataclass, field, fields
from typing import NamedTuple

from messages import Quaternion, Reason, Vec3
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception import so3, vec3
from perception.attitude.rest import Rest, RestSettings
from perception.attitude.usual_mounting import UsualMounting, UsualMountingSettings
from perception.so3 import Rows

_NAN_QUATERNION: Quaternion = (math.nan, math.nan, math.nan, math.nan)


@dataclass(frozen=True, kw_only=True)
class AttitudeSettings:
    """Parameters, all positive. `_rthz` is a noise density, `_rts` a random walk or an averaged value's deviation
    times √s; times do not depend on the sample rate. Noise from the MPU-6050's data sheet, motion of a person.

    Raises ValueError where one is not positive and finite.
    """

    gravity_mps2: float = STANDARD_GRAVITY_MPS2
    gyro_noise_radps_rthz: float = math.radians(0.01)
    gyro_bias_walk_radps_rts: float = math.radians(0.002)
    gyro_bias_radps: float = math.radians(2.0)  # what a change of temperature leaves of a calibrated bias
    sf_noise_mps2_rthz: float = 0.004
    sf_bias_walk_mps2_rts: float = 1e-4
    # Scale errors that no constant matrix explains act as noise in proportion to the motion, correlated this long.
    gyro_scale_time_s: float = 0.2
    sf_scale_time_s: float = 2.0
    # The velocity swings about a drift, which keeps to the heading and is a walker's: mean 0, this deviation on each
    # axis, correlated so long. The swing's mean over T has the variance (floor² + time · mean square swing) / T.
    drift_mps: float = 0.6
    drift_time_s: float = 20.0
    drift_limit_mps: float = 3.0
    swing_floor_mps_rts: float = 0.2
    swing_time_s: float = 1.0
    swing_average_s: float = 3.0
    # At rest the drift is a standing wearer's sway, and nothing swings.
    rest: RestSettings = field(default_factory=RestSettings)
    sway_mps: float = 0.006
    sway_time_s: float = 0.5
    sway_swing_mps_rts: float = 0.002
    sway_rate_radps_rts: float = math.radians(0.35)
    # A walk begins this long, to twice this long, before it is detected.
    detection_delay_s: float = 0.1
    # A velocity that contradicts rest, or any walk, adds to the variance of the attitude.
    runaway_rad_rts: float = math.radians(0.5)
    # A start from rest, and in motion: from the mean specific force, at some pace, somewhere in its swing. For
    # `pace_unknown_s` the pace may change as much as it is unknown: the tilt does not yet tell a stop from a lean.
    rest_tilt_rad: float = math.radians(0.3)
    moving_start_tilt_rad: float = math.radians(15.0)
    moving_start_speed_mps: float = 1.2
    moving_start_swing_mps: float = 0.2
    pace_unknown_s: float = 5.0
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
    usable_tilt_rad: float = math.radians(3.0)

    def __post_init__(self) -> None:
        for settings in (self, self.rest, self.usual_mounting):
            for each in fields(settings):
                value = getattr(settings, each.name)
                if isinstance(value, float) and not 0.0 < value < math.inf:
                    raise ValueError(
                        f"{type(settings).__name__}.{each.name} is {value}; it must be positive and finite"
                    )


class Sample(NamedTuple):
    """One calibrated sample: m/s² and rad/s, in B."""

    t_ns: int
    sf_B: Vec3
    w_B: Vec3
    clipped: bool


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
    """The whole state of the filter; `covariance` is (24, 24), of the errors θ, b, v, u, a and M."""

    covariance: FloatArray
    rest: Rest = field(default_factory=Rest)
    t_ns: int | None = None
    usual_step_s: float = 0.0
    gyro_bias: Vec3 = vec3.ZERO
    sf_bias: Vec3 = vec3.ZERO
    gyro_matrix: Rows = (0.0,) * 9
    started: bool = False
    resting: bool = False
    reason_uncertain: Reason = Reason.NOT_AT_REST  # why the tilt is uncertain, whenever it is
    q_WB: Quaternion = _NAN_QUATERNION
    v_W: Vec3 = vec3.ZERO
    drift_W: Vec3 = vec3.ZERO
    mean_square_swing: float = 0.0
    pace_unknown_s: float = 0.0  # so long the pace may still change freely
    w_measured: Vec3 = vec3.ZERO
    sf_measured: Vec3 = vec3.ZERO
    sf_W: Vec3 = vec3.ZERO
    usual_mounting: UsualMounting = field(default_factory=UsualMounting)
    step: Step = field(default_factory=Step)
    levelling: Levelling | None = None  # until the tilt is known from samples
    checkpoints: "list[Checkpoint]" = field(default_factory=list)
    before_clipping: "AttitudeState | None" = None  # while samples are clipped

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

"""What counts as wrong and as stale: the one place where the campaign's words are defined.

A ground is wrong if one of its three numbers is off the truth by more than its bound AND by more than `SIGMAS` of its
own stated standard deviation: an estimate that says how unsure it is may be unsure. The bounds are three times the
accuracy promised for walking (1.0° and 15 mm RMS). At an edge of the ground no plane is the truth to the bound; there
the second condition judges alone.

An attitude is wrong if its vertical is off by more than three times the 1.0° promised and by more than `SIGMAS`.

A ground is stale if it is heard later than `STALE_S` after the instant it stands for, or if its number was heard
before. Where the campaign's own process was held up, lateness is not the daemon's and is not judged
(`lab.faults.listener`).
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np

from messages import Attitude, GroundPlane, GroundTruth, Reason, Status
from messages.arrays import FloatArray
from perception import so3

WRONG_SLOPE_RAD = math.radians(3.0)
WRONG_HEIGHT_M = 0.045
WRONG_TILT_RAD = math.radians(3.0)
SIGMAS = 4.0
STALE_S = 0.150
AT_AN_EDGE = (Reason.NOT_PLANAR, Reason.TOO_STEEP, Reason.LOW_TEXTURE, Reason.OUT_OF_RANGE)
"""Reasons for which a faultless unit may refuse a frame whose foothold has an edge; such a refusal flags nothing."""

_BOUNDS = (WRONG_SLOPE_RAD, WRONG_SLOPE_RAD, WRONG_HEIGHT_M)


class Errors(NamedTuple):
    """How far one valid ground is off the truth, and whether that is wrong."""

    slope_rad: float
    height_m: float
    wrong: bool


class Wrong(msgspec.Struct, frozen=True):
    """How many estimates were marked valid and wrong: grounds heard on Zenoh and on CAN, attitudes."""

    zenoh: int = 0
    can: int = 0
    attitudes: int = 0

    def __add__(self, other: "Wrong") -> "Wrong":
        """Return both together."""
        return Wrong(self.zenoh + other.zenoh, self.can + other.can, self.attitudes + other.attitudes)

    def __sub__(self, other: "Wrong") -> "Wrong":
        """Return those that are not among `other`."""
        return Wrong(self.zenoh - other.zenoh, self.can - other.can, self.attitudes - other.attitudes)

    def __bool__(self) -> bool:
        """Return whether there are any."""
        return bool(self.zenoh or self.can or self.attitudes)


def ground_errors(
    numbers: tuple[float, float, float], deviations: tuple[float, float, float], truth: GroundTruth
) -> Errors:
    """Return the errors of (sagittal slope, frontal slope, height) with their stated standard deviations."""
    true = (truth.slope_sagittal_rad, truth.slope_frontal_rad, truth.height_m)
    off = [abs(number - right) for number, right in zip(numbers, true, strict=True)]
    bounds = (0.0, 0.0, 0.0) if truth.transition else _BOUNDS
    wrong = any(
        not error <= max(bound, SIGMAS * deviation)  # so written, a NaN is wrong too
        for error, bound, deviation in zip(off, bounds, deviations, strict=True)
    )
    return Errors(max(off[0], off[1]), off[2], wrong)


def errors_of(ground: GroundPlane, truth: GroundTruth) -> Errors:
    """Return the errors of a valid ground."""
    sagittal, frontal, height = (math.sqrt(ground.covariance[i]) for i in (0, 3, 5))
    return ground_errors(
        (ground.slope_sagittal_rad, ground.slope_frontal_rad, ground.height_m), (sagittal, frontal, height), truth
    )


def tilt_error_rad(attitude: Attitude, R_WB: FloatArray) -> float:
    """Return the angle between the vertical of a valid attitude and the true one."""
    up_B, true_up_B = so3.matrix_from_quaternion(attitude.q_WB)[2], R_WB[2]
    return float(np.arctan2(np.linalg.norm(np.cross(up_B, true_up_B)), up_B @ true_up_B))


def is_wrong_attitude(attitude: Attitude, R_WB: FloatArray) -> bool:
    """Return whether a valid attitude is wrong at an instant whose truth is `R_WB` (3, 3)."""
    xx, xy, _, yy, _, _ = attitude.rotation_cov_W_rad2
    deviation = math.sqrt(float(np.linalg.eigvalsh([[xx, xy], [xy, yy]])[-1]))
    return not tilt_error_rad(attitude, R_WB) <= max(WRONG_TILT_RAD, SIGMAS * deviation)


def flags(ground: GroundPlane, truth: GroundTruth) -> bool:
    """Return whether `ground` tells a consumer that something is wrong."""
    return ground.status is not Status.VALID and not (truth.transition and ground.reason in AT_AN_EDGE)

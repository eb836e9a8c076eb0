"""Where the camera stands in the IMU's axes, and when its pictures are taken: what the motion filter has learnt over a
minute of walking, taken over.

The filter's errors are small ones about a calibration, true = calibrated ⊕ error:

    R_BL ← exp(m) R_BL,   t ← t + λ,   b_w ← b_w + W⁻¹ δb,   b_f ← b_f + S⁻¹ δa                             (1)

m turns the camera in B, λ is how much later than stamped its pictures are, δb and δa what is left of both biases after
the calibration's matrices W and S. The walk is gone through twice: a camera that is off by degrees is brought near by
the first pass, and the second one starts there, wide enough not to believe the first; and once more from where that
ends, while it ends farther away than (1) is exact.

Over these passes the camera is rigid. The filter of the service, to which a camera may slip at any time, would take
errors of pictures that are alike for some steps, as where a walk begins, for a slip: once in some minutes, and would
forget what the walk has told of the mounting until then. That it stays where it is, is judged by what its first half
tells.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import msgspec
import numpy as np

from calib.pair import PairErrors, pair_errors, put_right
from calib.strict_yaml import CalibrationError
from messages import Calibration, Residual, matrix3, vec3
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.filter import AttitudeSettings
from perception.attitude.sensor_errors import MountingErrors, SensorErrors
from perception.attitude.state import CameraStepSettings

_NO_SLIP_SIGMAS = 1e3
RIGID = AttitudeSettings(
    camera=CameraStepSettings(mount_walk_rad_rts=math.radians(1e-6), slip_sigmas=_NO_SLIP_SIGMAS),
)
"""The filter for a calibration: over a minute the camera neither turns on its mount, as it may over an hour, nor
slips."""
LEAST_S = 40.0
MOST_MOUNT_STD_RAD = math.radians(0.1)
MOST_LAG_STD_S = 1e-3
_FIRST = (math.radians(3.0), 0.01)
_SECOND = (math.radians(0.5), 2e-3)
"""By what the camera's angles (rad) and its stamps (s) may be off before each pass, 1 σ, at least."""
_DISTANCES = 0.01
"""By what distances may seem wrong meanwhile, 1 σ: angles and stamps that are off make them so."""
_ACROSS_RAD, _PICTURES_S = math.radians(0.02), 3e-5
"""What pictures leave beyond the filter's own deviation, 1 σ: of the camera's turn about the axis across its view, of
which the odometer errs alike from step to step while walking, and of its stamps. From told walks with the odometer's
errors on rendered ones (`python -m benchmarks.mounting`, seeds below 100)."""


BEGINNINGS_S = (0.0, -8e-3, 8e-3, -16e-3, 16e-3)
"""By what the stamps are taken to be off where the first pass begins, one after the other until camera and IMU agree:
stamps that are off by more than about 6 ms are a contradiction for the filter, and it learns nothing."""


PATIENCE_S = 8.0
"""Camera and IMU that have contradicted each other for so long do not come to agree."""
_NEAR = (math.radians(1.0), 2e-3)
"""Farther from where a pass began, rad and s, (1) is off by more than 0.01°, and another one begins there,"""
_MOST_PASSES = 4
"""up to so many in all."""
_TURNED_SIGMAS = 5.0
"""What the whole walk tells of the angles beyond so many deviations of what its first half does is a camera that has
turned on its mount."""


class Found(NamedTuple):
    """What a pass over a walk has told: the errors of mounting and sensors at its end, of the calibration it ran with,
    those of the mounting after its first half, and the die's mean temperature, °C."""

    mounting: MountingErrors
    sensors: SensorErrors
    halfway: MountingErrors
    temperature_degC: float


Walk = Callable[[Calibration, str], Found | None]
"""Goes through a walk with a calibration; the name of the pass is for a person. None where camera and IMU do not agree.
"""


class Course:
    """What the filter says of the mounting in the course of a pass."""

    def __init__(self) -> None:
        self._told: list[MountingErrors] = []
        self._told_ns = self._agreed_ns = 0

    def add(self, t_ns: int, mounting: MountingErrors | None) -> bool:
        """Take what is said at `t_ns`, None where camera and IMU contradict each other; return whether they may still
        come to agree."""
        if mounting is not None or self._agreed_ns == 0:
            self._agreed_ns = t_ns
        if mounting is not None and t_ns - self._told_ns >= _REMEMBERED_NS:
            self._told.append(mounting)
            self._told_ns = t_ns
        return t_ns - self._agreed_ns <= 1e9 * PATIENCE_S

    @property
    def halfway(self) -> MountingErrors:
        """Return what was said in the middle. Raises IndexError where nothing ever was."""
        return self._told[len(self._told) // 2]


_REMEMBERED_NS = 1_000_000_000


class Mounted(NamedTuple):
    """The new calibration; by how much the camera has turned in B (3,) rad from the old one and its stamps, s, with one
    standard deviation of each; the error of distances that was found, relative, with its deviation, and what was put
    right of it, None where that is none of a calibration like the old one."""

    calibration: Calibration
    turn_B: FloatArray
    turn_std: FloatArray
    lag_s: float
    lag_std: float
    scale: float
    scale_std: float
    pair: PairErrors | None


def measured(known: Calibration, walk: Walk, where: str) -> Mounted:
    """Return what passes over a walk make of the calibration `known`.

    Raises CalibrationError, one line that begins with `where`, where camera and IMU do not agree, the camera has turned
    on its mount, or the walk has not told the angles to 0.1° and the stamps to 1 ms.
    """
    near = _first_pass(known, walk, where)
    for number in range(2, _MOST_PASSES + 1):
        found = walk(doubted(near, first=False), f"pass {number}")
        if found is None:
            break
        if is_near(found.mounting):
            return mounted(known, near, found, where)
        near = brought_near(near, found.mounting)
    raise CalibrationError(f"{where}: {_DISAGREE}")


def _first_pass(known: Calibration, walk: Walk, where: str) -> Calibration:
    for by_s in BEGINNINGS_S:
        begun = stamped_later(known, by_s)
        found = walk(doubted(begun, first=True), "pass 1" if by_s == 0.0 else f"pass 1, pictures {1e3 * by_s:+.0f} ms")
        if found is not None:
            return brought_near(begun, found.mounting)
    raise CalibrationError(f"{where}: {_DISAGREE}")


_DISAGREE = (
    "refused: at its end camera and IMU do not agree, or the attitude is not known; are the lenses and the IMU "
    "calibrated, and does the ground have texture?"
)


def is_near(found: MountingErrors) -> bool:
    """Return whether (1) is exact for what was found."""
    most_rad, most_s = _NEAR
    return math.hypot(*found.turn_B) <= most_rad and abs(found.lag_s) <= most_s


def doubted(known: Calibration, *, first: bool) -> Calibration:
    """Return the calibration with a residual as wide as a pass needs: for the `first`, that of a mounting by eye."""
    mount_rad, time_s = _FIRST if first else _SECOND
    residual = known.residual
    return msgspec.structs.replace(
        known,
        wearer=msgspec.UNSET,
        residual=msgspec.structs.replace(
            residual,
            camera_to_imu_rad=max(mount_rad, residual.camera_to_imu_rad if first else 0.0),
            time_s=max(time_s, residual.time_s if first else 0.0),
            baseline=max(_DISTANCES, residual.baseline_std),
        ),
    )


def stamped_later(known: Calibration, by_s: float) -> Calibration:
    """Return `known` with pictures that are taken `by_s` later than it says."""
    later_s = known.stereo.stamp_to_mid_exposure_s + by_s
    return msgspec.structs.replace(known, stereo=msgspec.structs.replace(known.stereo, stamp_to_mid_exposure_s=later_s))


def brought_near(known: Calibration, found: MountingErrors) -> Calibration:
    """Return `known` with (1) for the camera's angles and stamps."""
    R_BL = so3.exp(np.array(found.turn_B)) @ np.array(known.X_BL.R)
    turned = msgspec.structs.replace(known, X_BL=msgspec.structs.replace(known.X_BL, R=matrix3(R_BL)))
    return stamped_later(turned, found.lag_s)


def mounted(before: Calibration, near: Calibration, found: Found, where: str) -> Mounted:
    """Return what the second pass, begun at `near`, makes of the calibration `before`.

    Raises CalibrationError, one line that begins with `where`, where the camera has turned on its mount, or the walk
    has not told the angles to 0.1° and the stamps to 1 ms.
    """
    across = np.array(near.X_BL.R)[:, 0]
    turn_std: FloatArray = np.sqrt(np.diag(found.mounting.turn_covariance) + (_ACROSS_RAD * across) ** 2)
    lag_std = math.hypot(math.sqrt(found.mounting.lag_var), _PICTURES_S)
    if turn_std.max() > MOST_MOUNT_STD_RAD or lag_std > MOST_LAG_STD_S:
        angles = ", ".join(f"{math.degrees(std):.2f}" for std in turn_std)
        raise CalibrationError(
            f"{where}: refused: the walk tells the camera's angles about x, y, z of the IMU to ± {angles}° and its "
            f"stamps to ± {1e3 * lag_std:.1f} ms (1 σ), allowed {math.degrees(MOST_MOUNT_STD_RAD):g}° and "
            f"{1e3 * MOST_LAG_STD_S:g} ms: walk for a minute, with turns, and lean and twist while standing"
        )
    turned, half_std = _turned_since_halfway(found), np.sqrt(np.diag(found.halfway.turn_covariance))
    if (np.abs(turned) > _TURNED_SIGMAS * np.hypot(half_std, _ACROSS_RAD * across)).any():
        angles = ", ".join(f"{math.degrees(angle):+.2f}" for angle in turned)
        raise CalibrationError(
            f"{where}: refused: the camera's angles about x, y, z of the IMU are {angles}° from those that the first "
            "half of the walk tells: is the camera fixed to the IMU?"
        )
    made = brought_near(near, found.mounting)
    imu, residual = made.imu, _residual(before.residual, turn_std, lag_std)
    sensors = found.sensors
    w_bias = np.array(imu.w_bias_radps) + np.linalg.solve(np.array(imu.w_matrix), np.array(sensors.gyro_bias))
    imu = msgspec.structs.replace(imu, w_bias_radps=vec3(w_bias))
    sf_std = math.sqrt(max(sensors.sf_var))
    if sf_std < before.residual.specific_force_mps2:
        sf_bias = np.array(imu.sf_bias_mps2) + np.linalg.solve(np.array(imu.sf_matrix), np.array(sensors.sf_bias))
        imu = msgspec.structs.replace(imu, sf_bias_mps2=vec3(sf_bias))
        if math.isfinite(found.temperature_degC):
            imu = msgspec.structs.replace(imu, temperature_degC=round(found.temperature_degC, 2))
        residual = msgspec.structs.replace(residual, specific_force_mps2=sf_std)
    made = msgspec.structs.replace(made, imu=imu, residual=residual, wearer=before.wearer)
    scale, scale_std = found.mounting.scale, math.sqrt(found.mounting.scale_var)
    pair = pair_errors(made, scale, scale_std)
    made = made if pair is None else put_right(made, pair)
    turned = np.array(made.X_BL.R) @ np.array(before.X_BL.R).T
    return Mounted(
        calibration=made,
        turn_B=so3.log(turned),
        turn_std=turn_std,
        lag_s=made.stereo.stamp_to_mid_exposure_s - before.stereo.stamp_to_mid_exposure_s,
        lag_std=lag_std,
        scale=scale,
        scale_std=scale_std,
        pair=pair,
    )


def _turned_since_halfway(found: Found) -> FloatArray:
    return np.subtract(found.mounting.turn_B, found.halfway.turn_B)


def _residual(known: Residual, turn_std: FloatArray, lag_std: float) -> Residual:
    return msgspec.structs.replace(
        known,
        camera_to_imu_rad=float(turn_std.max()),
        time_s=lag_std,
    )

"""Where the camera stands in the IMU's axes, and when its pictures are taken: what the motion filter has learnt over a
minute of walking, taken over.

The filter's errors are small ones about a calibration, true = calibrated ⊕ error:

    R_BL ← exp(m) R_BL,   t ← t + λ,   b_w ← b_w + W⁻¹ δb,   b_f ← b_f + S⁻¹ δa                             (1)

m turns the camera in B, λ is how much later than stamped its pictures are, δb and δa what is left of both biases after
the calibration's matrices W and S. The walk is gone through twice: a camera that is off by degrees is brought near by
the first pass, and the second one starts there, wide enough not to believe the first.
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np

from calib.strict_yaml import CalibrationError
from messages import Calibration, Residual, matrix3, vec3
from messages.arrays import FloatArray
from perception import so3
from perception.attitude.filter import AttitudeSettings
from perception.attitude.sensor_errors import MountingErrors, SensorErrors
from perception.attitude.state import CameraStepSettings

RIGID = AttitudeSettings(camera=CameraStepSettings(mount_walk_rad_rts=math.radians(1e-6)))
"""The filter for a calibration: over a minute the camera does not turn on its mount, as it may over an hour."""
LEAST_S = 40.0
MOST_MOUNT_STD_RAD = math.radians(0.1)
MOST_LAG_STD_S = 1e-3
_FIRST = (math.radians(3.0), 0.01)
_SECOND = (math.radians(0.5), 2e-3)
"""By what the camera's angles (rad) and its stamps (s) may be off before each pass, 1 σ, at least."""
_DISTANCES = 0.01
"""By what distances may seem wrong meanwhile, 1 σ: angles and stamps that are off make them so."""
_ACROSS_RAD, _PICTURES_S = math.radians(0.03), 1.5e-4
"""What pictures leave beyond the filter's own deviation, 1 σ: of the camera's turn about the axis across its view, of
which the odometer errs alike from step to step while walking, and of its stamps. From told walks with the odometer's
errors on rendered ones (`python -m benchmarks.mounting`, seeds below 100)."""


BEGINNINGS_S = (0.0, -8e-3, 8e-3, -16e-3, 16e-3)
"""By what the stamps are taken to be off where the first pass begins, one after the other until camera and IMU agree:
stamps that are off by more than about 6 ms are a contradiction for the filter, and it learns nothing."""


class Found(NamedTuple):
    """What a pass over a walk has told: the errors of mounting and sensors at its end, of the calibration it ran with,
    and the die's mean temperature, °C."""

    mounting: MountingErrors
    sensors: SensorErrors
    temperature_degC: float


class Mounted(NamedTuple):
    """The new calibration; by how much the camera has turned in B (3,) rad from the old one and its stamps, s, with one
    standard deviation of each; the error of distances that was found, relative, with its deviation."""

    calibration: Calibration
    turn_B: FloatArray
    turn_std: FloatArray
    lag_s: float
    lag_std: float
    scale: float
    scale_std: float


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

    Raises CalibrationError, one line that begins with `where`, where the walk has not told the angles to 0.1° and the
    stamps to 1 ms.
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
    turned = np.array(made.X_BL.R) @ np.array(before.X_BL.R).T
    return Mounted(
        calibration=made,
        turn_B=so3.log(turned),
        turn_std=turn_std,
        lag_s=made.stereo.stamp_to_mid_exposure_s - before.stereo.stamp_to_mid_exposure_s,
        lag_std=lag_std,
        scale=sensors.scale,
        scale_std=math.sqrt(sensors.scale_var),
    )


def _residual(known: Residual, turn_std: FloatArray, lag_std: float) -> Residual:
    return msgspec.structs.replace(
        known,
        camera_to_imu_rad=float(turn_std.max()),
        time_s=lag_std,
    )

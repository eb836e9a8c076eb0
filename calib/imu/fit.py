"""The IMU's calibration from logs: what is supported goes into the file, the rest stays and is told."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np

from calib.imu.accelerometer import NAMES, AccelerometerFit, fit_accelerometer
from calib.imu.gyroscope import GyroscopeFit, fit_gyroscope
from calib.imu.log import ImuLog
from calib.imu.rests import Rest, find_rests
from calib.strict_yaml import CalibrationError
from messages import ImuCalibration, Residual, UserError, matrix3, vec3
from messages.arrays import FloatArray
from messages.constants import NORMAL_95, STANDARD_GRAVITY_MPS2

LEAST_RESTS = 3
GRAVITY_MPS2 = (9.76, 9.84)
USUAL_GRAVITY_STD = 0.015 / STANDARD_GRAVITY_MPS2
"""From place to place, as a share."""
TOLD_GRAVITY_STD = 1e-5
_TURN_ON_MPS2 = 0.5e-3 * STANDARD_GRAVITY_MPS2
"""An accelerometer's bias changes by so much from one power-up to the next, whatever was measured."""
_LEAST_SCALE = 2e-4
_GYRO_BIAS_STD = math.radians(0.3)
_AXES = "xyz"
WHAT_TO_DO = "rest the unit with each of its six faces up in turn, and in some poses between"


class Value(NamedTuple):
    """A calibrated number with its 95 % interval; `supported` where the poses or turns tell it."""

    value: float
    low: float
    high: float
    unit: str
    supported: bool


@dataclass(frozen=True)
class ImuFit:
    """Both sensors' fits and the rests they stem from. `gravity` is in the unit of the logs' accelerometer."""

    accelerometer: AccelerometerFit
    gyroscope: GyroscopeFit | None
    rests: tuple[Rest, ...]
    gravity: float
    in_counts: bool
    temperature_degC: float
    notes: tuple[str, ...]

    @property
    def values(self) -> dict[str, Value]:
        """Return all values with their intervals: biases in mg, scales and cross-axis terms as shares, in °/s."""
        found, acc, gyro = dict[str, Value](), self.accelerometer, self.gyroscope
        for k, name in enumerate(NAMES):
            unit, factor = ("mg", 1e3) if k < 3 else ("1", 1.0)
            value, half = factor * acc.values[k], factor * acc.half_width[k]
            found[f"acc.{name}"] = Value(
                float(value), float(value - half), float(value + half), unit, bool(acc.supported[k])
            )
        if gyro is None:
            return found
        for k, axis in enumerate(_AXES):
            value, half = math.degrees(gyro.bias[k]), NORMAL_95 * math.degrees(gyro.bias_std[k])
            found[f"gyro.bias_{axis}"] = Value(value, value - half, value + half, "°/s", True)
        for i, j in np.ndindex(3, 3):
            name = f"gyro.scale_{_AXES[i]}" if i == j else f"gyro.cross_{_AXES[i]}{_AXES[j]}"
            value, half = float(gyro.matrix[i, j] - (i == j)), float(gyro.matrix_half_width[i, j])
            found[name] = Value(value, value - half, value + half, "1", bool(gyro.supported[i, j]))
        return found

    @property
    def unsupported(self) -> list[str]:
        """Return, a line each, what the poses and turns do not tell, and what would."""
        acc, faces, lines = self.accelerometer, self.accelerometer.faces, list[str]()
        for k, axis in enumerate(_AXES):
            if not acc.axes_supported[k]:
                missing = [face for face in (f"+{axis}", f"-{axis}") if not faces[face]]
                why = f"never rested with {' or '.join(missing)} up" if missing else "too few poses"
                lines.append(f"accelerometer {axis}: bias and scale are not told apart: {why}")
        cross = [name for name, good in zip(NAMES[6:], acc.supported[6:], strict=True) if not good]
        if cross:
            lines.append(f"accelerometer {', '.join(cross)}: rest in poses between the faces too")
        if self.gyroscope is not None:
            for k, axis in enumerate(_AXES):
                if not self.gyroscope.supported[k, k]:
                    lines.append(
                        f"gyroscope scale {axis}: turn by 90° and more about {axis}, held level, between two rests"
                    )
        return lines


def fit_imu(logs: Sequence[ImuLog], where: str, *, gravity_mps2: float | None = None) -> ImuFit:
    """Return what logs of resting poses tell. Raises UserError, its line beginning with `where`, for too few rests."""
    if gravity_mps2 is not None and not GRAVITY_MPS2[0] <= gravity_mps2 <= GRAVITY_MPS2[1]:
        raise UserError(f"gravity is {gravity_mps2:g} m/s², allowed {GRAVITY_MPS2[0]:g} to {GRAVITY_MPS2[1]:g}")
    rests = find_rests(logs)
    if len(rests) < LEAST_RESTS:
        raise UserError(f"{where}: {len(rests)} rests of a second and more, allowed from {LEAST_RESTS}: {WHAT_TO_DO}")
    bursts = sum(log.in_bursts for log in logs)
    notes = list(dict.fromkeys(note for log in logs for note in log.notes))
    if bursts:
        notes.append(f"samples came in bursts in {bursts} of {len(logs)} logs: their stamps were put on a line")
    scaled = {log.acc_is_scaled for log in logs}
    if len(scaled) > 1:
        raise UserError(f"{where}: some logs are in counts, some in units; tell --acc-per-g")
    in_counts = not scaled.pop()
    gravity = STANDARD_GRAVITY_MPS2 if gravity_mps2 is None else gravity_mps2
    if in_counts:
        gravity = _gravity_in_counts(rests)
        notes.append(
            f"accelerometer in counts: one g is taken as {gravity:.1f} of them, and its scale relative to that"
        )
    gravity_std = TOLD_GRAVITY_STD if in_counts or gravity_mps2 is not None else USUAL_GRAVITY_STD
    accelerometer = fit_accelerometer(rests, gravity, gravity_std)
    usable = accelerometer.on_supported_axes
    gyroscope = fit_gyroscope(logs, rests, accelerometer.directions, usable)
    if gyroscope is not None and gyroscope.signs is not None:
        signs = ",".join(("" if sign > 0.0 else "-") + axis for sign, axis in zip(gyroscope.signs, _AXES, strict=True))
        notes.append(f"the accelerometer's and the gyroscope's axes are mirrored: tell --acc-axes {signs}")
    weights = np.array([rest.seconds for rest in rests])
    temperature = float(weights @ np.array([rest.temperature_degC for rest in rests]) / weights.sum())
    return ImuFit(accelerometer, gyroscope, tuple(rests), gravity, in_counts, temperature, tuple(notes))


def _gravity_in_counts(rests: list[Rest]) -> float:
    """Return the radius of the sphere through the rests' means, in counts; of few rests, or in a plane, their median
    length."""
    means = np.array([rest.sf for rest in rests])
    length = float(np.median(np.linalg.norm(means, axis=1)))
    # |m|² = 2 m·c + (r² − |c|²)
    A = np.column_stack((2.0 * means, np.full(len(means), length)))
    solved, _, rank, _ = np.linalg.lstsq(A, (means**2).sum(axis=1), rcond=1e-3)
    radius2 = float(solved[3] * length + solved[:3] @ solved[:3])
    return math.sqrt(radius2) if rank == 4 and radius2 > 0.0 and len(rests) > 5 else length


def with_imu(known: ImuCalibration, residual: Residual, fit: ImuFit, where: str) -> tuple[ImuCalibration, Residual]:
    """Return `known` and its residual with what the fit supports in their places.

    Raises CalibrationError, one line, where it supports nothing, or the log's scale is not the chip's.
    """
    acc, gyro = fit.accelerometer, fit.gyroscope
    if fit.in_counts:
        raise CalibrationError(f"{where}: the log is in counts of unknown size; tell --acc-per-g and --gyro-per-dps")
    if not acc.axes_supported.any():
        raise CalibrationError(f"{where}: refused: the rests tell no axis's bias and scale apart: {WHAT_TO_DO}")
    matrix, bias = np.array(known.sf_matrix), np.array(known.sf_bias_mps2)
    axes = np.diag_indices(3)
    good = acc.axes_supported
    bias[good] = acc.bias[good]
    matrix[axes] = np.where(good, acc.matrix[axes], matrix[axes])
    for (i, j), told in zip(((0, 1), (0, 2), (1, 2)), acc.supported[6:], strict=True):
        if told:
            matrix[i, j] = matrix[j, i] = acc.matrix[i, j]
    w_matrix, w_bias = np.array(known.w_matrix), np.array(known.w_bias_radps)
    if gyro is not None:
        w_bias = np.where(gyro.bias_std < _GYRO_BIAS_STD, gyro.bias, w_bias)
        w_matrix = np.where(gyro.supported, gyro.matrix, w_matrix)
    imu = replace_imu(known, matrix, bias, w_matrix, w_bias, fit.temperature_degC)
    return imu, _residual(residual, fit)


def replace_imu(
    known: ImuCalibration,
    sf_matrix: FloatArray,
    sf_bias: FloatArray,
    w_matrix: FloatArray,
    w_bias: FloatArray,
    temperature_degC: float,
) -> ImuCalibration:
    """Return `known` with other values; a temperature that is NaN leaves its own."""
    made = msgspec.structs.replace(
        known,
        sf_matrix=matrix3(sf_matrix),
        sf_bias_mps2=vec3(sf_bias),
        w_matrix=matrix3(w_matrix),
        w_bias_radps=vec3(w_bias),
    )
    if math.isfinite(temperature_degC):
        made = msgspec.structs.replace(made, temperature_degC=round(temperature_degC, 2))
    return made


def _residual(known: Residual, fit: ImuFit) -> Residual:
    acc, gyro = fit.accelerometer, fit.gyroscope
    good = acc.axes_supported
    force = max(_TURN_ON_MPS2, float(acc.std[:3][good].max()) * fit.gravity)
    terms = [_LEAST_SCALE, *acc.std[3:][acc.supported[3:]].tolist()]
    if gyro is not None:
        terms += gyro.matrix_std[gyro.supported].tolist()
    whole = bool(acc.supported[3:].all()) and gyro is not None and bool(gyro.supported.all())
    return msgspec.structs.replace(
        known,
        specific_force_mps2=force if good.all() else max(force, known.specific_force_mps2),
        scale=max(terms) if whole else max(*terms, known.scale),
    )

"""A recording of an IMU beside a reference motion: a folder of two plain files.

`imu.csv` holds what the IMU read, in its own axes; `reference.csv` what cameras saw: q takes sensor to world, z up, and
p is the sensor, in the world; NaN where they lost it. Both are stamped by the same clock, as well as the laboratory
knows. A column `temperature_degC` of imu.csv is the chip's temperature.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from impedance.recording.table import read_columns, write_columns
from messages.arrays import BoolArray, FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from messages.errors import UserError

IMU_FILE: Final = "imu.csv"
REFERENCE_FILE: Final = "reference.csv"
W_COLUMNS: Final = ("gx_radps", "gy_radps", "gz_radps")
SF_COLUMNS: Final = ("ax_mps2", "ay_mps2", "az_mps2")
IMU_COLUMNS: Final = ("t_s", *W_COLUMNS, *SF_COLUMNS)
TEMPERATURE_COLUMN: Final = "temperature_degC"
REFERENCE_COLUMNS: Final = ("t_s", "qw", "qx", "qy", "qz", "px_m", "py_m", "pz_m")

LEAST_S: Final = 5.0
"""Of a recording: a shorter one has hardly more than its ends, which are left out."""
LEAST_HZ: Final = 20.0
"""Of the stamps' rate: human motion reaches to 10 Hz."""
MOST_W_RADPS: Final = 90.0
"""Of a turning rate: beyond the widest common ranges, 70 rad/s; a walk in degrees per second is beyond it."""
MOST_SF_MPS2: Final = 4000.0
"""Of a specific force: the widest shock sensors' range, 400 g."""
MOST_M: Final = 100.0
"""Of a position: no camera room is as large; in mm most are."""
MOST_DEGC: Final = 200.0
"""Of a temperature, either way: no chip works beyond."""
LEAST_SF_MPS2: Final = 5.0
"""Of a specific force's norm, the median: one in g, or without gravity, lies below. Nothing lies above: a loose mount
that rings reads several g, and what holds too much of gravity fails in the world."""
_SHORTEST_STEP: Final = 0.2
"""Of the median step of the stamps."""
_MOST_SEEN_AWAY: Final = 0.5
"""Share of the reference that may be missing."""
_NORM_TOLERANCE: Final = 0.02
"""Of a quaternion's norm: two digits of each part leave less."""
_UP_TOLERANCE_MPS2: Final = 5.0
"""Of the mean specific force in the world: half of gravity, which a wrong convention of q misses by more."""


@dataclass(frozen=True, eq=False)
class ImuRecording:
    """`w_radps` (n, 3) and `sf_mps2` (n, 3) in the sensor's axes at the stamps `t_s` (n,); `temperature_degC` (n,).

    The reference, at its own stamps `reference_t_s` (m,): unit quaternions `q_WS` (m, 4; w, x, y, z) and positions
    `p_W_m` (m, 3), NaN where the cameras lost the sensor.
    """

    t_s: FloatArray
    w_radps: FloatArray
    sf_mps2: FloatArray
    reference_t_s: FloatArray
    q_WS: FloatArray
    p_W_m: FloatArray
    temperature_degC: FloatArray | None = None

    @staticmethod
    def load(folder: Path) -> "ImuRecording":
        """Read and check a recording; raises UserError with one line for what is missing, or cannot be."""
        imu_path, reference_path = folder / IMU_FILE, folder / REFERENCE_FILE
        imu = read_columns(imu_path, IMU_COLUMNS)
        temperature = _temperature(imu_path)
        told = np.isfinite(imu[:, 1:]).all(axis=1)
        _check_stamps(imu_path, imu[:, 0])
        if told.mean() < _MOST_SEEN_AWAY:
            raise UserError(f"{imu_path}: {100.0 * (1.0 - told.mean()):.0f} % of the rows hold no number, allowed 50 %")
        _check_range(imu_path, imu[:, 1:4], W_COLUMNS, MOST_W_RADPS, "rad/s: is it in degrees?")
        _check_range(imu_path, imu[:, 4:], SF_COLUMNS, MOST_SF_MPS2, "m/s²")
        _check_gravity(imu_path, imu[told, 4:])
        reference = read_columns(reference_path, REFERENCE_COLUMNS)
        _check_stamps(reference_path, reference[:, 0])
        _check_range(reference_path, reference[:, 5:], REFERENCE_COLUMNS[5:], MOST_M, "m: is it in mm?")
        q_WS = _unit(reference_path, reference[:, 1:5])
        for columns, values in (("qw to qz", q_WS), ("px_m to pz_m", reference[:, 5:])):
            lost = float(1.0 - np.isfinite(values).all(axis=1).mean())
            if lost > _MOST_SEEN_AWAY:
                raise UserError(f"{reference_path}: {columns}: {100.0 * lost:.0f} % of the rows are NaN, allowed 50 %")
        overlap_s = min(imu[-1, 0], reference[-1, 0]) - max(imu[0, 0], reference[0, 0])
        if overlap_s < LEAST_S:
            raise UserError(f"{reference_path}: t_s overlaps {IMU_FILE} by {overlap_s:.3g} s, allowed {LEAST_S:g} s up")
        _check_up(reference_path, imu[told], reference[:, 0], q_WS)
        return ImuRecording(
            t_s=imu[told, 0],
            w_radps=imu[told, 1:4],
            sf_mps2=imu[told, 4:],
            reference_t_s=reference[:, 0],
            q_WS=q_WS,
            p_W_m=reference[:, 5:],
            temperature_degC=None if temperature is None else temperature[told],
        )

    def save(self, folder: Path) -> None:
        """Write the two files; raises UserError where it cannot."""
        columns: tuple[str, ...] = IMU_COLUMNS
        imu = np.column_stack((self.t_s, self.w_radps, self.sf_mps2))
        if self.temperature_degC is not None:
            columns, imu = (*columns, TEMPERATURE_COLUMN), np.column_stack((imu, self.temperature_degC))
        write_columns(folder / IMU_FILE, columns, imu)
        write_columns(
            folder / REFERENCE_FILE, REFERENCE_COLUMNS, np.column_stack((self.reference_t_s, self.q_WS, self.p_W_m))
        )


def _temperature(path: Path) -> FloatArray | None:
    """Return the column of temperatures (n,) without NaN; None where the file has none."""
    with path.open(encoding="utf-8-sig") as file:
        if TEMPERATURE_COLUMN not in [name.strip() for name in file.readline().split(",")]:
            return None
    values = read_columns(path, (TEMPERATURE_COLUMN,))[:, 0]
    there = np.isfinite(values)
    if not there.any() or np.abs(values[there]).max() > MOST_DEGC:
        raise UserError(f"{path}: {TEMPERATURE_COLUMN}: allowed {-MOST_DEGC:g} to {MOST_DEGC:g} °C")
    return np.interp(np.arange(len(values)), np.flatnonzero(there), values[there])


def _check_stamps(path: Path, t_s: FloatArray) -> None:
    if not np.isfinite(t_s).all():
        raise UserError(f"{path}: row {_row(~np.isfinite(t_s))}: t_s is not a number")
    steps_s = np.diff(t_s)
    if not (steps_s > 0.0).all():
        raise UserError(f"{path}: row {_row(steps_s <= 0.0) + 1}: t_s does not increase")
    if t_s[-1] - t_s[0] < LEAST_S:
        raise UserError(f"{path}: lasts {t_s[-1] - t_s[0]:.3g} s, allowed {LEAST_S:g} s or more")
    median_s = float(np.median(steps_s))
    if median_s * LEAST_HZ > 1.0:
        raise UserError(f"{path}: t_s runs at {1.0 / median_s:.4g} Hz, allowed {LEAST_HZ:g} Hz or more")
    if float(steps_s.min()) < _SHORTEST_STEP * median_s:
        raise UserError(
            f"{path}: row {int(steps_s.argmin()) + 3}: t_s is {steps_s.min() / median_s:.2g} of the median step after "
            f"the row before, allowed {_SHORTEST_STEP:g} or more"
        )


def _check_range(path: Path, values: FloatArray, columns: tuple[str, ...], most: float, unit: str) -> None:
    beyond = np.abs(values) > most
    if beyond.any():
        row, column = np.argwhere(beyond)[0]
        raise UserError(
            f"{path}: row {row + 2}: {columns[column]} is {values[row, column]:.6g}, allowed ±{most:g} {unit}"
        )


def _check_gravity(path: Path, sf_mps2: FloatArray) -> None:
    norm = float(np.median(np.linalg.norm(sf_mps2, axis=1)))
    if norm < LEAST_SF_MPS2:
        raise UserError(
            f"{path}: ax_mps2 to az_mps2: their median norm is {norm:.3g}, allowed {LEAST_SF_MPS2:g} m/s² or more: "
            "is it in g, or is gravity taken away?"
        )


def _unit(path: Path, q: FloatArray) -> FloatArray:
    norm = np.linalg.norm(q, axis=1)
    wrong = np.abs(norm - 1.0) > _NORM_TOLERANCE
    if wrong.any():
        row = int(np.argmax(wrong))
        raise UserError(f"{path}: row {row + 2}: qw to qz have the norm {norm[row]:.4g}, allowed 1 ± {_NORM_TOLERANCE}")
    unit: FloatArray = q / norm[:, None]
    return unit


def _check_up(path: Path, imu: FloatArray, reference_t_s: FloatArray, q_WS: FloatArray) -> None:
    """Refuse a q that takes the mean of what the accelerometer read anywhere but up."""
    seen = np.flatnonzero(np.isfinite(q_WS).all(axis=1))
    at = imu[np.searchsorted(imu[:, 0], reference_t_s[seen]).clip(0, len(imu) - 1), 4:]
    w, v = q_WS[seen, :1], q_WS[seen, 1:]
    in_world = at + 2.0 * np.cross(v, np.cross(v, at) + w * at)
    x, y, z = in_world.mean(axis=0)
    if np.linalg.norm((x, y, z - STANDARD_GRAVITY_MPS2)) > _UP_TOLERANCE_MPS2:
        raise UserError(
            f"{path}: qw to qz turn the mean of the accelerometer to ({x:.1f}, {y:.1f}, {z:.1f}) m/s², allowed "
            f"(0, 0, 9.8) ± {_UP_TOLERANCE_MPS2:g}: q must take sensor to world, z up"
        )


def _row(flags: BoolArray) -> int:
    """Return the row of the file, its header being row 1, of the first flag."""
    return int(np.argmax(flags)) + 2

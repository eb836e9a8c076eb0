"""Logs of an IMU to calibrate it from: recordings, EuRoC folders, tables and arrays, in nominal units or in counts.

Stamps of a host that gets samples in bursts are put on a straight line: the chip samples evenly, its buffer does not.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.imu.tables import LEAST_HZ, Channels, read_table
from drivers.recording.asl_folder import AslFolder
from drivers.recording.recording import McapRecording
from messages import ImuSample, UserError
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2

RATES_HZ = (LEAST_HZ, 20_000.0)
_LEAST_SAMPLES = 100
_BURST = 0.5
"""A median step below this share of the mean one tells bursts."""
_TABLES = (".csv", ".csv.gz", ".tsv", ".npz")
_TEXTS = (".txt", ".txt.gz", ".dat", ".log", ".mat")
"""Tables too, where one is named; in a folder they may be anything."""


@dataclass(frozen=True)
class Units:
    """What counts mean: of both sensors how many are one g, or one °/s, and what reads zero; None where not known.

    `axes` tells which of the log's axes are B's, as (0, 1, 2) and signs, for the accelerometer: some logs have one of
    its axes turned against the gyroscope's.
    """

    acc_per_g: float | None = None
    gyro_per_dps: float | None = None
    acc_zero: float | None = None
    gyro_zero: float | None = None
    signs: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class ImuLog:
    """Samples as the chip tells them, before any calibration: t_s (n,), sf (n, 3) m/s², w (n, 3) rad/s, temperature
    (n,) °C, NaN where it is not known.

    `acc_is_scaled` and `gyro_is_scaled` tell whether the counts' scale is known; if not, counts stand there.
    `in_bursts` tells that stamps were put on a line, `notes` what had to be assumed of a table.
    """

    name: str
    t_s: FloatArray
    sf: FloatArray
    w: FloatArray
    temperature_degC: FloatArray
    acc_is_scaled: bool = True
    gyro_is_scaled: bool = True
    in_bursts: bool = False
    notes: tuple[str, ...] = ()

    @property
    def rate_hz(self) -> float:
        """Return the mean rate of the samples."""
        return (len(self.t_s) - 1) / float(self.t_s[-1] - self.t_s[0])


def read_logs(sources: Iterable[Path], units: Units) -> list[ImuLog]:
    """Return the logs of recordings, folders and tables. Raises UserError, one line, where one cannot be used."""
    return [sound(log) for source in sources for log in _logs(source, units)]


def log_of_samples(samples: Iterable[ImuSample], name: str) -> ImuLog:
    """Return the log of samples of a recording or a device. Raises UserError where they are none."""
    kept = [sample for sample in samples if not sample.clipped]
    if len(kept) < _LEAST_SAMPLES:
        raise UserError(f"{name}: holds {len(kept)} IMU samples that are not clipped, allowed from {_LEAST_SAMPLES}")
    t_ns = np.array([sample.t_sample_ns for sample in kept], dtype=np.int64)
    return ImuLog(
        name,
        (t_ns - t_ns[0]).astype(np.float64) * 1e-9,
        np.array([sample.sf_B_mps2 for sample in kept]),
        np.array([sample.w_WB_B_radps for sample in kept]),
        np.array([sample.temperature_degC for sample in kept]),
    )


def _logs(source: Path, units: Units) -> Iterator[ImuLog]:
    if not source.exists():
        raise UserError(f"{source}: no such file or folder")
    if source.is_dir() and any(True for place in ("imu0*", "mav0/imu0*") for _ in source.glob(place)):
        inputs = AslFolder(source).inputs()
        yield log_of_samples((each for each in inputs if isinstance(each, ImuSample)), str(source))
    elif source.is_dir():
        tables = sorted(path for path in source.iterdir() if path.name.endswith(_TABLES))
        if not tables:
            raise UserError(f"{source}: holds no log; allowed are {', '.join(_TABLES)}, or a EuRoC folder")
        for path in tables:
            yield _table(path, units)
    elif source.name.endswith(_TABLES + _TEXTS):
        yield _table(source, units)
    else:
        inputs = McapRecording(source).inputs()
        yield log_of_samples((each for each in inputs if isinstance(each, ImuSample)), str(source))


def _table(path: Path, units: Units) -> ImuLog:
    table = read_table(path)
    sf, acc_is_scaled = _scaled(table.acc, units.acc_per_g, units.acc_zero, STANDARD_GRAVITY_MPS2)
    w, gyro_is_scaled = np.zeros_like(sf), False
    if table.gyro is not None:
        w, gyro_is_scaled = _scaled(table.gyro, units.gyro_per_dps, units.gyro_zero, math.radians(1.0))
    return ImuLog(
        str(path),
        table.t_s,
        sf * np.array(units.signs),
        w,
        table.temperature_degC,
        acc_is_scaled,
        gyro_is_scaled,
        notes=table.notes,
    )


def _scaled(channels: Channels, per_unit: float | None, zero: float | None, unit: float) -> tuple[FloatArray, bool]:
    """Return the three axes (n, 3) and whether they are in SI units."""
    if math.isfinite(channels.factor):
        return channels.values * channels.factor, True
    counts = channels.values - (0.0 if zero is None else zero)
    return (counts, False) if per_unit is None else (counts * unit / per_unit, True)


def sound(log: ImuLog) -> ImuLog:
    """Return the log with even stamps where they came in bursts. Raises UserError where it cannot be used."""
    good = np.isfinite(log.t_s) & np.isfinite(log.sf).all(axis=1) & np.isfinite(log.w).all(axis=1)
    if not good.all():
        log = replace(
            log,
            t_s=log.t_s[good],
            sf=log.sf[good],
            w=log.w[good],
            temperature_degC=log.temperature_degC[good],
        )
    if len(log.t_s) < _LEAST_SAMPLES:
        raise UserError(f"{log.name}: holds {len(log.t_s)} samples, allowed from {_LEAST_SAMPLES}")
    steps = np.diff(log.t_s)
    if (steps < 0.0).any():
        raise UserError(f"{log.name}: time goes back at sample {int(np.argmax(steps < 0.0)) + 1}")
    if not log.t_s[-1] > log.t_s[0]:
        raise UserError(f"{log.name}: time does not rise")
    low_hz, high_hz = RATES_HZ
    if not low_hz <= log.rate_hz <= high_hz:
        raise UserError(f"{log.name}: {log.rate_hz:.3g} samples a second, allowed {low_hz:g} to {high_hz:g}")
    if np.median(steps) >= _BURST * steps.mean():
        return log
    even = np.arange(len(log.t_s), dtype=np.float64)
    slope, first = np.polyfit(even, log.t_s, 1)
    return replace(log, t_s=first + slope * even, in_bursts=True)

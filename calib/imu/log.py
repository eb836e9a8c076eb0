"""Logs of an IMU to calibrate it from: recordings, EuRoC folders, tables and arrays, in nominal units or in counts.

A table (`.csv`, also gzipped) has a line of names; NPZ files hold arrays under the same names, `acc` and `gyr` (n, 3):

    t_s or t_ns                 time
    ax ay az, gx gy gz          with what they are in behind them: _mps2, _g; _radps, _dps; _raw or nothing for counts
    temp_degC                   the die's temperature, if it is known

`acc_` and `gyr_` with x, y, z are the same names. Stamps of a host that gets samples in bursts are put on a straight
line: the chip samples evenly, its buffer does not.
"""

import gzip
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from drivers.recording.asl_folder import AslFolder
from drivers.recording.recording import McapRecording
from messages import ImuSample, UserError
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2

RATES_HZ = (5.0, 20_000.0)
_LEAST_SAMPLES = 100
_BURST = 0.5
"""A median step below this share of the mean one tells bursts."""
_NAME = re.compile(r"^(?:a|acc_?|accel_?|sf_?)([xyz])(?=_|$)|^(?:g|gyr_?|gyro_?|w_?)([xyz])(?=_|$)")
_UNITS = {
    "mps2": 1.0,
    "g": STANDARD_GRAVITY_MPS2,
    "mg": 1e-3 * STANDARD_GRAVITY_MPS2,
    "radps": 1.0,
    "dps": math.radians(1.0),
    "degps": math.radians(1.0),
}
_TIMES = {"t_s": 1.0, "time_s": 1.0, "t_ns": 1e-9, "#timestamp [ns]": 1e-9}
_TABLES = (".csv", ".csv.gz", ".npz")


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
    `in_bursts` tells that stamps were put on a line.
    """

    name: str
    t_s: FloatArray
    sf: FloatArray
    w: FloatArray
    temperature_degC: FloatArray
    acc_is_scaled: bool = True
    gyro_is_scaled: bool = True
    in_bursts: bool = False

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
    elif source.name.endswith(_TABLES):
        yield _table(source, units)
    else:
        inputs = McapRecording(source).inputs()
        yield log_of_samples((each for each in inputs if isinstance(each, ImuSample)), str(source))


def _table(path: Path, units: Units) -> ImuLog:
    columns = _npz(path) if path.suffix == ".npz" else _csv(path)
    time = next((name for name in columns if name in _TIMES), None)
    if time is None:
        raise UserError(f"{path}: column t_s is missing; there are {', '.join(columns) or 'none'}")
    axes: dict[str, dict[str, tuple[FloatArray, str]]] = {"a": {}, "g": {}}
    for name, values in columns.items():
        found = _NAME.match(name)
        if found is not None:
            kind, axis = ("a", found[1]) if found[1] else ("g", found[2])
            axes[kind][axis] = values, name[found.end() :].lstrip("_")
    if set(axes["a"]) != set("xyz"):
        raise UserError(f"{path}: columns ax, ay, az are missing; there are {', '.join(columns)}")
    t_s = columns[time] * _TIMES[time]
    if time.endswith(("ns", "[ns]")):
        t_s = (columns[time] - columns[time][0]) * 1e-9
    sf, acc_is_scaled = _scaled(axes["a"], units.acc_per_g, units.acc_zero, STANDARD_GRAVITY_MPS2)
    w, gyro_is_scaled = np.zeros_like(sf), False
    if set(axes["g"]) == set("xyz"):
        w, gyro_is_scaled = _scaled(axes["g"], units.gyro_per_dps, units.gyro_zero, math.radians(1.0))
    temperature = columns.get("temp_degC", columns.get("temperature_degC"))
    if temperature is None:
        temperature = np.full(len(t_s), math.nan, dtype=np.float64)
    return ImuLog(str(path), t_s, sf * np.array(units.signs), w, temperature, acc_is_scaled, gyro_is_scaled)


def _scaled(
    axes: dict[str, tuple[FloatArray, str]], per_unit: float | None, zero: float | None, unit: float
) -> tuple[FloatArray, bool]:
    """Return the three axes (n, 3) and whether they are in SI units."""
    values = np.stack([axes[axis][0] for axis in "xyz"], axis=-1)
    told = {axes[axis][1] for axis in "xyz"}
    factors = {_UNITS[name] for name in told if name in _UNITS}
    if len(factors) == 1 and told <= set(_UNITS):
        return values * factors.pop(), True
    counts = values - (0.0 if zero is None else zero)
    return (counts, False) if per_unit is None else (counts * unit / per_unit, True)


def _csv(path: Path) -> dict[str, FloatArray]:
    opened = gzip.open if path.name.endswith(".gz") else open
    try:
        with opened(path, "rt", encoding="utf-8") as file:
            names = [name.strip() for name in file.readline().lstrip("#").split(",")]
            values = np.loadtxt(file, delimiter=",", ndmin=2)
    except (OSError, EOFError, UnicodeDecodeError, ValueError) as error:
        raise UserError(f"{path}: no table of numbers: {' '.join(str(error).split())}") from error
    if values.shape[1] != len(names):
        raise UserError(f"{path}: its first line has {len(names)} names, its rows {values.shape[1]} numbers")
    return {name: values[:, k] for k, name in enumerate(names)}


def _npz(path: Path) -> dict[str, FloatArray]:
    found = dict[str, FloatArray]()
    try:
        with np.load(path, allow_pickle=False) as arrays:
            for name in arrays.files:
                array = arrays[name]
                if array.ndim == 2 and array.shape[1] == 3 and _NAME.match(f"{name[0]}x"):
                    kind, _, unit = name.partition("_")
                    found |= {f"{kind[:3]}_{axis}_{unit}": array[:, k].astype(float) for k, axis in enumerate("xyz")}
                elif array.ndim == 1:
                    found[name] = array.astype(float)
    except (OSError, ValueError, BadZipFile) as error:
        raise UserError(f"{path}: no NPZ file of arrays: {error}") from error
    return found


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

"""Tables and arrays of IMU samples as other programs write them: which column is what, and in which unit.

    t, time, timestamp, …       in s, ms, µs or ns; where no unit is told, in the largest that makes it 5 Hz and more
    ax ay az, gx gy gz          or acc, accel, linear_acceleration, a_RS_S …; gyr, gyro, angular_velocity, w_RS_S …
                                with the axis behind; the unit behind that, or in brackets; without one, counts
    temp_degC                   the die's temperature, if it is known

Text may have commas, semicolons, tabs or blanks between its columns, remarks before the line of names, and columns of
words. Numbers without names are taken for time, accelerometer and gyroscope where they are four or seven.
"""

import gzip
import io
import math
import re
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np

from messages import UserError
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2

LEAST_HZ = 5.0
_UNITS = {
    "mps2": (1.0, "mps2 m/s2 m/s/s ms-2 ms2 m/s^2"),
    "g": (STANDARD_GRAVITY_MPS2, "g gs"),
    "mg": (1e-3 * STANDARD_GRAVITY_MPS2, "mg millig"),
    "radps": (1.0, "radps rad/s rads-1 rads"),
    "dps": (math.radians(1.0), "dps degps deg/s degs-1 degs °/s degrees/s"),
    "mdps": (math.radians(1e-3), "mdps mdeg/s"),
}
_FACTORS = {spelling: factor for factor, spellings in _UNITS.values() for spelling in spellings.split()}
_ACC = r"a|acc|accel|acceleration|accelerometer|linear_acc|linear_accel|linear_acceleration|sf|a_rs_s"
_GYRO = r"g|gyr|gyro|gyroscope|w|omega|rate|ang_vel|angular_vel|angular_velocity|angular_rate|w_rs_s"
_SENSORS = f"{_ACC}|{_GYRO}".split("|")
_CHANNEL = re.compile(rf"^(?:.*_)??(?:(?P<acc>{_ACC})|(?P<gyro>{_GYRO}))_?(?P<axis>[xyz])(?:_(?P<unit>.*))?$")
_TIME = re.compile(
    r"^(?:.*_)?(?:t|time|timestamps?|time_?stamp|stamp|ts|elapsed|epoch|secs?|seconds)(?:_elapsed)?(?:_(?P<unit>.*))?$"
)
_SECONDS = {
    "s": 1.0,
    "sec": 1.0,
    "seconds": 1.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "us": 1e-6,
    "usec": 1e-6,
    "ns": 1e-9,
    "nsec": 1e-9,
}
_BRACKET = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*$")
_DELIMITERS = (",", ";", "\t", None)
_WITHOUT_NAMES = {4: ("t", "ax", "ay", "az"), 7: ("t", "ax", "ay", "az", "gx", "gy", "gz")}
_REMARKS = "#%/ \t"


class Channels(NamedTuple):
    """Three axes (n, 3) of a sensor in its own numbers, and what one of them is in SI; NaN where it is not told."""

    values: FloatArray
    factor: float


class Table(NamedTuple):
    """What a table holds: times (n,) s, from its first row on, both sensors, the gyroscope if it is there, the die's
    temperature (n,) °C, NaN where it is not known; and what had to be assumed."""

    t_s: FloatArray
    acc: Channels
    gyro: Channels | None
    temperature_degC: FloatArray
    notes: tuple[str, ...]


def read_table(path: Path) -> Table:
    """Return the samples of a table (.npz, or text, also gzipped). Raises UserError, one line."""
    columns, notes = (_npz(path), []) if path.suffix == ".npz" else _text(path)
    if not columns or not len(next(iter(columns.values()))):
        raise UserError(f"{path}: no table of numbers: it has no row")
    t_s = _time(path, columns, notes)
    found: dict[str, dict[str, tuple[FloatArray, str]]] = {"a": {}, "g": {}}
    for name, values in columns.items():
        base, unit = _told(name)
        channel = _CHANNEL.match(base)
        if channel is not None:
            kind = "a" if channel["acc"] else "g"
            found[kind].setdefault(channel["axis"], (values, unit or channel["unit"] or ""))
    acc, gyro = (_channels(found[kind]) for kind in "ag")
    if acc is None:
        raise UserError(f"{path}: columns ax, ay, az are missing; there are {', '.join(columns)}")
    acc = _by_gravity(acc, notes)
    if gyro is not None:
        gyro = _by_size(gyro, acc, notes)
    degC = next((columns[name] for name in columns if _told(name)[0].startswith("temp")), None)
    if degC is None:
        degC = np.full(len(t_s), math.nan)
    return Table(t_s, acc, gyro, degC, tuple(notes))


def _told(name: str) -> tuple[str, str]:
    """Return a column's name with nothing but small letters and _, and its unit, where it stands in brackets."""
    bracket = _BRACKET.match(name)
    base, unit = (bracket["name"], bracket["unit"]) if bracket else (name, "")
    base = re.sub(r"[\s.\-/:]+", "_", base.strip(_REMARKS + "\"'").lower())
    return base, unit


def _factor(unit: str) -> float:
    """Return what one is in SI; NaN for counts and what is not known."""
    plain = unit.lower().replace("²", "2").replace("μ", "u").replace("µ", "u")
    for gone in (" ", "_", "*", "^"):
        plain = plain.replace(gone, "")
    return _FACTORS.get(plain, math.nan)


def _channels(axes: dict[str, tuple[FloatArray, str]]) -> Channels | None:
    if set(axes) != set("xyz"):
        return None
    factors = {_factor(axes[axis][1]) for axis in "xyz"}
    factor = factors.pop() if len(factors) == 1 else math.nan
    return Channels(np.stack([axes[axis][0] for axis in "xyz"], axis=-1), factor)


def _by_gravity(acc: Channels, notes: list[str]) -> Channels:
    """Return the accelerometer with the unit that gravity tells, where none is told and the numbers are no counts."""
    if math.isfinite(acc.factor) or not _has_fractions(acc.values):
        return acc
    length = float(np.nanmedian(np.linalg.norm(acc.values, axis=1)))
    for unit, name in (("mps2", "m/s²"), ("g", "g")):
        factor = _UNITS[unit][0]
        if abs(length * factor / STANDARD_GRAVITY_MPS2 - 1.0) < 0.1:
            notes.append(f"no unit is told: ax, ay, az are taken for {name}, as their length is {length:.3g}")
            return acc._replace(factor=factor)
    return acc


def _by_size(gyro: Channels, acc: Channels, notes: list[str]) -> Channels:
    """Return the gyroscope with the unit that fits turns by hand, where none is told and the numbers are no counts."""
    if math.isfinite(gyro.factor) or not _has_fractions(gyro.values) or not math.isfinite(acc.factor):
        return gyro
    most = float(np.nanpercentile(np.abs(gyro.values - np.nanmedian(gyro.values, axis=0)), 99.9))
    unit, name = ("radps", "rad/s") if most < _FASTEST_RADPS else ("dps", "°/s")
    notes.append(f"no unit is told: gx, gy, gz are taken for {name}, as they reach {most:.3g}; if not, name it: gx_dps")
    return gyro._replace(factor=_UNITS[unit][0])


_FASTEST_RADPS = 15.0
"""Faster than a hand turns a unit; in °/s slower than one does."""


def _has_fractions(values: FloatArray) -> bool:
    finite = values[np.isfinite(values)]
    return bool((finite != np.rint(finite)).any())


def _time(path: Path, columns: dict[str, FloatArray], notes: list[str]) -> FloatArray:
    """Return the times (n,) s of the column that is one, best of one that tells its unit."""
    chosen: tuple[str, float] | None = None
    for name in columns:
        base, unit = _told(name)
        found = _TIME.match(base)
        if found is None or _CHANNEL.match(base):
            continue
        told = (unit or found["unit"] or ("s" if base.endswith(("seconds_elapsed", "secs", "seconds")) else "")).lower()
        factor = _SECONDS.get(told.replace("µ", "u").replace("μ", "u"), math.nan)
        if chosen is None or (math.isfinite(factor) and not math.isfinite(chosen[1])):
            chosen = name, factor
    if chosen is None:
        raise UserError(f"{path}: column t_s is missing; there are {', '.join(columns) or 'none'}")
    name, factor = chosen
    times: FloatArray = columns[name] - columns[name][0]
    if math.isfinite(factor):
        times = factor * times
        return times
    step = float(np.nanmean(np.diff(times))) if len(times) > 1 else 0.0
    unit, factor = next(
        (
            (unit, each)
            for unit, each in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9))
            if step * each <= 1.0 / LEAST_HZ
        ),
        ("s", 1.0),
    )
    notes.append(f"column {name} tells no unit: it is taken for {unit}, as its steps are {step:.4g}")
    scaled: FloatArray = factor * times
    return scaled


def _text(path: Path) -> tuple[dict[str, FloatArray], list[str]]:
    """Return the columns of a text by their names, but for columns of words."""
    try:
        data = path.read_bytes()
        data = gzip.decompress(data) if path.suffix == ".gz" else data
        lines = [line for line in data.decode("utf-8-sig").splitlines() if line.strip()]
    except UnicodeDecodeError:
        lines = [line for line in data.decode("cp1252", errors="replace").splitlines() if line.strip()]
    except (OSError, EOFError) as error:
        raise UserError(f"{path}: no table of numbers: {' '.join(str(error).split())}") from error
    first, delimiter = _first_row(path, lines)
    rows = lines[first:]
    if delimiter == ";":
        rows = [row.replace(",", ".") for row in rows]
    width = len(_cells(rows[0], delimiter))
    notes = list[str]()
    names = [name.strip() for name in _cells(lines[first - 1].lstrip(_REMARKS), delimiter)] if first else []
    if len(names) != width:
        if names and len(names) > 1:
            raise UserError(f"{path}: its line of names has {len(names)}, its rows {width} numbers")
        if width not in _WITHOUT_NAMES:
            raise UserError(f"{path}: {width} columns without a line of names; write one: t_s,ax,ay,az,gx,gy,gz")
        names = list(_WITHOUT_NAMES[width])
        notes.append(f"no line of names: taken for {', '.join(names)}")
    words = [k for k, cell in enumerate(_cells(rows[0], delimiter)) if not _is_number(cell)]
    numbers = [k for k in range(width) if k not in words]
    try:
        values = np.loadtxt(io.StringIO("\n".join(rows)), delimiter=delimiter, ndmin=2, usecols=numbers, comments=None)
    except ValueError as error:
        raise UserError(f"{path}: no table of numbers: {' '.join(str(error).split())}") from error
    return {names[k]: values[:, column] for column, k in enumerate(numbers)}, notes


def _first_row(path: Path, lines: list[str]) -> tuple[int, str | None]:
    """Return the first line that is a row, of four numbers and more, and what stands between its columns."""
    for number, line in enumerate(lines):
        for delimiter in _DELIMITERS:
            text = line.replace(",", ".") if delimiter == ";" else line
            if sum(map(_is_number, _cells(text, delimiter))) >= min(_WITHOUT_NAMES):
                return number, delimiter
    told = "no row of four numbers and more" if lines else "it is empty"
    raise UserError(f"{path}: no table of numbers: {told}")


def _cells(line: str, delimiter: str | None) -> list[str]:
    return line.split(delimiter)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _npz(path: Path) -> dict[str, FloatArray]:
    found = dict[str, FloatArray]()
    try:
        with np.load(path, allow_pickle=False) as arrays:
            for name in arrays.files:
                array, base = arrays[name], _told(name)[0]
                if array.ndim == 2 and array.shape[0] == 3 < array.shape[1]:
                    array = array.T
                if array.ndim == 2 and array.shape[1] == 3:
                    kind, _, unit = (base, "", "") if base in _SENSORS else base.partition("_")
                    found |= {f"{kind}_{axis}_{unit}": array[:, k].astype(float) for k, axis in enumerate("xyz")}
                elif array.ndim == 1:
                    found[name] = array.astype(float)
    except (OSError, ValueError, BadZipFile) as error:
        raise UserError(f"{path}: no NPZ file of arrays: {error}") from error
    if len({len(values) for values in found.values()}) > 1:
        raise UserError(f"{path}: its arrays are of different lengths")
    return found

"""Tables of a data set: one row a line, the time in integer ns first, numbers after it, commas between."""

import gzip
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drivers.protocols import DeviceError
from messages.arrays import FloatArray, IntArray

_LARGEST = 1e12
"""In SI units no position, rate or acceleration is beyond it."""


class Table(NamedTuple):
    """`t_ns` (n,) strictly increasing, `values` (n, columns) within ±1e12, `lines` the number of each row's line."""

    t_ns: IntArray
    values: FloatArray
    lines: list[int]


def read_table(path: Path, columns: int) -> Table:
    """Return the table's times and its first `columns` numbers; lines that begin with # and empty ones are skipped.

    Reads gzip where the name ends in .gz. Raises DeviceError, one line with the number of the line in the file, for
    a row that is short, not numeric, not finite, or not later than the row before; and if there is no row.
    """
    times: list[int] = []
    rows: list[list[float]] = []
    lines: list[int] = []
    for number, text in enumerate(_text(path).splitlines(), start=1):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        try:
            t_ns, row = _row(text, columns)
            if times and t_ns <= times[-1]:
                raise ValueError(f"time {t_ns} ns, allowed above {times[-1]} ns of the row before")
        except ValueError as error:
            raise DeviceError(f"{path}: line {number}: {error}") from error
        times.append(t_ns)
        rows.append(row)
        lines.append(number)
    if not times:
        raise DeviceError(f"{path}: holds no row")
    return Table(np.array(times, dtype=np.int64), np.array(rows, dtype=np.float64), lines)


def _text(path: Path) -> str:
    try:
        data = path.read_bytes()
        return (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
    except (OSError, EOFError, zlib.error) as error:
        raise DeviceError(f"{path}: cannot be read: {error}") from error
    except UnicodeDecodeError as error:
        raise DeviceError(f"{path}: is not text (byte {error.start})") from error


def _row(text: str, columns: int) -> tuple[int, list[float]]:
    cells = text.split(",")
    if len(cells) < 1 + columns:
        raise ValueError(f"{len(cells)} columns, allowed {1 + columns} or more")
    if not cells[0].strip().isdecimal() or (t_ns := int(cells[0])) >= 2**63:
        raise ValueError(f"time '{cells[0].strip()}', allowed whole ns from 0 to 2^63 - 1")
    values = [float(cell) for cell in cells[1 : 1 + columns]]
    if not all(-_LARGEST <= value <= _LARGEST for value in values):  # so written, NaN is refused too
        raise ValueError(f"a number that is not finite or beyond ±{_LARGEST:g}")
    return t_ns, values

"""Columns of numbers in CSV files: read at the speed of the disk, with a line for whoever wrote the wrong cell."""

import gzip
import os
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from messages.arrays import FloatArray
from messages.errors import UserError


def read_columns(path: Path, columns: Sequence[str]) -> FloatArray:
    """Return the numbers (n, c) of `columns`, in that order; an empty cell or `nan` is NaN, other columns are left out.

    Raises UserError naming the file and the missing column, or the row and column of a cell that is no number.
    """
    lines = _lines(path)
    header = _header(lines)
    for name in columns:
        if header.count(name) != 1:
            problem = "missing" if name not in header else "there twice"
            raise UserError(f"{path}: column {name} is {problem}; expected {', '.join(columns)}")
    rows = [line for line in lines[1:] if line.strip()]
    if len(rows) < 2:
        raise UserError(f"{path}: holds {len(rows)} rows below its header, at least 2 are needed")
    try:
        values = np.loadtxt([_with_nan(row) for row in rows], delimiter=",", ndmin=2, comments=None)
    except ValueError:
        values = np.empty((0, 0))
    if values.shape != (len(rows), len(header)):
        raise UserError(f"{path}: {_first_problem(lines, header)}")
    return np.ascontiguousarray(values[:, [header.index(name) for name in columns]])


def header_of(path: Path) -> list[str]:
    """Return the names in the first row of a file; raises UserError where it cannot be read, or has none."""
    names = _header(_lines(path))
    if not any(names):
        raise UserError(f"{path}: is empty; expected the columns' names in its first row")
    return names


def _lines(path: Path) -> list[str]:
    """Return the lines of a file, which may be gzipped where its name says so."""
    try:
        data = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
        return data.decode("utf-8-sig").splitlines()
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise UserError(f"{path}: not a whole gzip file") from error
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not UTF-8 text (byte {error.start})") from error


def _header(lines: Sequence[str]) -> list[str]:
    return [name.strip().strip('"') for name in lines[0].split(",")] if lines else []


def write_columns(path: Path, columns: Sequence[str], values: FloatArray) -> None:
    """Write numbers (n, c) under the names `columns`, in one step; raises UserError where it cannot."""
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(part, values, fmt="%.12g", delimiter=",", header=",".join(columns), comments="")
        os.replace(part, path)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error


def _with_nan(row: str) -> str:
    """Return a row whose empty cells say nan."""
    if ",," not in row and not row.startswith(",") and not row.endswith(","):
        return row
    return ",".join(cell if cell.strip() else "nan" for cell in row.split(","))


def _first_problem(lines: list[str], header: list[str]) -> str:
    """Return what is wrong with the first row that is."""
    for number, line in enumerate(lines[1:], start=2):
        cells = line.split(",")
        if line.strip() and len(cells) != len(header):
            return f"row {number} has {len(cells)} cells, the header {len(header)}"
        wrong = next((pair for pair in zip(header, cells, strict=False) if not _is_number(pair[1])), None)
        if wrong is not None:
            return f"row {number}: {wrong[0]} is {wrong[1].strip()!r}, allowed a number"
    return "is not a table of numbers"


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip() or "nan")
    except ValueError:
        return False
    return True

"""Plain files that a laboratory can write: TOML with a fixed set of fields, CSV with a fixed set of columns."""

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from messages.errors import UserError
from messages.text_files import parse_toml, read_text


def read_toml(path: Path) -> dict[str, object]:
    """Return what a TOML file holds; raises UserError with one line."""
    return parse_toml(read_text(path), str(path))


def write_toml(path: Path, document: Mapping[str, object], heading: str = "") -> None:
    """Write text, numbers and lists of them, tables and lists of tables; raises UserError where it cannot.

    A float that is not finite is written as nan or inf; every float reads back the same.
    """
    _write(path, heading + "\n".join(_lines(document, "")) + "\n")


def read_table(path: Path, columns: Sequence[str]) -> list[list[str]]:
    """Return the cells of a CSV file's rows, in the order of `columns`; raises UserError naming what is not so."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [[cell.strip() for cell in row] for row in csv.reader(file) if row]
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not UTF-8 text (byte {error.start})") from error
    except csv.Error as error:
        raise UserError(f"{path}: {error}") from error
    header = rows[0] if rows else []
    for name in columns:
        if header.count(name) != 1:
            problem = "missing" if name not in header else "there twice"
            raise UserError(f"{path}: column {name} is {problem}; expected {', '.join(columns)}")
    if len(rows) < 2:
        raise UserError(f"{path}: holds no row below its header")
    for number, row in enumerate(rows, start=1):
        if len(row) != len(header):
            raise UserError(f"{path}: row {number} has {len(row)} cells, the header {len(header)}")
    places = [header.index(name) for name in columns]
    return [[row[place] for place in places] for row in rows[1:]]


def write_table(path: Path, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write a CSV file; raises UserError where it cannot."""
    _write(path, "\n".join(",".join(row) for row in (columns, *rows)) + "\n")


def _write(path: Path, text: str) -> None:
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text, encoding="utf-8")
        os.replace(part, path)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error


def _lines(table: Mapping[str, object], name: str) -> list[str]:
    inner = {key: value for key, value in table.items() if isinstance(value, Mapping) or _is_tables(value)}
    lines = [f"{key} = {_value(value)}" for key, value in table.items() if key not in inner]
    for key, value in inner.items():
        path = f"{name}.{key}" if name else key
        if isinstance(value, Mapping):
            lines += ["", f"[{path}]", *_lines(value, path)]
        elif isinstance(value, Sequence):
            for item in value:
                lines += ["", f"[[{path}]]", *_lines(item, path)]
    return lines


def _is_tables(value: object) -> bool:
    return isinstance(value, Sequence) and bool(value) and isinstance(value[0], Mapping)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float | int):
        return repr(value)
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    if isinstance(value, Sequence):
        return f"[{', '.join(_value(item) for item in value)}]"
    raise TypeError(f"{type(value).__name__} has no place in a TOML file")

"""Small text files that a person writes: read as UTF-8, TOML parsed, whatever is wrong with one said in one line."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tomli

from messages.errors import UserError

LARGEST_TEXT_BYTES = 16 << 20
"""A thousand times the longest settings or calibration; what is larger is another file, or has no end."""


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file, line ends as LF; raises UserError, one line."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_TEXT_BYTES + 1)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    if len(data) > LARGEST_TEXT_BYTES:
        raise UserError(f"{path}: is larger than {LARGEST_TEXT_BYTES >> 20} MB, allowed for a text file")
    try:
        return data.decode().replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not UTF-8 text (byte {error.start})") from error


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Return what the TOML `text` holds; raises UserError, its line beginning with `where`."""
    try:
        document = tomli.loads(text)
        refuse_huge_numbers(document, where)
    except RecursionError as error:
        raise UserError(f"{where}: not TOML: nested too deeply") from error
    except ValueError as error:  # tomli's own error, or a number of more digits than Python reads
        raise UserError(f"{where}: not TOML: {error}") from error
    return document


def refuse_huge_numbers(document: object, where: str) -> None:
    """Raise UserError for a whole number beyond 64 bits, which neither becomes a float nor can always be printed."""
    for field, value in _numbers(document, ""):
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise UserError(
                f"{where}: {field or 'the file'} is a whole number of {value.bit_length()} bits, allowed 64"
            )


def check_sizes(document: object, largest: float, where: str) -> None:
    """Raise UserError for a number that is not finite or beyond ±`largest`, whatever its field."""
    for field, value in _numbers(document, ""):
        if not -largest <= value <= largest:
            raise UserError(f"{where}: {field} is {value:g}, allowed up to ±{largest:g}")


def _numbers(value: object, field: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, int | float):
        yield field, value
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _numbers(item, f"{field}.{key}" if field else str(key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _numbers(item, f"{field}[{index}]")

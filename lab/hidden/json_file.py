"""A struct in a JSON file of its own, written in one piece."""

import os
from pathlib import Path
from typing import TypeVar

import msgspec

from messages.errors import UserError

S = TypeVar("S", bound=msgspec.Struct)


def write_struct(path: Path, struct: msgspec.Struct) -> None:
    """Write `struct`, and the folder if there is none; nobody sees half of it. Raises UserError where it cannot."""
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(msgspec.json.format(msgspec.json.encode(struct), indent=2) + b"\n")
        os.replace(part, path)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error


def read_struct(path: Path, kind: type[S]) -> S:
    """Return what `write_struct` wrote; raises UserError naming file and field."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UserError(f"{path}: {error}") from error

"""Where a report comes from: the files that were read, the version, the command and the date."""

import hashlib
import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version

from messages.errors import UserError

_LISTED = 12
"""Files of a folder that are listed each; of more the folder is one row."""
_CHUNK_BYTES = 1 << 20
_LIBRARIES = ("numpy", "scipy")
"""Whose versions the last digits of a result may depend on."""


@dataclass(frozen=True)
class FileRead:
    """One file, or one folder of many: `sha256` is that of the bytes, of a folder that of its files' names and sums."""

    name: str
    size_bytes: int
    sha256: str


@dataclass(frozen=True)
class Provenance:
    """What a reader needs to make a report again, or to see that it is that of other data."""

    command: str
    versions: str
    date: str
    files: tuple[FileRead, ...]


def provenance(files: Sequence[Path]) -> Provenance:
    """Return where a report on `files` (files or folders) comes from, as of now and of this process's command line.

    Raises UserError where a file can no longer be read.
    """
    try:
        read = tuple(each for path in files for each in _read(path))
    except OSError as error:
        raise UserError(f"{error.filename}: {error.strerror}") from error
    command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
    return Provenance(command, _versions(), datetime.now().astimezone().isoformat(" ", "seconds"), read)


def _versions() -> str:
    try:
        own = version("gaiteyes")
    except PackageNotFoundError:
        own = "of an unknown version (not installed)"
    libraries = (f"{name} {version(name)}" for name in _LIBRARIES)
    return ", ".join((f"gaiteyes {own}", f"Python {python_version()}", *libraries))


def _read(path: Path) -> Iterator[FileRead]:
    if path.is_file():
        yield FileRead(str(path), path.stat().st_size, _sha256(path))
        return
    inside = sorted(file for file in path.rglob("*") if file.is_file())
    each = [FileRead(str(file), file.stat().st_size, _sha256(file)) for file in inside]
    if len(each) <= _LISTED:
        yield from each
        return
    sums = "".join(
        f"{file.relative_to(path).as_posix()} {one.sha256}\n" for file, one in zip(inside, each, strict=True)
    )
    name = f"{path}/ ({len(each)} files)"
    yield FileRead(name, sum(one.size_bytes for one in each), hashlib.sha256(sums.encode()).hexdigest())


def _sha256(path: Path) -> str:
    found = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK_BYTES):
            found.update(chunk)
    return found.hexdigest()

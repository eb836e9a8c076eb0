"""What the unit has learnt, kept from one run to the next in a small file of its own.

Two lines: the values as JSON, and the SHA-256 of the first line. The file is written whole beside its place and then
takes it, so that a brown-out leaves the old one or the new one; whatever else it leaves does not match its checksum and
is set aside. A calibration is never touched.
"""

import contextlib
import hashlib
import logging
import os
from datetime import datetime, timezone
from pathlib import Path

import msgspec

from daemon.config import Configuration
from messages import Learnt, UnitCalibration, UserError
from messages.checked import checked
from perception.attitude.learnt import check_learnt

log = logging.getLogger("gaiteyes")

FORMAT = 1
LARGEST_BYTES = 1 << 20
"""A state with a bias at every temperature is a tenth of that."""


class BrokenStateError(UserError):
    """The file does not hold what was written into it."""


class OtherFormatError(UserError):
    """The file was written by another version, which keeps something else in it."""


class State(msgspec.Struct, frozen=True, kw_only=True):
    """What the first line says. `written` is the wall clock's, for a person."""

    format: int
    written: datetime
    learnt: Learnt


def state_path(configuration_path: Path, configuration: Configuration) -> Path:
    """Return where the unit's state is kept: a relative path lies in the service manager's state directory, without
    one beside the configuration."""
    granted = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    return (Path(granted) if granted else configuration_path.parent) / configuration.learnt


def read_state(path: Path, calibration: UnitCalibration) -> State | None:
    """Return the state that the file holds, None where there is no file.

    Raises BrokenStateError where it is not as it was written, OtherFormatError where another version wrote it, and
    UserError where it cannot be read or does not belong to `calibration`; all in one line.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    body, _, rest = data.partition(b"\n")
    if rest != _checksum_line(body):
        raise BrokenStateError(f"{path}: does not match its checksum")
    document = _json(body, str(path))
    found_format = document.get("format") if isinstance(document, dict) else None
    if found_format != FORMAT:
        raise OtherFormatError(f"{path}: its format is '{found_format}', allowed '{FORMAT}'")
    state = checked(document, State, str(path))
    try:
        check_learnt(state.learnt, calibration)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    return state


def write_state(path: Path, learnt: Learnt, written: datetime) -> None:
    """Write the file in one step and see it onto the disk; raises UserError, in one line, where that fails."""
    body = msgspec.json.encode(State(format=FORMAT, written=written, learnt=learnt))
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            file.write(body + b"\n" + _checksum_line(body))
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error


def format_learnt(learnt: Learnt) -> str:
    """Return the text that a recording holds of it."""
    return msgspec.json.encode(learnt).decode()


def parse_learnt(text: str, where: str) -> Learnt:
    """Return what `format_learnt` wrote; raises UserError whose line begins with `where`."""
    return checked(_json(text.encode(), where), Learnt, where)


def _checksum_line(body: bytes) -> bytes:
    return hashlib.sha256(body).hexdigest().encode() + b"\n"


def _json(data: bytes, where: str) -> object:
    try:
        document: object = msgspec.json.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise UserError(f"{where}: not JSON: {error}") from error
    return document


class StateKeeper:
    """Loads the state of one unit at the start, and keeps the file up to date from then on. Never raises."""

    def __init__(self, path: Path, calibration: UnitCalibration) -> None:
        self._path = path
        self._calibration = calibration
        self._kept: Learnt | None = None
        self._failed = False

    def load(self) -> Learnt | None:
        """Return what the unit had learnt; None, and why in one line of the log, where nothing can be used of it."""
        try:
            state = read_state(self._path, self._calibration)
        except BrokenStateError as error:
            log.error("%s; set aside as %s, the unit learns anew", error, self._set_aside(".broken"))
            return None
        except OtherFormatError as error:  # its version finds it again, after a roll-back that is taken back
            log.warning("%s; set aside as %s, the unit learns anew", error, self._set_aside(".other-format"))
            return None
        except UserError as error:
            log.warning("%s; not used, the unit learns anew", error)
            return None
        self._kept = None if state is None else state.learnt
        return self._kept

    def _set_aside(self, ending: str) -> str:
        aside = self._path.with_name(self._path.name + ending)
        with contextlib.suppress(OSError):  # it will be overwritten all the same
            os.replace(self._path, aside)
        return aside.name

    def keep(self, learnt: Learnt) -> None:
        """Write `learnt` where it is new; that the disk fails is said once, until it works again."""
        if learnt is self._kept or learnt.is_empty:
            return
        try:
            write_state(self._path, learnt, datetime.now(timezone.utc))
        except UserError as error:
            if not self._failed:
                log.error("what the unit learns cannot be kept: %s", error)
            self._failed = True
        else:
            self._kept, self._failed = learnt, False

"""A campaign's file: a line for its seed, then one for each attempt at a trial, so that it can go on after any end."""

import os
from pathlib import Path

import msgspec

from lab.faults.report import Attempt
from messages import UserError


class _Header(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What all attempts of a file have in common."""

    seed: int
    scenario: str


class CampaignFile:
    """The attempts in the file `path`, which is made if it is not there. A last line that was cut short is dropped.

    Raises UserError where the file cannot be read or written, is no campaign's, or one of another seed or scenario.
    """

    def __init__(self, path: Path, seed: int, scenario: str) -> None:
        self._path = path
        self.attempts: list[Attempt] = []
        header = _Header(seed=seed, scenario=scenario)
        try:
            text = path.read_bytes() if path.exists() else b""
            whole = text[: text.rfind(b"\n") + 1]
            if len(whole) < len(text):
                os.truncate(path, len(whole))
            if not whole:
                self._append(header)
        except OSError as error:
            raise UserError(f"--file {path}: {error.strerror}") from error
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                found = msgspec.json.decode(line, type=_Header if number == 1 else Attempt)
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                raise UserError(f"--file {path}: line {number} is not of a campaign: {error}") from error
            if isinstance(found, Attempt):
                self.attempts.append(found)
            elif isinstance(found, _Header) and found != header:
                raise UserError(
                    f"--file {path}: it is of seed {found.seed}, scenario {found.scenario}; "
                    f"this is seed {seed}, scenario {scenario}"
                )

    @property
    def done(self) -> set[str]:
        """Return the names of the trials that need no further attempt; what was void is tried again."""
        return {attempt.trial.name for attempt in self.attempts if not attempt.trial.void}

    def add(self, attempt: Attempt) -> None:
        """Keep one more attempt. Raises UserError where it cannot be written."""
        self.attempts.append(attempt)
        try:
            self._append(attempt)
        except OSError as error:
            raise UserError(f"--file {self._path}: {error.strerror}") from error

    def _append(self, line: msgspec.Struct) -> None:
        with self._path.open("ab") as file:
            file.write(msgspec.json.encode(line) + b"\n")
            file.flush()
            os.fsync(file.fileno())

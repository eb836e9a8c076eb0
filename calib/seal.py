"""The seal of a calibration file: its last line, a comment with the SHA-256 of all that stands above it.

    # seal sha256 5f2c…

`gaiteyes calibrate …` writes it, and a file whose seal is missing or does not match is not used: of the changes of a
single character most give a calibration that is as plausible as the right one. The text is sealed, not the values, so
that a seal outlives fields that a later version adds with their defaults. Line ends may be LF or CRLF.
"""

import hashlib
import shlex

from calib.strict_yaml import CalibrationError

_SEAL = "# seal sha256 "


def sealed(text: str) -> str:
    """Return `text` with the seal that it needs in place of any that it has."""
    body = "".join(line + "\n" for line in text.rstrip("\n").split("\n") if not line.startswith(_SEAL))
    return body + _seal_of(body)


def check_seal(text: str, where: str) -> None:
    """Raise CalibrationError, its line beginning with `where`, unless `text` ends with its seal."""
    body, seal, _ = text.rpartition(_SEAL)
    if text == body + _seal_of(body):
        return
    problem = (
        "does not match its seal: it was changed or damaged since"
        if seal
        else "has no seal: it is older than seals, or was not written by 'gaiteyes calibrate'"
    )
    raise CalibrationError(
        f"{where}: {problem}; if its values are right, run: gaiteyes calibrate seal {shlex.quote(where)}"
    )


def _seal_of(body: str) -> str:
    return f"{_SEAL}{hashlib.sha256(body.encode()).hexdigest()}\n"

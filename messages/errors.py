"""The errors that reach a person, each one clear line."""

from collections.abc import Iterable
from difflib import get_close_matches

LONGEST_LINE = 600
"""Characters of an error's line. Of a longer one the middle is left out: what and where stand at its beginning, what is
allowed at its end."""


class UserError(Exception):
    """A device, file or setting is not as it must be: what, where, and what is allowed. The command exits with 2.

    It is one line whatever was quoted from a file: what does not print is escaped, what is too long is cut.
    """

    def __init__(self, line: str) -> None:
        super().__init__(_one_line(line))


class ServiceError(Exception):
    """The service failed by itself; what led to it is in the log. The command line exits with 1."""


def _one_line(text: str) -> str:
    text = _cut(text)  # of a file all of which was quoted, no more is escaped than may be kept
    return text if text.isprintable() else _cut("".join(map(_printable, text)))


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST_LINE else f"{text[: 2 * LONGEST_LINE // 3]} … {text[-LONGEST_LINE // 4 :]}"


def _printable(character: str) -> str:
    return character if character.isprintable() else character.encode("unicode_escape").decode("ascii")


def unknown_name(what: str, name: str, known: Iterable[str]) -> UserError:
    """Return the error of a `name` that is not among the `known` ones; `what` says in a message what it names."""
    nearest = get_close_matches(name, list(known), n=1, cutoff=0.0)
    return UserError(f"{what} is unknown; {f'the nearest known is {nearest[0]}' if nearest else 'none is known here'}")

"""The errors that reach a person, each one clear line."""

from collections.abc import Iterable
from difflib import get_close_matches


class UserError(Exception):
    """A device, file or setting is not as it must be: what, where, and what is allowed. The command exits with 2."""


class ServiceError(Exception):
    """The service failed by itself; what led to it is in the log. The command line exits with 1."""


def unknown_name(what: str, name: str, known: Iterable[str]) -> UserError:
    """Return the error of a `name` that is not among the `known` ones; `what` says in a message what it names."""
    nearest = get_close_matches(name, list(known), n=1, cutoff=0.0)
    return UserError(f"{what} is unknown; {f'the nearest known is {nearest[0]}' if nearest else 'none is known here'}")

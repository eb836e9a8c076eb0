"""The one family of errors that a person can mend; each is one clear line: what, where, and what is allowed."""


class UserError(Exception):
    """A device, file or setting is not as it must be. The command line prints the line and exits with 2."""

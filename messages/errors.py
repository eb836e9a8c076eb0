"""The errors that reach a person, each one clear line."""


class UserError(Exception):
    """A device, file or setting is not as it must be: what, where, and what is allowed. The command exits with 2."""


class ServiceError(Exception):
    """The service failed by itself; what led to it is in the log. The command line exits with 1."""

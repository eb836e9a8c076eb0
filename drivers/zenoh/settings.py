"""Where the service listens on Zenoh, and with what a subscriber comes. Reading a configuration needs no Zenoh."""

from typing import Annotated

import msgspec

SOCKET = "unixsock-stream/"
"""How the endpoint of a socket on this machine begins; its path follows."""

_File = Annotated[str, msgspec.Meta(pattern="^(/.+)?$")]


class ZenohSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Where the service listens, and who may connect. Whoever connects may listen and ask, never publish.

    Without `listen` it is a socket on this machine, in a directory that only the service may write
    (`drivers.zenoh.local_socket`): whoever may enter the directory may connect. `tls/HOST:PORT` shows its subscribers
    `certificate`, made out for HOST and proven by `private_key`. On every other endpoint anything may pose as the
    service; it is refused unless `insecure` says that this is meant, and then Health says so too.

    `client_authority` lets in only whom a certificate signed by it proves, `users` only those who know a password: one
    line `user:password` each. All files by their absolute paths, certificates and keys as PEM.
    """

    listen: Annotated[str, msgspec.Meta(pattern="^([a-z][a-z0-9-]*/.+)?$")] = ""
    insecure: bool = False
    certificate: _File = ""
    private_key: _File = ""
    client_authority: _File = ""
    users: _File = ""


class Credentials(msgspec.Struct, frozen=True, kw_only=True):
    """What a subscriber needs where the service is on another machine, or asks who comes.

    `authority` is the PEM file of who signed the service's certificate; nothing else is believed to be the service.
    `certificate` and `private_key`, PEM files too, prove the subscriber; `user` and `password` do so where the service
    has a list of them.
    """

    authority: str = ""
    certificate: str = ""
    private_key: str = ""
    user: str = ""
    password: str = ""


def is_secure(endpoint: str) -> bool:
    """Return whether nobody but the service can be at `endpoint`: a socket in its directory, or TLS."""
    return endpoint.startswith((SOCKET, "tls/"))

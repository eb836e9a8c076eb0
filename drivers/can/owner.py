"""Whose programs are at the two ends of a CAN bus on loopback TCP: any user of a host can listen on a port, or connect.

The kernel tells the user of each socket (/proc/net/tcp, proc(5)). Elsewhere than on Linux nothing is checked.
"""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

from messages import UserError

_TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_ESTABLISHED, _LISTENS = "01", "0A"
_ROOT = 0


def check_server(connection: socket.socket) -> None:
    """Raise UserError, in one line, if the program that `connection` leads to belongs to another user of this host.

    One on another machine is not judged.
    """
    host, port = connection.getpeername()[:2]
    if not is_ours(port, connection.getsockname()[1], or_absent=not host.startswith("127.")):
        raise UserError(f"the port {port} of {host} is held by another user's program: it could pose as the CAN bus")


def is_ours(port: int, other_port: int, *, or_absent: bool = False) -> bool:
    """Return whether this user or root has the socket of this host that goes from `port` to `other_port`.

    Whoever listens on `port` must be one of the two as well: a connection that is not accepted yet has no user. What
    has been closed has none either, and so is nobody's.
    """
    if not _TABLES[0].exists():
        return True
    users = set(_users(port, other_port))
    return users <= {_ROOT, os.geteuid()} and (bool(users) or or_absent)


def _users(port: int, other_port: int) -> Iterator[int]:
    for table in _TABLES:
        if not table.exists():  # without IPv6
            continue
        for row in table.read_text(encoding="ascii").splitlines()[1:]:
            _, local, remote, state, _, _, _, user, _, inode, *_ = row.split()
            connected = state == _ESTABLISHED and remote.endswith(f":{other_port:04X}") and inode != "0"
            if local.endswith(f":{port:04X}") and (connected or state == _LISTENS):
                yield int(user)

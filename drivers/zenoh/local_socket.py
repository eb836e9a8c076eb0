"""Where service and subscribers of one machine meet: a socket named after the device, found without configuration.

    /run/gaiteyes/DEVICE.sock            an installed service; systemd makes the directory (systemd/gaiteyes.service)
    $XDG_RUNTIME_DIR/gaiteyes/…          what a person starts, `gaiteyes demo` for instance; nobody else may enter
    ~/.cache/gaiteyes/…                  the same, for one without a session of the service manager's

Only the service may write in any of them: who cannot write cannot take its place, neither before it starts nor while
it starts anew.
"""

import os
import stat
from pathlib import Path

from drivers.zenoh.settings import SOCKET
from messages import UserError

SERVICE_DIRECTORY = Path("/run/gaiteyes")
LONGEST_PATH_BYTES = 107
"""What the system takes as a socket's path (sun_path, unix(7)), without the zero at its end."""


def service_endpoint(device: str) -> str:
    """Return where the service of `device` listens, in a directory that is there and private from now on.

    Raises UserError, in one line, if there can be none.
    """
    return _endpoint(service_directory(), device)


def service_directory() -> Path:
    """Return where a service of this user puts its sockets; private, and there from now on.

    Raises UserError, in one line, if there can be none.
    """
    return SERVICE_DIRECTORY if _is_ours(SERVICE_DIRECTORY) else _made_own_directory()


def service_directories() -> list[Path]:
    """Return where services of this machine may have put their sockets, an installed one's first."""
    return [SERVICE_DIRECTORY, *_own_directories()]


def subscriber_endpoint(device: str) -> str:
    """Return where the service of `device` listens on this machine; an installed one comes first.

    Raises UserError, in one line, if there is none.
    """
    for directory in service_directories():
        if _is_socket(directory / f"{device}.sock"):
            return _endpoint(directory, device)
    may_enter = os.access(SERVICE_DIRECTORY, os.X_OK) or not SERVICE_DIRECTORY.exists()
    closed = "" if may_enter else f"; {SERVICE_DIRECTORY} may be entered by its group alone"
    raise UserError(
        f"Zenoh: nobody publishes as '{device}' on this machine; is `gaiteyes run` or `gaiteyes demo` running?{closed}"
    )


def socket_path(endpoint: str) -> Path:
    """Return the socket of an endpoint that begins with `SOCKET`. Raises UserError if no socket can be called so."""
    path = Path(endpoint.removeprefix(SOCKET))
    if len(os.fsencode(path)) > LONGEST_PATH_BYTES:
        raise UserError(f"Zenoh: {path}: a socket's path is at most {LONGEST_PATH_BYTES} bytes long")
    return path


def check_private(socket: Path, *, to_listen: bool) -> None:
    """Raise UserError, in one line, if somebody else could put a socket of their own in the place of `socket`.

    Its directory must be writable for its owner alone, and nobody but that owner, this user and root may be able to
    exchange a directory on the way there. `to_listen`: then the owner must be this user, or root.
    """
    directory = socket.parent.resolve()
    trusted = (0, os.geteuid())
    is_ours = False
    for place in (directory, *directory.parents):
        try:
            found = place.stat()
        except OSError as error:
            raise UserError(f"Zenoh: {place}: {error.strerror}") from error
        for_others = bool(found.st_mode & (stat.S_IWGRP | stat.S_IWOTH))
        if place != directory:  # in a sticky directory others can make entries, but not exchange one of ours
            for_others = for_others and not (found.st_mode & stat.S_ISVTX and is_ours)
        is_ours = found.st_uid in trusted
        if for_others or (not is_ours and (to_listen or place != directory)):
            raise UserError(
                f"Zenoh: {socket}: others may write {place}, and so take the service's place; choose a directory that "
                "only the service may write"
            )


def _is_socket(path: Path) -> bool:
    try:
        return stat.S_ISSOCK(path.stat().st_mode)
    except OSError:
        return False


def _is_ours(directory: Path) -> bool:
    try:
        return directory.stat().st_uid == os.geteuid()
    except OSError:
        return False


def _own_directories() -> list[Path]:
    """Return where this user's programs may meet, the first choice first; they need not be there."""
    session = os.environ.get("XDG_RUNTIME_DIR")
    bases = [Path(session)] if session else []
    return [base / "gaiteyes" for base in (*bases, Path(f"/run/user/{os.geteuid()}"), _home() / ".cache")]


def _home() -> Path:
    try:
        return Path.home()
    except RuntimeError as error:
        raise UserError("Zenoh: this user has no home directory; set zenoh.listen, or XDG_RUNTIME_DIR") from error


def _made_own_directory() -> Path:
    *sessions, last = _own_directories()
    directory = next((each for each in sessions if _is_ours(each.parent)), last)
    try:
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"Zenoh: cannot make {directory}: {error.strerror}; set zenoh.listen") from error
    return directory


def _endpoint(directory: Path, device: str) -> str:
    return f"{SOCKET}{directory / f'{device}.sock'}"

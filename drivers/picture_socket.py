"""Pictures for who looks at a running service: a socket of this machine, beside the one that Zenoh listens on.

One message is one packet (SOCK_SEQPACKET, unix(7)), whole or not at all; one that does not fit into a reader's buffer
at once is dropped, so that the sender never waits. Who may connect is who may enter the directory
(`drivers.zenoh.local_socket`); nothing of this goes over a network.
"""

import os
import socket
from contextlib import suppress
from pathlib import Path

from drivers.protocols import DeviceError
from drivers.zenoh.local_socket import check_private, service_directories, service_directory, socket_path
from messages import UserError

MOST_READERS = 4
"""Who comes later is hung up on."""
LONGEST_PACKET_BYTES = 200_000
"""Below what Linux allows in a socket's buffer (net.core.wmem_max, 212992)."""
_SUFFIX = ".view"


def devices_here() -> list[str]:
    """Return the devices of this machine whose pictures may be read now."""
    found = {
        path.stem
        for directory in service_directories()
        if os.access(directory, os.R_OK | os.X_OK)
        for path in directory.glob(f"*{_SUFFIX}")
        if _answers(path)
    }
    return sorted(found)


class PictureServer:
    """Listens for readers of `device`'s pictures. Nothing here waits, and no reader can do harm.

    Raises DeviceError, in one line, where it cannot listen, UserError where it must not.
    """

    def __init__(self, device: str) -> None:
        self._path = socket_path(str(service_directory() / f"{device}{_SUFFIX}"))
        check_private(self._path, to_listen=True)
        self._readers: list[socket.socket] = []
        self.dropped = 0
        """Packets that a reader had no room for."""
        self._listening = _socket()
        self._listening.setblocking(False)
        try:
            if self._path.exists() and not _answers(self._path):
                self._path.unlink()  # of a service that was killed
            self._listening.bind(str(self._path))
            self._path.chmod(0o666)  # who may connect is who may enter the directory
            self._listening.listen(MOST_READERS)
        except OSError as error:
            self._listening.close()
            raise DeviceError(f"{self._path}: no pictures for `gaiteyes view`: {error.strerror}") from error

    @property
    def is_watched(self) -> bool:
        """Return whether anybody reads."""
        return bool(self._readers)

    def welcome(self, greeting: bytes) -> None:
        """Take in who has connected since the last call, and greet them."""
        with suppress(BlockingIOError):
            while True:
                reader, _ = self._listening.accept()
                if len(self._readers) >= MOST_READERS:
                    reader.close()
                    continue
                reader.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, LONGEST_PACKET_BYTES)
                self._readers.append(reader)
                self._send(reader, greeting)

    def send(self, packet: bytes) -> None:
        """Send to all who read; who has gone is forgotten."""
        for reader in tuple(self._readers):
            self._send(reader, packet)

    def close(self) -> None:
        """Hang up on all, and leave no socket behind."""
        for each in (*self._readers, self._listening):
            each.close()
        self._readers.clear()
        self._path.unlink(missing_ok=True)

    def _send(self, reader: socket.socket, packet: bytes) -> None:
        try:
            if len(packet) > LONGEST_PACKET_BYTES:
                raise BlockingIOError
            reader.send(packet, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except BlockingIOError:
            self.dropped += 1
        except OSError:
            self._readers.remove(reader)
            reader.close()


class PictureReader:
    """Reads `device`'s pictures. Raises UserError, in one line, where there are none to be had."""

    def __init__(self, device: str) -> None:
        for directory in service_directories():
            path = directory / f"{device}{_SUFFIX}"
            if os.access(directory, os.X_OK) and path.exists():
                break
        else:
            raise UserError(f"'{device}' does not run on this machine, or where you may not enter")
        check_private(path, to_listen=False)
        self._socket = _socket()
        try:
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            raise UserError(f"{path}: {error.strerror}; is the service of '{device}' running?") from error

    def receive(self, timeout_s: float) -> bytes | None:
        """Return the next packet, None if none came within `timeout_s`. Raises EOFError when the service has gone."""
        self._socket.settimeout(timeout_s)
        try:
            packet = self._socket.recv(LONGEST_PACKET_BYTES)
        except (TimeoutError, BlockingIOError):
            return None
        except ConnectionError as error:
            raise EOFError from error
        if not packet:
            raise EOFError
        return packet

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def _socket() -> socket.socket:
    return socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)


def _answers(path: Path) -> bool:
    with _socket() as trial:
        try:
            trial.connect(str(path))
        except OSError:
            return False
    return True

"""A CAN bus on loopback TCP: every slcan client (`socket://127.0.0.1:PORT`) receives the frames of all others.

It stands in for a serial adapter where a bus has to reach another process without kernel CAN and without a network.
"""

import selectors
import socket

from drivers.can.owner import is_ours
from drivers.can.settings import CanInterface, CanSettings
from messages import UserError

PORT = 29536
LONGEST_LINE = 32
FRAME_KINDS = b"tTrR"


class SlcanHub:
    """Relays whole slcan frame lines; other commands are taken and not answered. A client that does not read is hung
    up on, and so is one of another user: it could pose as the service. Raises OSError if the port is taken.
    """

    def __init__(self, port: int = 0) -> None:
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._partial: dict[socket.socket, bytes] = {}

    @property
    def settings(self) -> CanSettings:
        """Return how a CanLink reaches this bus; there is no adapter that would have to settle."""
        return CanSettings(interface=CanInterface.SLCAN, channel=self.channel, settle_s=0.0)

    @property
    def channel(self) -> str:
        """What a client takes as its serial port."""
        return f"socket://127.0.0.1:{self._listener.getsockname()[1]}"

    @property
    def clients(self) -> int:
        """Return how many nodes are on the bus."""
        return len(self._partial)

    def serve(self, timeout_s: float) -> None:
        """Relay what has come, or return after `timeout_s`; called over and over by one thread."""
        for key, _ in self._selector.select(timeout_s):
            if key.fileobj is self._listener:
                self._accept()
            elif key.data in self._partial:
                self._relay(key.data)

    def close(self) -> None:
        """Hang up on every client."""
        for client in list(self._partial):
            self._drop(client)
        self._selector.close()
        self._listener.close()

    def _accept(self) -> None:
        client, (_, port) = self._listener.accept()
        if not is_ours(port, self._listener.getsockname()[1]):
            client.close()
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._selector.register(client, selectors.EVENT_READ, client)
        self._partial[client] = b""

    def _relay(self, sender: socket.socket) -> None:
        try:
            received = sender.recv(4096)
        except ConnectionError:
            received = b""
        if not received:
            self._drop(sender)
            return
        *lines, rest = (self._partial[sender] + received).split(b"\r")
        self._partial[sender] = rest[:LONGEST_LINE]
        frames = b"".join(line + b"\r" for line in lines if line and line[0] in FRAME_KINDS)
        for client in [other for other in self._partial if other is not sender]:
            if not _took_all(client, frames):
                self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        self._selector.unregister(client)
        del self._partial[client]
        client.close()


def _took_all(client: socket.socket, data: bytes) -> bool:
    try:
        return client.send(data) == len(data)
    except (BlockingIOError, ConnectionError):
        return False


def open_hub(port: int = PORT) -> SlcanHub:
    """Return the bus at the port where the CAN example listens. Raises UserError if the port is taken."""
    try:
        return SlcanHub(port)
    except OSError as error:
        raise UserError(
            f"CAN bus on 127.0.0.1:{port}: {error.strerror}; another demo may be running, or use --can virtual:demo"
        ) from error

"""A Zenoh client at the level of bytes: it sends what the library keeps back, and can stop in the middle of anything.

The library sends a publication only to who has subscribed, and the service denies telling that it has; a program that
wants to forge need not care. The messages are those of Zenoh's protocol, version 9, on a stream: each batch with its
length, two bytes, before it.
"""

import os
import socket
import struct
from pathlib import Path

_PROTOCOL_VERSION = 9
_INIT, _OPEN = 0x81, 0x42  # transport messages; InitSyn with an extension, OpenSyn with its lease in seconds
_CLIENT_WITH_16_BYTES_OF_ID = 0xF2
_PATCH = bytes((0x27, 0x01))  # the extension that tells the revision of the protocol
_FRAME = 0x25  # of reliable messages
_PUSH, _PUT = 0x7D, 0x01
_LARGEST_NUMBER = 2**28
_ID_AT = 3  # in the answer to InitSyn: header, version, kind with how long the id is, at most 16 bytes
_HAS_SIZES, _SIZES = 0x40, 3  # before it, how long numbers and batches may be


class ZenohBytes:
    """One connection to the socket at `path`. With `greeting` False it is opened and says nothing.

    Raises OSError if nobody listens, or hangs up.
    """

    def __init__(self, path: Path, *, greeting: bool = True, lease_s: int = 10) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(2.0)
        self.socket.connect(str(path))
        self._number = 0
        if greeting:
            self.send(self._init())
            acknowledged = self._answer()
            at = _ID_AT + (acknowledged[2] >> 4) + 1 + (_SIZES if acknowledged[0] & _HAS_SIZES else 0)
            cookie = acknowledged[at + 1 : at + 1 + acknowledged[at]]
            self.send(bytes((_OPEN, lease_s)) + _zint(self._number) + _zint(len(cookie)) + cookie)
            self._answer()

    def send(self, message: bytes) -> None:
        """Send one batch."""
        self.socket.sendall(struct.pack("<H", len(message)) + message)

    def send_half_a_greeting(self) -> None:
        """Send the beginning of the first batch, and leave it at that."""
        greeting = self._init()
        self.socket.sendall(struct.pack("<H", len(greeting)) + greeting[:4])

    def put(self, key: str, payload: bytes, *, times: int = 1) -> None:
        """Publish `payload` under `key`, `times` over in one frame."""
        name = key.encode()
        one = bytes((_PUSH, 0)) + _zint(len(name)) + name + bytes((_PUT,)) + _zint(len(payload)) + payload
        self.send(bytes((_FRAME,)) + _zint(self._number) + times * one)
        self._number = (self._number + 1) % _LARGEST_NUMBER

    def close(self) -> None:
        """Hang up, without a word."""
        self.socket.close()

    def _init(self) -> bytes:
        return bytes((_INIT, _PROTOCOL_VERSION, _CLIENT_WITH_16_BYTES_OF_ID)) + os.urandom(16) + _PATCH

    def _answer(self) -> bytes:
        (length,) = struct.unpack("<H", self._exactly(2))
        return self._exactly(length)

    def _exactly(self, length: int) -> bytes:
        data = b""
        while len(data) < length:
            more = self.socket.recv(length - len(data))
            if not more:
                raise ConnectionResetError("hung up during the greeting")
            data += more
        return data


def _zint(number: int) -> bytes:
    """Seven bits a byte, the lowest first; the eighth says that more follow."""
    encoded = bytearray()
    while number > 0x7F:
        encoded.append(number & 0x7F | 0x80)
        number >>= 7
    encoded.append(number)
    return bytes(encoded)

"""Telling the service manager how the service fares. Source: systemd's sd_notify(3).

Without a manager (no NOTIFY_SOCKET in the environment) nothing is sent.
"""

import os
import socket
import time
from collections.abc import Mapping


class ServiceManager:
    """The socket of the service manager that started this process, if one did.

    `watchdog_s` is how long it waits for a sign of life before it kills, None if it does not wait at all.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        # "@" stands for the zero byte of an abstract address
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if address else None
        self._status = ""
        self._was_ready = False
        self.watchdog_s = _watchdog_s(environment) if address else None

    @property
    def is_there(self) -> bool:
        """Return whether a manager listens."""
        return self._socket is not None

    def ready(self) -> None:
        """Say that the service runs again after a reload."""
        self._send("READY=1")
        self._was_ready = True

    def reloading(self) -> None:
        """Say that the configuration is being read again; `ready` ends it."""
        self._send(f"RELOADING=1\nMONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        """Say that the service ends."""
        self._send("STOPPING=1")

    def feed_watchdog(self) -> None:
        """Tell the watchdog that the service works; the first time also that it is ready."""
        self._send("WATCHDOG=1" if self._was_ready else "READY=1\nWATCHDOG=1")
        self._was_ready = True

    def status(self, line: str) -> None:
        """Show one line to whoever asks `systemctl status`; said only when it changes."""
        if line != self._status:
            self._status = line
            self._send(f"STATUS={line}")

    def close(self) -> None:
        """Say nothing more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, words: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(words.encode(), socket.MSG_DONTWAIT, self._address)
        except OSError:
            return  # a manager that restarts loses a word; the next sign of life comes soon


def _watchdog_s(environment: Mapping[str, str]) -> float | None:
    meant = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    usec = environment.get("WATCHDOG_USEC", "")
    return int(usec) * 1e-6 if meant and usec.isdigit() and int(usec) > 0 else None

"""Whether this process hears promptly: what it sends to itself, as the daemon sends to it, tells.

A process that has no processor hears everything late, whoever sent it. The daemon's messages pass through threads of
Zenoh before any code of this one sees them, so only what passes through such threads as well tells of their lateness.
"""

import json
import tempfile
import threading
import time
from pathlib import Path

import zenoh


class Echo:
    """Sends itself the time over a socket of its own, every `period_s`; `is_prompt` while what it sends comes back
    within `late_s`, and from `caught_up_s` after it did not: until then what had to wait is still coming in."""

    period_s = 0.02
    late_s = 0.025
    caught_up_s = 0.1

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="gaiteyes-echo-")
        endpoint = f"unixsock-stream/{Path(self._folder.name) / 'echo.sock'}"
        self._sent_ns = time.monotonic_ns()
        self._late_ns = 0
        self._ended = threading.Event()
        self._server = _session("listen", endpoint)
        self._client = _session("connect", endpoint)
        self._client.declare_subscriber(_KEY, self._hear)
        self._sender = threading.Thread(target=self._send, name="echo", daemon=True)
        self._sender.start()

    def is_prompt(self, now_ns: int) -> bool:
        """Return whether what should have come back by `now_ns`, monotonic, has."""
        if now_ns - self._sent_ns > _NS_PER_S * (self.period_s + self.late_s):
            self._late_ns = now_ns
        return now_ns - self._late_ns > _NS_PER_S * self.caught_up_s

    def close(self) -> None:
        """End sending and both sessions."""
        self._ended.set()
        self._sender.join()
        for session in (self._client, self._server):
            session.close()  # type: ignore[no-untyped-call]  # zenoh's stubs leave it bare
        self._folder.cleanup()

    def _send(self) -> None:
        while not self._ended.wait(self.period_s):
            self._server.put(_KEY, str(time.monotonic_ns()))

    def _hear(self, sample: zenoh.Sample) -> None:
        self.is_prompt(time.monotonic_ns())
        self._sent_ns = int(sample.payload.to_string())


def _session(how: str, endpoint: str) -> zenoh.Session:
    settings = {"mode": "peer", how: {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}}
    if how == "connect":
        settings["listen"] = {"endpoints": []}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


_KEY, _NS_PER_S = "echo", 1e9

"""All topics of one device of this machine through one session, each message checked as `listen` checks it."""

import threading
import time
from collections import Counter, deque
from contextlib import ExitStack
from typing import Any

import zenoh

from drivers.boot_id import read_boot_id
from drivers.zenoh.local_socket import subscriber_endpoint
from drivers.zenoh.session import open_client
from drivers.zenoh.settings import Credentials
from messages import TOPICS, Refusal
from messages.json_receiver import LONGEST_PAYLOAD_BYTES, JsonReceiver, Received

WAITING_PAYLOADS = 1024
"""About 4 s of all topics; of more, the oldest leaves."""


class DeviceListener:
    """Everything that `device` publishes, simulated or not, in the order in which it came.

    `refused` counts what did not pass the checks, by reason. Raises UserError, in one line, if nobody publishes.
    """

    def __init__(self, device: str) -> None:
        endpoint = subscriber_endpoint(device)
        self.refused: Counter[Refusal] = Counter()
        self._arrived: deque[tuple[str, bytes, int]] = deque(maxlen=WAITING_PAYLOADS)
        self._some = threading.Event()
        self._receivers: dict[str, JsonReceiver[Any]] = {}
        session = open_client(endpoint, Credentials())
        self._undo = ExitStack()  # runs backwards: the session ends last
        self._undo.callback(session.close)
        for topic in TOPICS.values():
            if topic.published:
                self._receivers[topic.name] = JsonReceiver(
                    topic.message,
                    device,
                    boot_id=read_boot_id(),
                    accept_simulated=True,
                    same_machine=True,
                )
                self._undo.callback(session.declare_subscriber(topic.key(device), self._put(topic.name)).undeclare)

    def take(self, timeout_s: float) -> list[Received[Any]]:
        """Return all that came and passed since the last call, or wait for something up to `timeout_s`."""
        self._some.wait(timeout_s)
        self._some.clear()
        passed: list[Received[Any]] = []
        for _ in range(len(self._arrived)):
            name, payload, t_arrival_ns = self._arrived.popleft()
            found = self._receivers[name].feed(payload, t_arrival_ns, max(time.monotonic_ns(), t_arrival_ns))
            if isinstance(found, Refusal):
                self.refused[found] += 1
            else:
                passed.append(found)
        return passed

    def close(self) -> None:
        """End the subscriptions and the session."""
        self._undo.close()

    def _put(self, name: str) -> "zenoh.handlers.Callback[zenoh.Sample]":
        def put(sample: zenoh.Sample) -> None:  # in Zenoh's network thread: it only puts the payload aside
            payload = sample.payload
            if len(payload) <= LONGEST_PAYLOAD_BYTES:
                self._arrived.append((name, payload.to_bytes(), time.monotonic_ns()))
                self._some.set()

        callback: zenoh.handlers.Callback[zenoh.Sample] = zenoh.handlers.Callback(put, indirect=False)
        return callback

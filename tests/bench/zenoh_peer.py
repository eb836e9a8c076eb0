"""A Zenoh client of this machine for the tests, and sockets nobody listens on."""

import fcntl
import itertools
import json
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import zenoh

from drivers.zenoh.settings import SOCKET

PATIENCE_POLLS = 3 * 1000
POLL_S = 0.01

_FOLDER = tempfile.TemporaryDirectory(prefix="gaiteyes-")  # pytest's own paths are too long for sockets
_NUMBERS = itertools.count()


def free_endpoint() -> str:
    return f"{SOCKET}{_FOLDER.name}/{next(_NUMBERS)}.sock"


@contextmanager
def taken(endpoint: str) -> Iterator[None]:
    """Hold the socket's place as another service would, while the context lasts."""
    with open(f"{endpoint.removeprefix(SOCKET)}.lock", "wb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield


def client(endpoint: str) -> zenoh.Session:
    config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def arrival(
    subscription: "zenoh.Subscriber[zenoh.Handler[zenoh.Sample]]", publish: Callable[[], None] | None = None
) -> zenoh.Sample:
    """The next sample; `publish`, if given, is repeated until one arrives, for a subscription travels on its own."""
    for _ in range(PATIENCE_POLLS):
        if publish is not None:
            publish()
        time.sleep(POLL_S)
        sample = subscription.try_recv()
        if sample is not None:
            return sample
    raise AssertionError("no sample arrived")

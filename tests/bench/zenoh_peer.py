"""A Zenoh client on loopback for the tests, and a port nobody listens on."""

import json
import socket
import time
from collections.abc import Callable

import zenoh

PATIENCE_POLLS = 1000
POLL_S = 0.01


def free_endpoint() -> str:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


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

"""How a Zenoh session is opened: the one place for what a connection needs."""

import json
import re

import zenoh

from messages import UserError


def open_client(endpoint: str) -> zenoh.Session:
    """Return a session with the one service that listens on `endpoint`, as in tcp/127.0.0.1:7447.

    It looks for nobody else (no multicast), and finds the service again by itself when that was restarted. Raises
    UserError, in one line, if nobody answers there or `endpoint` is none.
    """
    config = zenoh.Config()
    entries = {"mode": "client", "connect/endpoints": [endpoint], "scouting/multicast/enabled": False}
    try:
        for key, value in entries.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise UserError(f"Zenoh: cannot connect to {endpoint}: {_reason(error)}") from error


def _reason(error: zenoh.ZError) -> str:
    """Return Zenoh's own line without the places in its sources."""
    if "Unable to connect" in str(error):
        return "nobody answers there; is `gaiteyes run` or `gaiteyes demo` running?"
    return re.sub(r" at /\S+:\d+\.\]?", "", " ".join(str(error).split()))

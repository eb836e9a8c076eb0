"""How a Zenoh session is opened, by the service and by who listens to it: the one place for what a connection needs.

Zenoh would route what any session publishes on to all others. The service's session lets in nobody's
publications: access control denies whatever `_access_control` does not name, and no peer is looked for or found.
"""

import json
import os
import re
import resource
from collections.abc import Sequence

import zenoh

from drivers.protocols import DeviceError
from drivers.zenoh.local_socket import check_private, service_endpoint, socket_path
from drivers.zenoh.settings import SOCKET, Credentials, ZenohSettings, is_secure
from messages import UserError

SEND_BUFFER_BYTES = 8192
"""Dropping starts only when TCP's own buffer is full. With the system's megabytes a subscriber that stood still was
told of thousands of old planes first and of no new one for seconds; with this little it catches up at once."""

BATCH_BYTES = 8192
"""Zenoh fills batches of this size, up to sixteen for a subscriber that does not read; what it takes as standard is
eight times as much, a megabyte a subscriber."""

LONGEST_QUERY_BYTES = 65_536
"""What somebody who connects may make the service keep of one message; Zenoh would keep a gigabyte."""

SESSIONS = 4096
"""How many may be connected at once, and how many more may be about to: those who connect and say nothing are hung up
on after `OPENING_MS`, but until then they must not shut out a subscriber."""
OPENING_MS = 1000
SPARE_FILES = 256
"""What is left of the process's open files for devices and recordings, whoever connects."""

ASKED_HZ = 100.0
"""So often one connection may ask for one key; more queries are dropped before they cost the interpreter anything."""

CONNECTING_MS = 2000
"""How long a subscriber tries to connect: a service that many others are connecting to does not take each at once."""
RETRY_MS = (50, 500)
"""The pauses of a subscriber that looks for its service, the first and the longest: also after a restart."""

_RUNTIME_PARTS = ("app", "acc", "tx", "rx", "net")
_BLOCKING_THREADS = 8
"""Zenoh ends a connection in a thread of its own, up to fifty for each of its five parts, more than the service's unit
allows (TasksMax) when hundreds hang up at once."""


def open_server(settings: ZenohSettings, device: str, answered: Sequence[str]) -> tuple[zenoh.Session, str]:
    """Return the service's session and its endpoint. Whoever may connect can listen, and ask for the keys `answered`.

    Raises DeviceError, in one line, if it cannot listen there; UserError if it must not: on an endpoint that is not
    secure, unless `settings.insecure`, or in a directory where others may write.
    """
    endpoint = settings.listen or service_endpoint(device)
    if not is_secure(endpoint) and not settings.insecure:
        raise UserError(
            f"zenoh.listen is {endpoint}, where anything could pose as the service; allowed is {SOCKET}PATH, "
            "tls/HOST:PORT with certificate and private_key, or any with insecure = true"
        )
    if endpoint.startswith(SOCKET):
        check_private(socket_path(endpoint), to_listen=True)
    if endpoint.startswith("tls/"):
        for name in ("certificate", "private_key"):
            _check_readable(f"zenoh.{name}", getattr(settings, name))
    for name in ("client_authority", "users"):
        if getattr(settings, name):
            _check_readable(f"zenoh.{name}", getattr(settings, name))
    parts = ", ".join(f"{part}: (max_blocking_threads: {_BLOCKING_THREADS})" for part in _RUNTIME_PARTS)
    os.environ.setdefault("ZENOH_RUNTIME", f"({parts})")
    try:
        session = zenoh.open(_config(_server_entries(settings, endpoint, device, answered)))
    except zenoh.ZError as error:
        raise DeviceError(f"Zenoh: cannot listen on {endpoint}: {_reason(error)}") from error
    if endpoint.startswith(SOCKET):
        socket_path(endpoint).chmod(0o666)  # who may connect is who may enter the directory
    return session, endpoint


def open_client(endpoint: str, credentials: Credentials, *, insecure: bool = False) -> zenoh.Session:
    """Return a session with the one service that listens on `endpoint`.

    It looks for nobody else (no multicast), and finds the service again by itself when that was restarted. Raises
    UserError, in one line, if nobody answers there, `endpoint` is none, or something else could pose as the service
    there and `insecure` does not say that this is meant.
    """
    if not is_secure(endpoint) and not insecure:
        raise UserError(
            f"Zenoh: on {endpoint} anything could pose as the service; allowed is {SOCKET}PATH, tls/HOST:PORT with "
            "an authority, or any with insecure=True"
        )
    if endpoint.startswith(SOCKET):
        check_private(socket_path(endpoint), to_listen=False)
    if endpoint.startswith("tls/"):
        _check_readable("Zenoh: authority", credentials.authority)
    try:
        return zenoh.open(_config(_client_entries(endpoint, credentials)))
    except zenoh.ZError as error:
        raise UserError(f"Zenoh: cannot connect to {endpoint}: {_reason(error)}") from error


def _server_entries(settings: ZenohSettings, endpoint: str, device: str, answered: Sequence[str]) -> dict[str, object]:
    sessions = min(SESSIONS, (_open_files() - SPARE_FILES) // 2)
    return {
        "mode": "peer",
        "listen/endpoints": [endpoint],
        "connect/endpoints": [],
        **_NOBODY_ELSE,
        "access_control": _access_control(device, answered),
        "downsampling": [
            {
                "flows": ["ingress"],
                "messages": ["query"],
                "rules": [{"key_expr": key, "freq": ASKED_HZ} for key in answered],
            }
        ],
        "transport/unicast/max_sessions": sessions,
        "transport/unicast/accept_pending": sessions,
        "transport/unicast/accept_timeout": OPENING_MS,
        "transport/link/rx/max_message_size": LONGEST_QUERY_BYTES,
        "transport/link/rx/buffer_size": 2 * BATCH_BYTES,
        "transport/link/tx/batch_size": BATCH_BYTES,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tcp/so_sndbuf": SEND_BUFFER_BYTES,
        "transport/link/tls/so_sndbuf": SEND_BUFFER_BYTES,
        "transport/link/tls/listen_certificate": settings.certificate or None,
        "transport/link/tls/listen_private_key": settings.private_key or None,
        "transport/link/tls/root_ca_certificate": settings.client_authority or None,
        "transport/link/tls/enable_mtls": bool(settings.client_authority),
        "transport/auth/usrpwd/dictionary_file": settings.users or None,
    }


def _client_entries(endpoint: str, credentials: Credentials) -> dict[str, object]:
    first_ms, longest_ms = RETRY_MS
    return {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": CONNECTING_MS,
        "connect/retry": {"period_init_ms": first_ms, "period_max_ms": longest_ms, "period_increase_factor": 2.0},
        **_NOBODY_ELSE,
        "transport/link/tls/root_ca_certificate": credentials.authority or None,
        "transport/link/tls/connect_certificate": credentials.certificate or None,
        "transport/link/tls/connect_private_key": credentials.private_key or None,
        "transport/link/tls/enable_mtls": bool(credentials.certificate),
        "transport/link/tls/verify_name_on_connect": True,
        "transport/auth/usrpwd/user": credentials.user or None,
        "transport/auth/usrpwd/password": credentials.password or None,
    }


_NOBODY_ELSE: dict[str, object] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
}


def _access_control(device: str, answered: Sequence[str]) -> dict[str, object]:
    """Return what may pass, by key, direction and kind of message; all else is denied, above all what others publish.

    In come subscriptions and questions; out go publications, answers and what tells that they are there.
    """

    def rule(name: str, flow: str, messages: Sequence[str], keys: Sequence[str]) -> dict[str, object]:
        return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}

    listening = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
    telling = ("put", "reply", "declare_queryable", "liveliness_token")
    rules = [
        rule("listen", "ingress", listening, ["gaiteyes/**"]),
        rule("ask", "ingress", ["query"], answered),
        rule("tell", "egress", telling, [f"gaiteyes/{device}/**"]),
    ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": "everybody"}],
        "policies": [{"rules": [each["id"] for each in rules], "subjects": ["everybody"]}],
    }


def _open_files() -> int:
    """Return how many files the process may have open, after asking for as many as the sessions need."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = min(2 * SESSIONS + SPARE_FILES, hard)
    if soft >= wanted:
        return soft
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    except (OSError, ValueError):  # a service manager may forbid it; it has set the limit itself
        return soft
    return wanted


def _check_readable(name: str, path: str) -> None:
    if not path:
        raise UserError(f"{name} is missing; TLS needs it, as a PEM file")
    if not os.access(path, os.R_OK):
        raise UserError(f"{name}: cannot read {path}")


def _config(entries: dict[str, object]) -> zenoh.Config:
    config: zenoh.Config = zenoh.Config()
    for key, value in entries.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _reason(error: zenoh.ZError) -> str:
    """Return Zenoh's own line without the places in its sources."""
    told = re.sub(r" at /\S+:\d+\.\]?", "", " ".join(str(error).split()))
    if "Address already in use" in told or "Unable to acquire" in told:
        return "the address is in use; is another service running?"
    if "Unable to connect" in told:
        return "nobody answers there, or not as asked; is `gaiteyes run` or `gaiteyes demo` running?"
    return told

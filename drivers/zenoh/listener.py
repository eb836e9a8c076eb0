"""Receives what the service publishes on Zenoh: `listen`."""

import math
import re
import threading
import time
import weakref
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Generic, TypeVar, get_args, overload

import msgspec
import zenoh

from drivers.boot_id import read_boot_id
from drivers.zenoh.local_socket import subscriber_endpoint
from drivers.zenoh.session import open_client
from drivers.zenoh.settings import SOCKET, Credentials
from messages import INTERFACE_VERSION, TOPIC_OF, Estimate, Refusal, UserError
from messages.json_receiver import LONGEST_PAYLOAD_BYTES, JsonReceiver, Received

WAITING_PAYLOADS = 16
"""How many payloads wait for the consumer; of more, the oldest leaves."""

_KEY = re.compile(
    r"gaiteyes/(?P<device>[A-Za-z0-9][A-Za-z0-9_.-]{0,63})/(?:replay/)?(?P<topic>[a-z_]+)/v(?P<version>[0-9]+)"
)

_NO_CREDENTIALS = Credentials()

E = TypeVar("E", bound=Estimate)


class Listener(Generic[E]):
    """The estimates of one key, to iterate over, each checked as `messages.json_receiver.JsonReceiver` says.

    The newest wins: of all that came since the last one was taken, only the newest that passes is given, so that a
    slow consumer never works on a backlog. Nothing that arrives raises: `refused` counts what was refused, by reason,
    and `superseded` what a newer estimate replaced. An iteration ends when nothing has passed for `timeout_s`; the next
    one goes on listening, until `close`, which the end of a `with` block calls, and the going of the last reference.
    """

    def __init__(
        self, key: str, receiver: JsonReceiver[E], session: zenoh.Session, timeout_s: float | None = None
    ) -> None:
        self.refused: Counter[Refusal] = Counter()
        self.superseded = 0
        self._receiver = receiver
        self._timeout_s = timeout_s
        self._mailbox = mailbox = _Mailbox()
        undo = ExitStack()  # runs backwards: the consumer is woken first, the session ends last
        undo.callback(session.close)
        undo.callback(session.declare_subscriber(key, _put_into(mailbox)).undeclare)
        undo.callback(mailbox.close)
        self._close = weakref.finalize(self, undo.close)

    def close(self) -> None:
        """End the subscription and the session; the iteration ends, in whatever thread it waits."""
        self._close()

    def __enter__(self) -> "Listener[E]":
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[Received[E]]:
        end_s = self._end_s()
        while self._mailbox.wait(end_s - time.monotonic()):
            received = self._newest(self._mailbox.take())
            if received is not None:
                yield received
                end_s = self._end_s()

    def _end_s(self) -> float:
        return math.inf if self._timeout_s is None else time.monotonic() + self._timeout_s

    def _newest(self, arrived: "list[tuple[bytes, int]]") -> Received[E] | None:
        newest: Received[E] | None = None
        for payload, t_arrival_ns in arrived:
            found = self._receiver.feed(payload, t_arrival_ns, time.monotonic_ns())
            if isinstance(found, Refusal):
                self.refused[found] += 1
            else:
                self.superseded += newest is not None
                newest = found
        return newest


class _Mailbox:
    """What came and was not taken yet, with its instants of arrival."""

    def __init__(self) -> None:
        self._arrived: deque[tuple[bytes, int]] = deque(maxlen=WAITING_PAYLOADS)
        self._changed = threading.Condition()
        self._closed = False

    def put(self, payload: bytes, t_arrival_ns: int) -> None:
        with self._changed:
            self._arrived.append((payload, t_arrival_ns))
            self._changed.notify()

    def wait(self, timeout_s: float) -> bool:
        """Return whether something came before `timeout_s`, which may be infinite, had passed; no once closed."""
        if timeout_s <= 0.0:
            return False
        with self._changed:
            self._changed.wait_for(lambda: self._arrived or self._closed, None if math.isinf(timeout_s) else timeout_s)
            return bool(self._arrived) and not self._closed

    def take(self) -> list[tuple[bytes, int]]:
        """Return all that waits, oldest first."""
        with self._changed:
            arrived = list(self._arrived)
            self._arrived.clear()
            return arrived

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()


def _put_into(mailbox: _Mailbox) -> "zenoh.handlers.Callback[zenoh.Sample]":
    def put(sample: zenoh.Sample) -> None:
        # Of what is too long only so much is kept that it is refused as too long.
        payload = sample.payload
        mailbox.put(
            payload.to_bytes() if len(payload) <= LONGEST_PAYLOAD_BYTES else bytes(LONGEST_PAYLOAD_BYTES + 1),
            time.monotonic_ns(),
        )

    # Called in Zenoh's network thread, where it only puts the payload aside: a thread between them would have a queue
    # of its own, without end.
    callback: zenoh.handlers.Callback[zenoh.Sample] = zenoh.handlers.Callback(put, indirect=False)
    return callback


@overload
def listen(
    topic: type[E],
    device: str,
    *,
    connect: str | None = None,
    credentials: Credentials = _NO_CREDENTIALS,
    insecure: bool = False,
    accept_simulated: bool = False,
    timeout_s: float | None = None,
) -> Listener[E]: ...


@overload
def listen(
    topic: str,
    device: str | None = None,
    *,
    connect: str | None = None,
    credentials: Credentials = _NO_CREDENTIALS,
    insecure: bool = False,
    accept_simulated: bool = False,
    timeout_s: float | None = None,
) -> Listener[Estimate]: ...


def listen(
    topic: type[E] | str,
    device: str | None = None,
    *,
    connect: str | None = None,
    credentials: Credentials = _NO_CREDENTIALS,
    insecure: bool = False,
    accept_simulated: bool = False,
    timeout_s: float | None = None,
) -> Listener[Any]:
    """Listen to one topic of one device: what comes are typed messages that passed every check.

    `topic` is the message's type (`GroundPlane`) or the topic's name ("ground") beside `device`, or the whole key
    alone ("gaiteyes/DEVICE/ground/v2"; a replay's is "gaiteyes/DEVICE/replay/ground/v2"). Each item is a `Received`:
    message, stamp, age. `accept_simulated` takes simulated and replayed data too. After `timeout_s` without an
    estimate that passes, the iteration ends; without a `timeout_s` it waits.

    A service on this machine is found by its device's name: its socket lies where only the service may write, so
    nothing can pose as it. One on another machine is reached with `connect`, "tls/HOST:PORT", and `credentials` that
    say whose certificate to believe. Any other endpoint, plain TCP for instance, needs `insecure`: whatever answers
    there is believed.

        with gaiteyes.listen(gaiteyes.GroundPlane, "unit-1", timeout_s=0.2) as listener:
            for received in listener:
                if received.message.status is gaiteyes.Status.VALID:
                    act_on(received.message)
        stop_acting()

    Raises UserError, in one line, for a topic that is not published, a key that is none, where nobody listens, or where
    others may write the directory of the socket.
    """
    key, kind, name = _resolved(topic, device)
    endpoint = subscriber_endpoint(name) if connect is None else connect
    receiver = JsonReceiver(
        kind,
        name,
        boot_id=read_boot_id(),
        accept_simulated=accept_simulated,
        same_machine=endpoint.startswith(SOCKET),
    )
    return Listener(key, receiver, open_client(endpoint, credentials, insecure=insecure), timeout_s)


def _resolved(topic: type[msgspec.Struct] | str, device: str | None) -> tuple[str, type[Estimate], str]:
    """Return key, message type and device."""
    published = {TOPIC_OF[kind].name: kind for kind in get_args(Estimate)}
    name = topic if isinstance(topic, str) else TOPIC_OF[topic].name if topic in TOPIC_OF else topic.__name__
    key = name if device is None else f"gaiteyes/{device}/{name}/v{INTERFACE_VERSION}"
    parts = _KEY.fullmatch(key)
    if parts is None or parts["topic"] not in published:
        raise UserError(
            f"'{key}': expected gaiteyes/DEVICE/TOPIC/v{INTERFACE_VERSION} with TOPIC one of {', '.join(published)}"
        )
    if parts["version"] != str(INTERFACE_VERSION):
        raise UserError(
            f"'{key}': published is version {INTERFACE_VERSION} alone, whose messages mean something else "
            f"(the ground is that under the next foothold): '{key.removesuffix(parts['version'])}{INTERFACE_VERSION}'"
        )
    return key, published[parts["topic"]], parts["device"]

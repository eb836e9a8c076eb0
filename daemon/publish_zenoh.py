"""Estimates on Zenoh, as flat JSON: the message's own keys and the stamp's (`messages.codec.encode_line`).

Exact keys, for a device called DEVICE; a replay has `replay/` after the device everywhere, and so never looks live:

    gaiteyes/DEVICE/ground/v2, …/terrain/v2, …/health/v2, …    published (messages.topics: names, rates, deadlines)
    gaiteyes/DEVICE/alive                                   liveliness token: presence, not a watchdog (10 s lease)
    gaiteyes/DEVICE/calibration                             queryable: the calibration in use
    gaiteyes/DEVICE/configuration                           queryable: the service's settings
    gaiteyes/DEVICE/schema                                  queryable: JSON Schema of every published message

Ask for exact keys, and subscribe to keys below gaiteyes/: a wider key expression gets nothing, silently, because access
control denies whatever is not allowed (`drivers.zenoh.session`).
"""

import contextlib
import json
import re
import threading
import time
from collections.abc import Mapping
from typing import NamedTuple

import msgspec
import zenoh

from drivers.protocols import DeviceError
from drivers.zenoh.session import open_server
from drivers.zenoh.settings import ZenohSettings, is_secure
from messages import (
    TOPIC_OF,
    TOPICS,
    Estimate,
    GroundPlane,
    Health,
    PropagatedGround,
    Stamp,
    UnitCalibration,
    UserError,
    ZenohHealth,
)
from messages.codec import encode, encode_line, published_schemas

MOST_ANSWERS_PER_S = 50
"""Of all who ask together; whoever asks for more gets no answer, so that a flood of queries costs no plane."""

_PRIORITIES: dict[type[msgspec.Struct], zenoh.Priority] = {
    GroundPlane: zenoh.Priority.REAL_TIME,
    Health: zenoh.Priority.INTERACTIVE_HIGH,
    PropagatedGround: zenoh.Priority.INTERACTIVE_LOW,
}
"""Each has a queue of its own: what is sent a hundred times a second crowds out neither the ground nor the one message
a second that says how the service is, and attitudes do not crowd out what a controller acts on."""

_DEVICE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


class _Outlet(NamedTuple):
    """One session that publishes: where, with what, and how all of it is taken back."""

    endpoint: str
    publishers: Mapping[type[msgspec.Struct], zenoh.Publisher]
    undo: contextlib.ExitStack


class ZenohPublisher:
    """A Zenoh peer that publishes, answers queries and shows that it is there.

    It finds nobody by itself (multicast and gossip are off): others connect to `endpoint`. Under congestion a
    publication is dropped at once, without Zenoh's usual wait; Zenoh does not tell how many. `errors` counts
    publications that Zenoh refused. Raises DeviceError, in one line, if it cannot listen or `device` is no key;
    UserError where it must not listen (`drivers.zenoh.session.open_server`).
    """

    name = "zenoh"

    def __init__(
        self,
        settings: ZenohSettings,
        device: str,
        *,
        calibration: UnitCalibration,
        configuration: msgspec.Struct,
        replay: bool = False,
    ) -> None:
        if not _DEVICE.fullmatch(device):
            raise DeviceError(f"device '{device}': 1 to 64 letters, digits, '_', '.' or '-', the first no sign")
        self.errors = 0
        self.sent = 0
        self._device = device
        self._replay = replay
        self._prefix = f"gaiteyes/{device}/replay" if replay else f"gaiteyes/{device}"
        self._answers = _Answers(
            {
                f"{self._prefix}/calibration": encode(calibration),
                f"{self._prefix}/configuration": encode(configuration),
                f"{self._prefix}/schema": json.dumps(published_schemas()).encode(),
            }
        )
        self._settings = settings
        self._publishing = threading.Lock()
        self._outlet = self._open(settings)

    @property
    def endpoint(self) -> str:
        """Return where subscribers connect."""
        return self._outlet.endpoint

    @property
    def health(self) -> ZenohHealth:
        """Return what the publisher's other end looks like: is it to be trusted, and what came that was no question?"""
        return ZenohHealth(
            insecure=not is_secure(self.endpoint), malformed=self._answers.malformed, refused=self._answers.refused
        )

    def set_configuration(self, configuration: msgspec.Struct) -> None:
        """Answer queries with these settings from now on."""
        self._answers.payloads[f"{self._prefix}/configuration"] = encode(configuration)

    def listen_anew(self, settings: ZenohSettings) -> None:
        """Publish on another endpoint, or on the same one with other keys or users; counts go on.

        Where that fails all is as before, and raises as at the start.
        """
        if settings.listen == self._settings.listen:  # nobody can listen twice in one place
            self._exchange(_Outlet(self.endpoint, {}, contextlib.ExitStack()))
            try:
                self._exchange(self._open(settings))
            except UserError:
                self._exchange(self._open(self._settings))
                raise
        else:
            self._exchange(self._open(settings))
        self._settings = settings

    def publish(self, estimate: Estimate, stamp: Stamp) -> None:
        """Send one estimate, or let Zenoh drop it; never waits for a subscriber."""
        line = encode_line(TOPIC_OF[type(estimate)], estimate, stamp)
        with self._publishing:
            try:
                self._outlet.publishers[type(estimate)].put(line)
            except (zenoh.ZError, KeyError):  # KeyError: between two endpoints
                self.errors += 1
            else:
                self.sent += 1

    def close(self) -> None:
        """Take everything back in order, then end the session."""
        self._outlet.undo.close()

    def _exchange(self, new: _Outlet) -> None:
        with self._publishing:  # Zenoh takes nothing back that is in use
            old, self._outlet = self._outlet, new
        old.undo.close()

    def _open(self, settings: ZenohSettings) -> _Outlet:
        keys = tuple(self._answers.payloads)
        session, endpoint = open_server(settings, self._device, keys)
        publishers = {
            topic.message: session.declare_publisher(
                topic.key(self._device, replay=self._replay),
                encoding=zenoh.Encoding.APPLICATION_JSON,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=_PRIORITIES.get(topic.message, zenoh.Priority.DATA_HIGH),
                express=True,
            )
            for topic in TOPICS.values()
            if topic.published
        }
        queryables = [session.declare_queryable(key, self._answers.callback(key)) for key in keys]
        token = session.liveliness().declare_token(f"{self._prefix}/alive")
        undo = contextlib.ExitStack()  # runs backwards: the token goes first, the session last
        undo.callback(session.close)
        for publisher in publishers.values():
            undo.callback(publisher.undeclare)
        for queryable in queryables:
            undo.callback(queryable.undeclare)
        undo.callback(token.undeclare)
        return _Outlet(endpoint, publishers, undo)


class _Answers:
    """What queries are answered with, by key; `malformed` and `refused` count those that got no answer."""

    def __init__(self, payloads: dict[str, bytes]) -> None:
        self.payloads = payloads
        self.malformed = 0
        self.refused = 0
        self._second = 0
        self._in_second = 0

    def callback(self, key: str) -> "zenoh.handlers.Callback[zenoh.Query]":
        """Return what answers queries for `key`."""

        def reply(query: zenoh.Query) -> None:
            with query:
                if self._is_answered(query):
                    query.reply(key, self.payloads[key], encoding=zenoh.Encoding.APPLICATION_JSON)

        # Called in Zenoh's network thread: the answer is ready, and a thread made for the callback would outlive a
        # service that died without closing, and keep its process from ending.
        callback: zenoh.handlers.Callback[zenoh.Query] = zenoh.handlers.Callback(reply, indirect=False)
        return callback

    def _is_answered(self, query: zenoh.Query) -> bool:
        if query.payload is not None or str(query.parameters):
            self.malformed += 1
            return False
        second = int(time.monotonic())
        self._in_second = self._in_second + 1 if second == self._second else 1
        self._second = second
        self.refused += self._in_second > MOST_ANSWERS_PER_S
        return self._in_second <= MOST_ANSWERS_PER_S

"""Estimates on Zenoh, as flat JSON: the message's own keys and the stamp's (`messages.codec.encode_line`).

Exact keys, for a device called DEVICE; a replay has `replay/` after the device everywhere, and so never looks live:

    gaiteyes/DEVICE/ground/v1, …/attitude/v1, …/motion/v1, …/health/v1   published (messages.topics: rates, deadlines)
    gaiteyes/DEVICE/alive                                   liveliness token: presence, not a watchdog (10 s lease)
    gaiteyes/DEVICE/calibration                             queryable: the calibration in use
    gaiteyes/DEVICE/configuration                           queryable: the service's settings
    gaiteyes/DEVICE/schema                                  queryable: JSON Schema of every published message

Subscribe to exact keys: where access control is on, a wider key expression gets nothing, silently.
"""

import contextlib
import json
import re
from collections.abc import Mapping

import msgspec
import zenoh

from daemon.config import ZenohSettings
from drivers.protocols import DeviceError
from messages import TOPIC_OF, TOPICS, Estimate, GroundPlane, Health, Stamp, UnitCalibration
from messages.codec import encode, encode_line, published_schemas

SEND_BUFFER_BYTES = 8192
"""Dropping starts only when TCP's own buffer is full. With the system's megabytes a subscriber that stood still was
told of thousands of old planes first and of no new one for seconds; with this little it catches up at once."""

_PRIORITIES: dict[type[msgspec.Struct], zenoh.Priority] = {
    GroundPlane: zenoh.Priority.REAL_TIME,
    Health: zenoh.Priority.INTERACTIVE_HIGH,
}
"""Each has a queue of its own: what is sent a hundred times a second crowds out neither the ground nor the one message
a second that says how the service is."""

_DEVICE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


class ZenohPublisher:
    """A Zenoh peer that publishes, answers queries and shows that it is there.

    It finds nobody by itself (multicast and gossip are off): others connect to `settings.listen`. Under congestion a
    publication is dropped at once, without Zenoh's usual wait; Zenoh does not tell how many. `errors` counts
    publications that Zenoh refused. Raises DeviceError, in one line, if it cannot listen or `device` is no key.
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
        session = _open(settings)
        self._publishers = {
            topic.message: session.declare_publisher(
                topic.key(device, replay=replay),
                encoding=zenoh.Encoding.APPLICATION_JSON,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=_PRIORITIES.get(topic.message, zenoh.Priority.DATA_HIGH),
                express=True,
            )
            for topic in TOPICS.values()
            if topic.published
        }
        prefix = f"gaiteyes/{device}/replay" if replay else f"gaiteyes/{device}"
        self._configuration_key = f"{prefix}/configuration"
        self._answers = answers = {
            f"{prefix}/calibration": encode(calibration),
            self._configuration_key: encode(configuration),
            f"{prefix}/schema": json.dumps(published_schemas()).encode(),
        }
        queryables = [session.declare_queryable(key, _reply_from(answers, key)) for key in answers]
        token = session.liveliness().declare_token(f"{prefix}/alive")
        self._undo = contextlib.ExitStack()  # runs backwards: the token goes first, the session last
        self._undo.callback(session.close)
        for publisher in self._publishers.values():
            self._undo.callback(publisher.undeclare)
        for queryable in queryables:
            self._undo.callback(queryable.undeclare)
        self._undo.callback(token.undeclare)

    def set_configuration(self, configuration: msgspec.Struct) -> None:
        """Answer queries with these settings from now on."""
        self._answers[self._configuration_key] = encode(configuration)

    def publish(self, estimate: Estimate, stamp: Stamp) -> None:
        """Send one estimate, or let Zenoh drop it; never waits for a subscriber."""
        try:
            self._publishers[type(estimate)].put(encode_line(TOPIC_OF[type(estimate)], estimate, stamp))
        except zenoh.ZError:
            self.errors += 1
        else:
            self.sent += 1

    def close(self) -> None:
        """Take everything back in order, then end the session."""
        self._undo.close()


def _open(settings: ZenohSettings) -> zenoh.Session:
    config = zenoh.Config()
    entries = {
        "mode": "peer",
        "listen/endpoints": [settings.listen],
        "connect/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tcp/so_sndbuf": SEND_BUFFER_BYTES,
    }
    try:
        for key, value in entries.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise DeviceError(f"Zenoh: cannot listen on {settings.listen}: {_reason(error)}") from error


def _reason(error: zenoh.ZError) -> str:
    """Zenoh's own line without the places in its sources."""
    if "Address already in use" in str(error):
        return "the address is in use; stop the other service or set another one"
    return re.sub(r" at /\S+:\d+\.\]?", "", " ".join(str(error).split()))


def _reply_from(answers: Mapping[str, bytes], key: str) -> "zenoh.handlers.Callback[zenoh.Query]":
    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply(key, answers[key], encoding=zenoh.Encoding.APPLICATION_JSON)

    # Called in Zenoh's network thread: the answer is ready, and a thread made for the callback would outlive a service
    # that died without closing, and keep its process from ending.
    callback: zenoh.handlers.Callback[zenoh.Query] = zenoh.handlers.Callback(reply, indirect=False)
    return callback

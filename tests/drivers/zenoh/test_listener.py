"""`listen` on loopback: a real session against real publishers, what passes, what is refused, and how it ends."""

import gc
import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

import msgspec
import pytest
import zenoh

from drivers.boot_id import read_boot_id
from drivers.zenoh.listener import WAITING_PAYLOADS, Listener, listen
from messages import (
    TOPIC_OF,
    Attitude,
    DropCause,
    Estimate,
    GroundPlane,
    Health,
    Motion,
    PropagatedGround,
    Refusal,
    Source,
    Status,
    Terrain,
    UserError,
)
from messages.codec import encode_line
from messages.json_receiver import LONGEST_PAYLOAD_BYTES, NEW_SEQUENCE_SILENCE_S, Received
from tests.bench.can_samples import attitude, ground, health, invalid_ground, motion, propagated_ground, stamp, terrain
from tests.bench.zenoh_peer import PATIENCE_POLLS, POLL_S, free_endpoint

KEY = "gaiteyes/unit-1/ground/v2"
PATIENCE_S = PATIENCE_POLLS * POLL_S

E = TypeVar("E", bound=Estimate)


class SlowClock:
    """CLOCK_MONOTONIC at a hundredth of its speed: on no machine, however busy, is what was just published too old."""

    def __init__(self) -> None:
        self._read_ns = time.monotonic_ns
        self._start_ns = self._read_ns()
        self._skipped_ns = 0

    def monotonic_ns(self) -> int:
        return self._start_ns + self._skipped_ns + (self._read_ns() - self._start_ns) // 100

    def skip(self, seconds: float) -> None:
        self._skipped_ns += round(1e9 * seconds)


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> SlowClock:
    slow = SlowClock()
    monkeypatch.setattr(time, "monotonic_ns", slow.monotonic_ns)
    return slow


class Peer:
    """Listens on `endpoint` as the service does, and puts whatever it is given."""

    def __init__(self, endpoint: str) -> None:
        config = zenoh.Config()
        for key, value in {
            "mode": "peer",
            "listen/endpoints": [endpoint],
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
        }.items():
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self.publisher = self.session.declare_publisher(KEY, congestion_control=zenoh.CongestionControl.BLOCK)

    def put(self, data: bytes) -> None:
        self.publisher.put(data)

    def wait_for_subscriber(self) -> None:
        wait_until_heard(self.publisher)

    def close(self) -> None:
        self.session.close()  # type: ignore[no-untyped-call]  # zenoh gives it no types


def wait_until_heard(publisher: zenoh.Publisher, *, heard: bool = True) -> None:
    for _ in range(PATIENCE_POLLS):
        if publisher.matching_status.matching == heard:  # type: ignore[attr-defined]  # zenoh calls it a bool
            return
        time.sleep(POLL_S)
    raise AssertionError("nobody subscribed" if heard else "still subscribed")


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture
def peer(endpoint: str) -> Iterator[Peer]:
    made = Peer(endpoint)
    yield made
    made.close()


@pytest.fixture
def listener(peer: Peer, endpoint: str) -> Iterator[Listener[GroundPlane]]:
    with listen(GroundPlane, "unit-1", connect=endpoint, timeout_s=PATIENCE_S) as made:
        peer.wait_for_subscriber()
        yield made


def line(seq: int, estimate: Estimate | None = None, *, age_ns: int = 0, **stamped: object) -> bytes:
    """A payload published now, captured `age_ns` ago. Without `estimate` it is the ground."""
    now_ns = time.monotonic_ns()
    sample = ground(t_exposure_ns=now_ns - age_ns) if estimate is None else estimate
    told = {"boot_id": read_boot_id(), "seq": seq, "t_publish_ns": now_ns, "age_s": 1e-9 * age_ns} | stamped
    return encode_line(TOPIC_OF[type(sample)], sample, stamp(**told))


def taken(listener: Listener[E]) -> Received[E]:
    return next(iter(listener))


def arrived(listener: Listener[GroundPlane], peer: Peer, data: bytes, seq: int) -> Received[GroundPlane]:
    """What passes of `data` followed by a good message: never `data`."""
    peer.put(data)
    peer.put(line(seq))
    return taken(listener)


def test_a_message_comes_typed_with_its_stamp(listener: Listener[GroundPlane], peer: Peer) -> None:
    peer.put(line(7))
    found = taken(listener)
    assert isinstance(found.message, GroundPlane)
    assert (found.message.height_m, found.message.status) == (0.931, Status.VALID)
    assert (found.stamp.seq, found.stamp.source, found.stamp.boot_id) == (7, Source.LIVE, read_boot_id())
    assert 0.0 < found.age_s <= TOPIC_OF[GroundPlane].deadline_s
    assert not listener.refused


@pytest.mark.parametrize(
    ("hostile", "why"),
    [
        (lambda: b"\xff\x00 no JSON", Refusal.MALFORMED),
        (lambda: line(1)[:-1], Refusal.MALFORMED),
        (lambda: line(1).replace(b"0.931", b'"high"'), Refusal.MALFORMED),
        (lambda: line(1).replace(b"0.931", b"NaN"), Refusal.MALFORMED),
        (lambda: line(1) + b" " * LONGEST_PAYLOAD_BYTES, Refusal.MALFORMED),
        (lambda: line(1, ground(t_exposure_ns=1), age_s=0.01), Refusal.MALFORMED),
        (lambda: line(1).replace(b"0.931", b"null"), Refusal.NOT_AVAILABLE),
        (lambda: line(1, age_ns=200_000_000), Refusal.STALE),
        (lambda: line(1, source=Source.SIMULATED), Refusal.NOT_LIVE),
        (lambda: line(1, source=Source.REPLAY), Refusal.NOT_LIVE),
        (lambda: line(0), Refusal.REPEATED),
        (lambda: line(1, boot_id="another boot"), Refusal.OTHER_BOOT),
        (lambda: line(1, device="unit-2"), Refusal.OTHER_TOPIC),
        (lambda: line(1, attitude()), Refusal.MALFORMED),
    ],
)
def test_what_is_hostile_is_counted_and_never_raised(
    listener: Listener[GroundPlane], peer: Peer, hostile: Callable[[], bytes], why: Refusal
) -> None:
    peer.put(line(0))
    taken(listener)
    assert arrived(listener, peer, hostile(), 2).stamp.seq == 2
    assert listener.refused == {why: 1}


def test_a_deleted_key_is_malformed(listener: Listener[GroundPlane], peer: Peer) -> None:
    peer.publisher.delete()
    peer.put(line(0))
    taken(listener)
    assert listener.refused == {Refusal.MALFORMED: 1}


def test_simulated_data_comes_when_asked_for(peer: Peer, endpoint: str) -> None:
    with listen(KEY, connect=endpoint, accept_simulated=True, timeout_s=PATIENCE_S) as listener:
        peer.wait_for_subscriber()
        peer.put(line(0, source=Source.SIMULATED))
        assert taken(listener).stamp.source is Source.SIMULATED


def test_an_estimate_that_is_not_valid_is_told(listener: Listener[GroundPlane], peer: Peer) -> None:
    now_ns = time.monotonic_ns()
    peer.put(line(0, msgspec.structs.replace(invalid_ground(), t_exposure_ns=now_ns), t_publish_ns=now_ns))
    assert taken(listener).message.status is Status.INVALID


def test_of_what_waits_the_newest_wins_and_the_rest_is_counted(listener: Listener[GroundPlane], peer: Peer) -> None:
    peer.put(line(0))
    taken(listener)
    for seq in range(1, 6):
        peer.put(line(seq))
    peer.put(b"no JSON")  # comes last, and takes nothing away
    found = [taken(listener)]
    while found[-1].stamp.seq < 5:
        found.append(taken(listener))
    assert listener.superseded + len(found) == 5
    peer.put(line(6))
    taken(listener)
    assert listener.refused == {Refusal.MALFORMED: 1}


def test_what_waits_is_bounded_and_the_oldest_leaves(listener: Listener[GroundPlane], peer: Peer) -> None:
    last = 10 * WAITING_PAYLOADS
    for seq in range(last):
        peer.put(str(seq).encode())
    for _ in range(PATIENCE_POLLS):
        if listener._mailbox._arrived and listener._mailbox._arrived[-1][0] == str(last - 1).encode():
            break
        time.sleep(POLL_S)
    waiting = [int(payload) for payload, _ in listener._mailbox.take()]
    assert waiting == list(range(last - WAITING_PAYLOADS, last))


def test_after_its_time_a_wait_ends_even_if_something_is_there(listener: Listener[GroundPlane]) -> None:
    listener._mailbox.put(b"flood", 0)
    assert listener._mailbox.wait(0.5)
    assert not listener._mailbox.wait(0.0)


def test_silence_ends_the_iteration(peer: Peer, endpoint: str) -> None:
    with listen(GroundPlane, "unit-1", connect=endpoint, timeout_s=0.05) as listener:
        assert list(listener) == []
        peer.wait_for_subscriber()
        peer.put(line(0))
        assert [received.stamp.seq for received in listener] == [0]
        assert list(listener) == []


def test_a_flood_of_what_is_refused_does_not_put_off_the_end(peer: Peer, endpoint: str) -> None:
    ended = threading.Event()

    def flood() -> None:
        while not ended.is_set():
            peer.put(b"flood")

    with listen(GroundPlane, "unit-1", connect=endpoint, timeout_s=0.2) as listener:
        peer.wait_for_subscriber()
        thread = threading.Thread(target=flood)
        thread.start()
        try:
            assert list(listener) == []
        finally:
            ended.set()
            thread.join()
        assert listener.refused[Refusal.MALFORMED] > 0


def test_closing_from_another_thread_ends_a_wait_without_end(peer: Peer, endpoint: str) -> None:
    listener = listen(GroundPlane, "unit-1", connect=endpoint)
    peer.wait_for_subscriber()
    threading.Timer(0.05, listener.close).start()
    assert list(listener) == []
    listener.close()


def test_a_loop_that_is_left_takes_its_subscription_back(peer: Peer, endpoint: str) -> None:
    def first() -> int:
        for found in listen(GroundPlane, "unit-1", connect=endpoint, timeout_s=PATIENCE_S):
            return found.stamp.seq
        return -1

    publishing = threading.Event()

    def publish() -> None:
        while not publishing.wait(POLL_S):
            peer.put(line(3))

    thread = threading.Thread(target=publish)
    thread.start()
    assert first() == 3
    publishing.set()
    thread.join()
    gc.collect()
    wait_until_heard(peer.publisher, heard=False)


def test_a_service_that_comes_back_is_found_again(endpoint: str, clock: SlowClock) -> None:
    first = Peer(endpoint)
    with listen(GroundPlane, "unit-1", connect=endpoint, timeout_s=PATIENCE_S) as listener:
        first.wait_for_subscriber()
        first.put(line(900))
        assert taken(listener).begins_sequence
        first.close()
        second = Peer(endpoint)
        second.wait_for_subscriber()
        clock.skip(NEW_SEQUENCE_SILENCE_S)
        second.put(line(0))
        found = taken(listener)
        assert (found.stamp.seq, found.begins_sequence, found.lost_before) == (0, True, 0)
        second.close()


SAMPLES: dict[type[Estimate], tuple[Estimate, str]] = {
    Attitude: (attitude(), "t_sample_ns"),
    GroundPlane: (ground(), "t_exposure_ns"),
    PropagatedGround: (propagated_ground(), "t_sample_ns"),
    Motion: (motion(), "t_exposure_ns"),
    Terrain: (terrain(), "t_exposure_ns"),
    Health: (health(), "t_ns"),
}


@pytest.mark.parametrize("kind", SAMPLES)
@pytest.mark.parametrize("by", ["name", "key", "type"])
def test_a_topic_is_given_by_name_key_or_type(peer: Peer, endpoint: str, kind: type[Estimate], by: str) -> None:
    sample, time_field = SAMPLES[kind]
    key = TOPIC_OF[kind].key("unit-1", replay=by == "key")
    publisher = peer.session.declare_publisher(key)
    listener: Listener[Estimate]
    if by == "type":
        listener = listen(kind, "unit-1", connect=endpoint, timeout_s=PATIENCE_S)
    elif by == "name":
        listener = listen(TOPIC_OF[kind].name, "unit-1", connect=endpoint, timeout_s=PATIENCE_S)
    else:
        listener = listen(key, connect=endpoint, timeout_s=PATIENCE_S)
    with listener:
        wait_until_heard(publisher)
        now_ns = time.monotonic_ns()
        publisher.put(line(0, msgspec.structs.replace(sample, **{time_field: now_ns}), t_publish_ns=now_ns))
        assert type(taken(listener).message) is kind


@pytest.mark.parametrize("connect", ["tcp/127.0.0.1:1", "garbage", "carrier/pigeon:1", "tcp/127.0.0.1:99999"])
def test_nobody_to_connect_to_is_one_clear_line(connect: str) -> None:
    with pytest.raises(UserError) as refused:
        listen(GroundPlane, "unit-1", connect=connect, insecure=True)
    assert str(refused.value).startswith(f"Zenoh: cannot connect to {connect}: ")
    assert ".rs" not in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("topic", "device"),
    [
        ("gaiteyes/unit-1/imu/v2", None),
        ("gaiteyes/unit-1/ground", None),
        ("gaiteyes/*/ground/v2", None),
        ("gaiteyes/**", None),
        ("ground", None),
        ("ground", "a/b"),
        ("ground", ""),
        ("frame", "unit-1"),
        (DropCause, "unit-1"),
    ],
)
def test_a_topic_that_is_none_is_one_clear_line(topic: str, device: str | None) -> None:
    with pytest.raises(UserError, match=r"TOPIC one of attitude, ground, .*, setpoint, health"):
        listen(topic, device)


@pytest.mark.parametrize("branch", ["", "replay/"])
@pytest.mark.parametrize("version", ["1", "3", "22"])
def test_a_key_of_another_version_is_one_clear_line_that_tells_the_key_of_this_one(branch: str, version: str) -> None:
    key = f"gaiteyes/unit-1/{branch}ground/v"
    with pytest.raises(UserError, match="mean something else") as refused:
        listen(f"{key}{version}")
    assert str(refused.value).startswith(f"'{key}{version}': ")
    assert str(refused.value).endswith(f"'{key}2'")
    assert "\n" not in str(refused.value)

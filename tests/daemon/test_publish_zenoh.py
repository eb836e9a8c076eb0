"""What a client of this machine sees of the Zenoh publisher: exact keys, flat JSON, answers, presence, no forgery."""

import itertools
import json
import math
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import jsonschema  # type: ignore[import-untyped]  # the package carries no type hints
import msgspec
import pytest
import zenoh

from daemon.publish_zenoh import MOST_ANSWERS_PER_S, ZenohPublisher
from drivers.protocols import DeviceError
from drivers.zenoh.listener import listen
from drivers.zenoh.local_socket import socket_path
from drivers.zenoh.session import ASKED_HZ
from drivers.zenoh.settings import SOCKET, Credentials, ZenohSettings
from lab.faults.zenoh_bytes import ZenohBytes
from messages import TOPICS, Calibration, Estimate, GroundPlane, Source, UserError, ZenohHealth
from messages.codec import decode, published_schemas
from tests.bench.can_samples import (
    attitude,
    calibration,
    ground,
    health,
    invalid_ground,
    motion,
    propagated_ground,
    setpoint,
    stamp,
    terrain,
)
from tests.bench.zenoh_peer import arrival, client, free_endpoint


class Configuration(msgspec.Struct, frozen=True):
    rate_hz: float = 20.0


def publisher(endpoint: str, device: str = "unit-1", *, replay: bool = False, insecure: bool = False) -> ZenohPublisher:
    return made_with(ZenohSettings(listen=endpoint, insecure=insecure), device, replay=replay)


def made_with(settings: ZenohSettings, device: str = "unit-1", *, replay: bool = False) -> ZenohPublisher:
    return ZenohPublisher(settings, device, calibration=calibration(), configuration=Configuration(), replay=replay)


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture
def live(endpoint: str) -> Iterator[ZenohPublisher]:
    made = publisher(endpoint)
    yield made
    made.close()


def test_ground_arrives_under_its_exact_key_as_flat_json(live: ZenohPublisher, endpoint: str) -> None:
    with client(endpoint) as session, session.declare_subscriber("gaiteyes/unit-1/ground/v2") as subscriber:
        sample = arrival(subscriber, lambda: live.publish(ground(), stamp()))
    assert str(sample.key_expr) == "gaiteyes/unit-1/ground/v2"
    assert sample.encoding == zenoh.Encoding.APPLICATION_JSON
    assert sample.priority == zenoh.Priority.REAL_TIME
    assert sample.congestion_control == zenoh.CongestionControl.DROP
    told = json.loads(sample.payload.to_bytes())
    assert told["topic"] == "ground"
    assert (told["device"], told["boot_id"], told["source"], told["age_s"]) == ("unit-1", "boot", "live", 0.04)
    assert decode(sample.payload.to_bytes(), GroundPlane) == ground()


def test_health_is_not_crowded_out_by_what_comes_a_hundred_times_a_second(live: ZenohPublisher, endpoint: str) -> None:
    def priority(estimate: Estimate) -> zenoh.Priority:
        return arrival(subscriber, lambda: live.publish(estimate, stamp())).priority

    with client(endpoint) as session, session.declare_subscriber("gaiteyes/unit-1/*/v2") as subscriber:
        assert priority(health()) == zenoh.Priority.INTERACTIVE_HIGH
        assert priority(propagated_ground()) == zenoh.Priority.INTERACTIVE_LOW
        assert priority(attitude()) == priority(motion()) == zenoh.Priority.DATA_HIGH


def test_what_is_not_known_is_null(live: ZenohPublisher, endpoint: str) -> None:
    with client(endpoint) as session, session.declare_subscriber("gaiteyes/unit-1/ground/v2") as subscriber:
        sample = arrival(subscriber, lambda: live.publish(invalid_ground(), stamp()))
    told = json.loads(sample.payload.to_bytes())
    assert told["slope_sagittal_rad"] is None
    assert told["reason"] == "no_frame"
    assert math.isnan(decode(json.dumps(told), GroundPlane).height_m)


def test_a_replay_never_publishes_or_lives_where_a_live_device_does(endpoint: str) -> None:
    made = publisher(endpoint, replay=True)
    with (
        client(endpoint) as session,
        session.declare_subscriber("gaiteyes/unit-1/replay/ground/v2") as of_replay,
        session.declare_subscriber("gaiteyes/unit-1/ground/v2") as of_live,
    ):
        sample = arrival(of_replay, lambda: made.publish(ground(), stamp(source=Source.REPLAY)))
        assert json.loads(sample.payload.to_bytes())["source"] == "replay"
        assert of_live.try_recv() is None
        assert alive(session, "gaiteyes/unit-1/replay/alive") == ["gaiteyes/unit-1/replay/alive"]
        assert alive(session, "gaiteyes/unit-1/alive") == []
    made.close()


def alive(session: zenoh.Session, key: str) -> list[str]:
    return [str(reply.ok.key_expr) for reply in session.liveliness().get(key, timeout=2.0) if reply.ok is not None]


def test_presence_is_shown_and_taken_back(endpoint: str) -> None:
    made = publisher(endpoint)
    key = "gaiteyes/unit-1/alive"
    with client(endpoint) as session, session.liveliness().declare_subscriber(key, history=True) as presence:
        assert arrival(presence).kind == zenoh.SampleKind.PUT
        made.close()
        assert arrival(presence).kind == zenoh.SampleKind.DELETE


def answer(session: zenoh.Session, key: str) -> bytes:
    (reply,) = [reply for reply in session.get(key, timeout=5.0) if reply.ok is not None]
    assert reply.ok is not None
    return bytes(reply.ok.payload.to_bytes())


def test_calibration_configuration_and_schema_are_answered(live: ZenohPublisher, endpoint: str) -> None:
    with client(endpoint) as session:
        assert decode(answer(session, "gaiteyes/unit-1/calibration"), Calibration) == calibration()
        assert json.loads(answer(session, "gaiteyes/unit-1/configuration")) == {"rate_hz": 20.0}
        assert json.loads(answer(session, "gaiteyes/unit-1/schema")) == published_schemas()


ESTIMATES: dict[str, Estimate] = {
    "attitude": attitude(),
    "ground": ground(),
    "propagated_ground": propagated_ground(),
    "motion": motion(),
    "setpoint": setpoint(),
    "terrain": terrain(),
    "health": health(),
}


def test_the_samples_here_are_all_published_topics() -> None:
    assert set(ESTIMATES) == {topic.name for topic in TOPICS.values() if topic.published}


@pytest.mark.parametrize("topic", ESTIMATES)
def test_every_published_topic_fits_the_schema_told_for_it(live: ZenohPublisher, endpoint: str, topic: str) -> None:
    with client(endpoint) as session, session.declare_subscriber(f"gaiteyes/unit-1/{topic}/v2") as subscriber:
        sample = arrival(subscriber, lambda: live.publish(ESTIMATES[topic], stamp()))
    told = json.loads(sample.payload.to_bytes())
    jsonschema.validate(told, published_schemas()[topic])
    assert decode(sample.payload.to_bytes(), type(ESTIMATES[topic])) == ESTIMATES[topic]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**told, "age_s": "old"}, published_schemas()[topic])


def next_seq(made: ZenohPublisher, subscriber: "zenoh.Subscriber[zenoh.Handler[zenoh.Sample]]", seq: int) -> int:
    sample = arrival(subscriber, lambda: made.publish(ground(), stamp(seq=seq)))
    return int(json.loads(sample.payload.to_bytes())["seq"])


@pytest.mark.realtime
def test_a_subscriber_that_stood_still_is_not_told_of_all_it_missed(live: ZenohPublisher, endpoint: str) -> None:
    with client(endpoint) as session, session.declare_subscriber("gaiteyes/unit-1/ground/v2") as subscriber:
        arrival(subscriber, lambda: live.publish(ground(), stamp()))
        missed = 10_000
        for seq in range(missed):
            live.publish(ground(), stamp(seq=seq))
        backlog = list(iter(lambda: next_seq(live, subscriber, missed), missed))
    assert 0 < len(backlog) < 0.2 * missed


def test_publishing_without_a_listener_counts_as_sent(live: ZenohPublisher) -> None:
    for seq in range(100):
        live.publish(ground(), stamp(seq=seq))
    assert (live.sent, live.errors) == (100, 0)


def test_publishing_after_the_end_is_counted_and_not_raised(endpoint: str) -> None:
    made = publisher(endpoint)
    made.close()
    made.publish(ground(), stamp())
    assert (made.sent, made.errors) == (0, 1)


def test_a_publisher_that_was_never_closed_does_not_keep_its_process_alive(endpoint: str) -> None:
    program = f"""
from daemon.publish_zenoh import ZenohPublisher
from drivers.zenoh.settings import ZenohSettings
from tests.bench.can_samples import calibration
settings = ZenohSettings(listen={endpoint!r})
publisher = ZenohPublisher(settings, "unit-1", calibration=calibration(), configuration=settings)
raise SystemExit(7)
"""
    ended = subprocess.run([sys.executable, "-c", program], timeout=30.0, check=False, cwd=Path(__file__).parents[2])
    assert ended.returncode == 7


def test_a_taken_address_is_one_clear_line(live: ZenohPublisher, endpoint: str) -> None:
    with pytest.raises(DeviceError) as refused:
        publisher(endpoint)
    assert str(refused.value).startswith(f"Zenoh: cannot listen on {endpoint}: the address is in use")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("listen", ["garbage", "carrier/pigeon:1", "tcp/127.0.0.1:99999"])
def test_an_address_that_is_none_is_one_clear_line(listen: str) -> None:
    with pytest.raises(DeviceError) as refused:
        publisher(listen, insecure=True)
    assert str(refused.value).startswith(f"Zenoh: cannot listen on {listen}: ")
    assert ".rs" not in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("device", ["", "a/b", "a*", "@a", "a b", "ä", "x" * 65])
def test_a_device_name_that_is_no_key_is_refused(device: str) -> None:
    with pytest.raises(DeviceError, match="letters, digits"):
        publisher(free_endpoint(), device)


def test_what_others_publish_reaches_nobody(live: ZenohPublisher, endpoint: str) -> None:
    key = "gaiteyes/unit-1/ground/v2"
    with client(endpoint) as forger, client(endpoint) as session, session.declare_subscriber(key) as subscriber:
        arrival(subscriber, lambda: live.publish(ground(), stamp()))
        by_bytes = ZenohBytes(socket_path(endpoint))
        for _ in range(20):
            forger.put(key, b"forged")
            by_bytes.put(key, b"forged")
        live.publish(ground(), stamp(seq=99))
        heard = [bytes(arrival(subscriber).payload)]
        while (sample := subscriber.try_recv()) is not None:
            heard.append(bytes(sample.payload))
        by_bytes.close()
    assert b"forged" not in heard
    assert json.loads(heard[-1])["seq"] == 99


def test_an_adversary_neither_answers_queries_nor_seems_present(live: ZenohPublisher, endpoint: str) -> None:
    key = "gaiteyes/unit-1/schema"
    with client(endpoint) as forger, client(endpoint) as session:
        queryable = forger.declare_queryable(key, lambda query: query.reply(key, b"forged"))
        token = forger.liveliness().declare_token("gaiteyes/unit-1/replay/alive")
        assert json.loads(answer(session, key)) == published_schemas()
        assert alive(session, "gaiteyes/unit-1/replay/alive") == []
        assert alive(session, "gaiteyes/unit-1/alive") == ["gaiteyes/unit-1/alive"]
        token.undeclare()
        queryable.undeclare()


@pytest.mark.realtime
def test_queries_that_are_none_and_too_many_are_counted_and_not_answered(live: ZenohPublisher, endpoint: str) -> None:
    key = "gaiteyes/unit-1/schema"
    with client(endpoint) as session:
        assert list(session.get(f"{key}?a=1", timeout=0.2)) == []
        time.sleep(0.02)
        assert list(session.get(key, payload=b"x", timeout=0.2)) == []
        assert live.health == ZenohHealth(malformed=2)
        asked = 4 * MOST_ANSWERS_PER_S
        for _ in range(asked):
            session.get(key, zenoh.handlers.Callback(lambda _reply: None, indirect=False), timeout=0.2)
            time.sleep(1.1 / ASKED_HZ)
        assert 0 < live.health.refused < asked
        assert live.health.malformed == 2


def test_plain_tcp_must_be_asked_for_and_is_a_warning() -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with pytest.raises(UserError, match="anything could pose as the service") as refused:
        publisher(endpoint)
    assert not isinstance(refused.value, DeviceError), "it is no outage that passes"
    made = publisher(endpoint, insecure=True)
    assert made.health.insecure
    with (
        pytest.raises(UserError, match="anything could pose as the service"),
        listen(GroundPlane, "unit-1", connect=endpoint),
    ):
        pass
    with listen(GroundPlane, "unit-1", connect=endpoint, insecure=True):
        pass
    made.close()


def test_a_socket_where_others_may_write_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    with pytest.raises(UserError, match="others may write"):
        publisher(f"{SOCKET}{tmp_path}/s")


def test_a_service_with_a_list_of_users_lets_in_who_knows_a_password(endpoint: str, tmp_path: Path) -> None:
    users = tmp_path / "users"
    users.write_text("ankle:secret\n", encoding="utf-8")
    made = made_with(ZenohSettings(listen=endpoint, users=str(users)))
    with listen(GroundPlane, "unit-1", connect=endpoint, credentials=Credentials(user="ankle", password="secret")):
        pass
    with pytest.raises(UserError, match="nobody answers there, or not as asked"):
        listen(GroundPlane, "unit-1", connect=endpoint, credentials=Credentials(user="ankle", password="guess"))
    made.close()


def test_listening_anew_in_the_same_place_goes_on_counting_and_a_failure_changes_nothing(
    live: ZenohPublisher, endpoint: str, tmp_path: Path
) -> None:
    live.publish(ground(), stamp())
    users = tmp_path / "users"
    with pytest.raises(UserError, match=f"zenoh.users: cannot read {users}"):
        live.listen_anew(ZenohSettings(listen=endpoint, users=str(users)))
    with client(endpoint) as session, session.declare_subscriber("gaiteyes/unit-1/ground/v2") as subscriber:
        arrival(subscriber, lambda: live.publish(ground(), stamp()))
    users.write_text("ankle:secret\n", encoding="utf-8")
    live.listen_anew(ZenohSettings(listen=endpoint, users=str(users)))
    with pytest.raises(zenoh.ZError):
        client(endpoint)
    assert live.sent >= 2


def test_listening_anew_while_another_thread_publishes_disturbs_neither(live: ZenohPublisher) -> None:
    ended = threading.Event()
    published = itertools.count()

    def publish() -> None:
        while not ended.is_set():
            live.publish(attitude(), stamp(seq=next(published)))

    thread = threading.Thread(target=publish)
    thread.start()
    places = [ZenohSettings(listen=free_endpoint()) for _ in range(10)]
    for place in places:
        live.listen_anew(place)
    ended.set()
    thread.join()
    assert live.endpoint == places[-1].listen
    assert live.sent + live.errors == next(published)


@pytest.fixture
def certificates(tmp_path: Path) -> Path:
    """A folder with an authority, a service's certificate signed by it, and another authority."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    authority = "req -x509 -newkey ed25519 -nodes -days 30 -subj /CN=test"
    for command in (
        f"{authority} -keyout ca.key -out ca.pem",
        f"{authority} -keyout other.key -out other.pem",
        "req -newkey ed25519 -nodes -subj /CN=localhost -keyout service.key -out service.csr",
        "x509 -req -in service.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 30 -extfile names -out service.pem",
    ):
        (tmp_path / "names").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\n", encoding="ascii")
        subprocess.run(["openssl", *command.split()], cwd=tmp_path, check=True, capture_output=True)
    return tmp_path


def test_with_tls_a_service_is_believed_by_its_certificate_alone(certificates: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        endpoint = f"tls/127.0.0.1:{probe.getsockname()[1]}"
    with pytest.raises(UserError, match=r"zenoh\.certificate is missing"):
        publisher(endpoint)
    certificate, private_key = str(certificates / "service.pem"), str(certificates / "service.key")
    made = made_with(ZenohSettings(listen=endpoint, certificate=certificate, private_key=private_key))
    assert not made.health.insecure
    with pytest.raises(UserError, match="authority is missing"):
        listen(GroundPlane, "unit-1", connect=endpoint)
    with pytest.raises(UserError, match="nobody answers there, or not as asked"):
        listen(
            GroundPlane,
            "unit-1",
            connect=endpoint,
            credentials=Credentials(authority=str(certificates / "other.pem")),
        )
    believed = Credentials(authority=str(certificates / "ca.pem"))
    with listen(GroundPlane, "unit-1", connect=endpoint, credentials=believed, timeout_s=10.0) as listener:
        seq = itertools.count()
        done = threading.Event()

        def publish() -> None:
            while not done.wait(0.02):
                now_ns = time.monotonic_ns()
                made.publish(ground(t_exposure_ns=now_ns), stamp(seq=next(seq), t_publish_ns=now_ns, age_s=0.0))

        thread = threading.Thread(target=publish)
        thread.start()
        assert next(iter(listener)).message.height_m == ground().height_m
        done.set()
        thread.join()
    made.close()

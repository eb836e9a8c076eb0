"""Programs of an adversary beside a running service: what `gaiteyes.listen` and the example believe of them is nothing.

`python -m benchmarks.forging` does the same from other users, and around a restart of the service.
"""

import itertools
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

import gaiteyes
from daemon.publish_zenoh import ZenohPublisher
from daemon.stamping import Stamper
from drivers.boot_id import read_boot_id
from drivers.zenoh.local_socket import socket_path
from drivers.zenoh.settings import ZenohSettings
from lab.faults.forger import FORGED_HEIGHT_M
from messages import GroundPlane, Source
from tests.bench.can_samples import calibration, ground
from tests.bench.zenoh_peer import arrival, free_endpoint

pytestmark = [pytest.mark.realtime, pytest.mark.long]

DEVICE = "unit-1"
KINDS = ("bytes", "library")


@pytest.fixture
def endpoint() -> str:
    folder = Path(free_endpoint().partition("/")[2])
    folder.mkdir(mode=0o700)
    return f"unixsock-stream/{folder / DEVICE}.sock"


@pytest.fixture
def service(endpoint: str) -> Iterator[None]:
    """A service that publishes a ground 20 times a second."""
    settings = ZenohSettings(listen=endpoint)
    publisher = ZenohPublisher(settings, DEVICE, calibration=calibration(), configuration=settings)
    stamper = Stamper(DEVICE, read_boot_id(), Source.LIVE)
    ended = threading.Event()

    def publish() -> None:
        while not ended.wait(0.05):
            now_ns = time.monotonic_ns()
            estimate = ground(t_exposure_ns=now_ns - 40_000_000)
            publisher.publish(estimate, stamper.stamp(estimate, now_ns))

    thread = threading.Thread(target=publish)
    thread.start()
    yield
    ended.set()
    thread.join()
    publisher.close()


def forging(kind: str, endpoint: str, seconds: int) -> "subprocess.Popen[str]":
    folder = str(socket_path(endpoint).parent)
    command = [sys.executable, "-m", "lab.faults.forger", kind, DEVICE, str(seconds), folder]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def sent(adversary: "subprocess.Popen[str]") -> int:
    told, _ = adversary.communicate(timeout=60.0)
    return int(told)


@pytest.mark.usefixtures("service")
def test_nothing_that_an_adversary_sends_is_believed(endpoint: str) -> None:
    adversaries = [forging(kind, endpoint, 6) for kind in KINDS]
    with gaiteyes.listen(GroundPlane, DEVICE, connect=endpoint, timeout_s=20.0) as listener:
        heights_m = [
            received.message.height_m
            for received, _ in itertools.takewhile(
                lambda _: any(each.poll() is None for each in adversaries), zip(listener, itertools.count())
            )
        ]
    assert all(sent(adversary) > 0 for adversary in adversaries)
    assert len(heights_m) > 0
    assert FORGED_HEIGHT_M not in heights_m


@pytest.mark.parametrize("identity", ["5e19910e64314ac7802f729d60efc0f1", "5e19910e64314ac7802f729d60efc0"])
@pytest.mark.parametrize("kind", KINDS)
def test_without_access_control_the_same_programs_would_be_heard(endpoint: str, kind: str, identity: str) -> None:
    """An identity is drawn of 16 bytes, and one of 256 is a byte shorter."""
    config = zenoh.Config()
    for name, value in {
        "id": identity,
        "mode": "peer",
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config) as open_to_all, open_to_all.declare_subscriber(f"gaiteyes/{DEVICE}/ground/v2") as heard:
        adversary = forging(kind, endpoint, 600)
        try:
            assert json.loads(bytes(arrival(heard).payload))["height_m"] == FORGED_HEIGHT_M
        finally:
            adversary.kill()
            adversary.communicate()

"""Both examples, run as a user runs them: in processes of their own, against publishers at work."""

import importlib.util
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import msgspec
import pytest

from daemon.publish_can import CanPublisher
from daemon.publish_zenoh import ZenohPublisher
from daemon.stamping import Stamper
from drivers.boot_id import read_boot_id
from drivers.can.link import CanLink
from drivers.can.settings import CanInterface, CanSettings
from drivers.protocols import DeviceError
from drivers.zenoh.settings import ZenohSettings
from messages import GroundPlane, Source
from tests.bench.can_samples import calibration, ground, invalid_ground
from tests.bench.heard_example import EXAMPLES, heard
from tests.bench.slcan_hub import served_hub
from tests.bench.zenoh_peer import free_endpoint

pytestmark = pytest.mark.realtime

GROUP = "239.74.163.78"
LONGEST_LINES = 30


class Service:
    """Publishes a ground estimate 20 times a second, from a thread of its own, until the context ends."""

    def __init__(
        self, publisher: ZenohPublisher | CanPublisher, source: Source, make: Callable[[int], GroundPlane]
    ) -> None:
        self._publisher = publisher
        self._stamper = Stamper("demo", read_boot_id(), source)
        self._make = make
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._publish)

    def _publish(self) -> None:
        while not self._ended.wait(0.05):
            estimate = self._make(time.monotonic_ns() - 40_000_000)
            self._publisher.publish(estimate, self._stamper.stamp(estimate, time.monotonic_ns()))
            if isinstance(self._publisher, CanPublisher):
                self._publisher.drain(0.0)

    def __enter__(self) -> "Service":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._publisher.close()


def measured(t_exposure_ns: int) -> GroundPlane:
    return ground(t_exposure_ns=t_exposure_ns)


def missing(t_exposure_ns: int) -> GroundPlane:
    return msgspec.structs.replace(invalid_ground(), t_exposure_ns=t_exposure_ns)


def old(t_exposure_ns: int) -> GroundPlane:
    return measured(t_exposure_ns - 100_000_000)


@pytest.fixture(params=[CanInterface.SLCAN, CanInterface.UDP_MULTICAST])
def can_settings(request: pytest.FixtureRequest) -> Iterator[CanSettings]:
    if request.param is CanInterface.SLCAN:
        with served_hub() as hub:
            yield CanSettings(interface=CanInterface.SLCAN, channel=hub.channel, settle_s=0.0)
    elif importlib.util.find_spec("msgpack") is None:
        pytest.skip("msgpack is not installed")
    else:
        yield CanSettings(interface=CanInterface.UDP_MULTICAST, channel=GROUP)


def told_at_least_twice(told: str) -> Callable[[list[str]], bool]:
    """Return whether two of at least seven lines are `told`; others may be refusals, as on a busy machine."""
    return lambda lines: len(lines) >= 7 and sum(re.fullmatch(told, line) is not None for line in lines) >= 2


@pytest.mark.parametrize(
    ("source", "make", "arguments", "told"),
    [
        (Source.LIVE, measured, (), r"live valid none slope \+5.7° height 0.931 m age 0.0\d+ s, lost 0"),
        (Source.SIMULATED, measured, (), r"silence, refused \{.*'not_live': \d+.*\}"),
        (Source.SIMULATED, measured, ("--accept-simulated",), r"simulated valid none slope \+5.7° height .*"),
        (Source.LIVE, missing, (), r"live invalid no_frame slope \+?nan° height nan m age 0.0\d+ s, lost 0"),
        (Source.LIVE, old, (), r"silence, refused \{.*'stale': \d+.*\}"),
    ],
)
def test_the_zenoh_example_tells_the_ground_or_counts_refusals(
    source: Source, make: Callable[[int], GroundPlane], arguments: tuple[str, ...], told: str
) -> None:
    settings = ZenohSettings(listen=free_endpoint())
    publisher = ZenohPublisher(settings, "demo", calibration=calibration(), configuration=settings)
    with Service(publisher, source, make):
        lines = heard("zenoh_subscriber.py", "--connect", settings.listen, *arguments, enough=told_at_least_twice(told))
    if told.startswith("silence"):  # where refusal is right nothing else may appear
        assert all(line.startswith("silence") for line in lines), lines


@pytest.mark.parametrize(
    ("source", "arguments", "told"),
    [
        (Source.LIVE, (), r"ground live slope \+5.7 ± 0.6° height 0.931 ± 0.003 m age 0.0\d+ s"),
        (Source.SIMULATED, ("--accept-simulated",), r"ground simulated slope \+5.7 ± 0.6°.*"),
    ],
)
def test_the_can_example_tells_the_ground_or_refuses_it(
    can_settings: CanSettings, source: Source, arguments: tuple[str, ...], told: str
) -> None:
    try:
        publisher = CanPublisher(CanLink(can_settings))
    except DeviceError as absent:
        pytest.skip(str(absent))
    with Service(publisher, source, measured):
        heard("can_listener.py", "--can", can_settings.name, *arguments, enough=told_at_least_twice(told))


@pytest.mark.parametrize("example", ["zenoh_subscriber.py", "can_listener.py"])
def test_an_example_is_short_enough_to_be_read(example: str) -> None:
    assert len((EXAMPLES / example).read_text().splitlines()) <= LONGEST_LINES


@pytest.mark.parametrize(
    ("example", "arguments", "told"),
    [
        ("zenoh_subscriber.py", ("--device", "nobody"), "Zenoh: nobody publishes as 'nobody' on this machine; "),
        ("zenoh_subscriber.py", ("--connect", "tcp/127.0.0.1:1"), "Zenoh: on tcp/127.0.0.1:1 anything could pose as "),
        ("can_listener.py", ("--can", "carrier:x"), "CAN 'carrier:x': expected INTERFACE:CHANNEL "),
        ("can_listener.py", ("--can", "slcan:socket://127.0.0.1:1"), "CAN slcan:socket://127.0.0.1:1: "),
        ("can_listener.py", ("--can", "socketcan:nocan"), "CAN socketcan:nocan: "),
        ("can_listener.py", ("--can", "virtual:x"), "CAN virtual:x: nothing is heard; is "),
        ("treadmill.py", ("absent.txt.gz",), "absent.txt.gz: "),
    ],
)
def test_nothing_to_connect_to_is_one_line(example: str, arguments: tuple[str, ...], told: str) -> None:
    command = [sys.executable, str(EXAMPLES / example), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60.0)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(told)
    assert done.stderr.count("\n") == 1


def test_of_the_project_the_examples_import_public_names_alone() -> None:
    packages = "messages|perception|impedance|discrepancy|drivers|calib|daemon|systems|sim_rig|lab|cli"
    for example in EXAMPLES.glob("*.py"):
        assert not re.search(rf"^\s*(?:from|import) (?:{packages})\b", example.read_text(), re.MULTILINE), example

"""`listen_can` on the rig's bus: what passes, what is counted, and that it survives what a bus can do."""

import itertools
import socket
import threading
from collections.abc import Iterator

import pytest

from drivers.can.listener import CanListener, listen_can
from messages import GroundPlane, Refusal, Source, Stamp, UserError
from messages.can_encoder import CanEncoder
from messages.can_estimates import ReceivedGround
from sim_rig.can.slcan_hub import SlcanHub
from tests.bench.can_samples import ground, stamp
from tests.bench.slcan_hub import served_hub

pytestmark = pytest.mark.long

PATIENCE_S = 20.0


class Node:
    """Sends grounds on a bus, 20 a second, and a piece of garbage after every tenth, until it is closed."""

    def __init__(self, channel: str, *, source: Source = Source.LIVE) -> None:
        self._port = int(channel.rpartition(":")[2])
        self._source = source
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def _send(self) -> None:
        encoder = CanEncoder()
        sample: GroundPlane = ground()
        stamped: Stamp = stamp(source=self._source)
        with socket.create_connection(("127.0.0.1", self._port)) as bus:
            for number in itertools.count():
                if self._ended.wait(0.05):
                    return
                frames = encoder.ground(sample, stamped, 0.04)
                lines = [f"t{frame.can_id:03X}{len(frame.data)}{frame.data.hex()}\r" for frame in frames]
                try:
                    bus.sendall("".join(lines).encode())
                    if number % 10 == 9 and not self._ended.wait(0.02):  # what comes with it is lost with it
                        bus.sendall(b"tXYZ\r")
                except OSError:
                    return

    def close(self) -> None:
        self._ended.set()
        self._thread.join()


@pytest.fixture
def hub() -> Iterator[SlcanHub]:
    with served_hub() as served:
        yield served


def listening(hub: SlcanHub, timeout_s: float = PATIENCE_S) -> CanListener[ReceivedGround]:
    return listen_can(f"slcan:{hub.channel}", timeout_s=timeout_s)


def test_grounds_pass_and_garbage_between_them_is_counted(hub: SlcanHub) -> None:
    with listening(hub) as listener:
        node = Node(hub.channel)
        heard = list(itertools.islice(listener, 30))
        node.close()
    assert all((found.source, round(found.height_m, 3)) == (Source.LIVE, 0.931) for found in heard)
    assert listener.refused[Refusal.MALFORMED] > 0


def test_what_is_simulated_is_counted_and_the_iteration_ends(hub: SlcanHub) -> None:
    with listening(hub, timeout_s=1.0) as listener:
        node = Node(hub.channel, source=Source.SIMULATED)
        assert list(listener) == []
        node.close()
    assert listener.refused[Refusal.NOT_LIVE] > 0


def test_a_bus_that_is_lost_is_opened_again() -> None:
    with served_hub() as first:
        port = int(first.channel.rpartition(":")[2])
        listener = listening(first)
        node = Node(first.channel)
        heard_first = next(iter(listener))
    node.close()
    with listener, served_hub(port) as second:
        node = Node(second.channel)
        heard_second = next(iter(listener))
        node.close()
    assert heard_first.source is heard_second.source is Source.LIVE


@pytest.mark.parametrize("bus", ["slcan:socket://127.0.0.1:1", "socketcan:nocan", "carrier:pigeon"])
def test_no_bus_is_one_clear_line(bus: str) -> None:
    with pytest.raises(UserError, match="CAN ") as refused:
        listen_can(bus)
    assert "\n" not in str(refused.value)

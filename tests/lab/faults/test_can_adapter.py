"""The campaign's serial adapter: what the daemon's own link sees of it, faultless and with faults."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.can.link import CanLink, SendResult
from lab.faults.can_adapter import SimulatedCanAdapter
from messages.can_encoder import CanEncoder
from messages.can_estimates import ReceivedGround
from messages.can_frames import CanFrame
from messages.can_receiver import CanReceiver
from messages.e2e import E2eCheck
from tests.bench.can_samples import ground, stamp


@pytest.fixture
def adapter(tmp_path: Path) -> Iterator[SimulatedCanAdapter]:
    made = SimulatedCanAdapter(tmp_path / "adapter")
    yield made
    made.unplug()


@pytest.fixture
def link(adapter: SimulatedCanAdapter) -> Iterator[CanLink]:
    with contextlib.closing(CanLink(adapter.settings)) as made:
        yield made


def served(adapter: SimulatedCanAdapter, link: CanLink, until: Callable[[], bool]) -> list[CanFrame]:
    """Let the bus and the link work by turns until `until`, or for ten seconds, and return what the link has sent."""
    heard: list[CanFrame] = []
    deadline_s = time.monotonic() + 10.0
    while not until() and time.monotonic() < deadline_s:
        heard += adapter.serve(0.002)
        link.receive(0.005)
    assert until()
    return heard


def test_the_ankle_is_heard_and_the_daemon_is_heard(adapter: SimulatedCanAdapter, link: CanLink) -> None:
    sent = list(CanEncoder().ground(ground(), stamp(seq=0), 0.04))
    assert [link.send(frame) for frame in sent] == [SendResult.SENT] * 2
    assert served(adapter, link, lambda: link.counters.ankle_states >= 3) == sent


def test_what_is_discarded_is_not_heard_later(adapter: SimulatedCanAdapter, link: CanLink) -> None:
    before, after = (list(CanEncoder().ground(ground(), stamp(seq=seq), 0.04)) for seq in (0, 9))
    for frame in before:
        link.send(frame)
    link.close()  # all of it is on the bus
    adapter.discard()
    with contextlib.closing(CanLink(adapter.settings)) as again:
        assert [again.send(frame) for frame in after] == [SendResult.SENT] * 2
        assert served(adapter, again, lambda: again.counters.ankle_states >= 3) == after


def test_corrupted_states_of_the_ankle_are_refused(adapter: SimulatedCanAdapter, link: CanLink) -> None:
    served(adapter, link, lambda: link.counters.ankle_states >= 1)
    adapter.ankle_corrupted = True
    served(adapter, link, lambda: link.counters.ankle_refused.get(E2eCheck.WRONG_CRC, 0) >= 3)
    adapter.ankle_corrupted, adapter.ankle_replayed = False, True
    served(adapter, link, lambda: link.counters.ankle_refused.get(E2eCheck.REPEATED, 0) >= 3)


def test_a_flood_and_garbage_leave_the_ankle_audible(adapter: SimulatedCanAdapter, link: CanLink) -> None:
    adapter.flooding = True
    served(adapter, link, lambda: link.counters.ankle_states >= 3)
    adapter.flooding, adapter.sending_garbage = False, True
    served(adapter, link, lambda: link.counters.bus_errors >= 1)
    adapter.sending_garbage = False
    before = link.counters.ankle_states
    served(adapter, link, lambda: link.counters.ankle_states >= before + 3)


def test_a_port_that_vanishes_is_found_again_under_its_name(adapter: SimulatedCanAdapter, link: CanLink) -> None:
    served(adapter, link, lambda: link.counters.ankle_states >= 1)
    adapter.unplug()
    served(adapter, link, lambda: link.counters.outages == 1)
    adapter.plug_in()
    before = link.counters.ankle_states
    served(adapter, link, lambda: link.counters.ankle_states > before)


def test_an_adapter_that_takes_nothing_fills_its_port(adapter: SimulatedCanAdapter, link: CanLink) -> None:
    adapter.stuck = True
    frame = CanFrame(0x1A0, bytes(8))
    results = [link.send(frame) for _ in range(2000)]
    assert SendResult.QUEUE_FULL in results
    adapter.stuck = False
    heard = served(adapter, link, lambda: link.counters.ankle_states >= 1)
    assert len(heard) <= results.count(SendResult.SENT)
    assert set(heard) == {frame}


def test_another_sender_under_our_identifiers_is_not_believed(adapter: SimulatedCanAdapter, link: CanLink) -> None:
    served(adapter, link, lambda: link.counters.ankle_states >= 1)
    adapter.identifiers_taken = True
    receiver = CanReceiver(ReceivedGround, accept_simulated=True)
    before = link.counters.ankle_states
    heard = served(adapter, link, lambda: link.counters.ankle_refused.get(E2eCheck.WRONG_CRC, 0) >= 20)
    assert len(heard) >= 20
    assert not [frame for frame in heard if isinstance(receiver.feed(frame.can_id, frame.data, 0), ReceivedGround)]
    assert link.counters.ankle_states > before  # the ankle itself stays audible

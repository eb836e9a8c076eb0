"""The CAN link on SocketCAN: a link that goes down or away, a full queue, what a controller reports, time stamps."""

import time
from collections.abc import Iterator

import can
import pytest

from drivers.can.link import CanLink, SendResult
from drivers.can.settings import CanInterface, CanSettings
from drivers.protocols import DeviceError
from messages import CanState
from messages.can_encoder import CanEncoder
from messages.can_frames import CanMessage, can_id
from tests.drivers.can.test_link_contract import (
    BUS_OFF,
    CONTROLLER,
    FRAME,
    RESTARTED,
    STATE,
    as_message,
    error_frame,
    receive_until,
)
from tests.kernel import can_links
from tests.kernel.modules import load_module, system

NAME = "vcan1"
SETTINGS = CanSettings(interface=CanInterface.SOCKETCAN, channel=NAME)
PATIENCE_S = 5.0


@pytest.fixture
def link() -> Iterator[CanLink]:
    can_links.make_vcan(NAME)
    opened = CanLink(SETTINGS)
    yield opened
    opened.close()
    if (can_links.NETWORK / NAME).exists():
        can_links.remove(NAME)


def sent_again(link: CanLink) -> bool:
    """Whether the link takes a frame again before long."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        if link.send(FRAME) is SendResult.SENT:
            return True
        link.receive(0.01)
    return False


def state(link: CanLink) -> CanState:
    return link.bus_health.state


def told(link: CanLink, frame: can.Message) -> None:
    """Let the link hear `frame` from its own controller."""
    with can.Bus(NAME, "socketcan") as controller:
        controller.send(frame)
        link.receive(0.05)


def test_a_link_set_down_loses_frames_and_nothing_else(link: CanLink) -> None:
    assert link.send(FRAME) is SendResult.SENT
    can_links.set_state(NAME, "down")
    assert link.send(FRAME) is SendResult.LINK_DOWN
    assert state(link) is CanState.DOWN
    assert link.counters.outages == 1
    can_links.set_state(NAME, "up")
    assert sent_again(link)
    assert state(link) is CanState.ACTIVE


def test_a_link_set_down_is_noticed_by_listening_alone(link: CanLink) -> None:
    can_links.set_state(NAME, "down")
    assert link.receive(0.2) is None
    assert state(link) is CanState.DOWN
    can_links.set_state(NAME, "up")
    encoder = CanEncoder()
    time.sleep(0.2)
    link.receive(0.01)
    with can.Bus(NAME, "socketcan") as ankle:
        for _ in range(4):
            ankle.send(as_message(encoder.ankle(STATE)))
        assert len(receive_until(link, 3)) == 3


def test_an_adapter_unplugged_and_plugged_in_again_is_found(link: CanLink) -> None:
    can_links.remove(NAME)
    assert link.send(FRAME) is SendResult.LINK_DOWN
    time.sleep(0.3)
    assert link.send(FRAME) is SendResult.LINK_DOWN
    can_links.make_vcan(NAME)
    assert sent_again(link)
    assert link.counters.outages == 1


def test_a_link_that_is_down_or_absent_is_told_in_one_line(link: CanLink) -> None:
    can_links.set_state(NAME, "down")
    with pytest.raises(DeviceError, match=f"ip link set {NAME} up"):
        CanLink(SETTINGS)
    can_links.remove(NAME)
    with pytest.raises(DeviceError, match=f"CAN socketcan:{NAME}: no such network link"):
        CanLink(SETTINGS)


def test_a_full_queue_drops_frames_and_serves_again(link: CanLink) -> None:
    load_module("sch_netem")
    system("tc", "qdisc", "add", "dev", NAME, "root", "netem", "delay", "1s", "limit", "4")
    results = [link.send(FRAME) for _ in range(12)]
    assert results[0] is SendResult.SENT
    assert results[-1] is SendResult.QUEUE_FULL
    assert link.counters.outages == 0
    system("tc", "qdisc", "del", "dev", NAME, "root")
    assert sent_again(link)


def test_a_controller_off_the_bus_is_seen_and_left_alone_until_it_restarts(link: CanLink) -> None:
    told(link, error_frame(CONTROLLER, 0x20))
    assert state(link) is CanState.PASSIVE
    told(link, error_frame(BUS_OFF))
    assert (state(link), link.bus_health.bus_offs) == (CanState.BUS_OFF, 1)
    assert link.send(FRAME) is SendResult.LINK_DOWN
    told(link, error_frame(RESTARTED))
    assert link.send(FRAME) is SendResult.SENT
    assert link.counters.bus_errors == 3
    assert link.counters.outages == 0


def test_reception_is_stamped_on_the_monotonic_clock(link: CanLink) -> None:
    encoder = CanEncoder()
    time.sleep(0.5)  # the kernel begins to stamp frames a while after a socket has asked for it
    with can.Bus(NAME, "socketcan") as ankle:
        before_ns = time.monotonic_ns()
        for _ in range(4):
            ankle.send(as_message(encoder.ankle(STATE)))
        after_ns = time.monotonic_ns()
    time.sleep(0.3)
    states = receive_until(link, 3)
    assert len(states) == 3
    for heard in states:
        assert before_ns - 1_000_000 <= heard.t_sample_ns <= after_ns + 1_000_000


def test_frames_of_others_do_not_wake_the_link(link: CanLink) -> None:
    with can.Bus(NAME, "socketcan") as other:
        for identifier in (0x000, can_id(CanMessage.ANKLE_STATE) ^ 1, 0x7FF):
            other.send(can.Message(arbitration_id=identifier, data=b"12345678", is_extended_id=False))
    assert link.receive(0.1) is None
    assert link.counters.ankle_refused == {}


def test_two_controllers_hear_each_other_and_one_set_down_comes_back() -> None:
    can_links.start_controllers()
    ours, other = can_links.CONTROLLERS
    link = CanLink(CanSettings(interface=CanInterface.SOCKETCAN, channel=ours))
    with can.Bus(other, "socketcan") as ankle:
        assert link.send(FRAME) is SendResult.SENT
        heard = ankle.recv(2.0)
        assert heard is not None
        assert bytes(heard.data) == FRAME.data
        can_links.set_state(ours, "down")
        assert link.send(FRAME) is SendResult.LINK_DOWN
        can_links.set_state(ours, "up")
        assert sent_again(link)
        assert ankle.recv(2.0) is not None
    link.close()


def test_frames_go_on_being_taken_when_nobody_else_is_on_the_bus() -> None:
    can_links.start_controllers()
    ours, other = can_links.CONTROLLERS
    link = CanLink(CanSettings(interface=CanInterface.SOCKETCAN, channel=ours))
    can_links.set_state(other, "down")
    results = {link.send(FRAME) for _ in range(50)}
    assert results <= {SendResult.SENT, SendResult.QUEUE_FULL}
    assert link.counters.outages == 0
    can_links.set_state(other, "up")
    with can.Bus(other, "socketcan") as ankle:
        assert sent_again(link)
        assert ankle.recv(2.0) is not None
    link.close()

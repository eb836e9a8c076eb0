"""Every backend of the CAN link keeps the same promises: what it sends arrives, what it hands on is protected, and
nothing that happens to the bus is raised into the service."""

import contextlib
import importlib.util
import itertools
import logging
import os
import pty
import re
import select
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import can
import msgspec
import pytest

from drivers.can.link import CanLink, SendResult, reception_ns
from drivers.can.settings import CanInterface, CanSettings, parse_can
from drivers.can.state import CanStateWatch
from drivers.protocols import AnkleSource, DeviceError
from messages import AnkleState, CanState, GaitPhase
from messages.can_encoder import CanEncoder
from messages.can_frames import CanFrame, CanMessage, can_id
from messages.e2e import E2eCheck
from sim_rig.can.slcan_hub import SlcanHub
from tests.bench.can_samples import ground, stamp
from tests.bench.slcan_hub import served_hub

CONTROLLER, BUS_OFF, RESTARTED = 0x004, 0x040, 0x100  # error classes of linux/can/error.h
GROUP = "239.74.163.77"
FRAME = CanFrame(0x1A0, bytes(range(8)))
STATE = AnkleState(t_sample_ns=0, ankle_angle_rad=0.12, ankle_rate_radps=-1.5, load_n=640.0, phase=GaitPhase.STANCE)


class Wire(NamedTuple):
    """The link under test and another node of the same bus, which plays the ankle."""

    link: CanLink
    ankle: can.BusABC


def slcan_settings(hub: SlcanHub) -> CanSettings:
    return CanSettings(interface=CanInterface.SLCAN, channel=hub.channel, settle_s=0.0)


@pytest.fixture(params=list(CanInterface))
def wire(request: pytest.FixtureRequest) -> Iterator[Wire]:
    interface: CanInterface = request.param
    if interface is CanInterface.SOCKETCAN:
        yield from joined(CanSettings(interface=interface, channel="vcan0"), {"channel": "vcan0"})
    elif interface is CanInterface.SLCAN:
        with served_hub() as hub:
            for pair in joined(slcan_settings(hub), {"channel": hub.channel, "sleep_after_open": 0.0}):
                while hub.clients < 2:  # what is sent before a node is on the bus is not for it
                    time.sleep(0.001)
                yield pair
    elif interface is CanInterface.UDP_MULTICAST:
        if importlib.util.find_spec("msgpack") is None:
            pytest.skip("msgpack is not installed")
        yield from joined(CanSettings(interface=interface, channel=GROUP), {"channel": GROUP, "hop_limit": 0})
    else:
        yield from joined(CanSettings(channel="contract"), {"channel": "contract"})


def joined(settings: CanSettings, peer: dict[str, str | float | int]) -> Iterator[Wire]:
    try:
        link = CanLink(settings)
    except DeviceError as absent:
        pytest.skip(str(absent))
    options = {key: value for key, value in peer.items() if key != "channel"}
    ankle = can.Bus(str(peer["channel"]), settings.interface.value, None, True, **options)
    yield Wire(link, ankle)
    ankle.shutdown()
    link.close()


def as_message(frame: CanFrame) -> can.Message:
    return can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)


def receive_until(link: AnkleSource, wanted: int) -> list[AnkleState]:
    states: list[AnkleState] = []
    for _ in range(20):
        state = link.receive(0.2)
        states += [state] if state is not None else []
        if len(states) == wanted:
            break
    return states


def test_frames_arrive_in_order_and_unchanged(wire: Wire) -> None:
    encoder = CanEncoder()
    sent = [frame for seq in range(5) for frame in encoder.ground(ground(), stamp(seq=seq), 0.04)]
    assert [wire.link.send(frame) for frame in sent] == [SendResult.SENT] * 10
    arrived = [wire.ankle.recv(2.0) for _ in sent]
    assert [(m.arbitration_id, bytes(m.data)) for m in arrived if m is not None] == [(f.can_id, f.data) for f in sent]


def test_protected_states_of_the_ankle_are_handed_on(wire: Wire) -> None:
    encoder = CanEncoder()
    for _ in range(4):
        wire.ankle.send(as_message(encoder.ankle(STATE)))
    states = receive_until(wire.link, 3)
    assert len(states) == 3
    for state in states:
        assert state.ankle_angle_rad == pytest.approx(0.12)
        assert state.ankle_rate_radps == pytest.approx(-1.5)
        assert state.load_n == pytest.approx(640.0)
        assert state.phase is GaitPhase.STANCE
    assert [state.t_sample_ns for state in states] == sorted(state.t_sample_ns for state in states)
    assert wire.link.counters.ankle_states == 3
    assert wire.link.counters.ankle_refused == {E2eCheck.INITIAL: 1}


def test_damaged_repeated_and_foreign_frames_are_refused_and_counted(wire: Wire) -> None:
    encoder = CanEncoder()
    first, second, third = (encoder.ankle(STATE) for _ in range(3))
    damaged = CanFrame(second.can_id, second.data[:6] + bytes([second.data[6] ^ 1]) + second.data[7:])
    for frame in (first, damaged, first, CanFrame(0x123, second.data), third):
        wire.ankle.send(as_message(frame))
    wire.ankle.send(can.Message(arbitration_id=can_id(CanMessage.ANKLE_STATE), data=second.data, is_extended_id=True))
    assert len(receive_until(wire.link, 1)) == 1
    assert wire.link.receive(0.0) is None
    refused = wire.link.counters.ankle_refused
    assert refused == {E2eCheck.INITIAL: 1, E2eCheck.WRONG_CRC: 1, E2eCheck.REPEATED: 1}


def test_silence_is_none(wire: Wire) -> None:
    assert wire.link.receive(0.02) is None
    assert wire.link.receive(0.0) is None


def test_a_closed_link_takes_and_gives_nothing(wire: Wire) -> None:
    wire.link.close()
    assert wire.link.send(FRAME) is SendResult.LINK_DOWN
    assert wire.link.receive(0.01) is None


def test_a_full_bus_drops_frames_and_serves_again_when_it_is_read() -> None:
    link = CanLink(CanSettings(channel="full"))
    reader = can.Bus("full", "virtual", None, True, rx_queue_size=2)
    assert [link.send(FRAME) for _ in range(3)] == [SendResult.SENT, SendResult.SENT, SendResult.QUEUE_FULL]
    reader.recv(0.0)
    assert link.send(FRAME) is SendResult.SENT
    assert link.counters.outages == 0
    reader.shutdown()
    link.close()


def test_error_frames_of_the_controller_are_counted() -> None:
    link = CanLink(CanSettings(channel="errors"))
    other = can.Bus("errors", "virtual", None, True)
    other.send(can.Message(arbitration_id=can_id(CanMessage.ANKLE_STATE), is_extended_id=False, is_error_frame=True))
    assert link.receive(0.1) is None
    assert link.counters.bus_errors == 1
    other.shutdown()
    link.close()


class Adapter:
    """A serial adapter that can be unplugged; `settings` names it by a link that survives that, as udev's do."""

    def __init__(self, folder: Path) -> None:
        self._link = folder / "adapter"
        self.settings = CanSettings(interface=CanInterface.SLCAN, channel=str(self._link), settle_s=0.0)
        self.plug_in()

    def plug_in(self) -> None:
        self.fd, self._port = pty.openpty()
        tty.setraw(self.fd)
        tty.setraw(self._port)
        self._link.symlink_to(os.ttyname(self._port))

    def unplug(self) -> None:
        self._link.unlink(missing_ok=True)
        for fd in (self.fd, self._port):
            with contextlib.suppress(OSError):
                os.close(fd)

    def say(self, *frames: CanFrame) -> None:
        os.write(self.fd, b"".join(f"t{f.can_id:03X}8{f.data.hex()}\r".encode() for f in frames))

    def heard(self) -> bytes:
        told = b""
        while select.select([self.fd], [], [], 0.1)[0]:
            told += os.read(self.fd, 65536)
        return told


@pytest.fixture
def adapter(tmp_path: Path) -> Iterator[Adapter]:
    made = Adapter(tmp_path)
    yield made
    made.unplug()


def test_a_link_that_was_unplugged_is_opened_again_without_a_word_to_the_service(adapter: Adapter) -> None:
    link, encoder = CanLink(adapter.settings), CanEncoder()
    adapter.unplug()
    assert link.receive(0.01) is None
    assert link.send(FRAME) is SendResult.LINK_DOWN
    assert link.counters.outages == 1
    adapter.plug_in()
    states = []
    for _ in range(50):
        adapter.say(encoder.ankle(STATE), encoder.ankle(STATE))
        state = link.receive(0.05)
        states += [state] if state is not None else []
        if len(states) == 2:
            break
    assert len(states) == 2
    assert link.send(FRAME) is SendResult.SENT
    assert adapter.heard().endswith(b"t1A080001020304050607\r")
    link.close()


def test_a_failed_send_is_link_down_and_the_next_one_may_open_again(adapter: Adapter) -> None:
    now_ns = [0]
    link = CanLink(adapter.settings, now_ns=lambda: now_ns[0])
    adapter.unplug()
    assert link.send(FRAME) is SendResult.LINK_DOWN
    adapter.plug_in()
    assert link.send(FRAME) is SendResult.LINK_DOWN
    now_ns[0] = 100_000_000
    assert link.send(FRAME) is SendResult.SENT
    link.close()


def test_a_sender_and_a_receiver_outlive_an_adapter_that_comes_and_goes(adapter: Adapter) -> None:
    link, encoder, ended = CanLink(adapter.settings), CanEncoder(), threading.Event()
    results: set[SendResult] = set()
    raised: list[BaseException] = []

    def until_ended(work: Callable[[], object]) -> None:
        try:
            while not ended.is_set():
                work()
        except Exception as error:  # noqa: BLE001  (whatever it is, the link must not have raised it)
            raised.append(error)

    threads = [
        threading.Thread(target=until_ended, args=(lambda: results.add(link.send(FRAME)),)),
        threading.Thread(target=until_ended, args=(lambda: link.receive(0.01),)),
    ]
    for thread in threads:
        thread.start()
    for _ in range(3):
        adapter.unplug()
        ended.wait(0.05)
        adapter.plug_in()
        before = link.counters.ankle_states
        for _ in range(200):
            adapter.say(encoder.ankle(STATE), encoder.ankle(STATE))
            ended.wait(0.01)
            if link.counters.ankle_states > before:
                break
        assert link.counters.ankle_states > before
    ended.set()
    for thread in threads:
        thread.join()
    assert not raised
    assert {SendResult.SENT, SendResult.LINK_DOWN} <= results
    link.close()


def test_the_pause_between_attempts_doubles_up_to_its_bound(adapter: Adapter, caplog: pytest.LogCaptureFixture) -> None:
    now_ns = [0]
    link = CanLink(adapter.settings, now_ns=lambda: now_ns[0])
    adapter.unplug()
    attempts_s = []
    with caplog.at_level(logging.DEBUG, "gaiteyes"):
        for tick in range(370):
            now_ns[0] = tick * 10_000_000
            caplog.clear()
            assert link.send(FRAME) is SendResult.LINK_DOWN
            if caplog.records:
                attempts_s.append(tick / 100)
    pauses = [round(later - sooner, 2) for sooner, later in itertools.pairwise(attempts_s)]
    assert pauses == [0.1, 0.2, 0.4, 0.8, 1.0, 1.0]
    link.close()


def test_a_serial_adapter_that_takes_nothing_neither_blocks_nor_gets_torn_lines(adapter: Adapter) -> None:
    link = CanLink(adapter.settings)
    assert b"S6\r" in adapter.heard()
    results = [link.send(FRAME) for _ in range(5000)]
    assert results[0] is SendResult.SENT
    assert results[-1] is SendResult.QUEUE_FULL
    told = adapter.heard()
    assert link.send(FRAME) is SendResult.SENT
    told += adapter.heard()
    assert told == b"t1A080001020304050607\r" * (results.count(SendResult.SENT) + 1)
    assert link.counters.outages == 0
    link.close()


def error_frame(classes: int, controller: int = 0) -> can.Message:
    """As SocketCAN shapes it: the class in the identifier, the controller's state in data[1]."""
    return can.Message(
        arbitration_id=classes, data=[0, controller, 0, 0, 0, 0, 0, 0], is_extended_id=False, is_error_frame=True
    )


def test_a_controller_off_the_bus_is_left_alone_but_for_one_frame_a_second() -> None:
    now_ns = [0]
    watch = CanStateWatch()
    watch.on_error_frame(error_frame(BUS_OFF), now_ns[0])
    assert (watch.state, watch.bus_offs) == (CanState.BUS_OFF, 1)
    allowed = [tick for tick in range(0, 3000, 50) if watch.may_send(tick * 1_000_000)]
    assert allowed == [1000, 2000]
    watch.on_error_frame(error_frame(BUS_OFF), now_ns[0])
    assert watch.bus_offs == 1
    watch.on_error_frame(error_frame(RESTARTED), now_ns[0])
    assert watch.state is CanState.ACTIVE
    assert watch.may_send(0)


@pytest.mark.parametrize(
    ("controller", "state"),
    [(0x04, CanState.WARNING), (0x08, CanState.WARNING), (0x10, CanState.PASSIVE), (0x28, CanState.PASSIVE)],
)
def test_warning_and_passive_are_told_and_do_not_keep_from_sending(controller: int, state: CanState) -> None:
    watch = CanStateWatch()
    watch.on_error_frame(error_frame(CONTROLLER, controller), 0)
    assert watch.state is state
    assert watch.may_send(0)
    watch.on_error_frame(error_frame(CONTROLLER, 0x40), 0)
    assert watch.state is CanState.ACTIVE


def test_traffic_from_others_shows_that_the_bus_is_back() -> None:
    watch = CanStateWatch()
    watch.on_error_frame(error_frame(BUS_OFF), 0)
    watch.on_other_frame()
    assert watch.state is CanState.ACTIVE


def test_a_patient_link_starts_without_a_bus_and_finds_it_later(adapter: Adapter) -> None:
    now_ns = [0]
    adapter.unplug()
    link = CanLink(adapter.settings, retry_opening=True, now_ns=lambda: now_ns[0])
    assert link.send(FRAME) is SendResult.LINK_DOWN
    assert (link.bus_health.state, link.bus_health.outages) == (CanState.DOWN, 1)
    adapter.plug_in()
    now_ns[0] = 100_000_000
    assert link.send(FRAME) is SendResult.SENT
    assert link.bus_health.state is CanState.ACTIVE
    link.close()


@pytest.mark.parametrize("garbage", [b"tXYZ8zz\r", b"\xff\xfe\r", b"t12", b"\r\a\r"])
def test_garbled_input_of_a_serial_adapter_is_passed_over(adapter: Adapter, garbage: bytes) -> None:
    link, encoder = CanLink(adapter.settings), CanEncoder()
    os.write(adapter.fd, garbage)
    assert link.receive(0.05) is None
    adapter.say(encoder.ankle(STATE))
    link.receive(0.05)
    for _ in range(3):
        adapter.say(encoder.ankle(STATE))
    assert len(receive_until(link, 2)) == 2
    assert link.counters.outages == 0
    link.close()


def test_lines_that_are_no_frames_are_counted(adapter: Adapter) -> None:
    link = CanLink(adapter.settings)
    os.write(adapter.fd, b"tXYZ8zz\r")
    assert link.receive(0.05) is None
    assert link.counters.bus_errors == 1
    link.close()


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (CanSettings(interface=CanInterface.SLCAN, channel="/dev/ttyNONE"), "slcan:/dev/ttyNONE: .*No such file"),
        (CanSettings(interface=CanInterface.SLCAN, channel="/dev/null"), "slcan:/dev/null: .*Inappropriate ioctl"),
        (CanSettings(interface=CanInterface.SOCKETCAN, channel="can99"), "socketcan:can99: "),
        (CanSettings(interface=CanInterface.UDP_MULTICAST, channel="nowhere"), "udp_multicast:nowhere: "),
    ],
)
def test_a_bus_that_cannot_be_opened_is_one_clear_line(settings: CanSettings, told: str) -> None:
    with pytest.raises(DeviceError) as refused:
        CanLink(settings)
    assert re.search(f"^CAN {told}", str(refused.value))
    assert "\n" not in str(refused.value)


def test_a_bit_rate_the_adapter_does_not_know_is_refused_with_those_it_knows(adapter: Adapter) -> None:
    with pytest.raises(DeviceError, match="500000"):
        CanLink(msgspec.structs.replace(adapter.settings, bitrate=123_456))


def test_a_bus_is_named_on_the_command_line() -> None:
    assert parse_can("socketcan:can0") == CanSettings(interface=CanInterface.SOCKETCAN, channel="can0")
    assert parse_can("slcan:socket://127.0.0.1:29536").channel == "socket://127.0.0.1:29536"


@pytest.mark.parametrize("text", ["", "can0", "socketcan", "socketcan:", "pcan:PCAN_USBBUS1"])
def test_a_bus_named_wrongly_is_told_what_is_expected(text: str) -> None:
    with pytest.raises(DeviceError, match="INTERFACE:CHANNEL with INTERFACE one of virtual, socketcan, slcan, udp"):
        parse_can(text)


@pytest.mark.parametrize(
    ("waited_s", "expected_ns"), [(0.25, 750_000_000), (0.0, 1_000_000_000), (-3600.0, 10**9), (3600.0, 10**9)]
)
def test_reception_is_told_on_the_monotonic_clock_even_when_the_wall_clock_steps(
    waited_s: float, expected_ns: int
) -> None:
    assert reception_ns(5000.0, 5000.0 + waited_s, 1_000_000_000) == pytest.approx(expected_ns, abs=1000)


def test_a_frame_stamped_late_does_not_make_the_next_ones_go_back_in_time() -> None:
    link = CanLink(CanSettings(channel="late"))
    ankle = can.Bus("late", "virtual", None, True, preserve_timestamps=True)
    encoder, wall_s = CanEncoder(), time.time()
    for age_s in (0.15, 0.14, 0.149, 0.145):  # the second was stamped only when it was read
        frame = as_message(encoder.ankle(STATE))
        frame.timestamp = wall_s - age_s
        ankle.send(frame)
    heard_ns = [state.t_sample_ns for state in receive_until(link, 3)]
    assert len(heard_ns) == 3
    assert heard_ns == sorted(heard_ns)
    ankle.shutdown()
    link.close()

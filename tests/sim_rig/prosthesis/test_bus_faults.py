"""A bus that loses, delays and babbles, as it was asked to."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import UserError
from messages.can_frames import CanFrame
from sim_rig.prosthesis.bus_faults import Babbler, BusFaults, FaultyWay, parse_faults

FRAMES = [CanFrame(0x120, bytes([k % 256] * 8)) for k in range(400)]
SPACING_NS = 1_000_000


def sent(faults: BusFaults, seed: int = 1) -> tuple[FaultyWay, list[tuple[int, CanFrame]]]:
    way = FaultyWay(faults, seed)
    for k, frame in enumerate(FRAMES):
        way.put(frame, k * SPACING_NS)
    return way, [(arrived.t_ns, arrived.frame) for arrived in way.due(10**12)]


def test_a_sound_bus_delivers_all_at_once_and_in_order() -> None:
    way, arrived = sent(BusFaults())
    assert arrived == [(k * SPACING_NS, frame) for k, frame in enumerate(FRAMES)]
    assert way.lost == 0


@settings(max_examples=20)
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(0, 9))
def test_what_is_not_lost_comes_as_late_as_asked_and_in_order(loss: float, delay_s: float, seed: int) -> None:
    way, arrived = sent(BusFaults(loss=loss, delay_s=delay_s), seed)
    assert len(arrived) + way.lost == len(FRAMES)
    assert abs(way.lost / len(FRAMES) - loss) < 0.12
    order = {id(frame): k for k, frame in enumerate(FRAMES)}
    numbers = [order[id(frame)] for _, frame in arrived]
    assert numbers == sorted(numbers)
    assert all(t_ns == k * SPACING_NS + round(1e9 * delay_s) for (t_ns, _), k in zip(arrived, numbers, strict=True))


def test_nothing_comes_before_its_time() -> None:
    way = FaultyWay(BusFaults(delay_s=0.02), 1)
    way.put(FRAMES[0], 0)
    assert not list(way.due(19_999_999))
    assert len(list(way.due(20_000_000))) == 1


def test_a_babbler_sends_as_often_as_asked_and_a_silent_one_never() -> None:
    babbler = Babbler(BusFaults(babble_hz=500.0), 1, 0)
    assert len(list(babbler.due(999_999_999))) == 500
    assert not list(babbler.due(999_999_999))
    assert not list(Babbler(BusFaults(), 1, 0).due(10**12))


def test_faults_are_read_as_they_are_written() -> None:
    assert parse_faults("") == BusFaults()
    assert parse_faults("loss=0.05, delay_s=0.02,babble_hz=500") == BusFaults(loss=0.05, delay_s=0.02, babble_hz=500.0)


@pytest.mark.parametrize(
    "text", ["loss", "loss=a", "lost=0.1", "loss=1.5", "delay_s=-1", "babble_hz=nan", "=", "loss=inf"]
)
def test_rubbish_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(UserError, match="bus faults: ") as refused:
        parse_faults(text)
    assert "\n" not in str(refused.value)

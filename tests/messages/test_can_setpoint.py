"""Set-points on CAN: what was put in comes out, damage is seen, and nothing old is fresh."""

import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import GaitPhase, Reason, Setpoint, Source, Status
from messages.can_encoder import CanEncoder
from messages.can_frames import CanFrame, CanMessage, can_id, decode, profile
from messages.can_setpoint import ReceivedSetpoint, SetpointReceiver
from messages.e2e import E2eCheck, E2eReceiver, E2eSender, Profile5
from messages.refusal import Refusal
from tests.bench.can_samples import NAN, setpoint, stamp

CYCLE_NS = 50_000_000
FRAME_NS = 270_000
SCHEME = profile(CanMessage.SETPOINT_FD)
BOTH = pytest.mark.parametrize("fd", [False, True])


class Bus:
    """A sender and a receiver; each update is heard `later_ns` after it was sent, but for frames that are `lost`."""

    def __init__(self, *, fd: bool = False, accept_simulated: bool = False) -> None:
        self.fd = fd
        self.encoder = CanEncoder()
        self.receiver = SetpointReceiver(accept_simulated=accept_simulated)
        self.seq = 0

    def frames(self, sent: Setpoint, age_s: float = 0.04, source: Source = Source.LIVE) -> tuple[CanFrame, ...]:
        told = stamp(seq=self.seq, source=source)
        if self.fd:
            return (self.encoder.setpoint_fd(sent, told, age_s),)
        return self.encoder.setpoint(sent, told, age_s)

    def update(
        self,
        sent: Setpoint | None = None,
        age_s: float = 0.04,
        *,
        source: Source = Source.LIVE,
        lost: tuple[int, ...] = (),
        later_ns: int = 0,
    ) -> list[ReceivedSetpoint | Refusal]:
        frames = self.frames(setpoint() if sent is None else sent, age_s, source)
        at_ns = self.seq * CYCLE_NS + later_ns
        self.seq += 1
        return [
            self.receiver.feed(frame.can_id, frame.data, at_ns + k * FRAME_NS)
            for k, frame in enumerate(frames)
            if k not in lost
        ]


@BOTH
def test_the_second_update_is_told_and_holds_what_was_sent(fd: bool) -> None:
    bus = Bus(fd=fd)
    assert set(bus.update()) == {Refusal.INITIAL, *(() if fd else (Refusal.FIRST_HALF,))}
    found, sent = bus.update()[-1], setpoint()
    assert isinstance(found, ReceivedSetpoint)
    assert (found.source, found.phase) == (Source.LIVE, GaitPhase.SWING)
    assert found.equilibrium_rad == pytest.approx(sent.equilibrium_rad, abs=0.00025)
    assert found.stiffness_nm_per_rad == pytest.approx(sent.stiffness_nm_per_rad, abs=0.25)
    assert found.damping_nms_per_rad == pytest.approx(sent.damping_nms_per_rad, abs=0.01)
    assert found.slope_rad == pytest.approx(0.1, abs=0.00025)
    assert found.equilibrium_sd_rad == pytest.approx(0.02)
    assert [found.stiffness_sd_share, found.damping_sd_share] == pytest.approx([0.25, 0.5])
    assert found.age_s == pytest.approx(0.04 + (0 if fd else 5 * 1e-9 * FRAME_NS))


@BOTH
@pytest.mark.parametrize("reason", [reason for reason in Reason if reason is not Reason.NONE])
def test_an_update_that_is_not_valid_makes_an_end_of_all_before_it(fd: bool, reason: Reason) -> None:
    bus = Bus(fd=fd)
    bus.update()
    bus.update()
    assert set(bus.update(setpoint().without_numbers(reason))) == {Refusal.NOT_VALID}
    assert bus.receiver.reason == reason.value
    if not fd:
        assert bus.update(lost=(2,))[-1] is Refusal.NOT_AVAILABLE  # nothing from before stands in


def test_a_lost_point_of_one_update_is_that_of_the_update_before() -> None:
    bus = Bus()
    bus.update()
    bus.update(setpoint(stiffness_nm_per_rad=(100.0, 100.0, 100.0, 100.0, 100.0)))
    found = bus.update(lost=(2,))[-1]
    assert isinstance(found, ReceivedSetpoint)
    assert found.stiffness_nm_per_rad == (100.0, 200.0, 100.0, 500.0, 80.0)
    assert found.age_s == pytest.approx(0.04 + 0.05 + 1e-9 * 3 * FRAME_NS)  # of the oldest


def test_a_point_is_not_used_after_its_age() -> None:
    bus = Bus()
    bus.update()
    found = [bus.update(lost=(2,) if n else ())[-1] for n in range(5)]
    assert [isinstance(each, ReceivedSetpoint) for each in found] == [True, True, True, False, False]
    assert found[-1] is Refusal.STALE


@BOTH
@pytest.mark.parametrize("source", [Source.SIMULATED, Source.REPLAY])
def test_what_is_not_live_is_refused(fd: bool, source: Source) -> None:
    bus, trusting = Bus(fd=fd), Bus(fd=fd, accept_simulated=True)
    bus.update()
    bus.update()
    assert Refusal.NOT_LIVE in bus.update(source=source)
    assert not any(isinstance(each, ReceivedSetpoint) for each in bus.update(source=source))
    trusting.update(source=source)
    assert isinstance(trusting.update(source=source)[-1], ReceivedSetpoint)


@BOTH
@pytest.mark.parametrize("age_s", [0.151, 0.3, NAN, -1.0])
def test_what_is_old_or_of_unknown_age_is_refused(fd: bool, age_s: float) -> None:
    bus = Bus(fd=fd)
    bus.update(age_s=age_s)
    assert set(bus.update(age_s=age_s)[:-1] or [Refusal.STALE]) == {Refusal.STALE}
    assert not any(isinstance(each, ReceivedSetpoint) for each in bus.update(age_s=age_s))


def test_frames_of_a_stuck_bus_that_come_as_a_burst_give_nothing() -> None:
    bus = Bus()
    bus.update()
    bus.update()
    waiting = [bus.frames(setpoint()) for _ in range(4)]
    told = [bus.receiver.feed(f.can_id, f.data, 10**9 + k) for k, f in enumerate(itertools.chain(*waiting))]
    assert not any(isinstance(each, ReceivedSetpoint) for each in told)
    assert Refusal.INITIAL in told
    assert Refusal.TOO_SOON in told


@BOTH
@settings(max_examples=20)
@given(chance=st.integers(0, 10**6))
def test_nothing_older_than_150_ms_is_ever_told(fd: bool, chance: int) -> None:
    """Losses, delays, silences and damage at random: what is told was seen no longer ago than its age says."""
    draw, bus, told = random.Random(chance), Bus(fd=fd), 0
    t_ns = 10**9
    for seq in range(40):
        t_ns += draw.choice([CYCLE_NS, CYCLE_NS, CYCLE_NS, 2 * CYCLE_NS, 1_000_000, 400_000_000])
        age_s = draw.choice([0.03, 0.08, 0.14, 0.149, 0.2])
        bus.seq = seq
        for k, frame in enumerate(bus.frames(setpoint(slope_rad=0.001 * seq), age_s)):
            if draw.random() < 0.1:
                continue
            data = bytearray(frame.data)
            if draw.random() < 0.05:
                data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
            found = bus.receiver.feed(frame.can_id, bytes(data), t_ns + k * FRAME_NS)
            if isinstance(found, ReceivedSetpoint):
                told += 1
                assert 0.0 < found.age_s <= 0.150
                assert t_ns + k * FRAME_NS - found.t_exposure_ns == pytest.approx(1e9 * found.age_s, abs=1.0)
                numbers = found.equilibrium_rad + found.stiffness_nm_per_rad + found.damping_nms_per_rad
                assert all(map(math.isfinite, numbers))


@BOTH
@pytest.mark.parametrize(
    "change",
    [
        {"stiffness_nm_per_rad": (100.0, 200.0, 1100.0, 500.0, 80.0)},
        {"equilibrium_rad": (0.0, NAN, 0.1, 0.05, -0.1)},
        {"damping_nms_per_rad": (1.0, 2.0, 21.0, 2.0, 1.0)},
        {"damping_nms_per_rad": (1.0, 2.0, -1.0, 2.0, 1.0)},
        {"slope_rad": 1.1},
        {"slope_sd_rad": NAN},
    ],
)
def test_a_set_point_that_does_not_fit_leaves_without_numbers(fd: bool, change: dict[str, object]) -> None:
    bus = Bus(fd=fd)
    frames = bus.frames(setpoint(**change))
    numbers = [number for frame in frames for number in _told(frame).items() if number[0] != "age_ms"]
    assert all(math.isnan(number) for name, number in numbers if name not in ("crc", "counter", *_ALWAYS))
    bus.update(setpoint(**change))
    assert bus.update(setpoint(**change))[-1] is Refusal.NOT_VALID
    assert bus.receiver.reason == "out_of_range"


def _told(frame: CanFrame) -> dict[str, float]:
    message = next(each for each in CanMessage if can_id(each) == frame.can_id)
    return decode(message, frame.data).numbers


_ALWAYS = ("frame_number", "stance_percent")


def test_only_the_frame_of_can_fd_needs_it() -> None:
    encoder = CanEncoder()
    assert not any(frame.is_fd for frame in encoder.setpoint(setpoint(), stamp(), 0.04))
    assert encoder.setpoint_fd(setpoint(), stamp(), 0.04).is_fd


def test_an_invalid_set_point_says_why() -> None:
    invalid = setpoint().without_numbers(Reason.STARTING)
    assert (invalid.status, invalid.reason) == (Status.INITIALISING, Reason.STARTING)
    with pytest.raises(ValueError, match="none"):
        setpoint().without_numbers(Reason.NONE)


@pytest.mark.parametrize("max_age_s", [0.0, -1.0, 0.254, NAN])
def test_an_age_that_a_frame_cannot_prove_is_refused(max_age_s: float) -> None:
    with pytest.raises(ValueError, match="max_age_s"):
        SetpointReceiver(max_age_s=max_age_s)


def test_the_counter_of_profile_5_wraps_after_255_and_its_step_is_bounded() -> None:
    sender, receiver = E2eSender(SCHEME), E2eReceiver(SCHEME)
    receiver.check(sender.protect(bytes(32)), 0)
    assert {receiver.check(sender.protect(bytes(32)), n) for n in range(300)} == {E2eCheck.OK}
    data = sender.protect(bytes(32))
    assert [receiver.check(data, 300) for _ in range(2)] == [E2eCheck.OK, E2eCheck.REPEATED]
    for _ in range(3):
        sender.protect(bytes(32))
    assert receiver.check(sender.protect(bytes(32)), 301) is E2eCheck.WRONG_SEQUENCE
    assert receiver.check(bytes(8), 302) is E2eCheck.WRONG_LENGTH


@pytest.mark.parametrize("message", CanMessage)
def test_frames_are_protected_as_another_implementation_of_autosars_profiles_does_it(message: CanMessage) -> None:
    e2e = pytest.importorskip("e2e")
    scheme, rng = profile(message), np.random.default_rng(7)
    for counter in range(scheme.counters):
        data = bytearray(scheme.protected(rng.bytes(scheme.length), counter))
        ours = bytes(data)
        if isinstance(scheme, Profile5):
            assert e2e.p05.e2e_p05_check(ours, scheme.data_id)
            e2e.p05.e2e_p05_protect(data, scheme.data_id, increment_counter=False)
        else:
            assert e2e.p02.e2e_p02_check(ours, scheme.data_ids, length=scheme.length)
            e2e.p02.e2e_p02_protect(data, scheme.data_ids, length=scheme.length, increment_counter=False)
        assert bytes(data) == ours
        damaged = bytearray(ours)
        damaged[int(rng.integers(scheme.length))] ^= 1 << int(rng.integers(8))
        assert not scheme.is_intact(bytes(damaged))


# The CRC is affine: what flipped bits do to it does not depend on the payload, so these counts hold for every frame.


def syndromes() -> np.ndarray:
    """What each of the 256 bits of SETPOINT_FD does to the difference between the CRC sent and that of the bytes."""
    zero = bytes(32)

    def off(data: bytes) -> int:
        assert isinstance(SCHEME, Profile5)
        return int.from_bytes(data[:2], "little") ^ SCHEME.crc(data)

    return np.array([off((1 << bit).to_bytes(32, "little")) ^ off(zero) for bit in range(256)])


def test_any_1_2_or_3_flipped_bits_of_profile_5_are_seen() -> None:
    of_bit = syndromes()
    a, b = np.triu_indices(256, 1)
    pairs = of_bit[a] ^ of_bit[b]
    assert of_bit.all()
    assert pairs.all()
    for k in range(256):  # 3 bits: the third undoes the first two
        assert not np.any(pairs[b < k] == of_bit[k])


def test_any_burst_of_up_to_16_bits_behind_the_crc_of_profile_5_is_seen() -> None:
    of_bit = syndromes()
    on_the_wire = np.array([8 * (i // 8) + 7 - i % 8 for i in range(256)])
    patterns = np.arange(1, 1 << 16, 2, dtype=np.int64)
    lengths = np.array([int(p).bit_length() for p in patterns])
    for start in range(16, 256):
        change = np.zeros(len(patterns), dtype=np.int64)
        for k in range(min(16, 256 - start)):
            change ^= np.where(patterns >> k & 1, of_bit[on_the_wire[start + k]], 0)
        assert change[start + lengths <= 256].all()

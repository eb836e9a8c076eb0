"""The receiver acts on a matching, fresh, live and complete pair, and on nothing else."""

import pytest

from messages import GroundPlane, Reason, Source, Stamp
from messages.can_encoder import CanEncoder
from messages.can_estimates import ReceivedGround, ReceivedPropagatedGround
from messages.can_frames import CanFrame, CanMessage, can_id, profile
from messages.can_receiver import CanReceiver
from messages.refusal import Refusal
from tests.bench.can_samples import ground, health, invalid_ground, propagated_ground, stamp

CYCLE_NS = 50_000_000


class Bus:
    """One sender and one receiver in step; `seq` and the receiver's time go on with every pair."""

    def __init__(self, receiver: CanReceiver[ReceivedGround] | None = None) -> None:
        self.receiver = receiver or CanReceiver(ReceivedGround)
        self.encoder = CanEncoder()
        self.seq = 0
        self.t_ns = 7_000_000_000

    def frames(
        self, sent: GroundPlane | None = None, sealed: Stamp | None = None, age_s: float = 0.04
    ) -> list[CanFrame]:
        self.seq += 1
        self.t_ns += CYCLE_NS
        pair = self.encoder.ground(sent or ground(), sealed or stamp(seq=self.seq), age_s)
        return list(pair)

    def feed(self, *frames: CanFrame) -> list[ReceivedGround | Refusal]:
        return [self.receiver.feed(frame.can_id, frame.data, self.t_ns) for frame in frames]

    def settled(self) -> "Bus":
        self.feed(*self.frames())
        return self


def test_the_first_pair_only_starts_the_sequence() -> None:
    bus = Bus()
    assert bus.feed(*bus.frames()) == [Refusal.INITIAL, Refusal.INITIAL]


def test_a_matching_pair_is_told_with_its_time_on_the_receivers_clock() -> None:
    bus = Bus().settled()
    first, second = bus.frames(age_s=0.0401)
    assert bus.feed(first) == [Refusal.FIRST_HALF]
    bus.t_ns += 2_000_000
    (told,) = bus.feed(second)
    assert isinstance(told, ReceivedGround)
    assert told.t_exposure_ns == bus.t_ns - 2_000_000 - 41_000_000
    assert told.age_s == pytest.approx(0.043)
    numbers = [told.slope_sagittal_rad, told.slope_frontal_rad, told.height_m]
    assert numbers == pytest.approx([0.1, -0.05, 0.931])
    deviations = [told.slope_sagittal_sd_rad, told.slope_frontal_sd_rad, told.height_sd_m]
    assert deviations == pytest.approx([0.01, 0.02, 0.003])
    assert (told.source, told.calibration_id) == (Source.LIVE, "a3f")


def test_other_messages_pass_by() -> None:
    bus = Bus().settled()
    first, second = bus.frames()
    bus.feed(first)
    assert bus.feed(bus.encoder.health(health(), stamp())) == [Refusal.OTHER_MESSAGE]
    assert isinstance(bus.feed(second)[0], ReceivedGround)


def test_halves_of_different_estimates_are_never_joined() -> None:
    bus = Bus().settled()
    first, _ = bus.frames()
    bus.feed(first)
    _, other_second = bus.frames()
    assert bus.feed(other_second) == [Refusal.FRAME_MISMATCH]
    assert bus.feed(*bus.frames())[0] is Refusal.FIRST_HALF


@pytest.mark.parametrize(("after_ns", "taken"), [(12_500_000, True), (12_499_999, False)])
def test_a_pair_may_come_a_quarter_of_a_cycle_after_the_last_and_no_sooner(after_ns: int, taken: bool) -> None:
    bus = Bus().settled()
    bus.feed(*bus.frames())
    pair = bus.frames()
    bus.t_ns += after_ns - CYCLE_NS
    assert (Refusal.TOO_SOON in bus.feed(*pair)) is not taken


def test_a_second_half_alone_is_refused_and_used_once() -> None:
    bus = Bus().settled()
    first, second = bus.frames()
    assert bus.feed(second) == [Refusal.FRAME_MISMATCH]
    bus.feed(first)
    _, next_second = bus.frames(sealed=stamp(seq=bus.seq))
    assert isinstance(bus.feed(next_second)[0], ReceivedGround)
    _, again = bus.frames(sealed=stamp(seq=bus.seq - 1))
    assert bus.feed(again) == [Refusal.FRAME_MISMATCH]


def test_a_repeated_frame_and_a_jump_are_refused() -> None:
    bus = Bus().settled()
    first, _ = bus.frames()
    assert bus.feed(first, first) == [Refusal.FIRST_HALF, Refusal.REPEATED]
    for _ in range(3):
        first, _ = bus.frames()
        bus.t_ns -= CYCLE_NS
    assert bus.feed(bus.frames()[0]) == [Refusal.WRONG_SEQUENCE]


def test_damage_and_a_wrong_length_are_refused() -> None:
    bus = Bus().settled()
    first, _ = bus.frames()
    damaged = CanFrame(first.can_id, first.data[:5] + bytes([first.data[5] ^ 0x10]) + first.data[6:])
    assert bus.feed(damaged, CanFrame(first.can_id, first.data[:7])) == [Refusal.WRONG_CRC, Refusal.WRONG_LENGTH]


@pytest.mark.parametrize("source", [Source.REPLAY, Source.SIMULATED])
def test_only_live_data_is_taken_unless_asked(source: Source) -> None:
    for receiver, taken in (
        (CanReceiver(ReceivedGround), False),
        (CanReceiver(ReceivedGround, accept_simulated=True), True),
    ):
        bus = Bus(receiver).settled()
        told = bus.feed(*bus.frames(sealed=stamp(seq=1, source=source)))[1]
        assert isinstance(told, ReceivedGround) is taken
        assert taken or told is Refusal.NOT_LIVE


def test_an_estimate_that_is_not_valid_is_refused_and_tells_why() -> None:
    bus = Bus().settled()
    assert bus.feed(*bus.frames(invalid_ground(reason=Reason.LOW_TEXTURE)))[1] is Refusal.NOT_VALID
    assert bus.receiver.reason == "low_texture"
    bus.feed(*bus.frames())
    assert bus.receiver.reason == "none"


@pytest.mark.parametrize(
    ("age_s", "between_ns", "fresh"),
    [(0.095, 0, True), (0.095, 6_000_000, False), (0.101, 0, False), (3.0, 0, False), (float("nan"), 0, False)],
)
def test_old_or_ageless_estimates_are_refused(age_s: float, between_ns: int, fresh: bool) -> None:
    bus = Bus().settled()
    first, second = bus.frames(age_s=age_s)
    bus.feed(first)
    bus.t_ns += between_ns
    (told,) = bus.feed(second)
    assert isinstance(told, ReceivedGround) is fresh
    assert fresh or told is Refusal.STALE


def test_a_valid_estimate_with_a_number_missing_is_refused() -> None:
    bus = Bus().settled()
    first, second = bus.frames()
    told = bytearray(first.data)
    told[5:7] = (int.from_bytes(told[5:7], "little") | 0xFFF0).to_bytes(2, "little")  # height_m = 4095
    told[0] = profile(CanMessage.GROUND).crc(bytes(told))
    assert bus.feed(CanFrame(first.can_id, bytes(told)), second)[1] is Refusal.NOT_AVAILABLE


def test_what_waited_in_the_queue_of_a_stuck_bus_is_not_taken_for_fresh() -> None:
    bus = Bus().settled()
    stuck = [bus.frames() for _ in range(4)]
    bus.t_ns += 60 * 1_000_000_000
    burst = []
    for pair in stuck:
        bus.t_ns += 500_000
        burst += bus.feed(*pair)
    assert not any(isinstance(told, ReceivedGround) for told in burst)
    assert Refusal.TOO_SOON in burst
    assert isinstance(bus.feed(*bus.frames())[1], ReceivedGround)


@pytest.mark.parametrize("max_age_s", [0.0, -1.0, 0.254, 1.0, float("nan")])
def test_an_age_limit_that_frames_cannot_prove_is_refused(max_age_s: float) -> None:
    with pytest.raises(ValueError, match="max_age_s"):
        CanReceiver(ReceivedGround, max_age_s=max_age_s)


def test_identifiers_put_the_halves_on_the_bus_in_order_and_the_ankle_first() -> None:
    assert can_id(CanMessage.ANKLE_STATE) < can_id(CanMessage.GROUND) < can_id(CanMessage.GROUND_QUALITY)
    assert can_id(CanMessage.GROUND_QUALITY) < can_id(CanMessage.HEALTH) < 0x800
    first, second = Bus().frames()
    assert (first.can_id, second.can_id) == (can_id(CanMessage.GROUND), can_id(CanMessage.GROUND_QUALITY))
    of_ground = profile(CanMessage.GROUND)
    assert of_ground.counter_of(first.data) == of_ground.counter_of(second.data)


def carried(encoder: CanEncoder, seq: int, age_s: float = 0.004) -> tuple[CanFrame, CanFrame]:
    return encoder.propagated_ground(propagated_ground(), stamp(seq=seq), age_s)


def test_a_carried_ground_is_taken_a_hundred_times_a_second_with_the_age_of_its_picture() -> None:
    encoder, receiver = CanEncoder(), CanReceiver(ReceivedPropagatedGround)
    found = []
    for seq in range(5):
        t_ns = 7_000_000_000 + 10_000_000 * seq
        found += [receiver.feed(frame.can_id, frame.data, t_ns) for frame in carried(encoder, seq)]
    assert found[:2] == [Refusal.INITIAL, Refusal.INITIAL]
    told = found[3::2]
    assert all(isinstance(each, ReceivedPropagatedGround) for each in told)
    newest = told[-1]
    assert isinstance(newest, ReceivedPropagatedGround)
    assert newest.t_sample_ns == 7_040_000_000 - 4_000_000
    assert newest.picture_age_s == pytest.approx(0.063)
    numbers = [newest.slope_sagittal_rad, newest.slope_frontal_rad, newest.height_m]
    assert numbers == pytest.approx([0.09, -0.06, 0.917])
    deviations = [newest.slope_sagittal_sd_rad, newest.slope_frontal_sd_rad, newest.height_sd_m]
    assert deviations == pytest.approx([0.01, 0.02, 0.004])


def test_carried_grounds_on_the_heels_of_each_other_and_old_ones_are_refused() -> None:
    encoder, receiver = CanEncoder(), CanReceiver(ReceivedPropagatedGround)
    [receiver.feed(frame.can_id, frame.data, 0) for frame in carried(encoder, 0)]
    first, second = carried(encoder, 1)
    assert receiver.feed(first.can_id, first.data, 2_400_000) is Refusal.TOO_SOON
    assert receiver.feed(second.can_id, second.data, 2_400_000) is Refusal.FRAME_MISMATCH
    first, second = carried(encoder, 2, age_s=0.061)
    assert receiver.feed(first.can_id, first.data, 10_000_000) is Refusal.FIRST_HALF
    assert receiver.feed(second.can_id, second.data, 10_000_000) is Refusal.STALE

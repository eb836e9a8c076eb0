"""What must hold of every frame: it says what was put in, to its resolution, and damage to it is seen."""

import itertools
import math
from typing import cast

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import AnkleState, GaitPhase, Reason, Side, Source, Status, TerrainEdge, TerrainKind, TerrainObstacle
from messages.can_encoder import CanEncoder
from messages.can_frames import CanMessage, database, decode, decode_ankle, packed, profile
from messages.e2e import COUNTERS, E2eCheck, E2eReceiver, Profile2
from tests.bench.can_samples import NAN, ground, invalid_ground, stamp, terrain

HALF_SLOPE_STEP_RAD = 0.00025
HALF_HEIGHT_STEP_M = 0.0005
CLASSIC = {message: each for message in CanMessage if isinstance(each := profile(message), Profile2)}
MESSAGES = pytest.mark.parametrize("message", CLASSIC)

slopes = st.floats(-1.0235, 1.0235)
heights = st.floats(0.0, 4.094)
payloads = st.binary(min_size=8, max_size=8)


def in_sequence(message: CanMessage, data: bytes) -> E2eReceiver:
    """A receiver that has just taken the frame before `data`."""
    scheme = profile(message)
    receiver = E2eReceiver(scheme)
    before = (scheme.counter_of(data) - 1) % scheme.counters
    receiver.check(scheme.protected(bytes(scheme.length), before), 0)
    return receiver


def protected(message: CanMessage, payload: bytes, counter: int) -> bytes:
    """`payload` as sent when the message's counter stands at `counter`."""
    return profile(message).protected(payload, counter)


@given(sagittal=slopes, frontal=slopes, height=heights, seq=st.integers(0, 10**9), source=st.sampled_from(Source))
def test_ground_comes_back_within_half_a_step(
    sagittal: float, frontal: float, height: float, seq: int, source: Source
) -> None:
    sent = ground(slope_sagittal_rad=sagittal, slope_frontal_rad=frontal, height_m=height)
    first, second = CanEncoder().ground(sent, stamp(seq=seq, source=source), 0.05)
    told, quality = decode(CanMessage.GROUND, first.data), decode(CanMessage.GROUND_QUALITY, second.data)
    assert told.words == {"status": "valid", "source": source.value}
    assert told.numbers["slope_sagittal_rad"] == pytest.approx(sagittal, abs=HALF_SLOPE_STEP_RAD * 1.000001)
    assert told.numbers["slope_frontal_rad"] == pytest.approx(frontal, abs=HALF_SLOPE_STEP_RAD * 1.000001)
    assert told.numbers["height_m"] == pytest.approx(height, abs=HALF_HEIGHT_STEP_M * 1.000001)
    assert told.numbers["frame_number"] == quality.numbers["frame_number"] == seq % 16


@given(variance=st.floats(0.0, 0.0417))
def test_a_deviation_is_never_told_smaller_than_it_is(variance: float) -> None:
    sent = ground(covariance=(variance, 0.0, 0.0, variance, 0.0, variance))
    _, second = CanEncoder().ground(sent, stamp(), 0.05)
    told = decode(CanMessage.GROUND_QUALITY, second.data).numbers
    deviation = math.sqrt(variance)
    assert deviation - 1e-12 <= told["slope_sagittal_sd_rad"] < deviation + 0.0002
    assert deviation - 1e-12 <= told["slope_frontal_sd_rad"] < deviation + 0.0002
    assert deviation - 1e-12 <= told["height_sd_m"] < deviation + 0.0005


@given(age_s=st.floats(0.0, 100.0))
def test_an_age_is_never_told_younger_than_it_is_until_it_saturates(age_s: float) -> None:
    first, _ = CanEncoder().ground(ground(), stamp(), age_s)
    told_ms = decode(CanMessage.GROUND, first.data).numbers["age_ms"]
    assert told_ms == 254.0 or 1e3 * age_s - 1e-6 <= told_ms < 1e3 * age_s + 1.0
    assert (told_ms == 254.0) == (age_s > 0.253 + 1e-9) or age_s == pytest.approx(0.253)


@given(
    name=st.sampled_from(["slope_sagittal_rad", "slope_frontal_rad", "height_m"]),
    value=st.floats(4.1, math.inf) | st.floats(-math.inf, -1.1) | st.just(NAN),
)
def test_a_number_that_does_not_fit_voids_the_whole_estimate(name: str, value: float) -> None:
    first, second = CanEncoder().ground(ground(**{name: value}), stamp(), 0.05)
    told, quality = decode(CanMessage.GROUND, first.data), decode(CanMessage.GROUND_QUALITY, second.data)
    assert told.words["status"] == "invalid"
    assert quality.words["reason"] == "out_of_range"
    numbers = [told.numbers[key] for key in ("slope_sagittal_rad", "slope_frontal_rad", "height_m")]
    numbers += [number for key, number in quality.numbers.items() if "_sd_" in key]
    assert len(numbers) == 6
    assert all(math.isnan(number) for number in numbers)


@given(status=st.sampled_from([Status.INITIALISING, Status.INVALID]), reason=st.sampled_from(Reason))
def test_an_estimate_without_numbers_says_why_and_holds_none(status: Status, reason: Reason) -> None:
    first, second = CanEncoder().ground(invalid_ground(status, reason), stamp(), 0.05)
    told, quality = decode(CanMessage.GROUND, first.data), decode(CanMessage.GROUND_QUALITY, second.data)
    assert (told.words["status"], quality.words["reason"]) == (status.value, reason.value)
    assert math.isnan(told.numbers["height_m"])
    assert math.isnan(quality.numbers["height_sd_m"])


@given(
    angle=st.floats(-3.2767, 3.2767) | st.just(NAN),
    rate=st.floats(-32.767, 32.767) | st.just(NAN),
    load=st.floats(-6553.4, 6553.4) | st.just(NAN),
    phase=st.sampled_from(GaitPhase),
)
def test_ankle_state_comes_back(angle: float, rate: float, load: float, phase: GaitPhase) -> None:
    sent = AnkleState(t_sample_ns=7, ankle_angle_rad=angle, ankle_rate_radps=rate, load_n=load, phase=phase)
    told = decode_ankle(CanEncoder().ankle(sent).data, 7)
    assert (told.t_sample_ns, told.phase) == (7, phase)
    assert told.ankle_angle_rad == pytest.approx(angle, abs=0.000051, nan_ok=True)
    assert told.ankle_rate_radps == pytest.approx(rate, abs=0.00051, nan_ok=True)
    assert told.load_n == pytest.approx(load, abs=0.1001, nan_ok=True)


metres = st.floats(0.0, 4.094)
deviations = st.floats(0.0, 0.25)


@given(
    distance=metres,
    rise=st.floats(-2.047, 2.047),
    deviation=deviations,
    probability=st.floats(0.0, 1.0),
    kind=st.sampled_from(TerrainKind),
    bound_only=st.booleans(),
    behind=st.integers(0, 3),
    count=st.integers(1, 12),
)
def test_terrain_tells_the_nearest_that_is_not_behind(
    distance: float,
    rise: float,
    deviation: float,
    probability: float,
    kind: TerrainKind,
    bound_only: bool,
    behind: int,
    count: int,
) -> None:
    edge = TerrainEdge(
        distance_m=distance,
        distance_sd_m=deviation,
        rise_m=rise,
        rise_sd_m=deviation,
        bound_only=bound_only,
        yaw_rad=0.0,
    )
    thing = TerrainObstacle(distance_m=distance, left_m=0.2, height_m=0.4)
    passed = msgspec.structs.replace(edge, distance_m=-0.1, rise_m=0.3), msgspec.structs.replace(thing, distance_m=-0.1)
    sent = terrain(
        kind=kind,
        probability=probability,
        edges=(passed[0],) * behind + (edge,) * count,
        obstacles=(passed[1],) * behind + (thing,) * count,
    )
    first, second = CanEncoder().terrain(sent, stamp(), 0.05)
    told, quality = decode(CanMessage.TERRAIN, first.data), decode(CanMessage.TERRAIN_QUALITY, second.data)
    assert told.words == {
        "status": "valid",
        "source": "live",
        "kind": kind.value,
        "edge": "bound_only" if bound_only else "measured",
    }
    assert told.numbers["edge_distance_m"] == pytest.approx(distance, abs=0.00050001)
    assert told.numbers["edge_rise_m"] == pytest.approx(rise, abs=0.00050001)
    assert told.numbers["edges_ahead"] == told.numbers["obstacles_ahead"] == min(count, 7)
    assert deviation - 1e-9 <= quality.numbers["edge_distance_sd_m"] < deviation + 0.001
    assert deviation - 1e-9 <= quality.numbers["edge_rise_sd_m"] < deviation + 0.0005
    assert probability - 0.01 < quality.numbers["probability"] <= probability + 1e-9
    assert quality.numbers["obstacle_distance_m"] == pytest.approx(distance, abs=0.0050001)
    assert quality.numbers["obstacle_left_m"] == pytest.approx(0.2, abs=0.0050001)


@given(
    side=st.sampled_from(Side),
    ahead=st.floats(-2.047, 2.047),
    left=st.floats(-0.511, 0.511),
    rise=st.floats(-0.511, 0.511),
    seconds=st.floats(-2.047, 2.047),
    deviation=deviations,
)
def test_the_foothold_comes_back_within_half_a_step(
    side: Side, ahead: float, left: float, rise: float, seconds: float, deviation: float
) -> None:
    found = msgspec.structs.replace(
        terrain().foothold,
        side=side,
        ahead_m=ahead,
        ahead_sd_m=deviation,
        left_m=left,
        left_sd_m=deviation,
        rise_m=rise,
        rise_sd_m=deviation,
        time_to_contact_s=seconds,
        time_to_contact_sd_s=deviation,
    )
    first, second = CanEncoder().foothold(terrain(foothold=found), stamp(), 0.05)
    told, quality = decode(CanMessage.FOOTHOLD, first.data), decode(CanMessage.FOOTHOLD_QUALITY, second.data)
    assert told.words == {"status": "valid", "source": "live", "side": side.value}
    numbers = [told.numbers[name] for name in ("ahead_m", "left_m", "time_to_contact_s")] + [quality.numbers["rise_m"]]
    assert numbers == pytest.approx([ahead, left, seconds, rise], abs=0.00050001)
    for name, step in (("ahead_sd_m", 0.001), ("left_sd_m", 0.001), ("rise_sd_m", 0.001)):
        assert deviation - 1e-9 <= quality.numbers[name] < deviation + step
    assert deviation - 1e-9 <= quality.numbers["time_to_contact_sd_s"] < deviation + 0.002


@given(message=st.sampled_from(CanMessage), data=st.data())
def test_frames_are_packed_as_cantools_packs_them(message: CanMessage, data: st.DataObject) -> None:
    definition = database().get_message_by_name(message.value)
    payload = data.draw(st.binary(min_size=definition.length, max_size=definition.length))
    raws = cast(dict[str, int], definition.decode(payload, scaling=False, decode_choices=False))
    assert packed(message, raws) == definition.encode(raws, scaling=False, strict=False)
    assert definition.decode(packed(message, raws), scaling=False, decode_choices=False) == raws


@given(message=st.sampled_from(list(CLASSIC)), payload=payloads, counter=st.integers(0, 15))
def test_every_single_flipped_bit_is_refused(message: CanMessage, payload: bytes, counter: int) -> None:
    data = protected(message, payload, counter)
    assert in_sequence(message, data).check(data, 0) is E2eCheck.OK
    for bit in range(64):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        assert in_sequence(message, data).check(bytes(damaged), 0) is E2eCheck.WRONG_CRC


@given(payload=payloads, counter=st.integers(0, 15))
def test_a_frame_never_passes_as_another_message(payload: bytes, counter: int) -> None:
    for sent, taken_for in itertools.permutations(CLASSIC, 2):
        data = protected(sent, payload, counter)
        assert in_sequence(taken_for, data).check(data, 0) is E2eCheck.WRONG_CRC


# The CRC is affine: what a set of flipped bits does to it does not depend on the payload. The exhaustive counts
# below therefore hold for every frame.


def syndromes(scheme: Profile2) -> tuple[np.ndarray, np.ndarray]:
    """What each of the 64 bits, and each value of the Data ID byte, does to the difference of CRCs."""
    plain = Profile2(length=8, data_ids=bytes(16), max_delta=1, cycle_s=1.0)
    zero = plain.crc(bytes(8))
    of_bit = np.array(
        [1 << bit if bit < 8 else plain.crc((1 << bit).to_bytes(8, "little")) ^ zero for bit in range(64)]
    )
    of_id = np.array(
        [Profile2(length=8, data_ids=bytes([x]) * 16, max_delta=1, cycle_s=1.0).crc(bytes(8)) for x in range(256)]
    )
    # Bits 8 to 11 are the counter; it also chooses the Data ID, so the two are kept apart.
    return of_bit, of_id ^ zero


def unseen(scheme: Profile2, flips: np.ndarray) -> int:
    """How many of the flips (n × 64 of 0 and 1), over all 16 counters, leave the CRC right."""
    of_bit, of_id = syndromes(scheme)
    change = np.bitwise_xor.reduce(np.where(flips == 1, of_bit, 0), axis=1)
    counter_change = flips[:, 8:12] @ np.array([1, 2, 4, 8])
    ids = np.frombuffer(scheme.data_ids, dtype=np.uint8)
    total = 0
    for counter in range(COUNTERS):
        total += int(np.sum(change == of_id[ids[counter]] ^ of_id[ids[counter ^ counter_change]]))
    return total


def flips_of(positions: list[tuple[int, ...]]) -> np.ndarray:
    flips = np.zeros((len(positions), 64), dtype=np.int64)
    for row, bits in enumerate(positions):
        flips[row, list(bits)] = 1
    return flips


@MESSAGES
def test_any_two_flipped_bits_are_seen(message: CanMessage) -> None:
    assert unseen(CLASSIC[message], flips_of(list(itertools.combinations(range(64), 2)))) == 0


@MESSAGES
def test_any_three_flipped_bits_outside_the_counter_are_seen_and_nearly_all_others(message: CanMessage) -> None:
    outside = [bit for bit in range(64) if not 8 <= bit < 12]
    assert unseen(CLASSIC[message], flips_of(list(itertools.combinations(outside, 3)))) == 0
    everywhere = flips_of(list(itertools.combinations(range(64), 3)))
    assert unseen(CLASSIC[message], everywhere) / (16 * len(everywhere)) < 0.0012


@MESSAGES
def test_any_burst_within_the_signals_is_seen_and_nearly_all_others(message: CanMessage) -> None:
    on_the_wire = [8 * (i // 8) + 7 - i % 8 for i in range(64)]  # each byte goes out highest bit first

    def bursts(first: int) -> np.ndarray:
        return flips_of(
            [
                tuple(on_the_wire[start + k] for k in range(8) if pattern >> k & 1)
                for start in range(first, 64)
                for pattern in range(1, 256, 2)
                if start + pattern.bit_length() <= 64
            ]
        )

    assert unseen(CLASSIC[message], bursts(16)) == 0
    assert unseen(CLASSIC[message], bursts(0)) / (16 * len(bursts(0))) < 0.0007


def test_random_corruption_passes_as_often_as_is_said() -> None:
    rng = np.random.default_rng(5)
    scheme = CLASSIC[CanMessage.GROUND]
    frames = rng.integers(0, 256, size=(40_000, 8), dtype=np.uint8)
    right_crc = sum(frame[0] == scheme.crc(frame) for frame in map(bytes, frames))
    assert right_crc == pytest.approx(40_000 / 256, rel=0.25)  # 3 standard deviations are 0.24
    passed = 0
    for frame in map(bytes, frames[:20_000]):
        fresh = E2eReceiver(scheme)
        fresh.check(protected(CanMessage.GROUND, bytes(8), 0), 0)
        passed += fresh.check(frame, 0) is E2eCheck.OK
    assert 1 <= passed <= 20_000 / 1365 + 4 * math.sqrt(20_000 / 1365)

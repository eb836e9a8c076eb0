"""The DBC, the Python enums and the C code made from the DBC are one contract; the protection is AUTOSAR's."""

import enum
import math
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from crccheck.crc import Crc8Autosar  # type: ignore[import-untyped]  # the package carries no type hints

from messages import (
    INTERFACE_VERSION,
    TOPIC_OF,
    DropCause,
    GaitPhase,
    GroundPlane,
    Health,
    Load,
    NextFoothold,
    PropagatedGround,
    Reason,
    Setpoint,
    Side,
    Source,
    Status,
    Terrain,
    TerrainKind,
)
from messages.can_encoder import CanEncoder
from messages.can_frames import NOT_AVAILABLE, CanMessage, EdgeTold, database, decode, decode_ankle, profile
from messages.e2e import E2eCheck, E2eReceiver, E2eSender, Profile2
from tests.bench.can_samples import NAN, ground, health, invalid_ground, propagated_ground, stamp, terrain

ALL_MESSAGES = pytest.mark.parametrize("message", list(CanMessage))
CLASSIC = {message: each for message in CanMessage if isinstance(each := profile(message), Profile2)}
IDS_0_TO_15 = Profile2(length=8, data_ids=bytes(range(16)), max_delta=3, cycle_s=0.05)
IDS_1_TO_16 = Profile2(length=8, data_ids=bytes(range(1, 17)), max_delta=3, cycle_s=0.05)


def test_crc_gives_the_published_check_value() -> None:
    assert Crc8Autosar.calc(b"123456789") == 0xDF


def test_a_known_frame_of_profile_2_comes_out() -> None:
    sender = E2eSender(IDS_0_TO_15)
    sender.protect(bytes(8))
    assert sender.protect(bytes(range(8))).hex(" ") == "bc 02 02 03 04 05 06 07"


def test_sixteen_known_frames_of_profile_2_come_out() -> None:
    sender = E2eSender(IDS_1_TO_16)
    known = "1b 98 31 0d 18 9b 65 08 1d 9e 37 0b 1e 9d cd 0e"
    sent = [sender.protect(bytes(8)) for _ in range(16)]
    assert bytes(data[0] for data in sent).hex(" ") == known
    assert [data[1] for data in sent] == [*range(1, 16), 0]


def test_the_counter_leaves_the_other_nibble_alone() -> None:
    assert E2eSender(IDS_0_TO_15).protect(bytes([0, 0xA7, 0, 0, 0, 0, 0, 0]))[1] == 0xA1


@pytest.mark.parametrize(
    ("lost", "expected"),
    [(0, E2eCheck.OK), (2, E2eCheck.OK), (3, E2eCheck.WRONG_SEQUENCE), (15, E2eCheck.REPEATED)],
)
def test_the_receiver_bounds_the_step_of_the_counter(lost: int, expected: E2eCheck) -> None:
    sender, receiver = E2eSender(IDS_0_TO_15), E2eReceiver(IDS_0_TO_15)
    assert receiver.check(sender.protect(bytes(8)), 0) is E2eCheck.INITIAL
    for _ in range(lost):
        sender.protect(bytes(8))
    assert receiver.check(sender.protect(bytes(8)), 1) is expected
    assert receiver.check(sender.protect(bytes(8)), 2) is E2eCheck.OK


def test_a_frame_sent_again_is_refused() -> None:
    sender, receiver = E2eSender(IDS_0_TO_15), E2eReceiver(IDS_0_TO_15)
    receiver.check(sender.protect(bytes(8)), 0)
    data = sender.protect(bytes(8))
    assert [receiver.check(data, t_ns) for t_ns in (1, 2)] == [E2eCheck.OK, E2eCheck.REPEATED]


def test_a_damaged_frame_does_not_disturb_the_sequence() -> None:
    sender, receiver = E2eSender(IDS_0_TO_15), E2eReceiver(IDS_0_TO_15)
    receiver.check(sender.protect(bytes(8)), 0)
    assert receiver.check(b"\xff" + sender.protect(bytes(8))[1:], 1) is E2eCheck.WRONG_CRC
    assert receiver.check(sender.protect(bytes(8)), 2) is E2eCheck.OK


@pytest.mark.parametrize("length", [0, 1, 7, 9])
def test_a_frame_of_another_length_is_refused(length: int) -> None:
    assert E2eReceiver(IDS_0_TO_15).check(bytes(length), 0) is E2eCheck.WRONG_LENGTH


def test_after_a_silence_the_sequence_begins_anew() -> None:
    sender, receiver = E2eSender(IDS_0_TO_15), E2eReceiver(IDS_0_TO_15)
    times_ns = [0, 50_000_000, 220_000_000, 400_000_000, 450_000_000]  # silences of 170 and 180 ms: limit 175
    checks = [receiver.check(sender.protect(bytes(8)), t_ns) for t_ns in times_ns]
    assert checks == [E2eCheck.INITIAL, E2eCheck.OK, E2eCheck.OK, E2eCheck.INITIAL, E2eCheck.OK]


@pytest.mark.parametrize(
    ("message", "signal", "words"),
    [
        ("GROUND", "status", Status),
        ("GROUND", "source", Source),
        ("GROUND_QUALITY", "reason", Reason),
        ("PROPAGATED_GROUND", "status", Status),
        ("PROPAGATED_GROUND", "source", Source),
        ("PROPAGATED_GROUND_QUALITY", "reason", Reason),
        ("FOOTHOLD", "status", Status),
        ("FOOTHOLD", "source", Source),
        ("FOOTHOLD", "side", Side),
        ("FOOTHOLD_QUALITY", "reason", Reason),
        ("TERRAIN", "status", Status),
        ("TERRAIN", "source", Source),
        ("TERRAIN", "kind", TerrainKind),
        ("TERRAIN", "edge", EdgeTold),
        ("TERRAIN_QUALITY", "reason", Reason),
        ("SETPOINT", "status", Status),
        ("SETPOINT", "source", Source),
        ("SETPOINT_QUALITY", "reason", Reason),
        ("SETPOINT_QUALITY", "phase", GaitPhase),
        ("SETPOINT_FD", "status", Status),
        ("SETPOINT_FD", "source", Source),
        ("SETPOINT_FD", "reason", Reason),
        ("SETPOINT_FD", "phase", GaitPhase),
        ("HEALTH", "source", Source),
        ("HEALTH", "load", Load),
        ("ANKLE_STATE", "phase", GaitPhase),
    ],
)
def test_the_dbc_and_the_enums_hold_the_same_words(message: str, signal: str, words: type[enum.Enum]) -> None:
    choices = database().get_message_by_name(message).get_signal_by_name(signal).choices
    assert choices is not None
    assert sorted(str(name) for name in choices.values()) == sorted(str(member.value) for member in words)


def test_the_dbc_has_the_version_of_the_interface() -> None:
    assert database().version == str(INTERFACE_VERSION)


@pytest.mark.parametrize(
    ("message", "data_ids"),
    [
        (CanMessage.GROUND, "A6 9B 75 77 A2 72 66 68 B3 6C 54 A3 1D 43 E3 B4"),
        (CanMessage.GROUND_QUALITY, "1C EA F9 E6 6B 59 B6 21 2A B9 8B 8A 47 F3 7A A8"),
    ],
)
def test_a_receiver_made_for_version_1_refuses_a_ground_that_means_something_else(
    message: CanMessage, data_ids: str
) -> None:
    of_version_1 = msgspec.structs.replace(profile(message), data_ids=bytes.fromhex(data_ids))
    encoder, receiver = CanEncoder(), E2eReceiver(of_version_1)
    half = (CanMessage.GROUND, CanMessage.GROUND_QUALITY).index(message)
    checks = [receiver.check(encoder.ground(ground(), stamp(), 0.05)[half].data, n * 50_000_000) for n in range(32)]
    assert set(checks) == {E2eCheck.WRONG_CRC}


@ALL_MESSAGES
def test_every_number_that_can_be_missing_has_a_raw_value_for_it_outside_its_range(message: CanMessage) -> None:
    for signal in database().get_message_by_name(message.value).signals:
        if signal.unit is None:
            continue
        missing = [raw for raw, name in (signal.choices or {}).items() if str(name) == NOT_AVAILABLE]
        assert len(missing) == 1, signal.name
        low, high = signal.minimum, signal.maximum
        assert low is not None
        assert high is not None
        assert not low <= missing[0] * signal.scale <= high
        assert missing[0] != 0


@pytest.mark.parametrize("message", CLASSIC)
def test_the_layout_is_that_of_profile_2(message: CanMessage) -> None:
    definition = database().get_message_by_name(message.value)
    assert definition.length == 8
    assert not definition.is_extended_frame
    for name, start, length in (("crc", 0, 8), ("counter", 8, 4)):
        signal = definition.get_signal_by_name(name)
        assert (signal.start, signal.length, signal.byte_order) == (start, length, "little_endian")
    assert sum(signal.length for signal in definition.signals) == 64
    assert len(CLASSIC[message].data_ids) == 16


def test_no_two_messages_share_a_data_id() -> None:
    ids = [data_id for each in CLASSIC.values() for data_id in each.data_ids]
    assert len(set(ids)) == 16 * len(CLASSIC)
    assert set(CanMessage) - set(CLASSIC) == {CanMessage.SETPOINT_FD}


def test_the_cycle_times_are_those_of_the_topics() -> None:
    cycles = {message.value: profile(message).cycle_s for message in CanMessage}
    assert cycles["GROUND"] == cycles["GROUND_QUALITY"] == pytest.approx(1.0 / TOPIC_OF[GroundPlane].rate_hz)
    carried = [cycles[name] for name in ("PROPAGATED_GROUND", "PROPAGATED_GROUND_QUALITY")]
    assert carried == pytest.approx([1.0 / TOPIC_OF[PropagatedGround].rate_hz] * 2)
    of_terrain = [cycles[name] for name in ("FOOTHOLD", "FOOTHOLD_QUALITY", "TERRAIN", "TERRAIN_QUALITY")]
    assert of_terrain == pytest.approx([1.0 / TOPIC_OF[Terrain].rate_hz] * 4)
    of_setpoint = [cycles[name] for name in ("SETPOINT", "SETPOINT_QUALITY", "SETPOINT_FD")]
    assert of_setpoint == pytest.approx([1.0 / TOPIC_OF[Setpoint].rate_hz] * 3)
    assert cycles["HEALTH"] == pytest.approx(1.0 / TOPIC_OF[Health].rate_hz)


@pytest.mark.parametrize("status", Status)
@pytest.mark.parametrize("source", Source)
def test_status_and_source_travel_as_words(status: Status, source: Source) -> None:
    sent = ground() if status is Status.VALID else invalid_ground(status)
    first, _ = CanEncoder().ground(sent, stamp(source=source), 0.05)
    assert decode(CanMessage.GROUND, first.data).words == {"status": status.value, "source": source.value}


def test_quality_tells_deviations_and_the_calibration() -> None:
    _, second = CanEncoder().ground(ground(), stamp(), 0.05)
    told = decode(CanMessage.GROUND_QUALITY, second.data)
    assert told.numbers["slope_sagittal_sd_rad"] == pytest.approx(0.01)
    assert told.numbers["slope_frontal_sd_rad"] == pytest.approx(0.02)
    assert told.numbers["height_sd_m"] == pytest.approx(0.003)
    assert f"{round(told.numbers['calibration_id']):03x}" == "a3f"
    assert told.words["reason"] == "none"


@pytest.mark.parametrize("variance", [NAN, -1e-9, 1.0])
def test_a_deviation_that_cannot_be_told_voids_the_estimate(variance: float) -> None:
    first, second = CanEncoder().ground(ground(covariance=(1e-4, 0.0, 0.0, variance, 0.0, 1e-6)), stamp(), 0.05)
    told = decode(CanMessage.GROUND, first.data)
    assert told.words["status"] == "invalid"
    assert math.isnan(told.numbers["height_m"])
    assert decode(CanMessage.GROUND_QUALITY, second.data).words["reason"] == "out_of_range"


@pytest.mark.parametrize("age_s", [-0.002, NAN])
def test_an_impossible_age_is_not_available(age_s: float) -> None:
    first, _ = CanEncoder().ground(ground(), stamp(), age_s)
    assert math.isnan(decode(CanMessage.GROUND, first.data).numbers["age_ms"])


def test_health_counts_modulo_4096() -> None:
    sent = health(imu_lost=4097, frames_dropped={DropCause.LATE: 4000, DropCause.CORRUPT: 100})
    told = decode(CanMessage.HEALTH, CanEncoder().health(sent, stamp()).data)
    assert told.words == {"source": "live", "load": "reduced"}
    counts = ("imu_lost", "imu_bus_errors", "frames_dropped", "frames_refused")
    assert [told.numbers[name] for name in counts] == [1.0, 2.0, 4.0, 5.0]


def test_a_phase_without_a_word_reads_as_unknown() -> None:
    assert decode_ankle(bytes([0, 0xF1, 0, 0, 0, 0, 0, 0]), 0).phase is GaitPhase.UNKNOWN


C_PROGRAM = r"""
#include <stdio.h>
#include "gaiteyes.h"

int main(void)
{
    unsigned byte;
    uint8_t data[8];
    struct gaiteyes_ground_t ground;
    for (int i = 0; i < 8; i++) {
        if (scanf("%2x", &byte) != 1) return 1;
        data[i] = (uint8_t)byte;
    }
    if (gaiteyes_ground_unpack(&ground, data, sizeof(data)) != 0) return 2;
    printf("%d %d %.4f %.4f %.3f %d %d\n",
           ground.status == GAITEYES_GROUND_STATUS_VALID_CHOICE, ground.source == GAITEYES_GROUND_SOURCE_LIVE_CHOICE,
           gaiteyes_ground_slope_sagittal_rad_decode(ground.slope_sagittal_rad),
           gaiteyes_ground_slope_frontal_rad_decode(ground.slope_frontal_rad),
           gaiteyes_ground_height_m_decode(ground.height_m), ground.age_ms,
           ground.slope_sagittal_rad == GAITEYES_GROUND_SLOPE_SAGITTAL_RAD_NOT_AVAILABLE_CHOICE);
    return 0;
}
"""


def test_the_codec_that_cantools_makes_for_a_microcontroller_reads_the_same(tmp_path: Path) -> None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    dbc = Path(__file__).parents[2] / "messages" / "gaiteyes.dbc"
    subprocess.run(
        [sys.executable, "-m", "cantools", "generate_c_source", "-o", str(tmp_path), str(dbc)],
        check=True,
        capture_output=True,
    )
    if compiler is None:
        pytest.skip("no C compiler on this machine")
    (tmp_path / "main.c").write_text(C_PROGRAM)
    program = tmp_path / "program"
    sources = [str(tmp_path / "main.c"), str(tmp_path / "gaiteyes.c")]
    subprocess.run([compiler, "-std=c99", "-Wall", "-Werror", "-o", str(program), *sources], check=True)

    def read_in_c(data: bytes) -> str:
        told = subprocess.run([str(program)], input=data.hex(" "), text=True, capture_output=True, check=True)
        return told.stdout.strip()

    encoder = CanEncoder()
    assert read_in_c(encoder.ground(ground(), stamp(), 0.0405)[0].data) == "1 1 0.1000 -0.0500 0.931 41 0"
    assert read_in_c(encoder.ground(invalid_ground(), stamp(), 0.0405)[0].data).endswith(" 41 1")


def test_terrain_without_edges_and_obstacles_says_so() -> None:
    first, second = CanEncoder().terrain(terrain(edges=(), obstacles=()), stamp(), 0.05)
    told, quality = decode(CanMessage.TERRAIN, first.data), decode(CanMessage.TERRAIN_QUALITY, second.data)
    assert (told.words["status"], told.words["edge"]) == ("valid", "none")
    assert told.numbers["edges_ahead"] == told.numbers["obstacles_ahead"] == 0
    missing = [name for name, number in (told.numbers | quality.numbers).items() if math.isnan(number)]
    assert missing == [
        "edge_distance_m",
        "edge_rise_m",
        "edge_distance_sd_m",
        "edge_rise_sd_m",
        "obstacle_distance_m",
        "obstacle_left_m",
    ]


@pytest.mark.parametrize("change", [{"rise_m": 2.1}, {"rise_sd_m": 0.3}, {"distance_m": 4.2}, {"distance_sd_m": NAN}])
def test_an_edge_that_does_not_fit_voids_the_terrain_and_not_the_foothold(change: dict[str, float]) -> None:
    sent = terrain(edges=(msgspec.structs.replace(terrain().edges[0], **change),))
    encoder = CanEncoder()
    first, second = encoder.terrain(sent, stamp(), 0.05)
    told, quality = decode(CanMessage.TERRAIN, first.data), decode(CanMessage.TERRAIN_QUALITY, second.data)
    assert told.words == {"status": "invalid", "source": "live", "kind": "unknown", "edge": "none"}
    assert quality.words["reason"] == "out_of_range"
    assert math.isnan(quality.numbers["probability"])
    assert decode(CanMessage.FOOTHOLD, encoder.foothold(sent, stamp(), 0.05)[0].data).words["status"] == "valid"


@pytest.mark.parametrize("change", [{"ahead_m": 3.0}, {"rise_m": NAN}, {"time_to_contact_sd_s": 0.6}])
def test_a_foothold_that_does_not_fit_is_void_and_its_terrain_is_not(change: dict[str, float]) -> None:
    sent = terrain(foothold=msgspec.structs.replace(terrain().foothold, **change))
    encoder = CanEncoder()
    first, second = encoder.foothold(sent, stamp(), 0.05)
    told, quality = decode(CanMessage.FOOTHOLD, first.data), decode(CanMessage.FOOTHOLD_QUALITY, second.data)
    assert told.words == {"status": "invalid", "source": "live", "side": "right"}
    assert quality.words["reason"] == "out_of_range"
    assert math.isnan(told.numbers["ahead_m"])
    assert decode(CanMessage.TERRAIN, encoder.terrain(sent, stamp(), 0.05)[0].data).words["status"] == "valid"


def test_a_next_step_that_is_not_known_has_no_number_in_a_valid_estimate() -> None:
    sent = terrain(foothold=NextFoothold.unknown(Side.LEFT))
    first, second = CanEncoder().foothold(sent, stamp(), 0.05)
    told, quality = decode(CanMessage.FOOTHOLD, first.data), decode(CanMessage.FOOTHOLD_QUALITY, second.data)
    assert told.words == {"status": "valid", "source": "live", "side": "left"}
    known = [name for name, number in (told.numbers | quality.numbers).items() if not math.isnan(number)]
    assert known == ["crc", "counter", "frame_number", "age_ms"]


def test_the_carried_ground_tells_the_age_of_its_picture_rounded_up() -> None:
    first, second = CanEncoder().propagated_ground(propagated_ground(), stamp(), 0.0041)
    told = decode(CanMessage.PROPAGATED_GROUND, first.data)
    quality = decode(CanMessage.PROPAGATED_GROUND_QUALITY, second.data)
    assert told.words == {"status": "valid", "source": "live"}
    assert (told.numbers["age_ms"], quality.numbers["picture_age_ms"]) == (5.0, 63.0)
    assert told.numbers["height_m"] == pytest.approx(0.917)
    assert quality.numbers["height_sd_m"] == pytest.approx(0.004)


@pytest.mark.parametrize("change", [{"height_m": 5.0}, {"picture_age_s": NAN}, {"covariance": (1.0,) * 6}])
def test_a_carried_ground_that_does_not_fit_is_void(change: dict[str, object]) -> None:
    first, second = CanEncoder().propagated_ground(propagated_ground(**change), stamp(), 0.004)
    told = decode(CanMessage.PROPAGATED_GROUND, first.data)
    quality = decode(CanMessage.PROPAGATED_GROUND_QUALITY, second.data)
    assert (told.words["status"], quality.words["reason"]) == ("invalid", "out_of_range")
    assert math.isnan(told.numbers["height_m"])
    assert math.isnan(quality.numbers["picture_age_ms"])

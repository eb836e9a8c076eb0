"""What passes a receiver of published JSON, and that nothing a payload may hold gets further or raises."""

import json
import math
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages import (
    TOPIC_OF,
    Attitude,
    Estimate,
    GroundPlane,
    Health,
    Motion,
    NextFoothold,
    PropagatedGround,
    Refusal,
    Side,
    Source,
    Status,
    Terrain,
)
from messages.codec import encode_line
from messages.json_receiver import LONGEST_PAYLOAD_BYTES, JsonReceiver, Received
from tests.bench.can_samples import (
    NAN,
    attitude,
    ground,
    health,
    invalid_ground,
    motion,
    propagated_ground,
    stamp,
    terrain,
)

HERE, ELSEWHERE = "this boot", "another machine's boot"
T0_NS = 50_000_000_000
PERIOD_NS = 50_000_000
AGE_NS = 40_000_000


def receiver(*, accept_simulated: bool = False) -> JsonReceiver[GroundPlane]:
    return JsonReceiver(GroundPlane, "unit-1", boot_id=HERE, accept_simulated=accept_simulated)


def payload(
    number: int, estimate: GroundPlane | None = None, *, age_ns: int = AGE_NS, boot_id: str = HERE, **stamped: object
) -> bytes:
    """What is published for the `number`th period, captured `age_ns` before."""
    t_publish_ns = T0_NS + number * PERIOD_NS
    message = msgspec.structs.replace(estimate or ground(), t_exposure_ns=t_publish_ns - age_ns)
    told = {"boot_id": boot_id, "seq": number, "t_publish_ns": t_publish_ns, "age_s": 1e-9 * age_ns} | stamped
    return encode_line(TOPIC_OF[GroundPlane], message, stamp(**told))


def fed(
    listening: JsonReceiver[GroundPlane], number: int, data: bytes | None = None, *, way_ns: int = 1_000_000
) -> Received[GroundPlane] | Refusal:
    t_ns = T0_NS + number * PERIOD_NS + way_ns
    return listening.feed(payload(number) if data is None else data, t_ns, t_ns)


def passed(found: Received[GroundPlane] | Refusal) -> Received[GroundPlane]:
    assert isinstance(found, Received)
    return found


def test_what_passes_comes_typed_with_its_stamp_and_its_age_now() -> None:
    found = passed(fed(receiver(), 0))
    assert found.message == ground(t_exposure_ns=T0_NS - AGE_NS)
    assert (found.stamp.seq, found.stamp.boot_id, found.stamp.source) == (0, HERE, Source.LIVE)
    assert found.age_s == pytest.approx(0.041)
    assert (found.lost_before, found.begins_sequence) == (0, True)


def test_on_the_same_machine_another_boot_is_refused_from_the_first_message_on() -> None:
    listening = JsonReceiver(GroundPlane, "unit-1", boot_id=HERE, same_machine=True)
    assert fed(listening, 0, payload(0, boot_id=ELSEWHERE)) is Refusal.OTHER_BOOT
    passed(fed(listening, 1))
    passed(fed(receiver(), 0, payload(0, boot_id=ELSEWHERE)))


def test_missing_numbers_are_counted() -> None:
    listening = receiver()
    assert [passed(fed(listening, number)).lost_before for number in (3, 4, 7)] == [0, 0, 2]


def test_an_estimate_that_says_it_is_not_valid_passes() -> None:
    assert passed(fed(receiver(), 0, payload(0, invalid_ground()))).message.status is Status.INVALID


@pytest.mark.parametrize("missing", ["slope_sagittal_rad", "slope_frontal_rad", "height_m", "ahead_m"])
def test_a_valid_estimate_without_a_number_is_refused(missing: str) -> None:
    assert fed(receiver(), 0, payload(0, ground(**{missing: NAN}))) is Refusal.NOT_AVAILABLE


@pytest.mark.parametrize("covariance", [(1.0, 0.0, 0.0, NAN, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0, 0.0, -1.0)])
def test_a_valid_estimate_without_a_variance_is_refused(covariance: tuple[float, ...]) -> None:
    assert fed(receiver(), 0, payload(0, ground(covariance=covariance))) is Refusal.NOT_AVAILABLE


@pytest.mark.parametrize("source", [Source.SIMULATED, Source.REPLAY])
def test_what_is_not_live_passes_only_when_asked_for(source: Source) -> None:
    assert fed(receiver(), 0, payload(0, source=source)) is Refusal.NOT_LIVE
    assert passed(fed(receiver(accept_simulated=True), 0, payload(0, source=source))).stamp.source is source


def test_what_is_not_live_does_not_touch_the_sequence() -> None:
    listening = receiver()
    fed(listening, 0)
    fed(listening, 1, payload(9, source=Source.SIMULATED))
    assert passed(fed(listening, 1)).lost_before == 0


@pytest.mark.parametrize(("way_ns", "is_stale"), [(59_000_000, False), (61_000_000, True)])
def test_on_this_machine_the_way_counts_into_the_age(way_ns: int, is_stale: bool) -> None:
    assert (fed(receiver(), 0, way_ns=way_ns) is Refusal.STALE) == is_stale


@pytest.mark.parametrize(("waited_ns", "is_stale"), [(59_000_000, False), (61_000_000, True)])
def test_from_elsewhere_the_wait_after_arrival_counts_into_the_age(waited_ns: int, is_stale: bool) -> None:
    found = receiver().feed(payload(0, boot_id=ELSEWHERE), 7, 7 + waited_ns)
    assert (found is Refusal.STALE) == is_stale


def test_what_was_old_when_it_was_published_is_stale() -> None:
    assert fed(receiver(), 0, payload(0, age_ns=101_000_000)) is Refusal.STALE


def test_an_age_that_the_times_contradict_is_malformed() -> None:
    assert fed(receiver(), 0, payload(0, age_ns=5_000_000_000, age_s=0.01)) is Refusal.MALFORMED
    assert fed(receiver(), 0, payload(0, age_ns=-5_000_000, age_s=0.0)) is Refusal.MALFORMED


def test_what_was_published_after_it_arrived_has_the_wrong_clock() -> None:
    assert fed(receiver(), 0, way_ns=-1) is Refusal.WRONG_CLOCK


def test_another_device_and_another_topic_under_the_key_are_refused() -> None:
    assert fed(receiver(), 0, payload(0, device="unit-2")) is Refusal.OTHER_TOPIC
    told: dict[str, Any] = json.loads(payload(0)) | {"topic": "attitude"}
    assert fed(receiver(), 0, json.dumps(told).encode()) is Refusal.OTHER_TOPIC


def test_a_number_that_stands_still_or_goes_back_is_refused() -> None:
    listening = receiver()
    fed(listening, 5)
    assert fed(listening, 6, payload(6, seq=5)) is Refusal.REPEATED
    assert fed(listening, 6, payload(6, seq=4)) is Refusal.WRONG_SEQUENCE
    assert fed(listening, 5) is Refusal.REPEATED
    assert passed(fed(listening, 6)).lost_before == 0


def test_a_later_number_published_earlier_is_refused() -> None:
    listening = receiver()
    fed(listening, 5)
    assert fed(listening, 5, payload(4, seq=6)) is Refusal.WRONG_SEQUENCE


def test_a_restarted_service_is_taken_after_a_second_of_silence() -> None:
    listening = receiver()
    fed(listening, 100)
    assert fed(listening, 119, payload(119, seq=0)) is Refusal.WRONG_SEQUENCE
    restarted = passed(fed(listening, 120, payload(120, seq=0)))
    assert (restarted.lost_before, restarted.begins_sequence) == (0, True)
    assert not passed(fed(listening, 121, payload(121, seq=1))).begins_sequence


def test_another_boot_is_taken_after_a_second_of_silence_and_never_in_turns() -> None:
    listening = receiver()
    fed(listening, 0)
    for number in range(1, 60):
        assert fed(listening, number, payload(number, boot_id=ELSEWHERE)) is Refusal.OTHER_BOOT
        assert not passed(fed(listening, number)).begins_sequence
    assert passed(fed(listening, 79, payload(3, boot_id=ELSEWHERE))).begins_sequence
    assert fed(listening, 80) is Refusal.OTHER_BOOT


def test_a_slow_topic_needs_three_periods_of_silence() -> None:
    listening: JsonReceiver[Health] = JsonReceiver(Health, "unit-1", boot_id=HERE)

    def told(t_s: int, seq: int) -> Received[Health] | Refusal:
        t_ns = t_s * 1_000_000_000
        stamped = stamp(boot_id=HERE, seq=seq, t_publish_ns=t_ns, age_s=0.0)
        return listening.feed(encode_line(TOPIC_OF[Health], health(t_ns=t_ns), stamped), t_ns, t_ns)

    assert isinstance(told(10, 8), Received)
    assert told(12, 0) is Refusal.WRONG_SEQUENCE
    assert isinstance(told(13, 0), Received)


TIMES = {
    Attitude: "t_sample_ns",
    PropagatedGround: "t_sample_ns",
    Motion: "t_exposure_ns",
    Terrain: "t_exposure_ns",
    Health: "t_ns",
}


@pytest.mark.parametrize(
    "sample",
    [attitude(), propagated_ground(), motion(), terrain(), health()],
    ids=["attitude", "propagated_ground", "motion", "terrain", "health"],
)
def test_the_other_topics_pass_too(sample: Attitude | PropagatedGround | Motion | Terrain | Health) -> None:
    listening: JsonReceiver[Estimate] = JsonReceiver(type(sample), "unit-1", boot_id=HERE)
    t_ns = 5_000_000_000
    sample = msgspec.structs.replace(sample, **{TIMES[type(sample)]: t_ns})
    stamped = stamp(boot_id=HERE, t_publish_ns=t_ns, age_s=0.0)
    found = listening.feed(encode_line(TOPIC_OF[type(sample)], sample, stamped), t_ns, t_ns)
    assert isinstance(found, Received)
    assert found.message == sample


@pytest.mark.parametrize(
    "missing",
    [
        {"picture_age_s": NAN},
        {"height_m": math.inf},
        {"covariance": (1.0, 0.0, 0.0, -1.0, 0.0, 1.0)},
        {"covariance": (1.0, NAN, 0.0, 1.0, 0.0, 1.0)},
    ],
)
def test_a_valid_carried_ground_without_a_number_is_refused(missing: dict[str, object]) -> None:
    listening: JsonReceiver[PropagatedGround] = JsonReceiver(PropagatedGround, "unit-1", boot_id=HERE)
    data = encode_line(TOPIC_OF[PropagatedGround], propagated_ground(**missing), stamp(boot_id=HERE))
    t_ns = stamp().t_publish_ns
    assert listening.feed(data, t_ns, t_ns) is Refusal.NOT_AVAILABLE


@pytest.mark.parametrize(
    "missing",
    [
        {"distance_m": NAN},
        {"distance_var_m2": -1.0},
        {"velocity_H_mps": (1.0, NAN, 0.0)},
        {"rate_cov_H": (1.0, 0.0, 0.0, -1.0, 0.0, 1.0)},
    ],
)
def test_a_valid_motion_without_a_number_is_refused(missing: dict[str, object]) -> None:
    listening: JsonReceiver[Motion] = JsonReceiver(Motion, "unit-1", boot_id=HERE)
    data = encode_line(TOPIC_OF[Motion], motion(**missing), stamp(boot_id=HERE))
    t_ns = stamp().t_publish_ns
    assert listening.feed(data, t_ns, t_ns) is Refusal.NOT_AVAILABLE


@pytest.mark.parametrize("missing", [{"distance_m": NAN}, {"rise_m": NAN}, {"rise_sd_m": -1.0}, {"distance_sd_m": NAN}])
def test_a_valid_terrain_whose_edge_lacks_a_number_is_refused(missing: dict[str, object]) -> None:
    listening: JsonReceiver[Terrain] = JsonReceiver(Terrain, "unit-1", boot_id=HERE)
    sample = terrain(edges=(msgspec.structs.replace(terrain().edges[0], **missing),))
    data = encode_line(TOPIC_OF[Terrain], sample, stamp(boot_id=HERE))
    t_ns = stamp().t_publish_ns
    assert listening.feed(data, t_ns, t_ns) is Refusal.NOT_AVAILABLE


@pytest.mark.parametrize("missing", [{"height_m": NAN}, {"rise_sd_m": -1.0}, {"time_to_contact_sd_s": NAN}])
def test_a_valid_terrain_whose_foothold_lacks_a_number_is_refused(missing: dict[str, object]) -> None:
    listening: JsonReceiver[Terrain] = JsonReceiver(Terrain, "unit-1", boot_id=HERE)
    sample = terrain(foothold=msgspec.structs.replace(terrain().foothold, **missing))
    data = encode_line(TOPIC_OF[Terrain], sample, stamp(boot_id=HERE))
    t_ns = stamp().t_publish_ns
    assert listening.feed(data, t_ns, t_ns) is Refusal.NOT_AVAILABLE


@pytest.mark.parametrize(
    "unknown",
    [
        ("rise_m", "rise_sd_m"),
        tuple(
            f"{name}{sd}_{unit}"
            for name, unit in (("slope_sagittal", "rad"), ("slope_frontal", "rad"), ("height", "m"), ("rise", "m"))
            for sd in ("", "_sd")
        ),
    ],
)
def test_a_valid_terrain_may_not_know_the_ground_at_the_foothold(unknown: tuple[str, ...]) -> None:
    listening: JsonReceiver[Terrain] = JsonReceiver(Terrain, "unit-1", boot_id=HERE)
    sample = terrain(foothold=msgspec.structs.replace(terrain().foothold, **dict.fromkeys(unknown, NAN)))
    data = encode_line(TOPIC_OF[Terrain], sample, stamp(boot_id=HERE))
    t_ns = stamp().t_publish_ns
    assert isinstance(listening.feed(data, t_ns, t_ns), Received)


def test_a_valid_terrain_may_know_no_foothold() -> None:
    listening: JsonReceiver[Terrain] = JsonReceiver(Terrain, "unit-1", boot_id=HERE)
    data = encode_line(TOPIC_OF[Terrain], terrain(foothold=NextFoothold.unknown(Side.LEFT)), stamp(boot_id=HERE))
    t_ns = stamp().t_publish_ns
    received = listening.feed(data, t_ns, t_ns)
    assert isinstance(received, Received)
    assert received.message.foothold.side is Side.LEFT


def test_a_valid_terrain_whose_obstacle_lacks_a_number_is_refused() -> None:
    listening: JsonReceiver[Terrain] = JsonReceiver(Terrain, "unit-1", boot_id=HERE)
    sample = terrain(obstacles=(msgspec.structs.replace(terrain().obstacles[0], height_m=NAN),))
    data = encode_line(TOPIC_OF[Terrain], sample, stamp(boot_id=HERE))
    t_ns = stamp().t_publish_ns
    assert listening.feed(data, t_ns, t_ns) is Refusal.NOT_AVAILABLE


def changed(**fields: object) -> bytes:
    return json.dumps(json.loads(payload(0)) | fields).encode()


WRONG = [
    b"",
    b"\x00",
    b"\xff\xfe{}",
    b"null",
    b"[]",
    b"{}",
    b'"ground"',
    payload(0)[:-1],
    payload(0) + b"}",
    payload(0).replace(b"0.931", b"NaN"),
    payload(0).replace(b"0.931", b"1e999"),
    payload(0).replace(b'"ground"', b'"gr\xffund"'),
    b"[" * LONGEST_PAYLOAD_BYTES,
    b'{"topic":' * (LONGEST_PAYLOAD_BYTES // 9),
    b" " * LONGEST_PAYLOAD_BYTES + payload(0),
    *(
        changed(**{field: wrong})
        for field, wrong in (
            ("height_m", "0.9"),
            ("height_m", [0.9]),
            ("height_m", True),
            ("status", "perfect"),
            ("status", None),
            ("reason", 3),
            ("covariance", [0.0] * 5),
            ("covariance", {}),
            ("topic", None),
            ("device", 7),
            ("boot_id", None),
            ("source", "LIVE"),
            ("seq", None),
            ("seq", -1),
            ("seq", 0.5),
            ("seq", 2**63),
            ("seq", 10**400),
            ("t_publish_ns", 10**400),
            ("t_publish_ns", -1),
            ("t_exposure_ns", 2**70),
            ("age_s", None),
            ("age_s", -0.001),
            ("age_s", "0.04"),
            ("age_s", 1e308),
        )
    ),
]


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_malformed_is_refused(wrong: bytes) -> None:
    listening = receiver(accept_simulated=True)
    assert fed(listening, 0, wrong) is Refusal.MALFORMED
    assert isinstance(fed(listening, 1), Received)


@pytest.mark.parametrize("field", sorted(set(json.loads(payload(0))) - {"left_m"}))  # younger than old recordings
def test_every_field_is_needed(field: str) -> None:
    told = json.loads(payload(0))
    del told[field]
    assert fed(receiver(), 0, json.dumps(told).encode()) is Refusal.MALFORMED


WORDS = st.sampled_from(["", "live", "valid", "none", "ground", "ä", "0.5"])
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | WORDS,
    lambda inner: st.lists(inner, max_size=7) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=9,
)


@given(st.dictionaries(st.sampled_from(sorted(set(json.loads(payload(0))))), JSON, max_size=4))
def test_no_field_of_any_value_raises(fields: dict[str, object]) -> None:
    fed(receiver(), 0, changed(**fields))


@given(st.binary(max_size=200))
def test_no_bytes_raise(data: bytes) -> None:
    assert fed(receiver(), 0, data) is Refusal.MALFORMED

"""The CAN publisher never waits in the pipeline's thread, sends nothing old and counts what it dropped."""

import pytest

from daemon.outgoing import STALE_NS
from daemon.publish_can import REPEAT_NS, CanPublisher
from drivers.can.link import SendResult
from messages import TOPIC_OF, GroundPlane, Health, Refusal
from messages.can_frames import CanFrame, CanMessage, can_id, decode
from messages.can_setpoint import ReceivedSetpoint, SetpointReceiver
from tests.bench.can_samples import (
    attitude,
    ground,
    health,
    invalid_ground,
    propagated_ground,
    setpoint,
    stamp,
    terrain,
)

GROUND, QUALITY, HEALTH = (can_id(m) for m in (CanMessage.GROUND, CanMessage.GROUND_QUALITY, CanMessage.HEALTH))

SENT_NS = 1_041_000_000
"""A millisecond after the stamp."""


class Link:
    """Answers each frame with the next of `results`, and SENT when there is none."""

    def __init__(self, *results: SendResult) -> None:
        self.results = list(results)
        self.offered: list[CanFrame] = []
        self.closed = False

    def send(self, frame: CanFrame) -> SendResult:
        self.offered.append(frame)
        return self.results.pop(0) if self.results else SendResult.SENT

    def close(self) -> None:
        self.closed = True

    @property
    def ids(self) -> list[int]:
        return [frame.can_id for frame in self.offered]


def publisher_on(link: Link, now_ns: int = SENT_NS) -> CanPublisher:
    return CanPublisher(link, now_ns=lambda: now_ns)


def test_publishing_alone_touches_no_bus() -> None:
    link = Link()
    publisher_on(link).publish(ground(), stamp())
    assert link.offered == []


def test_an_estimate_goes_out_as_two_halves_and_health_as_one() -> None:
    link = Link()
    publisher = publisher_on(link)
    publisher.publish(ground(), stamp(seq=5))
    publisher.publish(health(), stamp())
    publisher.drain(0.0)
    assert link.ids == [GROUND, QUALITY, HEALTH]
    assert (publisher.sent, publisher.errors) == (3, 0)


def test_of_carried_grounds_that_come_together_the_newest_goes_out_and_that_is_no_error() -> None:
    link = Link()
    publisher = publisher_on(link)
    for k in range(3):
        publisher.publish(propagated_ground(height_m=0.9 + 0.01 * k), stamp(seq=k))
    publisher.drain(0.0)
    assert link.ids == [can_id(CanMessage.PROPAGATED_GROUND), can_id(CanMessage.PROPAGATED_GROUND_QUALITY)]
    assert decode(CanMessage.PROPAGATED_GROUND, link.offered[0].data).numbers["height_m"] == pytest.approx(0.92)
    assert (publisher.superseded, publisher.errors) == (2, 0)


def test_carried_grounds_are_sent_half_a_cycle_apart_and_hold_up_nothing_else() -> None:
    link, now_ns = Link(), [SENT_NS]
    publisher = CanPublisher(link, now_ns=lambda: now_ns[0])
    carried = [can_id(CanMessage.PROPAGATED_GROUND), can_id(CanMessage.PROPAGATED_GROUND_QUALITY)]
    publisher.publish(propagated_ground(), stamp(seq=0))
    publisher.drain(0.0)
    publisher.publish(propagated_ground(height_m=0.91), stamp(seq=1))
    publisher.publish(ground(), stamp(seq=1))
    publisher.drain(0.0)
    assert link.ids == [*carried, GROUND, QUALITY]
    now_ns[0] += 4_999_999
    publisher.publish(propagated_ground(height_m=0.92), stamp(seq=2))
    publisher.drain(0.0)
    assert len(link.ids) == 4
    now_ns[0] += 1
    publisher.drain(0.0)
    assert link.ids == [*carried, GROUND, QUALITY, *carried]
    assert decode(CanMessage.PROPAGATED_GROUND, link.offered[4].data).numbers["height_m"] == pytest.approx(0.92)


def test_terrain_goes_out_after_the_ground_with_the_foothold_first() -> None:
    link = Link()
    publisher = publisher_on(link)
    publisher.publish(ground(), stamp(seq=5))
    publisher.publish(terrain(), stamp(seq=5))
    publisher.drain(0.0)
    of_terrain = (CanMessage.FOOTHOLD, CanMessage.FOOTHOLD_QUALITY, CanMessage.TERRAIN, CanMessage.TERRAIN_QUALITY)
    assert link.ids == [GROUND, QUALITY, *map(can_id, of_terrain)]
    assert (publisher.sent, publisher.errors) == (6, 0)


def test_nothing_waits_so_nothing_is_sent() -> None:
    link = Link()
    publisher_on(link).drain(0.0)
    assert link.offered == []


def test_the_age_is_that_at_transmission() -> None:
    link = Link()
    sealed = stamp(t_publish_ns=1_040_000_000, age_s=0.040)
    publisher = publisher_on(link, now_ns=1_047_000_000)
    publisher.publish(ground(), sealed)
    publisher.drain(0.0)
    assert decode(CanMessage.GROUND, link.offered[0].data).numbers["age_ms"] == 47.0


def test_a_newer_estimate_replaces_one_that_still_waits() -> None:
    link = Link()
    publisher = publisher_on(link)
    for seq in range(3):
        publisher.publish(ground(height_m=1.0 + seq), stamp(seq=seq))
    publisher.drain(0.0)
    assert decode(CanMessage.GROUND, link.offered[0].data).numbers["height_m"] == pytest.approx(3.0)
    assert link.ids == [GROUND, QUALITY]
    assert (publisher.superseded, publisher.errors) == (2, 2)


@pytest.mark.parametrize("cause", [SendResult.QUEUE_FULL, SendResult.LINK_DOWN])
def test_a_dropped_first_half_takes_the_second_with_it_and_is_counted(cause: SendResult) -> None:
    link = Link(cause)
    publisher = publisher_on(link)
    for seq in range(2):
        publisher.publish(ground(), stamp(seq=seq))
        publisher.drain(0.0)
    assert link.ids == [GROUND, GROUND, QUALITY]
    assert publisher.failures[cause] == publisher.errors == 1
    assert publisher.sent == 2


def test_other_estimates_do_not_go_on_can() -> None:
    link = Link()
    publisher = publisher_on(link)
    publisher.publish(attitude(), stamp())
    publisher.drain(0.0)
    assert link.offered == []


def test_closing_releases_the_bus_and_sends_nothing_more() -> None:
    link = Link()
    publisher = publisher_on(link)
    publisher.publish(ground(), stamp())
    publisher.close()
    assert link.closed
    assert link.offered == []


def test_what_waited_for_a_blocked_bus_until_it_was_too_old_is_dropped_and_counted() -> None:
    link = Link()
    publisher = publisher_on(link, now_ns=1_000_000_000 + STALE_NS + 1)
    publisher.publish(ground(), stamp(t_publish_ns=1_050_000_000, age_s=0.050))
    publisher.drain(0.0)
    assert link.offered == []
    assert (publisher.late, publisher.errors) == (1, 1)


@pytest.mark.parametrize("estimate", [invalid_ground(), health()])
def test_what_has_no_number_to_grow_old_waits_for_its_deadline(estimate: GroundPlane | Health) -> None:
    deadline_ns = round(1e9 * TOPIC_OF[type(estimate)].deadline_s)
    for waited_ns, sent in ((deadline_ns, True), (deadline_ns + 1, False)):
        link = Link()
        publisher = publisher_on(link, now_ns=1_040_000_000 + waited_ns)
        publisher.publish(estimate, stamp())
        publisher.drain(0.0)
        assert bool(link.offered) is sent
        assert publisher.late == (not sent)


def test_a_set_point_goes_out_as_five_points_and_their_quality_and_on_can_fd_as_one_frame() -> None:
    link = Link()
    publisher = publisher_on(link)
    publisher.publish(setpoint(), stamp())
    publisher.drain(0.0)
    points, quality, fd = (
        can_id(m) for m in (CanMessage.SETPOINT, CanMessage.SETPOINT_QUALITY, CanMessage.SETPOINT_FD)
    )
    assert link.ids == [points] * 5 + [quality]
    publisher.fd = True
    publisher.publish(setpoint(), stamp(seq=1))
    publisher.drain(0.0)
    assert link.ids[6:] == [fd]
    assert decode(CanMessage.SETPOINT_FD, link.offered[-1].data).numbers["age_ms"] == 41.0


def test_a_set_point_whose_ground_was_seen_too_long_ago_is_not_sent() -> None:
    link = Link()
    publisher = publisher_on(link, now_ns=1_000_000_000 + STALE_NS + 1)
    publisher.publish(setpoint(), stamp())
    publisher.drain(0.0)
    assert link.offered == []
    assert (publisher.late, publisher.errors) == (1, 1)


def test_a_set_point_is_sent_twice_a_third_of_a_cycle_apart_and_tells_its_age_each_time() -> None:
    link, now_ns = Link(), [SENT_NS]
    publisher = CanPublisher(link, now_ns=lambda: now_ns[0])
    publisher.publish(setpoint(), stamp(seq=3))
    for wait_ns in (0, REPEAT_NS - 1, 1, REPEAT_NS, 10 * REPEAT_NS):
        now_ns[0] += wait_ns
        publisher.drain(0.0)
    assert len(link.offered) == 2 * 6
    first, again = (decode(CanMessage.SETPOINT, link.offered[k].data) for k in (0, 6))
    assert again.numbers["age_ms"] - first.numbers["age_ms"] == pytest.approx(1e-6 * REPEAT_NS, abs=1.0)
    assert again.numbers["frame_number"] == first.numbers["frame_number"]
    assert (publisher.sent, publisher.errors) == (12, 0)


def test_a_newer_set_point_goes_out_at_once_in_place_of_the_repetition() -> None:
    link, now_ns = Link(), [SENT_NS]
    publisher = CanPublisher(link, now_ns=lambda: now_ns[0])
    publisher.publish(setpoint(), stamp(seq=3))
    publisher.drain(0.0)
    now_ns[0] += REPEAT_NS // 2
    publisher.publish(setpoint(), stamp(seq=4))
    publisher.drain(0.0)
    now_ns[0] += REPEAT_NS // 2
    publisher.drain(0.0)
    assert len(link.offered) == 2 * 6
    assert decode(CanMessage.SETPOINT, link.offered[6].data).numbers["frame_number"] == 4.0
    assert (publisher.superseded, publisher.errors) == (0, 0)


def test_what_the_bus_did_not_take_or_what_is_too_old_by_then_is_not_sent_again() -> None:
    link, now_ns = Link(SendResult.LINK_DOWN), [SENT_NS]
    publisher = CanPublisher(link, now_ns=lambda: now_ns[0])
    publisher.publish(setpoint(), stamp(seq=3))
    publisher.drain(0.0)
    now_ns[0] += REPEAT_NS
    publisher.drain(0.0)
    assert len(link.offered) == 1

    now_ns[0] = 1_000_000_000 + STALE_NS  # from the exposure on
    publisher.publish(setpoint(), stamp(seq=4, t_publish_ns=now_ns[0], age_s=1e-9 * STALE_NS))
    publisher.drain(0.0)
    now_ns[0] += REPEAT_NS
    publisher.drain(0.0)
    assert len(link.offered) == 1 + 6
    assert (publisher.late, publisher.errors) == (0, 1)


def test_whichever_frame_is_lost_the_receiver_has_the_whole_set_point_at_its_repetition() -> None:
    for lost in range(6):
        link, now_ns = Link(), [SENT_NS]
        publisher, receiver = CanPublisher(link, now_ns=lambda: now_ns[0]), SetpointReceiver()  # noqa: B023
        heard = list[ReceivedSetpoint]()
        for seq in range(3):
            for again in (False, True):
                if not again:
                    t_ns = now_ns[0] - 40_000_000
                    publisher.publish(setpoint(t_exposure_ns=t_ns), stamp(seq=seq, t_publish_ns=now_ns[0], age_s=0.040))
                publisher.drain(0.0)
                for place, frame in enumerate(link.offered):
                    if (seq, again, place) != (2, False, lost):
                        found = receiver.feed(frame.can_id, frame.data, now_ns[0] + 300_000 * place)
                        heard += [found] if isinstance(found, ReceivedSetpoint) else []
                link.offered.clear()
                now_ns[0] += REPEAT_NS
        assert heard[-1].age_s == pytest.approx(0.040 + 1e-9 * REPEAT_NS, abs=0.003)


def test_pictures_at_half_the_rate_leave_a_set_point_each_though_a_silence_refuses_the_first_point() -> None:
    link, now_ns = Link(), [SENT_NS]
    publisher, receiver = CanPublisher(link, now_ns=lambda: now_ns[0]), SetpointReceiver()
    heard = list[ReceivedSetpoint]()
    for seq in range(4):
        seen_ns = now_ns[0] - 40_000_000
        publisher.publish(setpoint(t_exposure_ns=seen_ns), stamp(seq=seq, t_publish_ns=now_ns[0], age_s=0.040))
        for wait_ns in (REPEAT_NS, 100_000_000 - REPEAT_NS):
            publisher.drain(0.0)
            for place, frame in enumerate(link.offered):
                found = receiver.feed(frame.can_id, frame.data, now_ns[0] + 300_000 * place)
                heard += [found] if isinstance(found, ReceivedSetpoint) else []
            link.offered.clear()
            now_ns[0] += wait_ns
    assert len(heard) == 4
    assert all(each.age_s < 0.060 for each in heard)


@pytest.mark.parametrize("early_ns", [30_000_000, 35_000_000, 50_000_000])
def test_the_repetition_does_not_make_a_receiver_refuse_a_next_set_point_that_comes_early(early_ns: int) -> None:
    link, now_ns = Link(), [SENT_NS]
    publisher, receiver = CanPublisher(link, now_ns=lambda: now_ns[0]), SetpointReceiver()
    heard = list[ReceivedSetpoint]()
    for due_ns, seq in ((0, 0), (REPEAT_NS, None), (early_ns, 1), (early_ns + REPEAT_NS, None)):
        now_ns[0] = SENT_NS + due_ns
        if seq is not None:
            seen_ns = now_ns[0] - 40_000_000
            publisher.publish(setpoint(t_exposure_ns=seen_ns), stamp(seq=seq, t_publish_ns=now_ns[0], age_s=0.040))
        publisher.drain(0.0)
        for place, frame in enumerate(link.offered):
            found = receiver.feed(frame.can_id, frame.data, now_ns[0] + 300_000 * place)
            assert found is not Refusal.TOO_SOON
            heard += [found] if isinstance(found, ReceivedSetpoint) else []
        link.offered.clear()
    assert heard[-2].age_s < 0.045

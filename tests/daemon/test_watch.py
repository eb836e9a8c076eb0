"""What lasts is told once; what passes is not told at all."""

import logging

import pytest

from daemon.load import LoadDecision
from daemon.watch import FRAMES_BEFORE_LOGGED, IN_WORDS, SETPOINT_IN_WORDS, Outage, ReasonWatch
from drivers.protocols import DeviceError
from messages import Load, Reason
from messages.reasons import OF_SET_POINTS

SECOND_NS = 1_000_000_000


@pytest.fixture
def told(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.INFO, "gaiteyes")
    return caplog


def test_exchanged_eyes_are_told_once_and_their_end_too(told: pytest.LogCaptureFixture) -> None:
    watch = ReasonWatch()
    for reason in [Reason.EYES_SWAPPED] * 5 * FRAMES_BEFORE_LOGGED + [Reason.NONE] * 3:
        watch.add_reason(reason)
    assert told.messages == [f"no ground: {IN_WORDS[Reason.EYES_SWAPPED]}", "the ground is seen again"]


def test_what_passes_within_a_second_is_not_told(told: pytest.LogCaptureFixture) -> None:
    watch = ReasonWatch()
    for _ in range(10):
        for reason in [Reason.NOT_PLANAR] * (FRAMES_BEFORE_LOGGED - 1) + [Reason.NONE]:
            watch.add_reason(reason)
    assert told.messages == []


def test_every_reason_that_can_last_has_words() -> None:
    assert set(IN_WORDS) == set(Reason) - {Reason.NONE, Reason.STARTING} - OF_SET_POINTS
    assert set(SETPOINT_IN_WORDS) <= OF_SET_POINTS


def test_a_phase_that_goes_on_contradicting_is_told_with_what_to_check(told: pytest.LogCaptureFixture) -> None:
    watch = ReasonWatch("set-point", SETPOINT_IN_WORDS, "there are set-points again")
    for reason in [Reason.NO_NEXT_STEP] * 50 + [Reason.PHASE_CONTRADICTS] * 50 + [Reason.NONE]:
        watch.add_reason(reason)
    words = SETPOINT_IN_WORDS[Reason.PHASE_CONTRADICTS]
    assert told.messages == [f"no set-point: {words}", "there are set-points again"]


def test_load_is_reduced_after_two_superseded_frames_and_relaxes_after_calm() -> None:
    load = LoadDecision(-SECOND_NS)
    changes = [load.decide(superseded, 0, k * SECOND_NS) for k, superseded in enumerate([0, 1, 3, 3, 3, 3, 3, 3, 3, 3])]
    assert changes == [None, None, Load.REDUCED, None, None, None, None, None, Load.NORMAL, None]


def test_load_is_reduced_where_the_pipeline_leaves_too_little_and_stays_so_while_that_would_be_again() -> None:
    busy = [0.5, 0.7, 0.45, 0.45, 0.45, 0.45, 0.45, 0.45, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.5]
    load, busy_ns, changes = LoadDecision(-SECOND_NS), 0, list[Load | None]()
    for k, share in enumerate(busy):
        busy_ns += round(share * SECOND_NS)
        changes.append(load.decide(0, busy_ns, k * SECOND_NS))
    assert {k: change for k, change in enumerate(changes) if change} == {1: Load.REDUCED, 13: Load.NORMAL}


def test_an_outage_is_told_once_and_its_end_with_length_and_attempts(told: pytest.LogCaptureFixture) -> None:
    now_s = 100.0
    outage = Outage("camera", clock=lambda: now_s)
    for _ in range(4):
        outage.add_failure(DeviceError("/dev/video0: unplugged"))
        now_s += 0.5
    assert outage.problem == "camera lost: /dev/video0: unplugged"
    outage.add_success()
    outage.add_success()
    assert outage.problem == ""
    assert told.messages == [
        "camera lost: /dev/video0: unplugged",
        "camera is back: outage_s=2.00 attempts=4",
    ]


def test_a_device_that_comes_and_goes_does_not_flood_the_log(told: pytest.LogCaptureFixture) -> None:
    now_s = 0.0
    outage = Outage("IMU", clock=lambda: now_s)
    for _ in range(1280):
        outage.add_failure(DeviceError("NAK"))
        now_s += 1 / 128
        outage.add_success()
        now_s += 1 / 128
    assert told.messages[:2] == ["IMU lost: NAK", "IMU is back: outage_s=0.01 attempts=1"]
    assert len(told.messages) == 4, "twice in 20 s"
    assert told.messages[2] == "IMU lost: NAK outages_not_logged=639"

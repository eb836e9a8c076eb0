"""What lasts is told once; what passes is not told at all."""

import logging

import pytest

from daemon.watch import FRAMES_BEFORE_TOLD, IN_WORDS, GroundWatch, LoadDecision
from messages import Load, Reason

SECOND_NS = 1_000_000_000


@pytest.fixture
def told(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.INFO, "gaiteyes")
    return caplog


def test_exchanged_eyes_are_told_once_and_their_end_too(told: pytest.LogCaptureFixture) -> None:
    watch = GroundWatch()
    for reason in [Reason.EYES_SWAPPED] * 5 * FRAMES_BEFORE_TOLD + [Reason.NONE] * 3:
        watch.saw(reason)
    assert told.messages == [f"no ground: {IN_WORDS[Reason.EYES_SWAPPED]}", "the ground is seen again"]


def test_what_passes_within_a_second_is_not_told(told: pytest.LogCaptureFixture) -> None:
    watch = GroundWatch()
    for _ in range(10):
        for reason in [Reason.NOT_PLANAR] * (FRAMES_BEFORE_TOLD - 1) + [Reason.NONE]:
            watch.saw(reason)
    assert told.messages == []


def test_every_reason_that_can_last_has_words() -> None:
    assert set(IN_WORDS) == set(Reason) - {Reason.NONE, Reason.STARTING}


def test_load_is_reduced_after_two_superseded_frames_and_relaxes_after_calm() -> None:
    load = LoadDecision()
    changes = [load.decide(superseded, k * SECOND_NS) for k, superseded in enumerate([0, 1, 3, 3, 3, 3, 3, 3, 3, 3])]
    assert changes == [None, None, Load.REDUCED, None, None, None, None, None, Load.NORMAL, None]

"""Camera beside IMU: what the innovations say, a contradiction within a few steps, no false one, soon forgiven."""

import math
from dataclasses import replace

import numpy as np
import pytest

from messages import Reason
from perception.attitude.agreement import Advice, Agreement, Innovation
from perception.motion.ego_motion import EgoMotion
from tests.bench.seen_motion import WALKING_NS, SampleAt
from tests.bench.told_track import Alter, follow

S = 1_000_000_000
STEP_S = 0.05
NONE = np.zeros(3)
ACCEL, GYRO = range(3), range(3, 6)


def said(
    agreement: Agreement,
    steps: int,
    missing_rad: np.ndarray,
    turn: float = 1.0,
    travel: float = 1.0,
    seen_rad: float = 0.025,
) -> bool:
    """Add equal steps, in which the camera turns by so much; return whether they contradict in the end."""
    seen = np.array([seen_rad, 0.0, 0.0])
    for _ in range(steps):
        agreement.add(Innovation(STEP_S, seen, missing_rad, turn, travel))
    return agreement.contradicted


def test_turns_that_are_missing_contradict_before_they_have_spoilt_three_degrees() -> None:
    agreement, missing = Agreement(), np.array([0.0, 0.006, 0.0])
    steps = next(k for k in range(1, 40) if said(agreement, 1, missing))
    assert steps * 0.006 < math.radians(3.0)


def test_turns_missing_to_and_fro_are_noise() -> None:
    agreement, missing = Agreement(), np.array([0.0, 0.006, 0.0])
    assert not any(said(agreement, 1, missing * (-1) ** k) for k in range(100))


@pytest.mark.parametrize(("turn", "travel"), [(40.0, 1.0), (1.0, 40.0)])
def test_squares_that_stay_large_contradict_and_one_large_one_does_not(turn: float, travel: float) -> None:
    agreement = Agreement()
    assert not said(agreement, 1, NONE, turn, travel)
    assert not said(agreement, 10, NONE)
    assert said(agreement, 4, NONE, turn, travel)


def test_what_contradicted_agrees_again_after_half_a_second_in_one_piece() -> None:
    agreement = Agreement()
    assert said(agreement, 4, NONE, turn=40.0)
    for _ in range(4):
        assert said(agreement, 9, NONE)
        agreement.interrupt()
    agreement = Agreement()
    said(agreement, 4, NONE, turn=40.0)
    advice = [agreement.add(Innovation(STEP_S, NONE, NONE, 1.0, 1.0)) for _ in range(40)]
    assert 8 <= advice.index(Advice.DISCARD) <= 35
    assert Advice.DISCARD not in advice[35:]
    assert not agreement.contradicted


@pytest.mark.parametrize("squares", [(40.0, 1.0), (1.0, 40.0)], ids=["turn", "travel"])
def test_pictures_that_stood_still_agree_only_once_they_have_moved(squares: tuple[float, float]) -> None:
    agreement, noise_rad, sway_rad = Agreement(), 0.0003, 0.002
    assert said(agreement, 40, NONE, *squares, seen_rad=noise_rad)
    assert said(agreement, 100, NONE, seen_rad=noise_rad)  # the wearer stands
    said(agreement, 1, NONE, seen_rad=sway_rad)
    assert not said(agreement, 12, NONE, seen_rad=noise_rad)


def test_pictures_that_moved_agree_while_the_wearer_stands() -> None:
    agreement = Agreement()
    assert said(agreement, 40, NONE, turn=40.0)
    assert not said(agreement, 40, NONE, seen_rad=0.0)


def test_a_travel_that_contradicts_is_tried_afresh_with_the_turns() -> None:
    agreement = Agreement()
    advice = [agreement.add(Innovation(STEP_S, NONE, NONE, 1.0, 40.0)) for _ in range(100)]
    assert set(advice) == {Advice.KEEP, Advice.DISCARD_ALL_BUT_TURNS}
    assert agreement.contradicted


@pytest.mark.parametrize(("squares", "agrees"), [((1.0, 40.0), False), ((40.0, 1.0), True)], ids=["travel", "turn"])
def test_turns_alone_settle_what_the_turn_contradicted_and_not_the_travel(
    squares: tuple[float, float], agrees: bool
) -> None:
    agreement, seen = Agreement(), np.array([0.025, 0.0, 0.0])
    assert said(agreement, 10, NONE, *squares)
    for _ in range(100):
        agreement.add(Innovation(STEP_S, seen, NONE, 1.0, None))
    assert agreement.contradicted is not agrees
    assert not said(agreement, 40, NONE)


def flip(axis: int, from_ns: int, to_ns: int) -> Alter:
    def alter(arrival: SampleAt | EgoMotion) -> SampleAt | EgoMotion:
        if isinstance(arrival, EgoMotion) or not from_ns <= arrival.t_ns < to_ns:
            return arrival
        x, y, z = arrival.sf_B_mps2
        p, q, r = arrival.w_B_radps
        signs = [-1.0 if k == axis else 1.0 for k in range(6)]
        return replace(
            arrival,
            sf_B_mps2=(signs[0] * x, signs[1] * y, signs[2] * z),
            w_B_radps=(signs[3] * p, signs[4] * q, signs[5] * r),
        )

    return alter


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_a_walk_raises_no_alarm(seed: int) -> None:
    followed = follow(WALKING_NS + 5 * S, seed=seed)
    assert {step.reason for step in followed} == {Reason.NONE}
    assert not any(step.ground_moves for step in followed)


@pytest.mark.parametrize("axis", [*ACCEL, *GYRO])
def test_a_changed_sign_is_seen_and_forgiven_in_two_seconds(axis: int) -> None:
    end_ns = WALKING_NS + 3 * S
    followed = follow(end_ns + 3 * S, flip(axis, WALKING_NS, end_ns))
    flagged = [step.t_ns for step in followed if step.reason is not Reason.NONE]
    across_the_walk = axis == ACCEL[1]  # passes for a ground that moves, until it has gone to and fro
    assert WALKING_NS < flagged[0] < WALKING_NS + S * (3 if across_the_walk else 1)
    assert flagged[-1] < end_ns + 2 * S + S * across_the_walk
    unflagged = [step.tilt_deg for step in followed if step.reason is Reason.NONE and step.t_ns < end_ns]
    assert sum(tilt_deg > 3.0 for tilt_deg in unflagged) <= 2  # told a frame late


@pytest.mark.parametrize("axis", [*ACCEL, *GYRO])
def test_a_sign_wrong_from_the_start_is_seen_once_the_wearer_walks(axis: int) -> None:
    followed = follow(WALKING_NS + 3 * S, flip(axis, 0, 10**18))
    assert any(step.reason is not Reason.NONE for step in followed)
    last = followed[-10:]
    assert all(step.reason is not Reason.NONE or not step.tilt_deg > 1.0 for step in last)


def test_lost_samples_are_no_contradiction() -> None:
    gone = range(WALKING_NS + S, WALKING_NS + S + S // 10)
    followed = follow(WALKING_NS + 4 * S, lost=gone)
    assert {step.reason for step in followed} == {Reason.NONE}


def test_what_moved_while_no_picture_came_is_kept() -> None:
    gone = range(WALKING_NS + S, WALKING_NS + 4 * S)
    followed = follow(WALKING_NS + 6 * S, blind=gone)
    assert {step.reason for step in followed} == {Reason.NONE}
    assert max(step.tilt_deg for step in followed if step.t_ns > WALKING_NS) < 1.5

"""Steps of eyes whose distances are wrong: the turn alone judges the gyroscope, and nothing is corrected."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from messages import Reason, Vec3, vec3
from perception.attitude.camera_step import CameraStep
from perception.attitude.track import AttitudeTrack
from tests.bench.seen_motion import WALKING_NS, SampleAt, arrivals_until
from tests.bench.told_track import CALIBRATION, camera_step, measured

WRONG_NS, END_NS = WALKING_NS + 2_000_000_000, WALKING_NS + 3_500_000_000
RIGHT = (1.0, 1.0, 1.0)
FIFTEEN_DPS = 0.26
"""Twice the offset of an ordinary chip, in rad/s: so much is off where the sign turns over while the wearer stands."""
COVERED_STEPS = 14
"""A little longer than all is believed without an accepted step."""


def walked(
    track: AttitudeTrack,
    seed: int,
    signs: Vec3 = RIGHT,
    off_radps: Vec3 = (0.0, 0.0, 0.0),
    force_signs: Vec3 = RIGHT,
) -> Iterator[CameraStep]:
    """Let `track` walk, and yield the steps from WRONG_NS on; from then on rates and forces have other signs, and rates
    are off."""
    for seq, each in enumerate(arrivals_until(END_NS, seed)):
        if isinstance(each, SampleAt):
            wrong = replace(
                each,
                sf_B_mps2=vec3(np.multiply(each.sf_B_mps2, force_signs)),
                w_B_radps=vec3(np.add(np.multiply(each.w_B_radps, signs), off_radps)),
            )
            track.add_sample(measured(wrong if each.t_ns >= WRONG_NS else each, seq))
        elif each.t_after_ns < WRONG_NS:
            track.add_camera_step(camera_step(each))
        else:
            yield camera_step(each)


def times_contradicted(
    seed: int, distances: float, signs: Vec3 = RIGHT, off_radps: Vec3 = (0.0, 0.0, 0.0)
) -> list[int]:
    """Return after which steps the gyroscope was contradicted, where distances are by a factor too long."""
    track, contradicted = AttitudeTrack(CALIBRATION), []
    for number, step in enumerate(walked(track, seed, signs, off_radps)):
        track.check_turn(replace(step, travel_B=vec3(distances * np.array(step.travel_B))))
        if track.contradiction is Reason.IMU_INCONSISTENT:
            contradicted.append(number)
    return contradicted


@pytest.mark.parametrize("signs", [(-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0)])
@pytest.mark.parametrize(("seed", "distances"), [(5, 1.3), (8, 0.5)])
def test_a_gyroscope_with_a_wrong_sign_is_contradicted(seed: int, distances: float, signs: Vec3) -> None:
    assert min(times_contradicted(seed, distances, signs)) < 8


@pytest.mark.parametrize("off_radps", [(FIFTEEN_DPS, 0.0, 0.0), (0.0, -FIFTEEN_DPS, 0.0), (0.0, 0.0, FIFTEEN_DPS)])
def test_small_turns_that_are_missing_in_every_step_contradict_together(off_radps: Vec3) -> None:
    assert min(times_contradicted(5, 1.3, off_radps=off_radps)) < 8


def test_what_wrong_distances_may_make_of_a_turn_does_not_contradict() -> None:
    assert times_contradicted(5, 1.3, off_radps=(0.03, -0.03, 0.0)) == []


@pytest.mark.parametrize("off_radps", [(FIFTEEN_DPS, 0.0, 0.0), (0.0, 0.0, -FIFTEEN_DPS)])
def test_the_first_steps_after_a_covered_camera_contradict_before_they_are_believed(off_radps: Vec3) -> None:
    track, contradicted = AttitudeTrack(CALIBRATION), []
    for number, step in enumerate(walked(track, 5, off_radps=off_radps)):
        if number >= COVERED_STEPS:
            track.add_camera_step(step)
            contradicted.append(track.contradiction is Reason.IMU_INCONSISTENT)
    assert any(contradicted[:8])


@pytest.mark.parametrize(("seed", "distances"), [(5, 1.3), (8, 0.5), (6, 0.9)])
def test_a_sound_gyroscope_is_not(seed: int, distances: float) -> None:
    assert times_contradicted(seed, distances) == []


def test_nothing_is_corrected() -> None:
    judging, unseeing = AttitudeTrack(CALIBRATION), AttitudeTrack(CALIBRATION)
    for step in walked(judging, 5):
        judging.check_turn(step)
    for _ in walked(unseeing, 5):
        pass
    vertical = judging.newest.R_WB[2] @ unseeing.newest.R_WB[2]
    assert np.degrees(np.arccos(min(1.0, vertical))) < 0.02


@pytest.mark.parametrize("force_signs", [(-1.0, 1.0, 1.0), (1.0, 1.0, -1.0)], ids=["x", "z"])
def test_an_accelerometer_that_has_contradicted_does_not_agree_by_turns_alone(force_signs: Vec3) -> None:
    track, contradicted = AttitudeTrack(CALIBRATION), list[bool]()
    for step in walked(track, 5, force_signs=force_signs):
        if any(contradicted):
            track.check_turn(step)
        else:
            track.add_camera_step(step)
        contradicted.append(track.contradiction is Reason.IMU_INCONSISTENT)
    since = contradicted.index(True)
    assert len(contradicted) > since + 15
    assert all(contradicted[since:])

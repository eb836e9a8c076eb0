"""A gyroscope or an accelerometer that becomes wrong in mid-walk: the tilt is stated as wide as it is wrong."""

import math

import numpy as np
import pytest

from lab.faults.criteria import errors_of, is_wrong_attitude, tilt_error_rad
from messages import Attitude, Status
from sim_rig.wearer import SimulatedWearer
from tests.daemon.struck_walks import told_since


def beyond_three_deviations(attitude: Attitude, wearer: SimulatedWearer) -> bool:
    R_WB = wearer.gait.at(np.array([attitude.t_sample_ns], dtype=np.int64)).R_WB[0]
    variance = max(attitude.rotation_cov_W_rad2[0], attitude.rotation_cov_W_rad2[3])
    return tilt_error_rad(attitude, R_WB) > 3.0 * math.sqrt(variance)


@pytest.mark.long
@pytest.mark.parametrize(("name", "seed"), [("accel-step-0.03", 1), ("accel-step-0.03", 10), ("gyro-step-5", 8)])
def test_what_a_jump_has_done_to_the_tilt_is_stated(name: str, seed: int) -> None:
    grounds, attitudes, wearer = told_since(name, seed, 10.0)
    valid = [each for each in attitudes if each.status is Status.VALID]
    assert len(valid) > 300
    assert sum(beyond_three_deviations(each, wearer) for each in valid) < 0.1 * len(valid)
    told = [each for each in grounds if each.status is Status.VALID]
    assert sum(errors_of(ground, wearer.truth_of(ground)).wrong for ground in told) == 0


@pytest.mark.long
@pytest.mark.parametrize(("name", "seed"), [("slipped-columns+gyro-flipped", 4), ("drop-2+gyro-flipped", 3)])
def test_eyes_whose_distances_are_wrong_still_contradict_a_gyroscope(name: str, seed: int) -> None:
    """Of their steps the turn alone counts; without it the attitude stays valid for 1.5 s."""
    _, attitudes, _ = told_since(name, seed, 6.5)
    valid_ns = [each.t_sample_ns for each in attitudes if each.status is Status.VALID]
    assert max(valid_ns) - attitudes[0].t_sample_ns < 300_000_000


@pytest.mark.long
@pytest.mark.parametrize(("name", "seed"), [("accel-flipped", 102), ("accel-flipped", 103), ("stamps-off-50", 102)])
def test_what_contradicted_leads_no_attitude_astray_once_pictures_are_known_to_be_wrong(name: str, seed: int) -> None:
    """Their distances seem wrong beside an accelerometer whose axis turned over; their stamps are, for 50 ms."""
    _, attitudes, wearer = told_since(name, seed, 10.0)
    valid = [each for each in attitudes if each.status is Status.VALID]
    R_WB = wearer.gait.at(np.array([each.t_sample_ns for each in valid], dtype=np.int64)).R_WB
    assert sum(is_wrong_attitude(each, R) for each, R in zip(valid, R_WB, strict=True)) == 0

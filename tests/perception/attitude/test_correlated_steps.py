"""Steps whose turns are all off to one side, and say that they share it: no gyroscope is accused for it."""

from dataclasses import replace

import numpy as np
import pytest

from messages import Reason, vec3
from messages.arrays import FloatArray
from perception.attitude.camera_step import CameraStep
from perception.attitude.track import AttitudeTrack
from tests.bench.told_track import CALIBRATION
from tests.perception.attitude.test_turn_alone import walked

OFF_RADPS, FAR_OFF_RADPS = np.array((0.0, 0.06, 0.0)), np.array((0.0, 0.12, 0.0))


def off_to_one_side(step: CameraStep, off_radps: FloatArray, stated_radps: float) -> CameraStep:
    common_rad = stated_radps * step.duration_s
    turn = np.diag((1.0, 1.0, 1.0, 0.0, 0.0, 0.0)) * common_rad**2
    turned = np.array(step.turn_B) + off_radps * step.duration_s
    return replace(step, turn_B=vec3(turned), covariance=step.covariance + turn, common_rad=common_rad)


def accused(seed: int, off_radps: FloatArray, stated_radps: float) -> bool:
    track = AttitudeTrack(CALIBRATION)
    found = False
    for step in walked(track, seed):
        track.add_camera_step(off_to_one_side(step, off_radps, stated_radps))
        found = found or track.contradiction is Reason.IMU_INCONSISTENT
    return found


@pytest.mark.parametrize("seed", [5, 6, 8])
def test_turns_that_say_what_error_they_share_accuse_no_gyroscope(seed: int) -> None:
    assert not accused(seed, OFF_RADPS, 0.10)
    assert accused(seed, FAR_OFF_RADPS, 0.0)

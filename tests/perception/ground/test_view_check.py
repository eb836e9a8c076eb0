"""What a view that may be deformed does to the ground: no plane begins on it, and the covariance grows."""

import msgspec
import numpy as np
import pytest

from lab.faults import deformed_view, image_changes
from lab.faults.faulty_camera import ImageChange
from messages import Calibration, GroundPlane, GroundTruth, Reason, Status, StereoFrame, vec3
from messages.arrays import FloatArray
from perception.ground.estimator import GroundEstimator
from perception.ground.foothold import FootholdSettings
from sim_rig.unit import HEIGHT_PX, RESIDUAL, WIDTH_PX
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

Seen = list[tuple[StereoFrame, GroundTruth]]

WEARER = SimulatedWearer(3, scenario("standing"), 10_000_000_000, perfect_calibration=True)
BRICKS = SimulatedWearer(61, scenario("mixed"), 10_000_000_000, perfect_calibration=True)
"""Stands on bricks laid lengthwise from 10.2 s on."""
ATTITUDE_COV = np.radians(0.1) ** 2 * np.eye(3)
"""Of a filter that has settled, beside the residual: what a view may widen is judged beside what is stated in use."""


@pytest.fixture(scope="module")
def frames() -> Seen:
    return list(WEARER.frames(14))


def calibration_of(wearer: SimulatedWearer) -> Calibration:
    return msgspec.structs.replace(wearer.calibration, residual=RESIDUAL)


def told(
    frames: Seen, change: ImageChange, onset: int, *, asked: bool = True, wearer: SimulatedWearer = WEARER
) -> list[GroundPlane]:
    """Return the grounds of frames whose pictures are changed from `onset` on; the view is `asked` about, or not."""
    estimator = GroundEstimator(calibration_of(wearer), FootholdSettings())
    grounds = []
    for k, (frame, _) in enumerate(frames):
        motion = wearer.gait.at(np.array([frame.header.t_exposure_ns]))
        if k >= onset:
            left, right = change((frame.left, frame.right))
            frame = msgspec.structs.replace(frame, left=left, right=right)
        v_W_mps = vec3(motion.v_WB_mps[0]) if asked else None
        rate = vec3(motion.w_WB_B_radps[0])
        grounds.append(estimator.estimate(frame, motion.R_WB[0], rate, ATTITUDE_COV, v_W_mps=v_W_mps))
    return grounds


def rising(u_px: float, v_px: float) -> ImageChange:
    """The right eye's picture moved, beside the foothold, by `u_px` along the rows and by `v_px` up or down."""
    x: FloatArray = np.tile((np.arange(float(WIDTH_PX)) - 640.0) / 180.0, (HEIGHT_PX, 1))
    return deformed_view.warped(deformed_view.Warp(u_px * x, v_px * x), left=False)


def test_a_plane_that_comes_with_a_shifted_view_is_never_begun(frames: Seen) -> None:
    change = rising(4.0, 0.14)
    unasked = told(frames, change, onset=7, asked=False)
    assert [ground.status is Status.VALID for ground in unasked[7:10]] == [False, True, True]
    slope_deg = np.degrees(unasked[9].slope_frontal_rad - frames[9][1].slope_frontal_rad)
    assert abs(slope_deg) > 5.0
    asked = told(frames, change, onset=7)
    assert all(ground.status is Status.VALID for ground in asked[1:7])
    assert not any(ground.status is Status.VALID for ground in asked[7:])
    assert asked[-1].reason is Reason.VIEW_DEFORMED


def test_joints_that_match_across_another_row_begin_no_plane() -> None:
    frames, turned = list(BRICKS.frames(10, first=205)), image_changes.turned(0.0, 15.0)
    unasked = told(frames, turned, onset=4, asked=False, wearer=BRICKS)
    assert all(ground.status is Status.VALID for ground in unasked[5:])
    assert abs(np.degrees(unasked[-1].slope_frontal_rad - frames[-1][1].slope_frontal_rad)) > 10.0
    asked = told(frames, turned, onset=4, wearer=BRICKS)
    assert [ground.status is Status.VALID for ground in asked] == [False, True, True, True] + 6 * [False]


def test_a_small_shift_widens_the_slopes_and_a_sound_view_hardly(frames: Seen) -> None:
    def deviations(change: ImageChange, *, asked: bool) -> FloatArray:
        ground = told(frames, change, onset=0, asked=asked)[-1]
        assert ground.status is Status.VALID
        stated: FloatArray = np.sqrt(np.array([ground.covariance[i] for i in (0, 3, 5)]))
        return stated

    sound, small = rising(0.0, 0.0), rising(0.0, 0.06)
    assert np.all(deviations(sound, asked=True) < 1.15 * deviations(sound, asked=False))
    wider = deviations(small, asked=True) ** 2 - deviations(small, asked=False) ** 2
    assert np.degrees(np.sqrt(wider[1])) > 0.08  # 0.06 px along the rows would be 0.16° across

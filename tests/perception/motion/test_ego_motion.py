"""The camera's motion from rendered pictures: against the truth, and none where the pictures tell none."""

from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from messages import Reason, StereoFrame
from perception.motion.ego_motion import EgoMotion, VisualOdometer
from perception.motion.watch import Judgement, MotionWatch
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
WALKING = 90
"""A frame in the middle of a walk."""


@pytest.fixture(scope="module")
def wearer() -> SimulatedWearer:
    return SimulatedWearer(21, scenario("mixed"), START_NS, perfect_calibration=True)


@pytest.fixture(scope="module")
def frames(wearer: SimulatedWearer) -> list[StereoFrame]:
    return [frame for frame, _ in wearer.frames(12, first=WALKING)]


def motions(wearer: SimulatedWearer, frames: Sequence[StereoFrame]) -> list[EgoMotion | None]:
    odometer = VisualOdometer(wearer.calibration.stereo)
    return [odometer.add_frame(frame.header.t_exposure_ns, frame.left, frame.right) for frame in frames]


def test_rates_and_velocities_of_a_walk(wearer: SimulatedWearer, frames: list[StereoFrame]) -> None:
    odometer = VisualOdometer(wearer.calibration.stereo)
    R_BC = np.array(wearer.calibration.X_BL.R) @ odometer.R_LC
    told = motions(wearer, frames)
    assert told[:3] == [None, None, None]
    errors = []
    for motion in told[3:]:
        assert motion is not None
        assert motion.tracks >= VisualOdometer.least_tracks
        truth = wearer.gait.at(np.linspace(motion.t_before_ns, motion.t_after_ns, 21).astype(np.int64))
        centre_m = truth.p_WB_m + truth.R_WB @ np.array(wearer.calibration.X_BL.p_m)
        true_w_B = np.trapezoid(truth.w_WB_B_radps, axis=0) / 20
        true_v_B = truth.R_WB[0].T @ (centre_m[-1] - centre_m[0]) / (1e-9 * (motion.t_after_ns - motion.t_before_ns))
        errors.append(np.concatenate((motion.w_C_radps - R_BC.T @ true_w_B, motion.v_C_mps - R_BC.T @ true_v_B)))
    rms = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    assert rms[:3].max() < 0.05
    assert rms[3:].max() < 0.06


def test_one_recording_gives_one_result(wearer: SimulatedWearer, frames: list[StereoFrame]) -> None:
    first, second = (motions(wearer, frames[:6])[-1] for _ in range(2))
    assert first is not None
    assert second is not None
    assert first.w_C_radps.tobytes() == second.w_C_radps.tobytes()
    assert first.covariance.tobytes() == second.covariance.tobytes()


def test_a_gap_begins_anew(wearer: SimulatedWearer, frames: list[StereoFrame]) -> None:
    told = motions(wearer, [*frames[:5], *frames[8:]])
    assert told[4] is not None
    assert told[5:8] == [None, None, None]


def test_pictures_without_texture_or_with_exchanged_eyes_tell_nothing(
    wearer: SimulatedWearer, frames: list[StereoFrame]
) -> None:
    grey = np.full_like(frames[0].left, 90)
    assert set(motions(wearer, [msgspec.structs.replace(frame, left=grey) for frame in frames[:5]])) == {None}
    swapped = [msgspec.structs.replace(frame, left=frame.right, right=frame.left) for frame in frames[:5]]
    assert set(motions(wearer, swapped)) == {None}


def test_a_watch_takes_no_notice_of_frames_of_another_size(wearer: SimulatedWearer, frames: list[StereoFrame]) -> None:
    watch = MotionWatch(wearer.calibration)
    small = msgspec.structs.replace(frames[0], left=frames[0].left[::2, ::2], right=frames[0].right[::2, ::2])
    assert watch.add_frame(small) == Judgement(Reason.NONE, discard=False)
    assert watch.contradictions == ()


@pytest.mark.parametrize("lower_px", [-4, 4])
def test_an_eye_that_has_slipped_is_named_at_once_and_forgiven_after_three_pairs(
    wearer: SimulatedWearer, frames: list[StereoFrame], lower_px: int
) -> None:
    watch, reasons = MotionWatch(wearer.calibration), []
    for k, frame in enumerate(frames):
        slipped = 3 <= k < 8
        lowered = msgspec.structs.replace(frame, right=np.roll(frame.right, lower_px, axis=0))
        watch.add_frame(lowered if slipped else frame)
        reasons.append(watch.finish_frame().reason)
    misaligned = [reason is Reason.EYES_MISALIGNED for reason in reasons]
    assert misaligned == [False] * 3 + [True] * 7 + [False] * 2

"""The camera's motion from rendered pictures: against the truth, without a right IMU, and none where there is none."""

from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from lab.faults.deformed_view import turned_eye
from messages import Reason, StereoFrame, vec3
from messages.arrays import FloatArray, column_rms
from messages.constants import STANDARD_GRAVITY_MPS2
from perception import so3
from perception.attitude.foretold import MotionForetold
from perception.motion.ego_motion import EgoMotion, VisualOdometer
from perception.motion.inner_motion import RecentSamples
from perception.motion.watch import MotionWatch
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


def motions(wearer: SimulatedWearer, frames: Sequence[StereoFrame], gyro: float = 1.0) -> list[EgoMotion | None]:
    """Return what the odometer makes of `frames`, with a perfect IMU whose rates are multiplied by `gyro`."""
    odometer = VisualOdometer(wearer.calibration.stereo)
    R_BC = np.array(wearer.calibration.X_BL.R) @ odometer.R_LC
    samples = RecentSamples(R_BC, wearer.calibration.X_BL.p_m)
    told: list[EgoMotion | None] = []
    next_ns = frames[0].header.t_exposure_ns - 50_000_000
    for frame in frames:
        t_ns = frame.header.t_exposure_ns
        times_ns = np.arange(next_ns, t_ns + 10_000_000, 10_000_000)
        for time_ns, sf_B, w_B in zip(times_ns, *wearer.gait.imu(times_ns), strict=True):
            samples.add(int(time_ns), vec3(sf_B), vec3(gyro * w_B))
        next_ns = int(times_ns[-1]) + 10_000_000
        inner = None
        if odometer.t_before_ns is not None:
            expected = foretold(wearer, int(times_ns[-1]))
            inner = samples.inner_motion(odometer.t_before_ns, t_ns, 8_000_000, expected, np.zeros(3))
        told.append(odometer.add_frame(t_ns, frame.left, frame.right, inner))
    return told


def foretold(wearer: SimulatedWearer, t_ns: int) -> MotionForetold:
    """Return the truth at `t_ns`, off by 0.1 m/s and 0.3 °/s."""
    truth = wearer.gait.at(np.array([t_ns]))
    R_BW = truth.R_WB[0].T
    return MotionForetold(
        t_ns=t_ns,
        w_at_rest_radps=(0.005, -0.005, 0.005),
        sf_at_rest_mps2=vec3(STANDARD_GRAVITY_MPS2 * R_BW[:, 2]),
        v_B_mps=vec3(R_BW @ truth.v_WB_mps[0] + 0.06),
        covariance=np.diag([0.005**2] * 3 + [0.06**2] * 3),
    )


def errors(wearer: SimulatedWearer, told: Sequence[EgoMotion | None]) -> FloatArray:
    """Return rates and velocities (n, 6) of those that were told, less the true ones."""
    R_BC = np.array(wearer.calibration.X_BL.R) @ VisualOdometer(wearer.calibration.stereo).R_LC
    found = []
    for motion in (motion for motion in told if motion is not None):
        truth = wearer.gait.at(np.array([motion.t_before_ns, motion.t_after_ns]))
        step_s = 1e-9 * (motion.t_after_ns - motion.t_before_ns)
        centre_m = truth.p_WB_m + truth.R_WB @ np.array(wearer.calibration.X_BL.p_m)
        R_WC = truth.R_WB @ R_BC
        w_C = so3.log(R_WC[0].T @ R_WC[1]) / step_s
        v_C = R_WC[0].T @ (centre_m[1] - centre_m[0]) / step_s
        found.append(np.concatenate((motion.w_C_radps - w_C, motion.v_C_mps - v_C)))
    return np.array(found)


def test_rates_and_velocities_of_a_walk(wearer: SimulatedWearer, frames: list[StereoFrame]) -> None:
    told = motions(wearer, frames)
    assert told[0] is None
    assert None not in told[1:]
    rms = column_rms(errors(wearer, told))
    assert rms[:3].max() < np.radians(0.6)
    assert rms[3:].max() < 0.012
    stated = [np.sqrt(np.diag(motion.covariance)) for motion in told if motion is not None]
    assert (rms < 2.5 * np.mean(stated, axis=0)).all()


def test_rates_do_not_lean_above_a_stair_down() -> None:
    wearer = SimulatedWearer(2, scenario("mixed"), START_NS, perfect_calibration=True)
    lip_in_view = [frame for frame, _ in wearer.frames(31, first=620)]
    told = motions(wearer, lip_in_view)
    assert None not in told[1:]
    assert np.abs(errors(wearer, told)[:, :3].mean(axis=0)).max() < np.radians(0.2)


def test_a_gyroscope_that_stands_still_does_not_hide_the_motion(
    wearer: SimulatedWearer, frames: list[StereoFrame]
) -> None:
    told = motions(wearer, frames, gyro=0.0)
    assert None not in told[1:]
    assert np.abs(errors(wearer, told)[:, :3]).max() < np.radians(10.0)
    assert max(np.linalg.norm(motion.w_C_radps) for motion in told if motion is not None) > np.radians(30.0)


def test_what_moves_with_the_wearer_is_not_the_ground(wearer: SimulatedWearer, frames: list[StereoFrame]) -> None:
    board = np.random.default_rng(1).integers(20, 236, (36, 128)).astype(np.uint8).repeat(10, 0).repeat(10, 1)
    other = SimulatedWearer(22, scenario("mixed"), START_NS, perfect_calibration=True)
    found = []
    for one, seen in ((wearer, frames), (other, [frame for frame, _ in other.frames(12, first=WALKING)])):
        half = [
            msgspec.structs.replace(
                frame,
                left=np.vstack((board, frame.left[360:])),
                right=np.vstack((np.roll(board, -90, axis=1), frame.right[360:])),
            )
            for frame in seen
        ]
        told = motions(one, half)
        assert None not in told[1:]
        found.append(errors(one, told))
    assert column_rms(np.vstack(found))[3:].max() < 0.05


def test_one_recording_gives_one_result(wearer: SimulatedWearer, frames: list[StereoFrame]) -> None:
    first, second = (motions(wearer, frames[:6])[-1] for _ in range(2))
    assert first is not None
    assert second is not None
    assert first.w_C_radps.tobytes() == second.w_C_radps.tobytes()
    assert first.covariance.tobytes() == second.covariance.tobytes()


def test_where_the_imu_tells_where_to_look_a_walk_is_followed_over_a_fifth_of_a_second(
    wearer: SimulatedWearer, frames: list[StereoFrame]
) -> None:
    told = motions(wearer, frames[::4])
    assert None not in told[1:]
    rms = column_rms(errors(wearer, told))
    assert rms[:3].max() < np.radians(0.6)
    assert rms[3:].max() < 0.012


def test_a_long_gap_begins_anew(wearer: SimulatedWearer, frames: list[StereoFrame]) -> None:
    told = motions(wearer, [*frames[:3], *frames[9:]])
    assert told[2] is not None
    assert told[3] is None
    assert None not in told[4:]


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
    assert watch.add_frame(small) is None
    assert watch.reason is Reason.NONE


@pytest.mark.parametrize("lower_px", [-4, 4])
def test_an_eye_that_has_slipped_is_named_at_once_and_forgiven_after_three_pairs(
    wearer: SimulatedWearer, frames: list[StereoFrame], lower_px: int
) -> None:
    watch, reasons = MotionWatch(wearer.calibration), []
    for k, frame in enumerate(frames):
        slipped = 3 <= k < 8
        lowered = msgspec.structs.replace(frame, right=np.roll(frame.right, lower_px, axis=0))
        watch.add_frame(lowered if slipped else frame)
        watch.finish_frame()
        reasons.append(watch.reason)
    misaligned = [reason is Reason.EYES_MISALIGNED for reason in reasons]
    assert misaligned == [False] * 3 + [True] * 7 + [False] * 2


@pytest.mark.parametrize("share", [-0.003, 0.003])
def test_an_eye_with_a_wrong_focal_length_is_named_within_a_second(
    wearer: SimulatedWearer, frames: list[StereoFrame], share: float
) -> None:
    lens = wearer.calibration.stereo.right
    wrong = msgspec.structs.replace(lens, fx_px=lens.fx_px * (1.0 + share), fy_px=lens.fy_px * (1.0 + share))
    stereo = msgspec.structs.replace(wearer.calibration.stereo, right=wrong)
    watch, right = (
        MotionWatch(msgspec.structs.replace(wearer.calibration, stereo=stereo)),
        MotionWatch(wearer.calibration),
    )
    for _ in range(2):
        for frame in frames[:10]:
            for each in (watch, right):
                each.add_frame(frame)
                each.finish_frame()
    assert watch.reason is Reason.EYES_MISALIGNED
    assert right.reason is Reason.NONE


@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)], ids=["toed", "rolled"])
@pytest.mark.parametrize("deg", [-1.5, -0.4, 0.4, 1.5])
def test_an_eye_that_is_turned_is_named_by_the_first_pair(
    wearer: SimulatedWearer, frames: list[StereoFrame], axis: tuple[float, float, float], deg: float
) -> None:
    turned = turned_eye(wearer.calibration.stereo, so3.exp(np.radians(deg) * np.array(axis)), left=False)
    left, right = turned((frames[0].left, frames[0].right))
    watch = MotionWatch(wearer.calibration)
    watch.add_frame(msgspec.structs.replace(frames[0], left=left, right=right))
    watch.finish_frame()
    assert watch.reason is Reason.EYES_MISALIGNED

"""Distances that all jump: synthetic corners, and rendered pictures of eyes that slip in mid-walk."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.faults import deformed_view, image_changes
from lab.faults.criteria import errors_of
from lab.faults.faulty_camera import ImageChange
from lab.faults.offline import START_NS, OfflineWalk, Strike, pictures, struck
from messages import GroundPlane, Reason, Status
from messages.arrays import Float32Array, FloatArray
from perception.motion.distance_jump import DistanceJumps
from perception.motion.stereo_points import StereoPoints
from perception.motion.watch import MotionWatch
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

SIZE_PX = np.array([320.0, 180.0])


def corners(count: int = 120) -> Float32Array:
    places_px: FloatArray = np.random.default_rng(3).uniform(0.0, 1.0, (count, 2)) * SIZE_PX
    return places_px.astype(np.float32)


def off(count: int, by_px: FloatArray | float, noise_px: float = 0.06, wrong: int = 0) -> FloatArray:
    """Return what `count` disparities differ by, the first `wrong` of them by anything."""
    chance = np.random.default_rng(4)
    off_px: FloatArray = by_px + noise_px * chance.standard_normal(count)
    off_px[:wrong] = chance.uniform(-25.0, 25.0, wrong)
    return off_px


def stretch_px(places_px: Float32Array) -> FloatArray:
    """Return a window's that moves the picture by a pixel either way, one deviation beside its middle."""
    x = places_px[:, 0].astype(np.float64)
    stretched: FloatArray = (x - x.mean()) / x.std()
    return stretched


def test_what_few_corners_differ_by_together_must_be_more_than_chance() -> None:
    by_px = -0.1 + 0.38 * stretch_px(corners(20))  # 0.48 px at most
    few, many = DistanceJumps(), DistanceJumps()
    few.add(corners(20), off(20, by_px, noise_px=0.14))
    assert not few.jumped
    by_px = -0.1 + 0.38 * stretch_px(corners(120))
    many.add(corners(120), off(120, by_px, noise_px=0.06))
    assert many.jumped


@pytest.mark.parametrize("by_px", [0.6, -0.6, 3.0])
def test_an_eye_that_turns_moves_all_distances_until_it_turns_back(by_px: float) -> None:
    jumps = DistanceJumps()
    jumps.add(corners(), off(120, by_px))
    assert jumps.contradict
    jumps.add(corners(), off(120, 0.0))
    assert jumps.contradict
    jumps.add(corners(), off(120, -by_px))
    assert not jumps.contradict


def test_a_window_that_stretches_the_picture_is_noticed_though_on_average_nothing_moves() -> None:
    jumps = DistanceJumps()
    jumps.add(corners(), off(120, stretch_px(corners())))
    assert jumps.contradict


@settings(max_examples=60, deadline=None)
@given(
    by_px=st.floats(-0.2, 0.2),
    noise_px=st.floats(0.0, 0.1),
    wrong=st.integers(0, 30),
    count=st.integers(90, 200),
)
def test_noise_and_things_that_move_by_themselves_are_no_jump(
    by_px: float, noise_px: float, wrong: int, count: int
) -> None:
    jumps = DistanceJumps()
    jumps.add(corners(count), off(count, by_px, noise_px, wrong))
    assert not jumps.contradict


def test_little_that_adds_up_is_no_jump_and_neither_is_what_few_corners_say() -> None:
    jumps = DistanceJumps()
    for _ in range(40):
        jumps.add(corners(), off(120, 0.1))
    jumps.add(corners(8), off(8, 3.0))
    assert not jumps.contradict


def test_what_a_few_of_many_corners_say_begins_nothing_and_where_few_are_usual_it_does() -> None:
    jumps = DistanceJumps()
    for _ in range(10):
        jumps.add(corners(80), off(80, 0.0))
    jumps.add(corners(20), off(20, 2.0))
    assert not jumps.contradict
    for _ in range(40):
        jumps.add(corners(25), off(25, 0.0))
    jumps.add(corners(20), off(20, 2.0))
    assert jumps.contradict


@pytest.mark.parametrize(("wrong", "jumped"), [(18, True), (36, False)])
def test_a_jump_is_one_that_four_of_five_corners_share(wrong: int, *, jumped: bool) -> None:
    jumps = DistanceJumps()
    jumps.add(corners(), off(120, 0.0))
    jumps.add(corners(), off(120, 2.0, wrong=wrong))
    assert jumps.contradict is jumped


@pytest.fixture(scope="module")
def over_ramps() -> OfflineWalk:
    return OfflineWalk(1, "ramps", 10.0)


@pytest.mark.long
@pytest.mark.parametrize(
    "change",
    [
        image_changes.right_shifted(0, -4),
        image_changes.right_shifted(0, 3),
        deformed_view.warped(deformed_view.stretched(2.0), left=False),
    ],
    ids=["outwards", "inwards", "stretched"],
)
def test_an_eye_that_slips_along_the_rows_in_mid_walk_is_flagged_at_once_and_misleads_nobody(
    over_ramps: OfflineWalk,
    change: ImageChange,
) -> None:
    """Before jumps were looked for the filter followed the wrong distances: attitude and ground off by 5°, valid."""
    walk, slip_ns, back_ns = over_ramps, START_NS + 4 * 10**9, START_NS + 7 * 10**9
    pipeline, grounds = walk.new_pipeline(), list[GroundPlane]()
    for message in struck(walk.inputs, [Strike(pictures(change), slip_ns, back_ns)]):
        grounds += [told for told in pipeline.step(message) if isinstance(told, GroundPlane)]
    slipped = [ground for ground in grounds if slip_ns <= ground.t_exposure_ns < back_ns]
    assert {ground.reason for ground in slipped} == {Reason.DISTANCES_WRONG}
    valid = [ground for ground in grounds if ground.status is Status.VALID]
    assert not any(errors_of(ground, walk.wearer.truth_of(ground)).wrong for ground in valid)
    recovered_ns = next(ground.t_exposure_ns for ground in valid if ground.t_exposure_ns > back_ns)
    assert recovered_ns < back_ns + 2_500_000_000


def test_no_step_that_rests_on_wrong_distances_is_sound() -> None:
    """Not in the frame in which the eyes slip, and not in the one in which they are back: it begins at wrong points."""
    wearer, slipped = SimulatedWearer(1, scenario("level"), START_NS), range(4, 8)
    watch, change, told = MotionWatch(wearer.calibration), image_changes.right_shifted(0, -4), list[bool]()
    for number, (frame, _) in enumerate(wearer.frames(11)):
        left, right = change((frame.left, frame.right)) if number in slipped else (frame.left, frame.right)
        step = watch.add_frame(msgspec.structs.replace(frame, left=left, right=right))
        told.append(step is not None and watch.step_is_sound)
        watch.finish_frame()
    assert told == [number not in (0, *slipped, slipped.stop) for number in range(11)]


def test_distances_are_compared_only_while_the_rows_of_the_eyes_agree() -> None:
    """Else corners that chance has matched, all as far from their rows as they may be, stand for a jump."""
    wearer = SimulatedWearer(1, scenario("level"), START_NS)
    frame, _ = next(iter(wearer.frames(1)))
    points = StereoPoints(wearer.calibration.stereo)
    left = points.detail(frame.left)
    view, _ = points.view(0, left, points.detail(frame.right))

    def compared(rows_px: int, columns_px: int) -> int:
        _, right = image_changes.right_shifted(rows_px, columns_px)((frame.left, frame.right))
        _, good = points.off_px(left, points.detail(right), view.corners_px, view.points_C[:, 2])
        return int(np.count_nonzero(good))

    assert compared(0, 0) > 40
    assert compared(0, -4) > 40
    assert compared(3, 0) == compared(-3, -4) == 0


@pytest.mark.long
@pytest.mark.parametrize(("name", "seed"), [("stairs", 11), ("trolley", 11), ("level", 12)])
def test_no_walk_of_sound_eyes_jumps(name: str, seed: int) -> None:
    walk = OfflineWalk(seed, name, 8.0)
    pipeline = walk.new_pipeline()
    told = [each for message in walk.inputs for each in pipeline.step(message)]
    assert not any(isinstance(each, GroundPlane) and each.reason is Reason.DISTANCES_WRONG for each in told)

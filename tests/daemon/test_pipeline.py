"""The pipeline: waiting for the IMU, saying silence, refusing bad samples, the same bytes for the same inputs."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import dropwhile, pairwise

import msgspec
import pytest

from daemon.pipeline import NO_FRAME_SEQ, Pipeline
from messages import (
    TOPICS,
    Attitude,
    DropCause,
    DroppedFrame,
    Estimate,
    GroundPlane,
    Health,
    ImuSample,
    Input,
    Load,
    LoadLevel,
    Motion,
    PropagatedGround,
    Reason,
    Status,
    StereoFrame,
    Terrain,
    Tick,
    capture_ns,
)
from perception.attitude.track import AttitudeTrack
from perception.frame_guard import FrameGuard
from perception.ground.foothold import FootholdSettings
from perception.motion.watch import MotionWatch
from perception.terrain.path_matching import Work
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer
from tests.daemon.told import lines, pipeline, run

START_NS = 10_000_000_000


@pytest.fixture(scope="module")
def wearer() -> SimulatedWearer:
    return SimulatedWearer(3, scenario("standing"), START_NS)


@pytest.fixture(scope="module")
def inputs(wearer: SimulatedWearer) -> list[Input]:
    return list(wearer.offline_inputs(2.4))


@pytest.fixture(scope="module")
def undisturbed(wearer: SimulatedWearer, inputs: list[Input]) -> list[Estimate]:
    """What the pipeline tells of the inputs as they are."""
    return run(pipeline(wearer), inputs)


def covered(message: Input, from_ns: int, until_ns: int = 2**62) -> Input:
    """Return a message whose pictures, in this time, show nothing."""
    if not isinstance(message, StereoFrame) or not from_ns <= message.header.t_exposure_ns < until_ns:
        return message
    # no two alike, or it would be a repeated picture
    shade = message.left * 0 + 90 + message.header.seq % 2
    return StereoFrame(header=message.header, left=shade, right=shade)


def grounds(estimates: list[Estimate]) -> list[GroundPlane]:
    return [estimate for estimate in estimates if isinstance(estimate, GroundPlane)]


def test_each_frame_and_each_sample_gets_its_estimate(inputs: list[Input], undisturbed: list[Estimate]) -> None:
    frames = [message for message in inputs if isinstance(message, StereoFrame)]
    samples = [message for message in inputs if isinstance(message, ImuSample)]
    assert [g.t_exposure_ns for g in grounds(undisturbed)] == [f.header.t_exposure_ns for f in frames]
    assert len([e for e in undisturbed if isinstance(e, Attitude)]) == len(samples)
    assert len([e for e in undisturbed if isinstance(e, Health)]) == 2


def test_each_attitude_is_followed_by_the_ground_carried_to_it(undisturbed: list[Estimate]) -> None:
    told = [e for e in undisturbed if isinstance(e, GroundPlane | Attitude | PropagatedGround)]
    last = None
    valid = 0
    for before, carried in pairwise(told):
        if isinstance(before, GroundPlane):
            last = before
        if not isinstance(carried, PropagatedGround):
            continue
        assert isinstance(before, Attitude)
        assert carried.t_sample_ns == before.t_sample_ns
        usable = last is not None and last.status is Status.VALID and before.status is Status.VALID
        assert (carried.status is Status.VALID) == usable
        if last is not None and carried.status is Status.VALID:
            valid += 1
            assert carried.picture_age_s == pytest.approx(1e-9 * (before.t_sample_ns - last.t_exposure_ns))
            assert 0.02 < carried.picture_age_s < 0.10
            assert carried.height_m == pytest.approx(last.height_m, abs=0.005)
            assert carried.slope_sagittal_rad == pytest.approx(last.slope_sagittal_rad, abs=1e-3)
    assert valid > 80


@pytest.mark.parametrize(
    ("cause", "reason"),
    [("covered", Reason.LOW_TEXTURE), ("no frames", Reason.NO_FRAME), ("no samples", Reason.NO_IMU)],
)
def test_a_ground_is_carried_for_no_longer_than_it_is_known(
    wearer: SimulatedWearer, inputs: list[Input], cause: str, reason: Reason
) -> None:
    cut_ns = START_NS + 2_000_000_000
    if cause == "covered":
        spoilt = [covered(message, cut_ns) for message in inputs]
    elif cause == "no frames":
        spoilt = [m for m in inputs if not (isinstance(m, StereoFrame) and m.header.t_arrival_ns > cut_ns)]
    else:
        spoilt = list(without_imu_after(inputs, cut_ns))
    carried = [e for e in run(pipeline(wearer), spoilt) if isinstance(e, PropagatedGround)]
    assert any(e.status is Status.VALID for e in carried)
    later = [e for e in carried if e.t_sample_ns > cut_ns + 150_000_000 or e.reason is reason]
    assert {e.status for e in later} == {Status.INVALID}
    assert later[-1].reason is reason
    assert all(e.height_m != e.height_m for e in later)


LATER_NS = 150_000_000


def test_a_picture_that_is_late_ends_what_is_carried(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    """Grounds come, but each of a picture from more than 150 ms ago: none of them is carried."""
    late: list[Input] = sorted(
        inputs, key=lambda m: m.header.t_arrival_ns + LATER_NS if isinstance(m, StereoFrame) else _arrival_ns(m)
    )
    told = run(pipeline(wearer), [m for m in late if not isinstance(m, Tick)])
    carried = [e for e in told if isinstance(e, PropagatedGround)]
    assert any(ground.status is Status.VALID for ground in grounds(told))
    assert {e.reason for e in carried if e.t_sample_ns > START_NS + 1_700_000_000} == {Reason.LATE}


def _arrival_ns(message: Input) -> int:
    return message.t_ns if isinstance(message, Tick) else message.t_arrival_ns if isinstance(message, ImuSample) else 0


def test_each_ground_is_followed_by_the_motion_of_its_frame(undisturbed: list[Estimate]) -> None:
    told = [e for e in undisturbed if isinstance(e, GroundPlane | Motion)]
    pairs = list(zip(told[::2], told[1::2], strict=True))
    assert all(isinstance(ground, GroundPlane) and isinstance(motion, Motion) for ground, motion in pairs)
    assert all(capture_ns(ground) == capture_ns(motion) for ground, motion in pairs)
    standing = [motion for _, motion in pairs if isinstance(motion, Motion) and motion.status is Status.VALID][2:]
    assert len(standing) >= 20
    for motion in standing:
        assert max(map(abs, motion.velocity_H_mps)) < 0.06
        assert 0.0 < max(motion.velocity_cov_H) < 0.03**2
        assert motion.distance_m < 0.05


def test_the_motion_is_not_told_while_nothing_can_be_followed(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    from_ns = START_NS + 1_200_000_000
    estimates = run(pipeline(wearer), [covered(message, from_ns) for message in inputs])
    motions = [e for e in estimates if isinstance(e, Motion) and e.t_exposure_ns > from_ns + 300_000_000]
    assert {motion.reason for motion in motions} == {Reason.LOW_TEXTURE}
    assert all(motion.distance_m != motion.distance_m for motion in motions)


def test_after_half_a_second_in_the_dark_neither_ground_nor_terrain_is_told_at_once(
    wearer: SimulatedWearer, inputs: list[Input]
) -> None:
    from_ns, until_ns = START_NS + 1_400_000_000, START_NS + 2_050_000_000
    estimates = run(pipeline(wearer), [covered(message, from_ns, until_ns) for message in inputs])
    for kind in (GroundPlane, Terrain):
        told = [e for e in estimates if isinstance(e, kind)]
        assert any(e.status is Status.VALID for e in told if e.t_exposure_ns < from_ns)
        after = [e for e in told if e.t_exposure_ns >= until_ns]
        assert len(after) >= 5
        assert all(e.status is not Status.VALID for e in after)


def test_estimates_come_at_the_rates_of_the_topic_table(undisturbed: list[Estimate]) -> None:
    started_ns = START_NS + 1_300_000_000
    grounds_ns = [g.t_exposure_ns for g in grounds(undisturbed) if g.t_exposure_ns > started_ns]
    attitudes_ns = [e.t_sample_ns for e in undisturbed if isinstance(e, Attitude)]
    for name, times_ns in (("ground", grounds_ns), ("attitude", attitudes_ns)):
        rate_hz = 1e9 * (len(times_ns) - 1) / (times_ns[-1] - times_ns[0])
        assert rate_hz == pytest.approx(TOPICS[name].rate_hz, rel=0.02), name  # the chip's clock is off by up to 1 %


def test_before_the_start_there_is_a_status_and_no_number(undisturbed: list[Estimate]) -> None:
    first, last = (grounds(undisturbed)[i] for i in (0, -1))
    assert (first.status, first.reason) == (Status.INITIALISING, Reason.STARTING)
    assert first.height_m != first.height_m
    assert (last.status, last.reason) == (Status.VALID, Reason.NONE)
    assert last.height_m == pytest.approx(0.95, abs=0.05)


def test_the_same_inputs_give_the_same_bytes(
    wearer: SimulatedWearer, inputs: list[Input], undisturbed: list[Estimate]
) -> None:
    assert lines(run(pipeline(wearer), inputs)) == lines(undisturbed)


def test_without_terrain_the_attitude_and_its_errors_are_the_same(
    wearer: SimulatedWearer, inputs: list[Input], undisturbed: list[Estimate]
) -> None:
    bare, whole = Pipeline(wearer.calibration, FootholdSettings(), tells_terrain=False), pipeline(wearer)
    told = run(bare, inputs)
    assert not any(isinstance(each, Terrain) for each in told)
    assert any(isinstance(each, Terrain) for each in undisturbed)
    bare_attitudes, attitudes = ([e for e in each if isinstance(e, Attitude)] for each in (told, undisturbed))
    assert lines(list(bare_attitudes)) == lines(list(attitudes))
    run(whole, inputs)
    assert bare.learnt == whole.learnt


def test_the_bytes_are_the_same_where_another_thread_matches_the_path(
    wearer: SimulatedWearer, inputs: list[Input], undisturbed: list[Estimate]
) -> None:
    pipe, done = pipeline(wearer), list[int]()
    with ThreadPoolExecutor(1) as thread:

        def beside(work: Work) -> Work:
            matching = thread.submit(work)
            matching.add_done_callback(lambda future: done.append(len(future.result())))
            return matching.result

        pipe.match_path_beside(beside)
        assert lines(run(pipe, inputs)) == lines(undisturbed)
    assert sum(done) > 20


def without_imu_after(inputs: list[Input], t_ns: int) -> Iterator[Input]:
    return (m for m in inputs if not (isinstance(m, ImuSample) and m.t_arrival_ns > t_ns))


def test_a_frame_without_later_imu_samples_waits_twenty_milliseconds_and_is_refused(
    wearer: SimulatedWearer, inputs: list[Input]
) -> None:
    pipe, cut_ns = pipeline(wearer), START_NS + 2_000_000_000
    seen: dict[int, int] = {}
    now_ns = 0
    for message in without_imu_after(inputs, cut_ns):
        if isinstance(message, Tick):
            now_ns = message.t_ns
        for ground in grounds(list(pipe.step(message))):
            if ground.t_exposure_ns > cut_ns and ground.frame_seq != NO_FRAME_SEQ:
                assert ground.reason is Reason.NO_IMU
                assert ground.slope_sagittal_rad != ground.slope_sagittal_rad
                seen[ground.t_exposure_ns] = now_ns
    arrivals = {m.header.t_exposure_ns: m.header.t_arrival_ns for m in inputs if isinstance(m, StereoFrame)}
    assert len(seen) >= 5
    for t_exposure_ns, t_ns in seen.items():
        assert 20_000_000 < t_ns - arrivals[t_exposure_ns] <= 50_000_000


def test_silence_of_the_camera_is_said_twenty_times_a_second(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    cut_ns = START_NS + 1_500_000_000
    silent = [m for m in inputs if not (isinstance(m, StereoFrame) and m.header.t_arrival_ns > cut_ns)]
    said = [g for g in grounds(run(pipeline(wearer), silent)) if g.reason is Reason.NO_FRAME]
    assert all(g.status is Status.INVALID and g.frame_seq == NO_FRAME_SEQ for g in said)
    assert 0 < said[0].t_exposure_ns - cut_ns <= 150_000_000
    gaps_ns = [b.t_exposure_ns - a.t_exposure_ns for a, b in pairwise(said)]
    assert gaps_ns
    assert set(gaps_ns) == {50_000_000}


def test_a_camera_that_never_comes_is_first_starting_and_then_silent(wearer: SimulatedWearer) -> None:
    said = grounds(run(pipeline(wearer), [Tick(t_ns=START_NS + k * 10_000_000) for k in range(700)]))
    assert {g.reason for g in said if g.t_exposure_ns < START_NS + 5_000_000_000} == {Reason.STARTING}
    assert {g.reason for g in said if g.t_exposure_ns >= START_NS + 5_000_000_000} == {Reason.NO_FRAME}


def test_a_repeated_or_broken_sample_is_refused_and_counted(
    wearer: SimulatedWearer, inputs: list[Input], undisturbed: list[Estimate]
) -> None:
    spoilt: list[Input] = []
    for message in inputs:
        spoilt.append(message)
        if isinstance(message, ImuSample) and message.seq % 20 == 0:
            spoilt.append(message)
            nan = (float("nan"), 0.0, 0.0)
            later_ns = message.t_sample_ns + 1
            spoilt.append(msgspec.structs.replace(message, sf_B_mps2=nan, t_sample_ns=later_ns))
    refused = run(pipeline(wearer), spoilt)
    assert [g.height_m for g in grounds(refused)[-5:]] == [g.height_m for g in grounds(undisturbed)[-5:]]
    health = [e for e in refused if isinstance(e, Health)][-1]
    assert health.imu_refused > 10


def test_health_counts_dropped_frames_by_cause(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    dropping = [
        DroppedFrame(header=m.header, cause=DropCause.SUPERSEDED)
        if isinstance(m, StereoFrame) and m.header.seq % 2
        else m
        for m in inputs
    ]
    health = [e for e in run(pipeline(wearer), dropping) if isinstance(e, Health)][-1]
    assert health.frames_dropped == {DropCause.SUPERSEDED: health.frames}
    assert health.frames_valid + sum(health.refused.values()) == health.frames


def test_under_reduced_load_the_ground_is_still_found(
    wearer: SimulatedWearer, inputs: list[Input], undisturbed: list[Estimate]
) -> None:
    reduced = [LoadLevel(t_ns=START_NS, load=Load.REDUCED), *inputs]
    estimates = run(pipeline(wearer), reduced)
    last = grounds(estimates)[-1]
    assert last.status is Status.VALID
    assert last.height_m == pytest.approx(grounds(undisturbed)[-1].height_m, abs=0.01)
    assert [e for e in estimates if isinstance(e, Health)][-1].load is Load.REDUCED


def test_under_reduced_load_few_frames_are_still_followed(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    few = [m for m in inputs if not isinstance(m, StereoFrame) or m.header.seq % 2]
    later = next(k for k, m in enumerate(few) if isinstance(m, StereoFrame) and m.header.seq > 16)
    reduced = [*few[:later], LoadLevel(t_ns=START_NS, load=Load.REDUCED), *few[later:]]
    motions = [e for e in run(pipeline(wearer), reduced) if isinstance(e, Motion)]
    assert {motion.status for motion in motions[-8:]} == {Status.VALID}


def test_swapped_eyes_are_named(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    swapped = [
        StereoFrame(header=m.header, left=m.right, right=m.left) if isinstance(m, StereoFrame) else m for m in inputs
    ]
    found = grounds(run(pipeline(wearer), swapped))
    assert all(g.status is not Status.VALID for g in found)
    assert found[-1].reason is Reason.EYES_SWAPPED


def test_frames_of_another_size_are_refused_by_name(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    cropped = [
        StereoFrame(header=m.header, left=m.left[:480], right=m.right[:480]) if isinstance(m, StereoFrame) else m
        for m in inputs
    ]
    assert grounds(run(pipeline(wearer), cropped))[-1].reason is Reason.WRONG_SIZE


def test_a_uniform_floor_is_no_ground(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    def grey(message: Input) -> Input:
        if not isinstance(message, StereoFrame):
            return message
        return StereoFrame(header=message.header, left=message.left * 0 + 90, right=message.right * 0 + 90)

    found = grounds(run(pipeline(wearer), [grey(message) for message in inputs]))
    assert all(g.status is not Status.VALID for g in found)
    assert found[-1].reason is Reason.LOW_TEXTURE


def test_silence_of_the_imu_is_said_at_once_and_until_it_is_back(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    from_ns, to_ns = START_NS + 1_800_000_000, START_NS + 1_870_000_000
    pipe, now_ns = pipeline(wearer), 0
    said: list[tuple[int, Attitude | GroundPlane]] = []
    for message in inputs:
        if isinstance(message, ImuSample) and from_ns <= message.t_arrival_ns < to_ns:
            continue
        if isinstance(message, Tick):
            now_ns = message.t_ns
        said += [(now_ns, estimate) for estimate in pipe.step(message) if isinstance(estimate, Attitude | GroundPlane)]
    silent = [(t_ns, e) for t_ns, e in said if from_ns <= t_ns and e.status is Status.INVALID]
    assert {e.reason for _, e in silent} == {Reason.NO_IMU}
    for kind in (Attitude, GroundPlane):
        assert min(t_ns for t_ns, e in silent if isinstance(e, kind)) - from_ns <= 50_000_000
    assert not [e for t_ns, e in said if silent[0][0] < t_ns < to_ns and e.status is Status.VALID]
    assert said[-1][1].status is Status.VALID


def test_a_repeated_picture_is_no_ground(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    frames = [m for m in inputs if isinstance(m, StereoFrame)]
    frozen = [
        StereoFrame(header=m.header, left=frames[30].left, right=frames[30].right)
        if isinstance(m, StereoFrame) and m.header.seq > frames[30].header.seq
        else m
        for m in inputs
    ]
    found = grounds(run(pipeline(wearer), frozen))
    assert [g.reason for g in found[31:]] == [Reason.FROZEN_FRAME] * (len(frames) - 31)


@pytest.mark.parametrize(
    ("of_pictures", "of_imu", "no_attitude"),
    [
        (Reason.NONE, Reason.IMU_INCONSISTENT, True),
        (Reason.TIME_INCONSISTENT, Reason.NONE, False),
        (Reason.TIME_INCONSISTENT, Reason.IMU_INCONSISTENT, False),
        (Reason.DISTANCES_WRONG, Reason.NONE, False),
        (Reason.DISTANCES_WRONG, Reason.IMU_INCONSISTENT, True),
    ],
)
def test_while_imu_and_camera_contradict_each_other_there_is_no_ground(
    wearer: SimulatedWearer,
    inputs: list[Input],
    monkeypatch: pytest.MonkeyPatch,
    of_pictures: Reason,
    of_imu: Reason,
    no_attitude: bool,
) -> None:
    monkeypatch.setattr(MotionWatch, "reason", property(lambda _: of_pictures))
    monkeypatch.setattr(AttitudeTrack, "contradiction", property(lambda _: of_imu))
    estimates = run(pipeline(wearer), inputs[: len(inputs) // 4])
    assert {g.reason for g in grounds(estimates)} == {of_imu if of_pictures is Reason.NONE else of_pictures}
    assert all(g.status is Status.INVALID and g.height_m != g.height_m for g in grounds(estimates))
    since_a_frame = dropwhile(lambda e: not isinstance(e, Motion), estimates)
    doubted = {e.reason is Reason.IMU_INCONSISTENT for e in since_a_frame if isinstance(e, Attitude)}
    assert doubted == {no_attitude}


@pytest.mark.long
@pytest.mark.parametrize("carried", ["tray", "rollator"])
def test_what_sets_off_with_its_wearer_does_not_contradict_the_imu(carried: str) -> None:
    """For the first tenths of a second it moves by less than half a pixel a frame otherwise than the ground."""
    wearer = SimulatedWearer(3, scenario(carried), START_NS)
    setting_off = [g for g in grounds(run(pipeline(wearer), list(wearer.offline_inputs(2.6)))) if g.frame_seq >= 40]
    assert len(setting_off) > 8
    assert {g.reason for g in setting_off} == {Reason.NONE}


@pytest.mark.parametrize(("silence_s", "another"), [(0.8, False), (1.5, True)])
def test_only_after_a_long_silence_may_it_be_another_camera(
    wearer: SimulatedWearer, inputs: list[Input], monkeypatch: pytest.MonkeyPatch, silence_s: float, another: bool
) -> None:
    resets: list[FrameGuard] = []
    monkeypatch.setattr(FrameGuard, "reset_timing", lambda guard: resets.append(guard))
    pipe = pipeline(wearer)
    run(pipe, inputs[: len(inputs) // 2])
    last_ns = max(m.header.t_arrival_ns for m in inputs[: len(inputs) // 2] if isinstance(m, StereoFrame))
    run(pipe, [Tick(t_ns=last_ns + t_ns) for t_ns in range(0, round(1e9 * silence_s), 10_000_000)])
    assert bool(resets) is another

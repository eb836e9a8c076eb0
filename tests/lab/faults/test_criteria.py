"""What the campaign calls wrong, stale, flagged and recovered, on things heard that are made up."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from lab.faults import criteria
from lab.faults.criteria import Errors, errors_of, flags, is_wrong_attitude, tilt_error_rad
from lab.faults.fault import Expect
from lab.faults.listener import Heard, HeardAttitude, HeardOnCan
from lab.faults.trial import Expectation, Measured, Times, failures, is_steady, measure, recovery_s
from messages import Attitude, GroundPlane, GroundTruth, Reason, Status
from tests.bench.can_samples import ground as sample_ground

NAN = math.nan
TRUTH = GroundTruth(
    t_exposure_ns=0,
    slope_sagittal_rad=0.0,
    slope_frontal_rad=0.0,
    height_m=0.9,
    q_WB=(1.0, 0.0, 0.0, 0.0),
    kind="level",
    transition=False,
    standing=False,
)
AT_AN_EDGE = msgspec.structs.replace(TRUTH, transition=True)
FRAME_NS = 50_000_000


def plane(slope_rad: float = 0.0, height_m: float = 0.9, deviation: float = 0.002) -> GroundPlane:
    variance = deviation**2
    return msgspec.structs.replace(
        sample_ground(),
        status=Status.VALID,
        reason=Reason.NONE,
        slope_sagittal_rad=slope_rad,
        slope_frontal_rad=0.0,
        height_m=height_m,
        covariance=(variance, 0.0, 0.0, variance, 0.0, variance),
    )


def refused(reason: Reason) -> GroundPlane:
    return GroundPlane.invalid(t_exposure_ns=1_000_000_000, frame_seq=3, reason=reason, ahead_m=0.6, calibration_id="x")


@pytest.mark.parametrize(
    ("ground", "truth", "wrong"),
    [
        (plane(), TRUTH, False),
        (plane(slope_rad=math.radians(2.9)), TRUTH, False),  # within the bound, though beyond 4 σ
        (plane(slope_rad=math.radians(3.1)), TRUTH, True),
        (plane(slope_rad=math.radians(3.1), deviation=0.02), TRUTH, False),  # it says how unsure it is
        (plane(height_m=0.946), TRUTH, True),
        (plane(height_m=0.946, deviation=0.012), TRUTH, False),
        (plane(height_m=0.92), AT_AN_EDGE, True),  # at an edge its own deviation judges alone
        (plane(height_m=0.907), AT_AN_EDGE, False),
        (plane(slope_rad=NAN), TRUTH, True),
    ],
)
def test_wrong_is_beyond_the_bound_and_beyond_its_own_deviation(
    ground: GroundPlane, truth: GroundTruth, wrong: bool
) -> None:
    assert errors_of(ground, truth).wrong is wrong


def tilted(by_rad: float, deviation_rad: float) -> Attitude:
    variance = deviation_rad**2
    return Attitude(
        t_sample_ns=0,
        status=Status.VALID,
        reason=Reason.NONE,
        q_WB=(math.cos(by_rad / 2), math.sin(by_rad / 2), 0.0, 0.0),
        w_WB_B_radps=(0.0, 0.0, 0.0),
        gyro_bias_B_radps=(0.0, 0.0, 0.0),
        rotation_cov_W_rad2=(variance, 0.0, 0.0, variance, 0.0, 1.0),
        calibration_id="00000000",
    )


def test_an_attitude_is_judged_by_its_vertical_alone() -> None:
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert tilt_error_rad(tilted(0.1, 0.01), turned) == pytest.approx(0.1)
    assert is_wrong_attitude(tilted(0.1, 0.01), np.eye(3))
    assert not is_wrong_attitude(tilted(0.1, 0.03), np.eye(3))
    assert not is_wrong_attitude(tilted(0.04, 0.001), np.eye(3))


def test_a_refusal_at_an_edge_flags_nothing_but_a_missing_device_does() -> None:
    assert not flags(refused(Reason.NOT_PLANAR), AT_AN_EDGE)
    assert flags(refused(Reason.NOT_PLANAR), TRUTH)
    assert flags(refused(Reason.NO_IMU), AT_AN_EDGE)
    assert not flags(plane(), TRUTH)


def heard(k: int, ground: GroundPlane | None = None, *, wrong: bool = False, stale: bool = False) -> Heard:
    ground = ground or plane()
    valid = ground.status is Status.VALID
    return Heard(k * FRAME_NS, ground, TRUTH, Errors(0.01, 0.002, wrong), valid, stale, flags(ground, TRUTH))


def on_can(frames: Sequence[Heard]) -> list[HeardOnCan]:
    return [HeardOnCan(h.t_ns + 1_000_000, h.errors) for h in frames if h.valid]


FLAGGED = Expectation(Expect.FLAGGED, 0.15, in_motion=False, recovery_s=2.0)


def passed_s(from_ns: int, to_ns: int) -> float:
    return 1e-9 * (to_ns - from_ns)


def test_flag_recovery_and_counts_are_those_of_the_trial() -> None:
    frames = [heard(k, wrong=k == 3) for k in range(10)]  # the wrong one was before the fault
    frames += [heard(10, stale=True), heard(11, wrong=True)]
    frames += [heard(k, refused(Reason.NO_FRAME)) for k in range(12, 20)]
    frames += [heard(20), heard(21), heard(22, refused(Reason.LOW_TEXTURE))]
    frames += [heard(k) for k in range(23, 40)]
    attitudes = [HeardAttitude(11 * FRAME_NS + 7, True, True, Reason.NONE)]
    times = Times(inject_ns=10 * FRAME_NS - 1, clear_ns=19 * FRAME_NS, end_ns=40 * FRAME_NS)
    found = measure(frames, attitudes, on_can(frames), times, FLAGGED, passed_s)
    assert found.flag_s == pytest.approx(0.1)
    assert found.flag_reason == "no_frame"
    assert found.recovery_s == pytest.approx(0.2)  # from frame 23 on: the two before were no steady run
    assert (found.wrong, found.stale, found.wrong_attitudes, found.wrong_on_can) == (1, 1, 1, 1)
    (told,) = found.wrong_told
    assert "after the fault began" in told
    assert "at an edge" not in told
    assert (found.frames, found.flags) == (10, 8)
    assert found.worst_slope_deg == pytest.approx(math.degrees(0.01))


def test_a_refusal_that_begins_at_an_edge_and_goes_on_behind_it_is_flagged_from_its_begin() -> None:
    def at_an_edge(k: int, reason: Reason) -> Heard:
        return heard(k, refused(reason))._replace(flag=False)

    behind = [heard(k, refused(Reason.LOW_TEXTURE)) for k in range(8, 12)]
    times = Times(5 * FRAME_NS - 1, 11 * FRAME_NS, 30 * FRAME_NS)
    for first, flag_s in ((Reason.LOW_TEXTURE, 0.1), (Reason.NOT_PLANAR, 0.15)):
        edge = [at_an_edge(6, Reason.NOT_PLANAR), at_an_edge(7, first)]
        found = measure([heard(5), *edge, *behind], [], [], times, FLAGGED, passed_s)
        assert found.flag_s == pytest.approx(flag_s)


def test_an_invalid_attitude_is_a_flag_too() -> None:
    frames = [heard(k) for k in range(30)]
    times = Times(5 * FRAME_NS, 15 * FRAME_NS, 30 * FRAME_NS)
    attitudes = [HeardAttitude(5 * FRAME_NS + 20_000_000, False, False, Reason.NO_IMU)]
    found = measure(frames, attitudes, on_can(frames), times, FLAGGED, passed_s)
    assert found.flag_s == pytest.approx(0.02)
    assert found.flag_reason == "no_imu"
    assert found.flags == 0


def test_what_takes_motion_is_not_flagged_by_chance() -> None:
    frames = [heard(k) for k in range(10)] + [heard(10, refused(Reason.IMU_INCONSISTENT))]
    frames += [heard(k) for k in range(11, 20)]
    frames += [heard(k, refused(Reason.NO_FRAME)) for k in range(20, 30)]
    frames += [heard(k, refused(Reason.IMU_INCONSISTENT)) for k in range(30, 40)]
    expected = FLAGGED._replace(in_motion=True, foreign=frozenset({Reason.NO_FRAME}))
    found = measure(frames, [], [], Times(5 * FRAME_NS, 40 * FRAME_NS, 40 * FRAME_NS), expected, passed_s)
    assert found.flag_s == pytest.approx(1.25)
    assert found.flag_reason == "imu_inconsistent"


def test_no_recovery_without_the_bus() -> None:
    frames = [heard(k) for k in range(30)]
    assert recovery_s(frames, on_can(frames), 10 * FRAME_NS) is not None
    assert recovery_s(frames, [], 10 * FRAME_NS) is None
    assert recovery_s(frames[:15], on_can(frames), 10 * FRAME_NS) is None


def test_who_is_valid_but_wrong_has_not_recovered() -> None:
    frames = [heard(k, wrong=k < 17) for k in range(40)]
    assert recovery_s(frames, on_can(frames), 10 * FRAME_NS) == pytest.approx(0.35)
    assert not is_steady(frames[:30], 0, 20, 30 * FRAME_NS)


def test_steady_means_fresh_and_without_a_flag() -> None:
    frames = [heard(k) for k in range(30)]
    assert is_steady(frames, 0, 20, 30 * FRAME_NS)
    assert not is_steady(frames, 15 * FRAME_NS, 20, 30 * FRAME_NS)
    assert not is_steady(frames, 0, 20, 40 * FRAME_NS)
    assert not is_steady([*frames, heard(30, refused(Reason.NO_IMU))], 0, 20, 31 * FRAME_NS)


GOOD = Measured(
    flag_s=None,
    flag_reason="",
    recovery_s=0.03,
    frames=30,
    flags=0,
    wrong=0,
    stale=0,
    wrong_on_can=0,
    wrong_attitudes=0,
    worst_slope_deg=0.3,
    worst_height_mm=2.0,
)


@pytest.mark.parametrize(
    ("expect", "found", "why"),
    [
        (Expect.TOLERATED, GOOD, []),
        (Expect.TOLERATED, msgspec.structs.replace(GOOD, flags=2, flag_reason="no_imu"), ["2 frames marked invalid"]),
        (Expect.TOLERATED, msgspec.structs.replace(GOOD, frames=11), ["only 11 frames"]),
        (Expect.FLAGGED, GOOD, ["never flagged"]),
        (Expect.FLAGGED, msgspec.structs.replace(GOOD, flag_s=0.049), []),
        (Expect.FLAGGED, msgspec.structs.replace(GOOD, flag_s=0.051), ["flagged after 51 ms"]),
        (Expect.HONEST, msgspec.structs.replace(GOOD, flags=9, flag_s=0.2), []),
        (Expect.HONEST, msgspec.structs.replace(GOOD, wrong=1), ["1 wrong ground"]),
        (Expect.SILENT, msgspec.structs.replace(GOOD, frames=0, stale=2), ["2 ground estimates too old"]),
        (Expect.UNDETECTABLE, msgspec.structs.replace(GOOD, wrong=90, wrong_on_can=88), []),
        (Expect.UNDETECTABLE, msgspec.structs.replace(GOOD, recovery_s=None), ["did not recover"]),
        (Expect.HONEST, msgspec.structs.replace(GOOD, recovery_s=2.5), ["recovered after 2.5 s"]),
    ],
)
def test_the_verdict_names_what_is_amiss(expect: Expect, found: Measured, why: list[str]) -> None:
    told = list(failures(Expectation(expect, 0.05, False, 2.0), found, hold_s=1.5))
    assert len(told) == len(why)
    assert all(line.startswith(beginning) for line, beginning in zip(told, why, strict=True))


def test_the_limits_are_those_of_the_promise() -> None:
    assert math.radians(3.0) == criteria.WRONG_SLOPE_RAD
    assert criteria.WRONG_HEIGHT_M == 3 * 0.015

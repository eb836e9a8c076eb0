"""The verdicts: each contradiction within 3 s of motion, no false one, recovery within 2 s, nothing from standing."""

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from messages import Calibration, Pose, Reason, matrix3, vec3
from perception.motion.consistency import ConsistencyMonitor, Subject, Verdict
from perception.motion.ego_motion import EgoMotion
from sim_rig.unit import draw_unit
from tests.bench.seen_motion import P_BC_M, R_BC, START_NS, WALKING_NS, SampleAt, arrivals_until

S = 1_000_000_000
Alter = Callable[[SampleAt | EgoMotion], SampleAt | EgoMotion]
ACCEL, GYRO = range(3), range(3, 6)


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    mounted = Pose(R=matrix3(R_BC), p_m=vec3(P_BC_M))
    return msgspec.structs.replace(draw_unit(4).exact_calibration(), X_BL=mounted)


class Heard:
    """What a monitor says, with the time of each word."""

    def __init__(self) -> None:
        self.reasons: list[tuple[int, Reason]] = []
        self.restarts_ns: list[int] = []
        self.verdicts: dict[Subject, Verdict] = {}

    @property
    def by_window(self) -> set[Verdict]:
        return {verdict for subject, verdict in self.verdicts.items() if subject is not Subject.TURN}

    def first_ns(self, since_ns: int) -> int:
        return next(t_ns for t_ns, reason in self.reasons if t_ns >= since_ns and reason is not Reason.NONE)

    def last_ns(self) -> int:
        return max(t_ns for t_ns, reason in self.reasons if reason is not Reason.NONE)


def heard(
    calibration: Calibration, to_ns: int, alter: Alter | None = None, seed: int = 5, name: str = "level"
) -> Heard:
    monitor, words = ConsistencyMonitor(calibration, np.eye(3)), Heard()
    for arrival in arrivals_until(to_ns, seed, name):
        message = arrival if alter is None else alter(arrival)
        if isinstance(message, SampleAt):
            monitor.add_sample(message.t_ns, message.sf_B_mps2, message.w_B_radps)
            now_ns = message.t_ns
        elif isinstance(message, EgoMotion):
            if monitor.add_motion(message, None) | monitor.update_verdicts():
                words.restarts_ns.append(now_ns)
            words.reasons.append((now_ns, monitor.reason))
    words.verdicts = monitor.verdicts
    return words


def flip(axis: int, from_ns: int, to_ns: int) -> Alter:
    def alter(arrival: SampleAt | EgoMotion) -> SampleAt | EgoMotion:
        if isinstance(arrival, EgoMotion) or not from_ns <= arrival.t_ns < to_ns:
            return arrival
        values = [*arrival.sf_B_mps2, *arrival.w_B_radps]
        values[axis] = -values[axis]
        return replace(arrival, sf_B_mps2=vec3(values[:3]), w_B_radps=vec3(values[3:]))

    return alter


def stamped(late_ns: Callable[[int], int]) -> Alter:
    def alter(arrival: SampleAt | EgoMotion) -> SampleAt | EgoMotion:
        if isinstance(arrival, SampleAt):
            return arrival
        return replace(
            arrival,
            t_before_ns=arrival.t_before_ns + late_ns(arrival.t_before_ns),
            t_after_ns=arrival.t_after_ns + late_ns(arrival.t_after_ns),
        )

    return alter


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_a_walk_raises_no_alarm_and_shows_that_all_is_well(calibration: Calibration, seed: int) -> None:
    words = heard(calibration, WALKING_NS + 5 * S, seed=seed)
    assert {reason for _, reason in words.reasons} == {Reason.NONE}
    assert words.by_window == {Verdict.CONSISTENT}


def test_standing_tells_nothing(calibration: Calibration) -> None:
    words = heard(calibration, START_NS + 6 * S, name="standing")
    assert {reason for _, reason in words.reasons} == {Reason.NONE}
    assert words.by_window == {Verdict.UNKNOWN}


@pytest.mark.parametrize("axis", [*ACCEL, *GYRO])
def test_a_changed_sign_is_seen_in_three_seconds_and_forgiven_in_two(calibration: Calibration, axis: int) -> None:
    end_ns = WALKING_NS + 4 * S
    words = heard(calibration, end_ns + 3 * S, flip(axis, WALKING_NS, end_ns))
    assert all(reason is Reason.NONE for t_ns, reason in words.reasons if t_ns < WALKING_NS)
    assert words.first_ns(WALKING_NS) < WALKING_NS + 3 * S
    assert {reason for _, reason in words.reasons} == {Reason.NONE, Reason.IMU_INCONSISTENT}
    assert words.last_ns() < end_ns + 2 * S
    assert end_ns < words.restarts_ns[-1] < end_ns + 2 * S
    assert words.by_window == {Verdict.CONSISTENT}


@pytest.mark.parametrize("axis", [*ACCEL, *GYRO])
def test_a_sign_wrong_from_the_start_is_seen_once_the_wearer_walks(calibration: Calibration, axis: int) -> None:
    words = heard(calibration, WALKING_NS + 3 * S, flip(axis, 0, 10**18))
    assert words.first_ns(0) < WALKING_NS + 3 * S
    assert words.reasons[-1][1] is Reason.IMU_INCONSISTENT


@pytest.mark.parametrize("by_ms", [-80, -50, -20, 20, 50, 80])
def test_stamps_that_are_off_are_seen_in_three_seconds(calibration: Calibration, by_ms: int) -> None:
    words = heard(calibration, WALKING_NS + 3 * S, stamped(lambda _: by_ms * 1_000_000))
    assert words.first_ns(0) < WALKING_NS + 2 * S
    assert words.reasons[-1][1] is Reason.TIME_INCONSISTENT


@pytest.mark.parametrize("by_ms", [-6, 6])
def test_stamps_that_are_off_by_less_than_stated_are_left_alone(calibration: Calibration, by_ms: int) -> None:
    words = heard(calibration, WALKING_NS + 4 * S, stamped(lambda _: by_ms * 1_000_000))
    assert {reason for _, reason in words.reasons} == {Reason.NONE}


@pytest.mark.parametrize("rate", [-0.01, 0.01])
def test_a_clock_that_drifts_is_seen_in_three_seconds(calibration: Calibration, rate: float) -> None:
    drifting = stamped(lambda t_ns: round(rate * max(0, t_ns - WALKING_NS)))
    words = heard(calibration, WALKING_NS + 4 * S, drifting)
    assert words.first_ns(WALKING_NS) < WALKING_NS + 3 * S
    assert words.reasons[-1][1] is Reason.TIME_INCONSISTENT


def test_a_contradiction_is_not_forgiven_while_nothing_is_seen(calibration: Calibration) -> None:
    monitor = ConsistencyMonitor(calibration, np.eye(3))
    for arrival in arrivals_until(WALKING_NS + 3 * S, 5):
        message = flip(4, 0, 10**18)(arrival)
        if isinstance(message, SampleAt):
            monitor.add_sample(message.t_ns, message.sf_B_mps2, message.w_B_radps)
        elif isinstance(message, EgoMotion):
            monitor.add_motion(message, None)
            monitor.update_verdicts()
    for _ in range(100):
        assert not monitor.add_motion(None, None)
        assert not monitor.update_verdicts()
    assert monitor.reason is Reason.IMU_INCONSISTENT
    assert monitor.verdicts[Subject.GYRO_Y] is Verdict.INCONSISTENT
    assert monitor.verdicts[Subject.GYRO_X] is Verdict.CONSISTENT


@pytest.mark.parametrize(
    ("gone_from_ns", "gone_s", "restarts"),
    [(WALKING_NS + S, 3.5, 1), (WALKING_NS + S, 0.6, 0), (START_NS + S // 2, 1.0, 0)],
    ids=["walking", "walking, briefly", "standing"],
)
def test_what_moved_while_no_picture_came_is_discarded(
    calibration: Calibration, gone_from_ns: int, gone_s: float, restarts: int
) -> None:
    monitor, counted = ConsistencyMonitor(calibration, np.eye(3)), 0
    for arrival in arrivals_until(WALKING_NS + 6 * S, 5):
        if isinstance(arrival, SampleAt):
            monitor.add_sample(arrival.t_ns, arrival.sf_B_mps2, arrival.w_B_radps)
        elif not gone_from_ns <= arrival.t_before_ns < gone_from_ns + gone_s * S:
            counted += monitor.add_motion(arrival, None) | monitor.update_verdicts()
            assert monitor.reason is Reason.NONE
    assert counted == restarts


def test_lost_samples_are_no_contradiction(calibration: Calibration) -> None:
    monitor = ConsistencyMonitor(calibration, np.eye(3))
    for arrival in arrivals_until(WALKING_NS + 4 * S, 5):
        if isinstance(arrival, SampleAt):
            if not WALKING_NS + S <= arrival.t_ns < WALKING_NS + S + S // 5:
                monitor.add_sample(arrival.t_ns, arrival.sf_B_mps2, arrival.w_B_radps)
        else:
            monitor.add_motion(arrival, None)
            monitor.update_verdicts()
            assert monitor.reason is Reason.NONE


def remounted(angle_rad: float) -> Alter:
    """Return what is seen by a camera that is rolled by `angle_rad` on its mount."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def alter(arrival: SampleAt | EgoMotion) -> SampleAt | EgoMotion:
        if isinstance(arrival, SampleAt):
            return arrival
        return replace(arrival, w_C_radps=R @ arrival.w_C_radps, v_C_mps=R @ arrival.v_C_mps)

    return alter


def test_a_camera_rolled_on_its_mount_is_seen_in_three_seconds_and_named(calibration: Calibration) -> None:
    words = heard(calibration, WALKING_NS + 3 * S, remounted(np.radians(15.0)))
    assert words.first_ns(0) < WALKING_NS + 3 * S
    assert words.verdicts[Subject.MOUNT] is Verdict.INCONSISTENT


def test_a_mount_that_is_off_by_a_degree_is_left_alone(calibration: Calibration) -> None:
    words = heard(calibration, WALKING_NS + 4 * S, remounted(np.radians(1.0)))
    assert {reason for _, reason in words.reasons} == {Reason.NONE}

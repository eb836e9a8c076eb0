"""What ticks tell of a silent IMU or camera, and how often."""

from itertools import pairwise

from daemon.silence import CAMERA_SILENCE_NS, CAMERA_START_NS, FRAME_PERIOD_NS, IMU_SILENCE_NS, Silence
from messages import Reason

MS = 1_000_000


def test_the_imu_falls_silent_once_until_a_sample_comes() -> None:
    silence = Silence()
    assert not silence.imu_falls_silent(10 * IMU_SILENCE_NS)
    for arrived_ns in (100 * MS, 300 * MS):
        silence.sample_arrived(arrived_ns)
        told = [silence.imu_falls_silent(arrived_ns + k * MS) for k in range(60)]
        assert [k for k, each in enumerate(told) if each] == [IMU_SILENCE_NS // MS + 1]
        assert silence.imu_is_silent
    silence.sample_arrived(400 * MS)
    assert not silence.imu_is_silent


def test_a_sample_that_arrives_before_the_one_before_it_makes_no_silence() -> None:
    silence = Silence()
    silence.sample_arrived(100 * MS)
    silence.sample_arrived(80 * MS)
    assert not silence.imu_falls_silent(100 * MS + IMU_SILENCE_NS)


def test_a_camera_is_starting_and_then_silent_at_the_pace_of_frames() -> None:
    silence = Silence()
    told = [(t, silence.of_camera(t)) for t in range(0, 7000 * MS, 10 * MS)]
    said = [(t, reason) for t, reason in told if reason is not Reason.NONE]
    assert said[0] == (CAMERA_SILENCE_NS, Reason.STARTING)
    assert {later - earlier for (earlier, _), (later, _) in pairwise(said)} == {FRAME_PERIOD_NS}
    assert [reason for t, reason in said if t < CAMERA_START_NS] == [Reason.STARTING] * 98
    assert {reason for t, reason in said if t >= CAMERA_START_NS} == {Reason.NO_FRAME}


def test_after_a_frame_silence_is_a_fault_at_once_and_after_a_stall_no_report_is_made_up_for() -> None:
    silence = Silence()
    silence.frame_arrived(100 * MS)
    due_ns = 100 * MS + CAMERA_SILENCE_NS
    assert silence.of_camera(due_ns - 1) is Reason.NONE
    assert silence.of_camera(due_ns) is Reason.NO_FRAME
    assert silence.of_camera(due_ns + 10 * FRAME_PERIOD_NS) is Reason.NO_FRAME
    assert silence.of_camera(due_ns + 11 * FRAME_PERIOD_NS - 1) is Reason.NONE
    assert silence.since_frame_ns(due_ns) == CAMERA_SILENCE_NS

"""After the camera was lost: nothing is believed before turns and velocity have agreed for a second."""

import math

import numpy as np
import pytest

from lab.evaluation.told_steps import OdometerNoise, told_steps
from messages import ImuSample, Reason, Status, vec3
from perception import so3
from perception.attitude.agreement import Innovation
from perception.attitude.confirmation import Confirmation
from perception.attitude.track import AttitudeTrack
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS, S = 10_000_000_000, 1_000_000_000
NOISE = OdometerNoise(0.012, float(np.radians(0.4)))
LOST_S, BACK_S, END_S = 4.0, 7.0, 10.0
JUMP_RADPS = np.radians((3.0, 4.0, 0.0))
STEP_S = 0.05


def steps(confirmation: Confirmation, count: int, missing_rad: float = 0.0, squares: float = 1.0) -> bool:
    """Add equal steps; return whether all of them were usual."""
    turn = np.array((missing_rad, 0.0, 0.0))
    said = [confirmation.add(Innovation(STEP_S, turn, turn, squares, 1.0)) for _ in range(count)]
    return all(said)


def test_before_the_first_step_nothing_is_lost_and_half_a_second_after_the_last_it_is() -> None:
    confirmation = Confirmation()
    assert not confirmation.is_pending(100 * S)
    confirmation.accept(10 * S)
    assert not confirmation.is_pending(10 * S + S // 2)
    assert confirmation.is_pending(10 * S + S // 2 + 1)


def test_a_second_of_usual_steps_completes_and_a_beginning_starts_anew() -> None:
    confirmation = Confirmation()
    found = []
    for count in (19, 2):
        assert steps(confirmation, count)
        found.append(confirmation.is_complete)
    confirmation.begin()
    assert [*found, confirmation.is_complete] == [False, True, False]


def test_what_is_found_first_may_be_large_and_later_may_not() -> None:
    confirmation = Confirmation()
    assert steps(confirmation, 4, missing_rad=0.02, squares=20.0)
    assert not steps(confirmation, 4, squares=20.0)
    confirmation.begin()
    assert not steps(confirmation, 20, missing_rad=math.radians(0.1))


@pytest.mark.parametrize(("jumps_s", "jump_ends_s"), [(4.5, 99.0), (4.5, 6.5)])
def test_a_gyroscope_that_jumps_in_the_dark_is_not_believed_and_soon_found(jumps_s: float, jump_ends_s: float) -> None:
    wearer = SimulatedWearer(65, scenario("level"), START_NS)
    track = AttitudeTrack(wearer.calibration)
    seen = [
        told
        for told in told_steps(wearer, END_S, NOISE, 65)
        if not LOST_S <= 1e-9 * (told.step.t_after_ns - START_NS) < BACK_S
    ]
    unknown_s, confirmed_s = [], []
    for sample in wearer.offline_samples(END_S):
        since_s = 1e-9 * (sample.t_sample_ns - START_NS)
        jumped = jumped_by(sample) if jumps_s <= since_s < jump_ends_s else sample
        attitude = track.add_sample(jumped)
        while seen and seen[0].t_told_ns <= sample.t_arrival_ns:
            track.add_camera_step(seen.pop(0).step)
        if since_s > LOST_S + 0.6 and track.is_confirmed:
            confirmed_s.append(since_s)
        if attitude.status is Status.VALID:
            xx, _, _, yy, _, _ = attitude.rotation_cov_W_rad2
            up_B = so3.matrix_from_quaternion(attitude.q_WB)[2]
            true_B = wearer.gait.at(np.array([sample.t_sample_ns])).R_WB[0][2]
            error_rad = math.acos(min(1.0, float(up_B @ true_B)))
            assert error_rad < max(math.radians(3.0), 4.0 * math.sqrt(max(xx, yy)))
        elif since_s > LOST_S:
            assert attitude.reason is Reason.UNCONFIRMED
            unknown_s.append(since_s)
    assert unknown_s[0] == pytest.approx(LOST_S + 1.5, abs=0.3)
    assert BACK_S + 1.0 < confirmed_s[0] < BACK_S + 2.0


def test_steps_that_are_told_at_once_confirm_each_other_too() -> None:
    wearer = SimulatedWearer(65, scenario("level"), START_NS)
    track = AttitudeTrack(wearer.calibration)
    steps_seen = [
        told.step
        for told in told_steps(wearer, END_S, NOISE, 65)
        if not LOST_S <= 1e-9 * (told.step.t_after_ns - START_NS) < BACK_S
    ]
    confirmed_s = []
    for sample in wearer.offline_samples(END_S):
        since_s = 1e-9 * (sample.t_sample_ns - START_NS)
        track.add_sample(sample)
        while steps_seen and steps_seen[0].t_after_ns <= sample.t_sample_ns:  # within 10 ms
            track.add_camera_step(steps_seen.pop(0))
        if since_s > LOST_S + 0.6 and track.is_confirmed:
            confirmed_s.append(since_s)
    assert BACK_S + 1.0 < confirmed_s[0] < BACK_S + 2.0


def jumped_by(sample: ImuSample) -> ImuSample:
    """Return the sample of a gyroscope whose bias has jumped by 5 °/s."""
    return ImuSample(
        seq=sample.seq,
        t_sample_ns=sample.t_sample_ns,
        t_arrival_ns=sample.t_arrival_ns,
        sf_B_mps2=sample.sf_B_mps2,
        w_WB_B_radps=vec3(np.add(sample.w_WB_B_radps, JUMP_RADPS)),
        temperature_degC=sample.temperature_degC,
    )


def test_a_tilt_found_anew_by_an_imu_that_contradicted_waits_for_the_camera() -> None:
    """What it has measured was discarded as wrong: what it measures next need be no better."""
    wearer = SimulatedWearer(66, scenario("level"), START_NS)
    track = AttitudeTrack(wearer.calibration)
    waiting = list(told_steps(wearer, END_S, NOISE, 66))
    discarded, reasons = False, list[tuple[float, Reason]]()
    for sample in wearer.offline_samples(END_S):
        since_s = 1e-9 * (sample.t_sample_ns - START_NS)
        if since_s >= LOST_S and not discarded:
            track.roll_back()
            discarded = True
        reasons.append((since_s, track.add_sample(sample).reason))
        while waiting and waiting[0].t_told_ns <= sample.t_arrival_ns:
            told = waiting.pop(0)
            if not LOST_S <= 1e-9 * (told.step.t_after_ns - START_NS) < BACK_S:
                track.add_camera_step(told.step)
                track.checkpoint()
    alone = {reason for at_s, reason in reasons if LOST_S < at_s < BACK_S}
    assert Reason.NONE not in alone
    assert Reason.UNCONFIRMED in alone
    assert {reason for at_s, reason in reasons if at_s > BACK_S + 2.0} == {Reason.NONE}

import math
from dataclasses import replace

import numpy as np

from lab.evaluation.attitude import tilt_errors_W
from lab.evaluation.hip_motion import Motion, hip_motion
from messages import Attitude, ImuSample, Reason, Status, vec3
from perception import so3
from perception.attitude.track import AttitudeTrack
from sim_rig.unit import draw_unit

CALIBRATION = draw_unit(1).exact_calibration()
IMU = CALIBRATION.imu


def add_all(track: AttitudeTrack, motion: Motion) -> list[Attitude]:
    """Return what the track says to `motion`, measured by the unit's chip without noise."""
    measured_sf = motion.sf_B @ np.linalg.inv(IMU.sf_matrix).T + IMU.sf_bias_mps2
    measured_w = motion.w_B @ np.linalg.inv(IMU.w_matrix).T + IMU.w_bias_radps
    return [
        track.add_sample(
            ImuSample(
                seq=seq,
                t_sample_ns=t_ns,
                t_arrival_ns=t_ns,
                sf_B_mps2=vec3(sf),
                w_WB_B_radps=vec3(w),
                temperature_degC=25.0,
            )
        )
        for seq, (t_ns, sf, w) in enumerate(zip(motion.t_ns.tolist(), measured_sf, measured_w, strict=True))
    ]


def test_rolling_back_leaves_no_number_until_the_filter_has_started_again() -> None:
    track, motion = AttitudeTrack(CALIBRATION), hip_motion([], 8.0, seed=1)
    newest = add_all(track, motion.between(0.0, 3.0))[-1]
    assert newest.status is Status.VALID
    assert track.at(newest.t_sample_ns) is not None
    track.roll_back()
    assert track.at(newest.t_sample_ns) is None
    assert track.reason is Reason.STARTING
    attitudes = add_all(track, motion.between(3.0, 8.0))
    starting = [attitude for attitude in attitudes if attitude.status is not Status.VALID]
    assert 90 <= len(starting) <= 105
    assert all(math.isnan(attitude.q_WB[0]) for attitude in starting)
    assert attitudes[-1].status is Status.VALID


def test_attitudes_in_retrospect_are_right_and_do_not_reach_across_a_gap() -> None:
    track, motion = AttitudeTrack(CALIBRATION), hip_motion([(2.0, 20.0)], 20.0, seed=2)
    add_all(track, motion.between(0.0, 6.0))
    add_all(track, motion.between(7.0, 7.5))
    after = motion.between(8.2, 10.2)
    attitudes = add_all(track, after)
    valid = next(k for k, attitude in enumerate(attitudes) if attitude.status is Status.VALID)
    assert all(attitude.reason is Reason.NO_IMU for attitude in attitudes[:valid])
    assert track.at(int(motion.between(7.0, 7.5).t_ns[-1])) is None
    before_ns = int(after.t_ns[valid]) - 400_000_000
    past = track.at(before_ns)
    assert past is not None
    truth_R_WB = after.R_WB[int(np.searchsorted(after.t_ns, before_ns))]
    error = tilt_errors_W(so3.matrix_from_quaternion(past.q_WB)[np.newaxis], truth_R_WB[np.newaxis])[0]
    assert np.degrees(np.linalg.norm(error)) < 6.0


def test_what_contradicted_is_rolled_back_to_the_checkpoint() -> None:
    track, motion = AttitudeTrack(CALIBRATION), hip_motion([(2.0, 12.0)], 12.0, seed=3)
    for second in range(7):
        add_all(track, motion.between(float(second), second + 1.0))
        track.checkpoint()
    wrong = motion.between(7.0, 9.0)
    add_all(track, replace(wrong, sf_B=wrong.sf_B * (-1.0, 1.0, 1.0)))
    track.roll_back()
    after = motion.between(9.0, 11.0)
    attitudes = add_all(track, after)
    valid = next(k for k, attitude in enumerate(attitudes) if attitude.status is Status.VALID)
    assert 0 < valid <= 150
    q_WB = [so3.matrix_from_quaternion(attitude.q_WB) for attitude in attitudes[valid:]]
    assert np.degrees(np.abs(tilt_errors_W(np.array(q_WB), after.R_WB[valid:])).max()) < 6.0


def contradicted(accelerometer: float) -> tuple[AttitudeTrack, Motion]:
    """Return a track that was kept during a walk and then measured the accelerometer's x wrong, and what follows."""
    track, motion = AttitudeTrack(CALIBRATION), hip_motion([(2.0, 14.0)], 14.0, seed=4)
    for second in range(7):
        add_all(track, motion.between(float(second), second + 1.0))
        track.checkpoint()
    wrong = motion.between(7.0, 10.0)
    add_all(track, replace(wrong, sf_B=wrong.sf_B * (accelerometer, 1.0, 1.0)))
    return track, motion.between(10.0, 14.0)


def test_turns_that_hold_carry_the_vertical_past_an_accelerometer_that_does_not() -> None:
    track, after = contradicted(accelerometer=-1.0)
    track.roll_back(gyro_agrees=True)
    attitudes = add_all(track, after)
    assert all(attitude.status is Status.VALID for attitude in attitudes)
    q_WB = np.array([so3.matrix_from_quaternion(attitude.q_WB) for attitude in attitudes])
    errors_rad = np.linalg.norm(tilt_errors_W(q_WB, after.R_WB), axis=1)
    assert np.degrees(errors_rad.max()) < 1.5
    stated_rad = [math.sqrt(a.rotation_cov_W_rad2[0] + a.rotation_cov_W_rad2[3]) for a in attitudes]
    assert (errors_rad < 3.0 * np.array(stated_rad)).all()


def test_turns_carry_nothing_past_samples_that_are_missing() -> None:
    track, after = contradicted(accelerometer=-1.0)
    add_all(track, after.between(1.0, 1.5))
    track.roll_back(gyro_agrees=True)
    assert add_all(track, after.between(1.5, 1.6))[-1].status is not Status.VALID

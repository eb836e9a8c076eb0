"""Steps of the camera in the filter: as good as all of them at once."""

from dataclasses import replace

import numpy as np
import pytest

from messages import Status, vec3
from perception.attitude.camera_step import CameraStep, begin_step, follow_odometer_scale, measure_step
from perception.attitude.filter import AttitudeSettings
from perception.attitude.history import AttitudeAt
from perception.attitude.kalman import AttitudeKalman
from perception.attitude.track import AttitudeTrack
from perception.motion.ego_motion import EgoMotion
from perception.so3 import quaternion_from_matrix
from perception.vec3 import ZERO
from tests.bench.attitude_batch import solve
from tests.bench.seen_motion import WALKING_NS, SampleAt, arrivals_until, gait, seen
from tests.bench.told_track import CALIBRATION, camera_step, follow, measured

S = 1_000_000_000


def tilt_deg(R_WB: np.ndarray, true_R_WB: np.ndarray) -> float:
    return float(np.degrees(np.arccos(min(1.0, float(R_WB[2] @ true_R_WB[2])))))


@pytest.mark.parametrize("seed", [5, 8])
def test_the_filter_agrees_with_a_batch_over_the_same_motion(seed: int) -> None:
    """The batch is told the last two seconds only, the filter all: they differ by what either does not know."""
    end_ns, walk = WALKING_NS + 3 * S, gait(seed)
    arrived = list(arrivals_until(end_ns, seed))
    track = AttitudeTrack(CALIBRATION)
    samples = [each for each in arrived if isinstance(each, SampleAt)]
    steps = [camera_step(each) for each in arrived if isinstance(each, EgoMotion)]
    seq, newest = 0, None
    for each in arrived:
        if isinstance(each, SampleAt):
            seq, newest = seq + 1, track.add_sample(measured(each, seq))
        else:
            track.add_camera_step(camera_step(each))
    assert newest is not None
    assert newest.status is Status.VALID
    last_ns = steps[-1].t_after_ns
    begin_ns = last_ns - 2 * S
    filtered = track.at(last_ns)
    assert filtered is not None
    part = [sample for sample in samples if begin_ns <= sample.t_ns <= last_ns]
    told = [step for step in steps if step.t_before_ns >= begin_ns]
    guess = walk.at(np.array([part[0].t_ns])).R_WB[0]
    batch = solve(part, told, guess, CALIBRATION.residual)
    truth = walk.at(np.array([last_ns])).R_WB[0]
    assert tilt_deg(batch.R_WB[-1], truth) < 0.4
    assert tilt_deg(filtered.R_WB, truth) < 0.4
    assert tilt_deg(filtered.R_WB, batch.R_WB[-1]) < 0.4


def test_what_samples_lose_of_a_bob_is_no_scale_of_distances() -> None:
    """A sample every 10 ms: lines between them cut off 0.2 % of a walker's bob."""
    walk, track, seq = gait(5), AttitudeTrack(CALIBRATION), 0
    for each in arrivals_until(WALKING_NS + 6 * S, 5):
        if isinstance(each, SampleAt):
            seq += 1
            track.add_sample(measured(each, seq))
        else:
            exact = seen(walk, each.t_before_ns, each.t_after_ns, noise=0.0)
            track.add_camera_step(camera_step(replace(exact, covariance=0.01 * each.covariance)))
    found = track.sensor_errors
    assert found is not None
    assert abs(found.scale) < 0.0008


def test_an_odometer_errs_by_more_in_all_where_it_states_more_noise() -> None:
    kalman = AttitudeKalman(AttitudeSettings(), CALIBRATION.residual)
    state, settings = kalman.new_state(), kalman.settings.camera
    step = CameraStep(
        0, 50_000_000, ZERO, (0.06, 0.0, 0.0), np.eye(6) * (0.05 * settings.odometer_noise_mps) ** 2, ZERO
    )
    follow_odometer_scale(state, step, settings)
    assert state.odometer_scale == pytest.approx(settings.odometer_scale)
    follow_odometer_scale(state, replace(step, covariance=9.0 * step.covariance), settings)
    assert state.odometer_scale == pytest.approx((1.0 + 3.0 / 9.0) / (1.0 + 1.0 / 9.0) * settings.odometer_scale)
    follow_odometer_scale(state, replace(step, travel_B=ZERO, covariance=900.0 * step.covariance), settings)
    assert state.odometer_scale == pytest.approx(1.2 * settings.odometer_scale)


def test_a_turn_counts_for_less_only_by_what_steps_share() -> None:
    kalman = AttitudeKalman(AttitudeSettings(), CALIBRATION.residual)
    doubtful_rad = kalman.settings.camera.doubtful_radps * 0.05

    def told(step: CameraStep) -> float:
        state = kalman.new_state()
        state.q_WB = (1.0, 0.0, 0.0, 0.0)
        begin_step(kalman, state)
        said = measure_step(kalman, state, step, believed=False)
        assert said is not None
        return float(said.missing_rad[2])

    step = CameraStep(0, 50_000_000, (0.0, 0.0, 0.01), ZERO, np.eye(6) * 1e-8, ZERO)
    assert told(step) == pytest.approx(0.01)
    assert told(replace(step, covariance=np.eye(6) * doubtful_rad**2)) == pytest.approx(0.01)
    assert told(replace(step, common_rad=doubtful_rad)) == pytest.approx(0.005)


def test_a_start_is_no_tilt_where_the_camera_sees_it() -> None:
    walking = [step.tilt_deg for step in follow(WALKING_NS + 2 * S) if step.t_ns > WALKING_NS - S]
    assert float(np.sqrt(np.mean(np.square(walking)))) < 0.25


def test_a_step_tells_the_mean_velocity_of_the_imu() -> None:
    walk, worst_mps = gait(5, "level"), 0.0
    for from_ns in range(WALKING_NS + S, WALKING_NS + 3 * S, 50_000_000):
        step = camera_step(seen(walk, from_ns, from_ns + 50_000_000, noise=0.0))
        before, after = (walk.at(np.array([t_ns])) for t_ns in (step.t_before_ns, step.t_after_ns))
        attitude = AttitudeAt(
            step.t_after_ns, quaternion_from_matrix(after.R_WB[0]), vec3(after.w_WB_B_radps[0]), 0.0, np.eye(3)
        )
        mean_mps = (after.p_WB_m - before.p_WB_m)[0] / step.duration_s
        assert np.linalg.norm(mean_mps) > 0.5
        worst_mps = max(worst_mps, float(np.linalg.norm(step.with_velocity(attitude).v_W_mps - mean_mps)))
    assert worst_mps < 0.002

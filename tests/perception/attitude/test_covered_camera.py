"""A gyroscope whose bias moves, with the camera and after it was covered: the stated uncertainty holds."""

from dataclasses import replace

import numpy as np
import pytest

from lab.evaluation.attitude import coverage, tilt_errors_W
from lab.evaluation.told_steps import OdometerNoise, told_steps
from messages import Status
from messages.arrays import FloatArray, rms
from perception import so3
from perception.attitude.track import AttitudeTrack
from sim_rig.imu.drift import Drift
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Pace, Scenario, scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
NOISE = OdometerNoise(0.012, float(np.radians(0.4)))
JUMP_S = 10.0


def errors_deg(seed: int, drift: Drift, seconds: float, covered_s: float, from_s: float) -> tuple[FloatArray, float]:
    """Return the errors of the vertical (n,) from `from_s` on, and their share inside the stated 95 % ellipse."""
    level = scenario("level")
    walked = Scenario("on", "", level.world, (Stand(1.5), Pace().to(200.0), Stand(0.5)), drift=drift)
    wearer = SimulatedWearer(seed, walked, START_NS)
    track, tilts, covs = AttitudeTrack(wearer.calibration), [], []
    waiting = [
        told for told in told_steps(wearer, seconds, NOISE, seed) if told.step.t_after_ns < START_NS + covered_s * 1e9
    ]
    for sample in wearer.offline_samples(seconds):
        attitude = track.add_sample(sample)
        while waiting and waiting[0].t_told_ns <= sample.t_arrival_ns:
            track.add_camera_step(waiting.pop(0).step)
        if attitude.status is Status.VALID and sample.t_sample_ns > START_NS + from_s * 1e9:
            truth = wearer.gait.at(np.array([sample.t_sample_ns])).R_WB
            tilts.append(tilt_errors_W(np.array([so3.matrix_from_quaternion(attitude.q_WB)]), truth)[0])
            xx, xy, _, yy, _, _ = attitude.rotation_cov_W_rad2
            covs.append([[xx, xy], [xy, yy]])
    tilt = np.array(tilts)
    return np.degrees(np.linalg.norm(tilt, axis=1)), coverage(tilt, np.array(covs))


@pytest.mark.long
@pytest.mark.parametrize("seed", [61, 62])
def test_uncertainty_holds_when_a_bias_drifts_under_a_covered_camera(seed: int) -> None:
    rate = float(np.radians(1.0)) / 60.0
    error, inside = errors_deg(seed, Drift(w_rate_radps2=(rate, -rate, rate)), 40.0, 8.0, 8.0)
    assert len(error) > 100
    assert error.max() < 2.0
    assert inside > 0.95


@pytest.mark.long
@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (1.0, 0.0, 1.0), (-1.0, 0.5, 1.0)])
def test_a_jump_of_the_bias_is_followed_whatever_its_direction(direction: tuple[float, float, float]) -> None:
    x, y, z = (float(each) for each in np.radians(1.5) * np.array(direction) / np.linalg.norm(direction))
    error, _ = errors_deg(63, replace(Drift(), w_steps=((JUMP_S, (x, y, z)),)), 20.0, 99.0, JUMP_S)
    assert error.max() < 1.5
    assert rms(error) < 0.7

"""How far an IMU drifts is seen from its velocity of late; how far its gyroscope errs, from how its rate changes."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.evaluation.attitude import coverage, tilt_errors_W
from lab.evaluation.hip_motion import G_W_MPS2, Motion, with_mpu6050_noise
from messages import Residual
from messages.arrays import FloatArray
from perception.attitude.filter import AttitudeFilter, AttitudeSettings
from perception.attitude.kalman import AttitudeKalman

RESIDUAL = Residual(specific_force_mps2=0.02, scale=0.005)
HZ = 100
FROM_S = 20.0


def handled_in_place(seconds: float, seed: int, *, leaves_at_s: float = math.inf) -> Motion:
    """Rest for 5 s, then turn by up to 30° about every axis and shake by 0.15 m/s in one place; leave it within 1.5 s,
    at 1.2 m/s."""
    t_s = np.arange(-1, round(seconds * HZ) + 1)[:, np.newaxis] / HZ
    grown = np.clip(t_s / 5.0 - 1.0, 0.0, 1.0)
    R_WB = Rotation.from_rotvec(0.5 * grown * np.sin(2.0 * math.pi * np.array((0.5, 0.6, 0.2)) * t_s))
    a_W = grown * np.sin(2.0 * math.pi * np.array((1.1, 0.9, 1.3)) * t_s)
    a_W[:, 0] += np.where((t_s[:, 0] > leaves_at_s) & (t_s[:, 0] < leaves_at_s + 1.5), 0.8, 0.0)
    w_B = (R_WB[:-2].inv() * R_WB[2:]).as_rotvec() * HZ / 2.0
    sf_B = R_WB[1:-1].inv().apply(a_W[1:-1] - G_W_MPS2)
    motion = Motion(np.rint(1e9 * (t_s[1:-1, 0] + 1.0)).astype(np.int64), sf_B, w_B, R_WB[1:-1].as_matrix())
    return with_mpu6050_noise(motion, seed, sf_bias_mps2=RESIDUAL.specific_force_mps2, scale=RESIDUAL.scale)


def said(motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return tilt errors (n, 2), rad, from `FROM_S` on, and their stated covariances (n, 3, 3)."""
    filter_ = AttitudeFilter(AttitudeSettings(), RESIDUAL)
    R_WB, cov_W = [], []
    for t_ns, sf_B, w_B in zip(motion.t_ns.tolist(), motion.sf_B.tolist(), motion.w_B.tolist(), strict=True):
        filter_.update(t_ns, tuple(sf_B), tuple(w_B))
        R_WB.append(filter_.R_WB)
        cov_W.append(filter_.rotation_cov_W)
    late = motion.t_ns - motion.t_ns[0] >= round(1e9 * FROM_S)
    return tilt_errors_W(np.array(R_WB), motion.R_WB)[late], np.array(cov_W)[late]


def test_an_imu_that_only_turns_and_shakes_in_its_place_is_known_more_closely_than_one_that_walks() -> None:
    tilt_W, cov_W = said(handled_in_place(45.0, seed=1))
    assert coverage(tilt_W, cov_W) >= 0.95
    stated_rad = math.sqrt(np.mean(cov_W[:, 0, 0] + cov_W[:, 1, 1]))
    assert math.degrees(stated_rad) < 0.75


def test_one_who_leaves_the_place_is_admitted_by_what_is_stated() -> None:
    tilt_W, cov_W = said(handled_in_place(45.0, seed=0, leaves_at_s=25.0))
    assert coverage(tilt_W, cov_W) >= 0.95


def test_a_turn_errs_the_more_the_more_its_rate_changes() -> None:
    kalman = AttitudeKalman(AttitudeSettings(), RESIDUAL)
    steady = kalman.turn_var((1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.01)
    changing = kalman.turn_var((0.5, 0.0, 0.0), (1.5, 0.0, 0.0), 0.01)
    time_s = kalman.settings.gyro_scale_time_s
    assert steady == pytest.approx(RESIDUAL.scale**2 * time_s * 0.01)
    assert changing == pytest.approx(steady * (1.0 + (time_s * 100.0) ** 2))

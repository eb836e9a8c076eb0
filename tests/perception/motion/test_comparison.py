"""The camera's and the IMU's motion: lag, misfit, gain and gravity of a walk whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from perception.motion.comparison import CameraMotion, ImuMotion, lag_of, rate_misfit, velocity_misfit
from tests.bench.seen_motion import FRAME_NS, P_BC_M, R_BC, START_NS, WALKING_NS, gait, imu_samples, seen

WALK = gait(5)
STEPS = 24
X_BIAS_MPS2 = np.array([-0.98, 0.0, 0.0])


def stretch(noise: float = 0.0, late_ns: int = 0) -> tuple[CameraMotion, ImuMotion]:
    """Return a second of walking; its steps are stamped `late_ns` after they were."""
    steps = [
        seen(WALK, t_ns, t_ns + FRAME_NS, noise) for t_ns in range(WALKING_NS, WALKING_NS + STEPS * FRAME_NS, FRAME_NS)
    ]
    samples = imu_samples(WALK, WALKING_NS - 300_000_000, WALKING_NS + STEPS * FRAME_NS + 300_000_000)
    return (
        CameraMotion(
            from_s=1e-9 * np.array([s.t_before_ns + late_ns - START_NS for s in steps]),
            to_s=1e-9 * np.array([s.t_after_ns + late_ns - START_NS for s in steps]),
            w_B_radps=np.array([s.w_C_radps for s in steps]) @ R_BC.T,
            v_C_B_mps=np.array([s.v_C_mps for s in steps]) @ R_BC.T,
            p_BC_m=P_BC_M,
        ),
        ImuMotion(
            t_s=1e-9 * np.array([s.t_ns - START_NS for s in samples]),
            sf_B_mps2=np.array([s.sf_B_mps2 for s in samples]),
            w_B_radps=np.array([s.w_B_radps for s in samples]),
        ),
    )


def test_camera_and_imu_agree_on_one_motion() -> None:
    sight, feeling = stretch()
    rates, velocities = rate_misfit(sight, feeling, 0.0), velocity_misfit(sight, feeling, 0.0)
    assert rates.swing_radps.min() > 0.15
    assert rates.misfit_radps.max() < 0.01
    assert np.abs(rates.bias_radps).max() < 0.005
    assert velocities.swing_mps.min() > 0.04
    assert velocities.misfit_mps.max() < 0.005
    assert velocities.gain == pytest.approx(1.0, abs=0.1)
    assert velocities.gravity_mps2 == pytest.approx(9.80665, abs=0.02)


@pytest.mark.parametrize("late_ms", [-80, -20, -3, 0, 3, 20, 80])
def test_a_late_stamp_is_a_lag(late_ms: int) -> None:
    lag = lag_of(*stretch(noise=1.0, late_ns=late_ms * 1_000_000), longest_s=0.1, grid_s=0.01)
    assert lag.lag_s == pytest.approx(-1e-3 * late_ms, abs=1.5e-3)
    assert 1e-4 < lag.deviation_s < 2e-3


def test_without_motion_there_is_no_lag() -> None:
    sight, feeling = stretch()
    still = replace(sight, w_B_radps=np.zeros((STEPS, 3)))
    assert lag_of(still, replace(feeling, w_B_radps=np.zeros_like(feeling.w_B_radps)), 0.1, 0.01).deviation_s == np.inf


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_changed_sign_is_a_gain_of_minus_one(axis: int) -> None:
    sight, feeling = stretch(noise=1.0)
    sign = np.ones(3)
    sign[axis] = -1.0
    flipped = velocity_misfit(sight, replace(feeling, sf_B_mps2=feeling.sf_B_mps2 * sign), 0.0)
    assert flipped.gain[axis] == pytest.approx(-1.0, abs=0.5)
    turned = rate_misfit(sight, replace(feeling, w_B_radps=feeling.w_B_radps * sign), 0.0)
    assert turned.misfit_radps[axis] > 1.8 * turned.swing_radps[axis]
    assert np.delete(turned.misfit_radps, axis).max() < 0.03


def test_a_biased_accelerometer_changes_the_length_of_gravity() -> None:
    sight, feeling = stretch(noise=1.0)
    biased = velocity_misfit(sight, replace(feeling, sf_B_mps2=feeling.sf_B_mps2 + X_BIAS_MPS2), 0.0)
    assert biased.gravity_mps2 - 9.80665 == pytest.approx(0.98 * np.sqrt(0.5), abs=0.15)

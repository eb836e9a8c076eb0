"""Bias and scale from resting poses: exact, honest about what poses do not tell, and right 95 times in 100."""

import numpy as np
import pytest

from calib.imu.accelerometer import SUPPORTED_STD, fit_accelerometer
from lab.evaluation.calibration_trials import FACES, POSES, drawn_rests, drawn_values, symmetric
from messages.constants import STANDARD_GRAVITY_MPS2


def test_poses_without_noise_give_the_true_values_back() -> None:
    rng = np.random.default_rng(1)
    true = drawn_values(rng)
    fit = fit_accelerometer(drawn_rests(rng, true, POSES, std=1e-9), STANDARD_GRAVITY_MPS2)
    assert fit.values == pytest.approx(true, abs=1e-6)
    assert fit.matrix == pytest.approx(symmetric(true), abs=1e-6)
    assert fit.supported.all()
    assert np.abs(fit.norm).max() < 1e-7


@pytest.mark.parametrize("missing", range(6))
def test_an_axis_that_never_pointed_both_ways_is_not_told(missing: int) -> None:
    rng = np.random.default_rng(2)
    seen = FACES[[face for face in range(6) if face != missing]]
    fit = fit_accelerometer(drawn_rests(rng, drawn_values(rng), seen), STANDARD_GRAVITY_MPS2)
    axis = missing % 3
    assert not fit.axes_supported[axis]
    assert (fit.std[[axis, 3 + axis]] > SUPPORTED_STD[0]).all()
    assert not fit.supported[6:].any()  # no pose between the faces


@pytest.mark.long
def test_95_percent_intervals_hold_92_to_98_times_in_100_trials() -> None:
    inside, off = [], []
    for seed in range(1000, 1400):
        rng = np.random.default_rng(seed)
        true = drawn_values(rng)
        fit = fit_accelerometer(drawn_rests(rng, true, POSES), STANDARD_GRAVITY_MPS2)
        off.append(np.abs(fit.values - true))
        inside.append(off[-1] <= fit.half_width)
    share = np.mean(inside, axis=0)
    assert ((share >= 0.92) & (share <= 0.98)).all(), share
    worst = np.percentile(off, 95.0, axis=0)
    assert (worst[:3] < 2e-3).all()  # g
    assert (worst[3:6] < 1e-3).all()

"""What the calibration's residual leaves out of the accelerometer."""

import math

import numpy as np
import pytest

from messages import Residual
from perception.attitude.accelerometer import follow_temperature
from perception.attitude.error_state import SF_BIAS
from perception.attitude.filter import AttitudeFilter
from perception.attitude.kalman import AttitudeKalman
from perception.attitude.state import AttitudeSettings

SETTINGS = AttitudeSettings()
RESIDUAL = Residual(specific_force_mps2=0.0147)


def bias_std_mps2(temperatures_degC: list[float]) -> float:
    """Return the deviation of the bias, on each axis, after a die has had these temperatures."""
    state = AttitudeKalman(SETTINGS, RESIDUAL).new_state()
    for temperature_degC in temperatures_degC:
        follow_temperature(state, RESIDUAL.sf_per_K_std_mps2, temperature_degC)
    deviations = np.sqrt(np.diag(state.covariance[SF_BIAS, SF_BIAS]))
    assert np.ptp(deviations) == 0.0
    return float(deviations[0])


def test_a_die_that_warms_up_or_cools_down_makes_the_bias_less_certain_by_how_far_it_has_been() -> None:
    changed = math.hypot(0.0147, 20.0 * RESIDUAL.sf_per_K_std_mps2)
    assert bias_std_mps2([25.0, 35.0, 45.0, 30.0]) == pytest.approx(changed)
    assert bias_std_mps2([25.0, 5.0]) == pytest.approx(changed)


def test_what_is_no_temperature_of_a_die_tells_nothing() -> None:
    assert bias_std_mps2([25.0, math.nan, 25.0, 400.0, -273.0]) == pytest.approx(0.0147)


def test_the_filter_is_told_the_temperature_of_each_sample() -> None:
    deviations = []
    for warming_K in (0.0, 20.0):
        found = AttitudeFilter(SETTINGS, RESIDUAL)
        for k in range(200):
            found.update(
                10_000_000 * (k + 1), (0.0, 0.0, 9.80665), (0.0, 0.0, 0.0), temperature_degC=25.0 + warming_K * k / 200
            )
        deviations.append(found.sensor_errors.sf_var[0] ** 0.5)
    assert deviations[1] > 3.0 * deviations[0]

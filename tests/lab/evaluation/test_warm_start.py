"""The whole pipeline, switched on while its wearer walks, with and without what the unit had learnt."""

import math

import pytest

from lab.evaluation.warm_start import warm_start


@pytest.mark.long
def test_the_camera_starts_a_unit_in_motion_and_what_was_learnt_does_no_harm() -> None:
    learnt, cold, warm = warm_start(305)
    assert [max(each.gyro_std_radps) < 0.002 for each in learnt.biases] == [True]
    for start in (cold, warm):
        assert start.ground_s < 1.6
        assert start.slope_rms_rad < math.radians(0.5)
    assert warm.bias_error_radps <= cold.bias_error_radps

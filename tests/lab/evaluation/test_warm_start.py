"""The whole pipeline, switched on while its wearer walks, with and without what the unit had learnt."""

import pytest

from lab.evaluation.warm_start import warm_start


@pytest.mark.long
def test_a_unit_that_has_learnt_sees_the_ground_sooner_and_knows_its_bias_better() -> None:
    learnt, cold, warm = warm_start(305)
    assert [max(each.gyro_std_radps) < 0.002 for each in learnt.biases] == [True]
    assert warm.ground_s < cold.ground_s - 1.0
    assert warm.bias_error_radps < 0.5 * cold.bias_error_radps

"""A real photograph of a concrete floor, against the plane fitted to its true disparity."""

from lab.evaluation.real_pair import compare_floor, load


def test_the_floor_of_a_real_pair_is_measured() -> None:
    found = compare_floor(load())
    assert abs(found.pitch_error_deg) <= 0.10
    assert found.angle_error_deg <= 0.15
    assert abs(found.height_error_mm) <= 4.0

"""Wrong focal lengths: what they make of a plane, and what is known of them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages.arrays import FloatArray
from perception.depth.focal_lengths import UNWATCHED, FocalDifference, difference_var, plane_errors_px

F_PX, BASELINE_M = 350.0, 0.12
THETA = F_PX * BASELINE_M / 0.95 * np.array([0.05, 0.68, 0.72])
"""A floor 0.95 m below a camera that looks down at 45°."""
shares = st.floats(-0.01, 0.01)
stds = st.floats(1e-5, 0.01)


def seen_plane(left: float, right: float) -> FloatArray:
    """Return θ fitted to a grid of points on THETA, seen by eyes whose focal lengths are off by these shares."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.3, 0.3, 7), np.linspace(-0.2, 0.2, 5)))
    rays = np.column_stack((x, y, np.ones_like(x)))
    x_right = x - rays @ THETA / F_PX
    disparity_px = F_PX * ((1.0 + left) * x - (1.0 + right) * x_right)
    taken = rays * np.array([1.0 + left, 1.0 + left, 1.0])
    theta: FloatArray = np.linalg.lstsq(taken, disparity_px)[0]
    return theta


def test_the_errors_are_those_of_points_that_are_seen_with_the_wrong_focal_lengths() -> None:
    std = 1e-5
    errors = plane_errors_px(THETA, F_PX, std, UNWATCHED)
    by_eye = np.array([seen_plane(std, 0.0) - THETA, seen_plane(0.0, std) - THETA])
    np.testing.assert_allclose(errors.T @ errors, by_eye.T @ by_eye, rtol=1e-3, atol=1e-9)


def test_three_thousandths_in_one_eye_tilt_the_ground_by_more_than_a_degree() -> None:
    assert abs(seen_plane(0.003, 0.0)[0] - THETA[0]) / np.hypot(*THETA[1:]) > np.radians(1.2)


def test_what_was_seen_bounds_the_difference() -> None:
    assert difference_var(1e-6, UNWATCHED) == 1e-6
    assert difference_var(1e-6, FocalDifference(0.0, 1e-4)) == pytest.approx(1e-8, rel=0.02)
    assert difference_var(1e-8, FocalDifference(0.0, 1.0)) == pytest.approx(1e-8, rel=1e-3)


def test_a_calibration_that_is_contradicted_is_not_believed() -> None:
    assert math.sqrt(difference_var(1e-8, FocalDifference(0.003, 3e-4))) == pytest.approx(0.003, rel=0.05)


@given(calibrated=stds, share=shares, std=stds)
def test_no_more_is_left_than_calibration_or_what_was_seen_leaves(calibrated: float, share: float, std: float) -> None:
    found = difference_var(calibrated**2, FocalDifference(share, std))
    assert 0.0 < found <= 1.001 * max(calibrated**2, share**2)
    assert found <= 1.001 * (std**2 + share**2)

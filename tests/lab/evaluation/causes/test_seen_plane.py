"""What an attitude's error alone makes of a plane, and the sums over frames."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lab.evaluation.causes.ledger import AS_MEASURED, Ledger, SlopeError
from lab.evaluation.causes.seen_plane import error_of_attitude
from messages import GroundTruth
from messages.arrays import FloatArray

angles = st.floats(-0.2, 0.2)


def truth(ahead_rad: float, across_rad: float, height_m: float = 0.95) -> GroundTruth:
    return GroundTruth(
        t_exposure_ns=1,
        slope_sagittal_rad=ahead_rad,
        slope_frontal_rad=across_rad,
        height_m=height_m,
        q_WB=(1.0, 0.0, 0.0, 0.0),
        kind="ramp",
        transition=False,
        standing=True,
    )


def looking_down(yaw_rad: float) -> FloatArray:
    """Return R_WC of a camera 45° down, its optical axis z."""
    ahead_down = Rotation.from_euler("ZYX", (yaw_rad, math.radians(45.0), 0.0))
    axes = np.array(((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)))
    R_WC: FloatArray = ahead_down.as_matrix() @ axes
    return R_WC


@given(angles, angles, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_an_attitude_without_error_makes_none_whatever_its_yaw(
    ahead_rad: float, across_rad: float, yaw_rad: float, turned_rad: float
) -> None:
    true_R_WC = looking_down(yaw_rad)
    told_R_WC = Rotation.from_euler("z", turned_rad).as_matrix() @ true_R_WC
    error = error_of_attitude(told_R_WC, true_R_WC, truth(ahead_rad, across_rad))
    assert error is not None
    assert (*error.slopes, error.height_m) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


@given(st.floats(-0.02, 0.02), st.floats(-3.0, 3.0))
def test_a_camera_told_lower_than_it_looks_sees_level_ground_fall(pitch_rad: float, yaw_rad: float) -> None:
    true_R_WC = looking_down(yaw_rad)
    across = Rotation.from_euler("z", yaw_rad).as_matrix()[:, 1]
    told_R_WC = Rotation.from_rotvec(pitch_rad * across).as_matrix() @ true_R_WC
    error = error_of_attitude(told_R_WC, true_R_WC, truth(0.0, 0.0))
    assert error is not None
    assert error.sagittal_rad == pytest.approx(-pitch_rad, abs=1e-9)
    assert error.frontal_rad == pytest.approx(0.0, abs=1e-9)
    assert error.height_m == pytest.approx(0.95 * (1.0 / math.cos(pitch_rad) - 1.0), abs=1e-9)


def test_a_camera_that_looks_straight_down_has_no_heading() -> None:
    down = Rotation.from_euler("x", 180.0, degrees=True).as_matrix()
    assert error_of_attitude(down, looking_down(0.0), truth(0.0, 0.0)) is None


def test_a_cause_is_scored_by_what_it_makes_and_by_what_is_left() -> None:
    ledger = Ledger({"bias": "none", "absent": "nothing"})
    for frame, (whole, left) in enumerate([(0.03, 0.01), (0.03, -0.01), (0.01, math.nan)]):
        ledger.add(AS_MEASURED, frame, SlopeError(whole, 0.0, 0.002))
        if not math.isnan(left):
            ledger.add("bias", frame, SlopeError(left, 0.0, 0.001))
    measured, bias = ledger.scores()
    assert (measured.frames, bias.frames) == (3, 2)
    assert bias.left_sagittal_deg == pytest.approx(math.degrees(0.01))
    assert bias.part_sagittal_deg == pytest.approx(math.degrees(math.sqrt((0.02**2 + 0.04**2) / 2)))
    assert bias.part_height_mm == pytest.approx(1.0)
    assert measured.left_sagittal_deg == pytest.approx(math.degrees(math.sqrt((2 * 0.03**2 + 0.01**2) / 3)))

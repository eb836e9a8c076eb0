"""What a walk tells of a pair: which share of a scale is the baseline's and which the toe-in's, and what is left."""

import math

import msgspec
import numpy as np
import pytest

from calib.pair import CORNERS_Z_M, PairErrors, lengthened, pair_errors, put_right, toed_in
from messages import Calibration
from messages.constants import NORMAL_95
from sim_rig.unit import RESIDUAL, draw_unit

TRUE = msgspec.structs.replace(draw_unit(7).exact_calibration(), residual=RESIDUAL)
BASELINE_M = math.hypot(*TRUE.stereo.X_RL.p_m)
TOE_IN_SHARE = -CORNERS_Z_M / BASELINE_M
"""By what share distances are too long for each radian of toe-in."""


def with_residual(baseline: float, toe_in_rad: float, focal_length: float = 0.0) -> Calibration:
    residual = msgspec.structs.replace(RESIDUAL, baseline=baseline, toe_in_rad=toe_in_rad, focal_length=focal_length)
    return msgspec.structs.replace(TRUE, residual=residual)


def too_long(calibration: Calibration) -> float:
    """Return by what share a point at the corners' distance, which the true pair sees, is too far."""
    true, said = TRUE.stereo.X_RL, calibration.stereo.X_RL
    p_L = np.array((0.06, 0.0, CORNERS_Z_M))
    ray_R = np.array(true.R) @ p_L + np.array(true.p_m)
    ray_L = np.array(said.R) @ p_L
    (times, _), *_ = np.linalg.lstsq(np.column_stack((ray_L, -ray_R)), -np.array(said.p_m), rcond=None)
    return float(times) - 1.0


@pytest.mark.parametrize(
    ("residual", "taken"),
    [((2e-3, 1e-9), "baseline"), ((1e-9, 2e-4), "toe_in")],
)
def test_what_is_known_worse_takes_the_scale(residual: tuple[float, float], taken: str) -> None:
    found = pair_errors(with_residual(*residual), 0.002, 1e-6)
    assert found is not None
    expected = {"baseline": (0.002, 0.0), "toe_in": (0.0, 0.002 / TOE_IN_SHARE)}[taken]
    assert (found.baseline, found.toe_in_rad) == pytest.approx(expected, rel=1e-3, abs=1e-8)
    assert max(found.baseline_std, -found.toe_in_std_rad * TOE_IN_SHARE) < 1e-5


def test_what_a_walk_does_not_tell_apart_stays_uncertain_in_both() -> None:
    known = with_residual(1e-3, -1e-3 / TOE_IN_SHARE)
    found = pair_errors(known, 0.002, 1e-6)
    assert found is not None
    assert found.baseline == pytest.approx(found.toe_in_rad * TOE_IN_SHARE)
    assert found.baseline_std == pytest.approx(1e-3 / math.sqrt(2.0), rel=1e-3)
    assert -found.toe_in_std_rad * TOE_IN_SHARE == pytest.approx(1e-3 / math.sqrt(2.0), rel=1e-3)
    assert found.scale_std < 1e-5


def test_a_scale_that_the_walk_tells_badly_changes_nothing() -> None:
    known = with_residual(1e-4, 1e-5)
    found = pair_errors(known, 0.01, 0.05)
    assert found is not None
    assert abs(found.baseline) < 1e-6
    assert found.baseline_std == pytest.approx(1e-4, rel=1e-3)


def test_a_scale_beyond_what_the_file_states_is_not_shared_out() -> None:
    assert pair_errors(with_residual(1e-3, 1e-9), 0.0045, 1e-3) is None
    assert pair_errors(with_residual(1e-3, 1e-9), 0.004, 1e-3) is not None
    assert pair_errors(with_residual(1e-3, 1e-9, focal_length=2e-3), 0.0045, 1e-3) is not None


@pytest.mark.parametrize(("baseline", "toe_in_rad"), [(0.004, 0.0), (0.0, 4e-4), (-0.002, 3e-4)])
def test_put_right_takes_out_what_makes_distances_too_long(baseline: float, toe_in_rad: float) -> None:
    wrong = toed_in(lengthened(TRUE, 1.0 + baseline), toe_in_rad)
    assert too_long(wrong) == pytest.approx(baseline + TOE_IN_SHARE * toe_in_rad, rel=0.02)
    made = put_right(wrong, PairErrors(baseline, 1e-3, toe_in_rad, 1e-4, 1e-3))
    assert too_long(made) == pytest.approx(0.0, abs=1e-6)
    assert (made.residual.baseline, made.residual.toe_in_rad) == (1e-3, 1e-4)
    assert made.X_BL == wrong.X_BL


def test_its_intervals_hold() -> None:
    """Errors drawn as the file states them, found with the walk's own."""
    chance, known, held = np.random.default_rng(7), with_residual(5e-4, 1.7e-4, 1e-4), []
    for _ in range(2000):
        baseline, toe_in_rad, focal = chance.normal(0.0, (5e-4, 1.7e-4, 1e-4))
        scale = baseline + TOE_IN_SHARE * toe_in_rad + focal
        found = pair_errors(known, scale + chance.normal(0.0, 8e-4), 8e-4)
        if found is None:
            continue
        left = baseline - found.baseline, toe_in_rad - found.toe_in_rad
        stds = found.baseline_std, found.toe_in_std_rad, found.scale_std
        held.append(np.abs((*left, left[0] + TOE_IN_SHARE * left[1])) <= NORMAL_95 * np.array(stds))
    assert len(held) > 1980
    assert (np.abs(np.mean(held, axis=0) - 0.95) < 0.02).all()

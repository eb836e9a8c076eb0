"""Steps made from the truth: what they add up to, when they are told, and what calibration and noise do to them."""

from itertools import pairwise

import numpy as np
import pytest

from calib.pair import CORNERS_Z_M, lengthened, toed_in
from lab.evaluation.told_steps import OdometerNoise, ToldStep, pair_off, told_steps
from perception import so3
from sim_rig.unit import draw_unit
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
EXACT = OdometerNoise(0.0, 0.0)
USUAL = OdometerNoise(0.012, 0.007)


def told(noise: OdometerNoise, *, perfect: bool, seed: int = 3) -> tuple[SimulatedWearer, list[ToldStep]]:
    wearer = SimulatedWearer(3, scenario("turns"), START_NS, perfect_calibration=perfect)
    return wearer, list(told_steps(wearer, 9.0, noise, seed))


def test_exact_steps_of_an_exact_calibration_lead_from_the_first_frame_to_the_last() -> None:
    wearer, steps = told(EXACT, perfect=True)
    first, last = steps[0].step.t_before_ns, steps[-1].step.t_after_ns
    truth = wearer.gait.at(np.array([first, last]))
    p_BL = np.array(wearer.unit.X_BL.p_m)
    R_WB, p_WL = truth.R_WB[0], truth.p_WB_m[0] + truth.R_WB[0] @ p_BL
    for each in steps:
        p_WL = p_WL + R_WB @ np.array(each.step.travel_B)
        R_WB = R_WB @ so3.exp(np.array(each.step.turn_B))
    np.testing.assert_allclose(R_WB, truth.R_WB[1], atol=1e-9)
    np.testing.assert_allclose(p_WL, truth.p_WB_m[1] + truth.R_WB[1] @ p_BL, atol=1e-9)


def test_a_step_is_told_when_the_frame_after_it_has_arrived() -> None:
    _, steps = told(USUAL, perfect=False)
    late_s = [1e-9 * (each.t_told_ns - each.step.t_after_ns) for each in steps]
    assert 0.075 < min(late_s) < max(late_s) < 0.1
    assert all(a.step.t_after_ns == b.step.t_before_ns for a, b in pairwise(steps))


def test_a_baseline_makes_distances_long_and_points_turned_to_the_right_make_them_short() -> None:
    unit = draw_unit(3)
    made = toed_in(lengthened(unit.exact_calibration(), 1.002), 3e-4)
    off = pair_off(unit, made)
    assert (off.baseline, off.toe_in_rad) == pytest.approx((2e-3, 3e-4), rel=1e-3)
    assert off.distances == pytest.approx(2e-3 - 3e-4 * CORNERS_Z_M / np.linalg.norm(made.stereo.X_RL.p_m), rel=1e-3)


def test_noise_has_the_size_that_it_states() -> None:
    _, steps = told(USUAL, perfect=True)
    _, exact = told(EXACT, perfect=True)
    off = [
        np.subtract((*a.step.turn_B, *a.step.travel_B), (*b.step.turn_B, *b.step.travel_B))
        for a, b in zip(steps, exact, strict=True)
    ]
    stated = np.sqrt(np.diag(steps[0].step.covariance))
    np.testing.assert_allclose(stated, 0.05 * np.repeat((0.007, 0.012), 3))
    np.testing.assert_allclose(np.std(off, axis=0), stated, rtol=0.25)


def test_the_calibrations_residual_turns_and_stretches_the_steps() -> None:
    _, off = told(EXACT, perfect=False)
    _, exact = told(EXACT, perfect=True)
    walked = [np.linalg.norm([each.step.travel_B for each in steps], axis=1).sum() for steps in (off, exact)]
    assert 1e-5 < abs(walked[0] / walked[1] - 1.0) < 0.01
    assert np.ptp([np.subtract(a.step.turn_B, b.step.turn_B) for a, b in zip(off, exact, strict=True)]) > 1e-6


def test_a_seed_draws_the_same_noise() -> None:
    (_, once), (_, again), (_, other) = (told(USUAL, perfect=False, seed=seed) for seed in (3, 3, 4))
    assert [each.step.turn_B for each in once] == [each.step.turn_B for each in again]
    assert once[0].step.turn_B != other[0].step.turn_B
    assert once[0].step.travel_B == pytest.approx(other[0].step.travel_B, abs=0.01)

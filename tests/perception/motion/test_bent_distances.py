"""Distances that are bent across the picture, told by how points move: sized right, and never by their scale alone."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from messages import Residual
from messages.arrays import FloatArray
from perception.motion.bent_distances import Bend, BentDistances
from perception.motion.inner_motion import steady_motion
from perception.motion.rigid_step import PointsInStep, RigidStepSettings, solve

SETTINGS = RigidStepSettings(f_px=175.0)
STEP_S, NOISE, BASELINE_M = 0.05, 0.05 / 175.0, 0.12
STANDS, WALKS = 0.0, 1.1
ROW_S = 0.016  # from one row to another, as far apart as its tangents differ by 1

bends = st.floats(-0.01, 0.01)


def bend(
    seed: int,
    speed_mps: float,
    wrong: tuple[float, float] = (0.0, 0.0),
    scale: float = 1.0,
    accelerates: FloatArray | None = None,
) -> Bend:
    """Return what one step of a camera that looks down at about 45° tells, on bumpy ground with distances that are
    `wrong` by so much and all too long by `scale`; where it `accelerates` (3,), m/s², nothing tells that it does."""
    chance = np.random.default_rng(seed)
    rays = np.column_stack((chance.uniform(-0.7, 0.7, 70), chance.uniform(-0.45, 0.45, 70), np.ones(70)))
    points_C = rays * (0.95 / (0.7071 * (rays[:, 1] + 1.0)) + chance.normal(0.0, 0.02, 70))[:, None]
    rates = np.concatenate((chance.normal(0.0, 0.5, 3), speed_mps * np.array([0.05, -0.6, 0.8])))
    expected, times_s = steady_motion(rates), ROW_S * rays[:, 1]
    if accelerates is None:
        truly = expected = replace(expected, acceleration_sd=None)
    else:
        truly = replace(expected, p_m=expected.p_m + 0.5 * np.outer(expected.t_s**2, accelerates))
    moved_C = PointsInStep(points_C, BASELINE_M / points_C[:, 2], times_s, times_s + STEP_S, truly).moved(np.zeros(6))
    seen = (moved_C[:2] / moved_C[2]).T + chance.normal(0.0, NOISE, (70, 2))
    disparity = BASELINE_M / points_C[:, 2] + chance.normal(0.0, NOISE, 70) - rays[:, :2] @ wrong
    disparity /= scale
    measured_C = rays * (BASELINE_M / disparity)[:, None]
    step = solve(PointsInStep(measured_C, disparity, times_s, times_s + STEP_S, expected), seen, None, SETTINGS)
    assert step is not None
    return step.bend


def size(steps: list[Bend]) -> tuple[FloatArray, FloatArray]:
    """Return what steps tell together (2,), and its covariance (2, 2)."""
    covariance = np.linalg.inv(np.sum([each.information for each in steps], axis=0))
    return covariance @ np.sum([each.weighted for each in steps], axis=0), covariance


@given(across=bends, along=bends, scale=st.floats(0.95, 1.05), seed=st.integers(0, 2**32 - 101))
@settings(max_examples=25, deadline=None)
def test_a_bend_is_sized_within_its_covariance_whatever_the_scale(
    across: float, along: float, scale: float, seed: int
) -> None:
    found, covariance = size([bend(seed + k, WALKS, (across, along), scale) for k in range(12)])
    off, std = np.abs(found - (across, along)), np.sqrt(covariance.diagonal())
    assert std.max() < 6e-4
    assert (off < 5.0 * std + 0.12 * max(abs(across), abs(along))).all()


def test_only_bent_distances_contradict_and_only_known_ones_are_straight() -> None:
    sound, bent, standing = (BentDistances(Residual()) for _ in range(3))
    for k in range(15):
        sound.add(bend(k, WALKS, scale=1.04), 0.0)
        bent.add(bend(k, WALKS, (0.004, 0.0)), 0.0)
        standing.add(bend(k, STANDS, (0.004, 0.0)), 0.0)
    assert (sound.contradicts, sound.is_straight) == (False, True)
    assert (bent.contradicts, bent.is_straight) == (True, False)
    assert (standing.contradicts, standing.is_straight) == (False, False)


def test_what_was_bent_is_straight_again_within_two_seconds_of_walking() -> None:
    bent = BentDistances(Residual())
    for k in range(30):
        bent.add(bend(k, WALKS, (0.0, -0.004)), 0.0)
    assert bent.contradicts
    for k in range(40):
        bent.add(bend(k, WALKS), 0.0)
    assert (bent.contradicts, bent.is_straight) == (False, True)
    bent.forget()
    assert (bent.contradicts, bent.is_straight) == (False, False)


@pytest.mark.parametrize("residual", [Residual(rows_rad=2e-3), Residual(toe_in_rad=2e-3), Residual(focal_length=2e-3)])
def test_what_the_calibration_may_leave_is_no_bend(residual: Residual) -> None:
    watch = BentDistances(residual)
    for k in range(15):
        watch.add(bend(k, WALKS, (0.004, 0.0)), 0.0)
    assert not watch.contradicts


def test_an_acceleration_that_nothing_tells_is_no_bend() -> None:
    """Gravity taken for one, as where the vertical is off by 15°, moves each row of a rolling shutter by as much more
    as it is exposed later."""
    watch = BentDistances(Residual())
    for k in range(24):
        watch.add(bend(k, WALKS, accelerates=np.array([0.0, -2.0, 1.5])), 0.0)
        assert not watch.contradicts


def test_errors_that_corners_share_are_no_bend() -> None:
    watch = BentDistances(Residual())
    for k in range(60):
        watch.add(bend(k, WALKS, (0.004, 0.0)), 0.001)
    assert not watch.contradicts
    assert not watch.is_straight

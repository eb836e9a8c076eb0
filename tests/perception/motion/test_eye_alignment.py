"""How the eyes stand to each other, from what their rows show: against drawn corners whose skew is known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from messages.arrays import FloatArray
from perception.motion.eye_alignment import EyeAlignment, RowSkew, row_skew

F_PX, RAW_F_PX = 230.0, 700.0
NOISE = 0.15 / F_PX
WALKED, STOOD = 0.1, 0.0001
"""That corners move from frame to frame, of a ray's tangent."""

turns = st.floats(-0.03, 0.03)


def corners(seed: int, count: int = 80) -> tuple[np.random.Generator, FloatArray, FloatArray]:
    random = np.random.default_rng(seed)
    return random, random.uniform(-0.6, 0.6, count), random.uniform(-0.45, 0.3, count)


def seen(seed: int, roll: float = 0.0, growth: float = 0.0, toe: float = 0.0, false_matches: int = 0) -> RowSkew | None:
    """Return what is made of a frame whose eyes stand like this."""
    random, x, y = corners(seed)
    lower = roll * x + growth * y + toe * x * y + random.normal(0.0, NOISE, len(x))
    lower[:false_matches] = random.uniform(-3.0, 3.0, false_matches) / F_PX
    return row_skew(lower, x, y, F_PX)


@given(roll=turns, growth=turns, toe=turns, false_matches=st.integers(0, 16), seed=st.integers(0, 2**32 - 1))
def test_turns_are_found_within_their_covariance_in_spite_of_false_matches(
    roll: float, growth: float, toe: float, false_matches: int, seed: int
) -> None:
    found = seen(seed, roll, growth, toe, false_matches)
    assert found is not None
    off = found.by_place - (roll, growth, toe)
    assert off @ np.linalg.solve(found.covariance, off) < 40.0  # χ² of three: 1e-8


def test_too_few_corners_or_such_as_agree_on_nothing_tell_nothing() -> None:
    random, x, y = corners(1)
    assert row_skew(np.zeros(19), x[:19], y[:19], F_PX) is None
    assert row_skew(random.uniform(-1.0, 1.0, len(x)) / F_PX, x, y, F_PX) is None


def test_corners_on_one_column_say_nothing_of_what_differs_between_columns() -> None:
    random, _, y = corners(2)
    found = row_skew(random.normal(0.0, NOISE, len(y)), np.zeros(len(y)), y, F_PX)
    assert found is not None
    roll_std, growth_std, toe_std = np.sqrt(found.covariance.diagonal())
    assert min(roll_std, toe_std) > 0.01
    assert growth_std < 0.001


@pytest.mark.parametrize(
    ("roll", "growth", "toe"), [(0.003, 0.0, 0.0), (-0.003, 0.0, 0.0), (0.0, -0.005, 0.0), (0.0, 0.0, 0.01)]
)
def test_a_turned_eye_is_told_within_a_second_and_forgiven_after_three_frames(
    roll: float, growth: float, toe: float
) -> None:
    alignment = EyeAlignment(RAW_F_PX, rows_rad=0.0)
    for seed in range(40):
        alignment.add(seen(seed), WALKED, 0.0)
        assert not alignment.contradicts
    told = []
    for seed in range(40, 60):
        alignment.add(seen(seed, roll, growth, toe), WALKED, 0.0)
        told.append(alignment.contradicts)
    assert told[-1]
    forgiven = []
    for seed in range(60, 80):
        alignment.add(seen(seed), WALKED, 0.0)
        forgiven.append(not alignment.contradicts)
    assert forgiven[-1]
    assert not any(forgiven[:2])


def test_what_the_calibration_may_leave_is_no_turned_eye() -> None:
    sure, rough = EyeAlignment(RAW_F_PX, rows_rad=0.0), EyeAlignment(RAW_F_PX, rows_rad=0.002)
    for seed in range(20):
        skew = seen(seed, roll=0.004)
        sure.add(skew, WALKED, 0.0)
        rough.add(skew, WALKED, 0.0)
    assert sure.contradicts
    assert not rough.contradicts


def test_frames_that_tell_nothing_change_nothing() -> None:
    alignment = EyeAlignment(RAW_F_PX, rows_rad=0.0)
    assert math.isinf(alignment.focal_difference.std)
    alignment.add(seen(3, roll=0.02), WALKED, 0.0)
    before = alignment.focal_difference
    for _ in range(5):
        alignment.add(None, WALKED, 0.0)
    assert alignment.contradicts
    assert alignment.focal_difference == before


def test_errors_that_corners_share_are_no_turned_eye_but_a_larger_turn_is() -> None:
    shared, turned = EyeAlignment(RAW_F_PX, rows_rad=0.0), EyeAlignment(RAW_F_PX, rows_rad=0.0)
    for seed in range(20):
        shared.add(seen(seed, growth=0.006), WALKED, 0.002)
        turned.add(seen(seed, growth=0.015), WALKED, 0.002)
    assert not shared.contradicts
    assert turned.contradicts
    assert shared.focal_difference.std > 0.0019


def test_who_stands_sees_the_same_errors_again() -> None:
    """The same corners, frame after frame, are off by chance of the first; walked over, the frames tell."""
    alignment = EyeAlignment(RAW_F_PX, rows_rad=0.0)
    for _ in range(60):
        alignment.add(seen(1, growth=0.0021), STOOD, 0.0)
    stood, told_standing = alignment.focal_difference.std, alignment.contradicts
    for seed in range(60):
        alignment.add(seen(seed, growth=0.0021), WALKED, 0.0)
    assert (told_standing, alignment.contradicts) == (False, True)
    assert alignment.focal_difference.std < 0.8 * stood


def test_errors_that_corners_share_acquit_no_eye_that_was_told() -> None:
    alignment, told = EyeAlignment(RAW_F_PX, rows_rad=0.0), list[bool]()
    for seed in range(20):
        alignment.add(seen(seed, growth=0.006), WALKED, 0.0 if seed < 10 else 0.002)
        told.append(alignment.contradicts)
    assert all(told[9:])

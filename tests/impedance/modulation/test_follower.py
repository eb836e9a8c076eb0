"""A controller that follows set-points: bounds, rates and the way back hold for whatever it is told."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance.modulation.curve import BACK_S, Limits, StanceCurve
from impedance.modulation.follower import LONGEST_STANCE_S, MAX_AGE_S, Follower, Trust
from impedance.modulation.table import published
from messages.arrays import FloatArray
from messages.inputs import GaitPhase

STEP_NS = 5_000_000
LEVEL = published().level(75.0)
LIMITS = Limits(LEVEL)
UPHILL = published().at(0.1, 0.0, 75.0)[0]
SWING, STANCE, UNKNOWN = GaitPhase.SWING, GaitPhase.STANCE, GaitPhase.UNKNOWN

numbers = st.floats(allow_nan=True, allow_infinity=True, width=32)
anything = st.lists(numbers, min_size=15, max_size=15).map(lambda told: np.array(told).reshape(5, 3))
set_points = st.one_of(st.just(UPHILL.points), anything, st.just(np.zeros((2, 3))))
events = st.lists(
    st.tuples(
        st.sampled_from(["step", "step", "step", "take", "refuse"]),
        st.sampled_from(GaitPhase),
        set_points,
        st.integers(0, 400),
        st.floats(allow_nan=True, allow_infinity=True),
        st.booleans(),
    ),
    max_size=40,
)


def state_of(follower: Follower) -> Trust:
    """Return the state anew: it changes with each step."""
    return follower.state


def walked(follower: Follower, t_ns: int, phase: GaitPhase, seconds: float, told: FloatArray | None = None) -> int:
    """Step for so long, telling `told` afresh each 50 ms; return the time reached."""
    for k in range(round(1e9 * seconds) // STEP_NS):
        t_ns += STEP_NS
        if told is not None and k % 10 == 0:
            follower.take(told, t_ns - 40_000_000)
        follower.step(t_ns, phase, 0.3)
    return t_ns


@settings(max_examples=60)
@given(told=events)
def test_whatever_it_is_told_it_stays_finite_within_the_bounds_and_the_rates(
    told: list[tuple[str, GaitPhase, FloatArray, int, float, bool]],
) -> None:
    follower, t_ns = Follower(LIMITS, 0), 0
    for what, phase, points, milliseconds, share, contradicted in told:
        before, since_ns = follower.curve.points, t_ns
        if what == "take":
            follower.take(points, t_ns - 1_000_000 * milliseconds)
        elif what == "refuse":
            follower.refuse()
        else:
            t_ns += 1_000_000 * milliseconds
            out = follower.step(t_ns, phase, share, contradicted=contradicted)
            assert all(map(math.isfinite, out))
            assert out.stiffness_nm_per_rad > 0.0
            assert out.damping_nms_per_rad > 0.0
            changed = np.abs(follower.curve.points - before)
            assert (changed <= LIMITS.rates * 1e-9 * (t_ns - since_ns) + 1e-9).all()
        assert (follower.curve.points >= LIMITS.low - 1e-9).all()
        assert (follower.curve.points <= LIMITS.high + 1e-9).all()


@settings(max_examples=25)
@given(told=events, phase=st.sampled_from(GaitPhase))
def test_in_silence_it_is_back_at_level_ground_in_the_stated_time(
    told: list[tuple[str, GaitPhase, FloatArray, int, float, bool]], phase: GaitPhase
) -> None:
    follower, t_ns = Follower(LIMITS, 0), 0
    for what, before, points, milliseconds, share, _ in told:
        if what == "take":
            follower.take(points, t_ns - 1_000_000 * milliseconds)
        t_ns += 1_000_000 * milliseconds
        follower.step(t_ns, before, share)
    stated_s = BACK_S + (LONGEST_STANCE_S if phase is STANCE else MAX_AGE_S)
    walked(follower, t_ns, phase, stated_s + 0.02)
    assert state_of(follower) is Trust.LEVEL
    np.testing.assert_allclose(follower.curve.points, LEVEL.points, rtol=0.0, atol=1e-9)


def test_the_stated_times_are_those_of_the_page() -> None:
    assert (MAX_AGE_S, LONGEST_STANCE_S, BACK_S) == (0.150, 1.5, 0.25)


@pytest.mark.parametrize(("extreme", "end"), [(1e6, LIMITS.high), (-1e6, LIMITS.low)])
def test_a_set_point_beyond_all_reason_goes_no_further_than_the_limits(extreme: float, end: FloatArray) -> None:
    follower = Follower(LIMITS, 0)
    walked(follower, 0, SWING, 1.0, np.full((5, 3), extreme))
    np.testing.assert_allclose(follower.curve.points, end)


def test_it_trusts_in_swing_holds_in_stance_and_falls_back_at_toe_off() -> None:
    follower = Follower(LIMITS, 0)
    t_ns = walked(follower, 0, SWING, 0.4, UPHILL.points)
    assert state_of(follower) is Trust.TRUST
    np.testing.assert_allclose(follower.curve.points, UPHILL.points)
    t_ns = walked(follower, t_ns, STANCE, 0.7)
    assert state_of(follower) is Trust.HOLD  # in silence, through the whole stance
    np.testing.assert_allclose(follower.curve.points, UPHILL.points)
    t_ns = walked(follower, t_ns, SWING, STEP_NS * 1e-9)
    assert state_of(follower) is Trust.LEVEL
    walked(follower, t_ns, SWING, BACK_S)
    np.testing.assert_allclose(follower.curve.points, LEVEL.points)


def test_what_is_told_in_stance_does_not_change_that_stance() -> None:
    follower = Follower(LIMITS, 0)
    t_ns = walked(follower, 0, SWING, 0.4, UPHILL.points)
    downhill = published().at(-0.1, 0.0, 75.0)[0]
    t_ns = walked(follower, t_ns, STANCE, 0.01)
    walked(follower, t_ns, STANCE, 0.5, downhill.points)
    np.testing.assert_allclose(follower.curve.points, UPHILL.points)


def test_an_older_set_point_does_not_take_the_place_of_a_newer_one() -> None:
    follower = Follower(LIMITS, 0)
    t_ns = walked(follower, 0, SWING, 0.4, UPHILL.points)
    follower.take(LEVEL.points, t_ns - 110_000_000)
    walked(follower, t_ns, SWING, 0.03)
    np.testing.assert_allclose(follower.curve.points, UPHILL.points)


def test_who_stands_for_long_stands_as_on_level_ground() -> None:
    follower = Follower(LIMITS, 0)
    t_ns = walked(follower, 0, SWING, 0.4, UPHILL.points)
    t_ns = walked(follower, t_ns, STANCE, LONGEST_STANCE_S)
    assert state_of(follower) is Trust.HOLD
    walked(follower, t_ns, STANCE, 0.02)
    assert state_of(follower) is Trust.LEVEL


@pytest.mark.parametrize("age_ms", [151, 200, 10_000])
def test_an_old_set_point_is_not_acted_upon(age_ms: int) -> None:
    follower = Follower(LIMITS, 0)
    follower.take(UPHILL.points, 10**9 - 1_000_000 * age_ms)
    follower.step(10**9, SWING, 0.0)
    assert state_of(follower) is Trust.LEVEL


def test_a_camera_covered_in_swing_means_level_ground_at_contact() -> None:
    follower = Follower(LIMITS, 0)
    t_ns = walked(follower, 0, SWING, 0.2, UPHILL.points)
    t_ns = walked(follower, t_ns, SWING, MAX_AGE_S)
    walked(follower, t_ns, STANCE, 0.02)
    assert state_of(follower) is Trust.LEVEL


def test_a_refusal_ends_trust_at_once_but_not_a_stance_that_has_begun() -> None:
    follower = Follower(LIMITS, 0)
    t_ns = walked(follower, 0, SWING, 0.4, UPHILL.points)
    t_ns = walked(follower, t_ns, STANCE, 0.1)
    follower.refuse()
    t_ns = walked(follower, t_ns, STANCE, 0.1)
    assert state_of(follower) is Trust.HOLD
    follower.take(UPHILL.points, t_ns)
    follower.refuse()
    follower.step(t_ns + STEP_NS, SWING, 0.0)
    assert state_of(follower) is Trust.LEVEL


def test_own_sensors_that_feel_other_ground_end_a_held_set_point() -> None:
    follower = Follower(LIMITS, 0)
    t_ns = walked(follower, 0, SWING, 0.4, UPHILL.points)
    follower.step(t_ns + STEP_NS, STANCE, 0.1, contradicted=True)
    assert state_of(follower) is Trust.LEVEL


def test_an_unknown_phase_is_level_ground() -> None:
    follower = Follower(LIMITS, 0)
    walked(follower, 0, UNKNOWN, 0.3, UPHILL.points)
    assert state_of(follower) is Trust.LEVEL
    np.testing.assert_array_equal(follower.curve.points, LEVEL.points)


@pytest.mark.parametrize("column", [1, 2])
def test_a_level_ground_without_stiffness_or_damping_bounds_nothing(column: int) -> None:
    points = LEVEL.points.copy()
    points[2, column] = 0.0
    with pytest.raises(ValueError, match="above 0"):
        Limits(StanceCurve(points))

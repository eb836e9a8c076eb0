"""The table of set-points: published numbers, and own trials in their place."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance.ankle.table import AnkleTable
from impedance.ankle.trial import Manoeuvre
from impedance.modulation.curve import SHARES, Limits
from impedance.modulation.own_trials import of_trials
from impedance.modulation.table import BEYOND_RAD, published
from messages import UserError
from tests.bench.straight_trial import trial

MASS_KG = 75.0
slopes = st.floats(-0.17, 0.17)


def test_the_published_equilibrium_turns_with_the_ground_in_early_stance_and_not_at_toe_off() -> None:
    table = published()
    up, level, down = (table.at(math.radians(deg), 0.0, MASS_KG)[0].points for deg in (7.5, 0.0, -7.5))
    assert (up[:3, 0] > level[:3, 0] + 0.05).all()
    assert down[0, 0] < level[0, 0] - 0.05
    assert up[-1, 0] == down[-1, 0] == level[-1, 0]
    np.testing.assert_allclose(level[:, 1], MASS_KG * np.array([1.3, 2.3, 4.3, 6.0, 1.5]))


@given(slope=slopes, mass=st.floats(30.0, 150.0))
def test_a_curve_of_the_published_table_is_finite_and_within_the_limits(slope: float, mass: float) -> None:
    table = published()
    limits = Limits(table.level(mass))
    curve, deviations = table.at(slope, 0.01, mass)
    assert np.isfinite(curve.points).all()
    assert (deviations > 0.0).all()
    np.testing.assert_array_equal(limits.bounded(curve.points).points, curve.points)


@given(slope=slopes, step=st.floats(1e-6, 1e-3))
def test_a_small_change_of_slope_is_a_small_change_of_the_curve(slope: float, step: float) -> None:
    one, other = (published().at(each, 0.0, MASS_KG)[0].points for each in (slope, min(slope + step, 0.17)))
    assert np.abs(one[:, 0] - other[:, 0]).max() <= 1.5 * step


def test_stiffness_and_damping_grow_with_the_body_and_the_equilibrium_does_not() -> None:
    light, heavy = (published().at(0.05, 0.0, mass)[0].points for mass in (50.0, 100.0))
    np.testing.assert_allclose(heavy[:, 1:], 2.0 * light[:, 1:])
    np.testing.assert_array_equal(heavy[:, 0], light[:, 0])


def test_an_uncertain_slope_makes_an_uncertain_equilibrium() -> None:
    sure, unsure = (published().at(0.05, sd, MASS_KG)[1] for sd in (0.0, 0.1))
    assert (unsure[:3, 0] > sure[:3, 0]).all()
    np.testing.assert_array_equal(unsure[:, 1], sure[:, 1])  # stiffness does not depend on the slope


def test_a_slope_beyond_the_table_is_refused() -> None:
    table, steepest = published(), math.radians(7.5) + BEYOND_RAD
    assert table.holds(steepest - 1e-9)
    assert not table.holds(steepest + 1e-6)
    assert not table.holds(math.nan)
    with pytest.raises(ValueError, match="outside"):
        table.at(steepest + 0.01, 0.0, MASS_KG)


def test_own_trials_replace_what_they_tell() -> None:
    table = of_trials([trial(0.0), trial(5.0, equilibrium=0.08)], ["level.toml", "up.toml"])
    level, deviations = table.at(0.0, 0.0, 60.0)
    np.testing.assert_allclose(level.points[1:4, 0], 0.02)
    np.testing.assert_allclose(level.points[1:4, 1], 300.0)
    np.testing.assert_allclose(level.points[1:4, 2], 3.0)
    np.testing.assert_allclose(deviations[1:4, 1], 15.0 / 1.96, rtol=1e-3)
    up, _ = table.at(math.radians(5.0), 0.0, 60.0)
    np.testing.assert_allclose(up.points[1:4, 0], 0.08)
    assert np.isfinite(table.values).all()  # the ends of stance are the published ones
    assert table.id != published().id


def test_slopes_without_a_trial_are_the_published_ones_moved_to_the_own_level() -> None:
    base, table = published(), of_trials([trial(0.0, equilibrium=0.1)], ["level.toml"])
    np.testing.assert_allclose(np.rad2deg(table.slopes_rad), [-7.5, 0.0, 7.5])
    own, moved = table.at(0.0, 0.0, 60.0)[0].points, table.at(base.slopes_rad[2], 0.0, 60.0)[0].points
    shift = base.at(base.slopes_rad[2], 0.0, 60.0)[0].points - base.at(0.0, 0.0, 60.0)[0].points
    np.testing.assert_allclose(moved[:, 0] - own[:, 0], shift[:, 0])
    np.testing.assert_allclose(moved[:, 1], own[:, 1])


def test_what_a_trial_could_not_identify_is_published() -> None:
    nothing = [math.nan] * 3
    axis = msgspec.structs.replace(trial(0.0).dorsi_plantarflexion, stiffness_nm_per_rad=nothing, equilibrium_rad=[])
    table = of_trials([trial(0.0, dorsi_plantarflexion=axis)], ["level.toml"])
    np.testing.assert_allclose(
        table.at(0.0, 0.0, 60.0)[0].points[:, :2], published().at(0.0, 0.0, 60.0)[0].points[:, :2]
    )


@pytest.mark.parametrize(
    ("trials", "told"),
    [
        ([trial(5.0)], "0 trials of level ground"),
        ([trial(0.0), trial(0.5)], "2 trials of level ground"),
        ([trial(0.0), trial(5.0), trial(5.5)], "less than 1° apart"),
        ([trial(0.0, manoeuvre=Manoeuvre.SPIN_TURN)], "manoeuvre is 'spin_turn', allowed straight"),
    ],
)
def test_trials_that_make_no_table_are_refused_in_one_line(trials: list[AnkleTable], told: str) -> None:
    with pytest.raises(UserError, match=told) as raised:
        of_trials(trials, [f"{k}.toml" for k in range(len(trials))])
    assert "\n" not in str(raised.value)


def test_a_curve_runs_in_straight_lines_between_its_points() -> None:
    level = published().level(MASS_KG)
    for share, point in zip(SHARES, level.points, strict=True):
        assert level.at(float(share)) == pytest.approx(tuple(point))
    assert level.at(0.125) == pytest.approx(tuple(0.5 * (level.points[0] + level.points[1])))
    assert level.at(-1.0) == level.at(0.0)
    assert level.at(2.0) == level.at(1.0)

"""What each candidate leaves: look-alikes by what they explain are told apart by what they leave."""

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.explanation import Evidence, Explanation, Misfit
from discrepancy.report.figures import shown_channels, worst_stretch
from discrepancy.report.ranking import chance_text, ranking
from discrepancy.report.wording import parameter_words, parameters_text, words
from tests.bench.explained import explanation, toy

MISFIT = Misfit(before=203_010_000.0, after=10_000.0, count=10_000)


def candidate(effect: str, left: float, *, refitted: bool = True, chi2: float | None = None) -> Evidence:
    return Evidence(
        effect=effect,
        choice=("value_s",),
        chi2=MISFIT.before - left if chi2 is None else chi2,
        threshold=11.2,
        chance=0.001,
        refitted=refitted,
        status="accepted" if effect == "force_delay" else "rejected",
        parameters={"value_s": 0.004},
        units=("s",),
        left=left,
    )


def of(*evidence: Evidence, named: bool = True) -> Explanation:
    return replace(explanation(toy(1), named=named), evidence=evidence, misfit=MISFIT)


def test_a_delay_and_a_lag_that_explain_nearly_all_are_told_apart_by_what_they_leave() -> None:
    rows = ranking(of(candidate("force_delay", 10_000.0), candidate("force_lag", 1_010_000.0))).rows
    simulated, delay, lag = rows
    assert [row.left for row in rows] == ["142", "1", "10"]  # √(χ² / samples)
    assert float(delay.width) == 0.0
    assert 50.0 < float(lag.width) < float(simulated.width) == 100.0
    assert [row.told for row in rows] == ["", "named", "fits worse"]


def test_what_two_causes_leave_together_has_a_row_of_its_own() -> None:
    alone = candidate("force_delay", 90_000.0)
    names = [row.name for row in ranking(of(alone)).rows]
    assert names == ["the simulation as it is", "with all that is named", "force delay"]


def test_an_estimate_says_so_and_chance_is_no_candidate() -> None:
    rows = ranking(of(candidate("tare_error", 203_009_997.0, refitted=False, chi2=3.0))).rows
    assert rows[-1].left == "≈ 142"
    assert rows[-1].told == "no better than noise"
    unnamed = ranking(of(candidate("force_lag", 1_010_000.0), named=False)).rows
    assert unnamed[-1].told == "not enough"
    assert chance_text([]) == ""


def test_a_recording_of_nothing_but_noise_has_bars_too() -> None:
    same = replace(of(candidate("force_lag", 10_000.0), named=False), misfit=Misfit(10_000.0, 10_000.0, 10_000))
    assert {row.width for row in ranking(same).rows} == {"0.0"}


def test_a_candidate_names_its_axes_with_and_without_values() -> None:
    choice, units = ("x_rad", "y_rad", "z_radps_per_degc"), ("rad", "rad", "rad/s/°C")
    assert parameters_text(choice, units, {"x_rad": -0.0048}) == "x −0.275°, y, z"
    assert parameters_text(("value_s",), ("s",), {}) == ""
    many = tuple(f"at_{place}" for place in range(12))
    assert parameters_text(many, ("1",) * 12, {}).endswith("at 7, and 4 more")


@pytest.mark.parametrize(
    ("name", "told"),
    [("delay_of_voltage_V", "delay of voltage"), ("play_of_upper_m", "play of upper"), ("force_delay", "force delay")],
)
def test_an_effect_on_a_channel_is_told_without_the_channels_unit(name: str, told: str) -> None:
    assert words(name) == told


def test_parameters_are_words() -> None:
    assert [parameter_words(each) for each in ("hz", "z_hz", "value_s", "per_octave_px")] == [
        "frequency",
        "z",
        "value",
        "per octave",
    ]


def test_the_zoom_is_where_measured_and_simulated_differ_most() -> None:
    view = explanation(toy(1)).held_out
    view.base[1200:1210, 0] += 50.0
    view.base[300:, 1] = np.nan
    stretch = worst_stretch(view, 0)
    assert stretch.start <= 1200
    assert stretch.stop >= 1210
    assert stretch.stop - stretch.start == 2000 // 40
    assert worst_stretch(view, 1).start < 300
    assert shown_channels(view, 1) == [0]

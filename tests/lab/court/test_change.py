"""A cause counts as named where it is told anew, or where one that was told before has changed by what was planted."""

import numpy as np
import pytest

from lab.court.change import change, expected
from lab.court.result import Told, ToldCause, ToldQuantity
from lab.hidden.case import TrueCause


def told(*causes: tuple[str, dict[str, tuple[float, float]]], equivalents: dict[str, float] | None = None) -> Told:
    """Return a verdict with causes of these parameters: value and half width."""
    alike = equivalents or {}
    return Told(
        "imu",
        "named" if causes else "unknown",
        [
            ToldCause(
                name,
                {key: ToldQuantity(value, value - half, value + half, "") for key, (value, half) in parameters.items()},
                {f"worse_by.{other}": worse for other, worse in alike.items()},
                list(alike),
            )
            for name, parameters in causes
        ],
    )


BIAS = TrueCause("gyro_bias", {"x_radps": 0.02}, 0.02, "rad/s")


def test_a_cause_told_anew_is_named_and_its_size_judged() -> None:
    after = told(("gyro_bias", {"x_radps": (0.021, 0.002)}), ("lever_arm", {"x_m": (0.01, 0.001)}))
    found = change(BIAS, told(), after, {"gyro_bias.x_radps": 0.0005})
    assert (found.named, found.own_name, found.in_interval, found.like_for_like) == (True, True, True, True)
    assert found.beside == ("lever_arm",)
    assert not change(BIAS, told(), after, {"gyro_bias.x_radps": 0.005}).like_for_like


def test_a_cause_that_was_there_must_change_by_what_was_planted() -> None:
    before = told(("gyro_bias", {"x_radps": (0.01, 0.001)}))
    right = told(("gyro_bias", {"x_radps": (0.03, 0.001)}))
    assert change(BIAS, before, right, {"gyro_bias.x_radps": 0.01}).named
    assert not change(BIAS, before, before, {"gyro_bias.x_radps": 0.01}).named
    assert not change(BIAS, before, told(), {}).named


def test_a_look_alike_counts_only_where_it_is_proven_to_fit_as_well() -> None:
    other = {"x_radps2": (1.0, 0.1)}
    for worse, named in ((3.0, True), (30.0, False)):
        after = told(("temperature", other), equivalents={"gyro_bias": worse})
        found = change(BIAS, told(), after, {})
        assert (found.named, found.own_name, found.in_interval) == (named, False, False)


def test_two_low_passes_in_a_row_fall_by_three_decibels_below_either() -> None:
    planted = TrueCause("low_pass", {"gyro_hz": 20.0}, 20.0, "Hz")
    together = expected(planted, {"gyro_hz": 20.0, "zeta": float(np.sqrt(0.5))})["gyro_hz"]
    assert together == pytest.approx(20.0 * (np.sqrt(2.0) - 1.0) ** 0.25, rel=1e-6)
    assert expected(planted, {})["gyro_hz"] == 20.0
    assert expected(TrueCause("acc_scale", {"x": 0.02}, 0.02, "1"), {"x": 0.01})["x"] == pytest.approx(0.0302)
    gravity = TrueCause("gravity_magnitude", {"value_mps2": 0.05}, 0.05, "m/s²")
    assert expected(gravity, {})["value_mps2"] == pytest.approx(9.85665)

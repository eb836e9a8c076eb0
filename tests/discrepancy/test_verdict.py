"""verdict.json: exactly the fields that were agreed, null in place of NaN, the same there and back."""

import json
import math

import msgspec
import pytest

from discrepancy.verdict import (
    Cause,
    Gain,
    Quantity,
    Remainder,
    Signature,
    Verdict,
    from_json,
    number,
    quantity,
    to_json,
)


def verdict() -> Verdict:
    return Verdict(
        system="rig",
        verdict="named",
        causes=[Cause("delay", {"value_s": quantity(1e-3, 1e-4, "s")}, {"chi2": 50.0, "rival_chi2": None}, ["lag"])],
        remainder=Remainder(False, 0.0, Signature([], (None, None), None)),
        gain=Gain(0.2, 0.1, 0.1, 1.0),
        parameters_before={"mass_kg": quantity(3.0, math.nan, "kg")},
        parameters_after={"mass_kg": quantity(3.0, math.inf, "kg")},
        next_experiment=None,
    )


def test_fields_are_those_agreed() -> None:
    told = json.loads(to_json(verdict()))
    assert list(told) == [
        "system",
        "verdict",
        "causes",
        "remainder",
        "gain",
        "parameters_before",
        "parameters_after",
        "next_experiment",
        "noise_from",
        "seen_above",
        "notes",
        "constructed",
        "recordings",
        "disagreements",
    ]
    assert list(told["causes"][0]) == ["name", "parameters", "evidence", "equivalents"]
    assert list(told["causes"][0]["parameters"]["value_s"]) == ["value", "low", "high", "unit"]
    assert list(told["remainder"]) == ["present", "share", "signature"]
    assert told["remainder"]["signature"] == {"channels": [], "band_hz": [None, None], "when_s": None}
    assert list(told["gain"]) == [
        "held_out_nrmse_before",
        "held_out_nrmse_after",
        "noise_floor_nrmse",
        "share_of_excess_removed",
    ]


def test_what_does_not_apply_is_null() -> None:
    told = json.loads(to_json(verdict()))
    assert told["parameters_before"]["mass_kg"] == {"value": 3.0, "low": None, "high": None, "unit": "kg"}
    assert told["parameters_after"]["mass_kg"]["high"] is None
    assert "NaN" not in to_json(verdict()).decode()
    assert [number(each) for each in (math.nan, math.inf, 2)] == [None, None, 2.0]


def test_there_and_back() -> None:
    assert from_json(to_json(verdict())) == verdict()


def test_another_shape_is_refused() -> None:
    told = json.loads(to_json(verdict()))
    told["verdict"] = "perhaps"
    with pytest.raises(msgspec.ValidationError, match="verdict"):
        from_json(json.dumps(told))


def test_an_interval_may_be_given() -> None:
    assert quantity(1.0, math.nan, "m", (0.5, 2.0)) == Quantity(1.0, 0.5, 2.0, "m")

"""Constructed causes of systems unlike each other: quick on a heater, long on a pendulum that cogs, and clean ones."""

from pathlib import Path

import numpy as np
import pytest

from discrepancy import explain
from discrepancy.explanation import Explanation
from discrepancy.report.extended import load_extended, with_constructed
from discrepancy.report.output import write_report
from discrepancy.values import predicted
from discrepancy.verdict import from_json, to_json
from lab.hidden.five.studied import CLEAN, STUDIED, studied
from lab.undeclared.five_systems import simulation

_SEED, _OTHER = 1, 501


def explained(system: str, hidden: str, *, declared: bool = True) -> Explanation:
    """Return what is found in a system modelled without any library."""
    fit, held_out = (simulation(system, studied(system, hidden, seed), declared=declared) for seed in (_SEED, _OTHER))
    return explain(fit, held_out, seed=1)


@pytest.mark.long
def test_radiation_is_constructed_with_its_size_and_comes_back_from_its_file(tmp_path: Path) -> None:
    found = explained("heater", "radiation")
    verdict = found.verdict
    assert verdict.verdict == "constructed"
    assert [term.form for term in verdict.constructed] == ["fourth_power_offset"]
    amount = verdict.causes[0].parameters["amount"]
    assert amount.low is not None
    assert amount.high is not None
    assert amount.low <= -5e-10 <= amount.high
    assert (verdict.gain.held_out_nrmse_after or 1.0) < 0.003
    assert from_json(to_json(verdict)) == verdict
    write_report(found, tmp_path, report=False)
    held_out = simulation("heater", studied("heater", "radiation", _OTHER), declared=True)
    whole = with_constructed(tmp_path / "extended.toml", held_out)
    values = load_extended(tmp_path / "extended.toml", whole)
    assert np.array_equal(predicted(whole, values), found.held_out.extended)


@pytest.mark.long
@pytest.mark.parametrize("declared", [True, False])
def test_cogging_is_constructed_with_its_teeth(declared: bool) -> None:
    verdict = explained("pendulum", "cogging", declared=declared).verdict
    assert verdict.verdict == "constructed"
    assert [term.form for term in verdict.constructed] == ["wave"]
    told = verdict.causes[0].parameters
    for name, true in (("sine", -0.08), ("per_unit", 8.0)):
        low, high = told[name].low, told[name].high
        assert low is not None
        assert high is not None
        assert low <= true <= high
    assert (verdict.gain.held_out_nrmse_after or 1.0) < 0.005


@pytest.mark.long
@pytest.mark.parametrize("system", sorted(STUDIED))
def test_nothing_is_constructed_in_a_clean_system(system: str) -> None:
    for declared in (True, False):
        assert explained(system, CLEAN, declared=declared).verdict.verdict != "constructed"

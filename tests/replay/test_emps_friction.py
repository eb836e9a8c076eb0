"""A drive measured elsewhere: its dry friction is found from a model of a mass with viscous friction alone."""

import pytest

from discrepancy import explain
from lab.evaluation.measured.emps import emps, residual_force
from tests.bench.data_folder import shared_data

MASS_KG = 95.1
"""Janot, Gautier and Brunot (2019), as the friction."""
COULOMB_N = 20.4


@pytest.mark.long
def test_the_friction_of_the_drive_is_named_and_most_of_the_missing_force_with_it() -> None:
    data = shared_data("sysid_emps")
    simulation = emps(data / "estimation.csv.gz")
    found = explain(simulation, emps(data / "validation.csv.gz"), seed=1)
    (cause,) = found.verdict.causes
    assert cause.name in ("coulomb_friction_at_carriage", "asymmetric_friction_at_carriage")
    assert cause.parameters["value"].value == pytest.approx(COULOMB_N, rel=0.1)
    assert dict(found.values_after)["mass"] == pytest.approx(MASS_KG, rel=0.05)
    before, after = (
        residual_force(data / "validation.csv.gz", simulation, dict(values))
        for values in (found.values_before, found.values_after)
    )
    assert after < 0.55 * before

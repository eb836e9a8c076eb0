"""Tanks measured elsewhere: both overflows are found from Torricelli's law, by whatever processor."""

import numpy as np
import pytest

from discrepancy import explain
from lab.evaluation.measured.cascaded_tanks import tanks
from tests.bench.data_folder import shared_data

MOST_PARAMETERS = 12


@pytest.mark.long
def test_both_overflows_are_named_and_most_of_the_error_with_them() -> None:
    path = shared_data("sysid_cascaded_tanks") / "dataBenchmark.csv.gz"
    found = explain(tanks(path, "Est"), tanks(path, "Val"), seed=1)
    causes = found.verdict.causes
    assert {"overflow_at_upper", "overflow_at_lower"} <= {cause.name for cause in causes}
    count = len(found.verdict.parameters_after) + sum(len(cause.parameters) for cause in causes)
    assert count <= MOST_PARAMETERS
    measured, before, after = found.held_out.channels.values, found.held_out.base, found.held_out.extended
    left = [float(np.sqrt(np.nanmean((measured - each) ** 2))) for each in (before, after)]
    assert left[1] < 0.5 * left[0]

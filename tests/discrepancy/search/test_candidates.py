"""The noise beneath a library: whatever rounding puts into columns without influence, it is that of the recording."""

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.evidence.whitening import White
from discrepancy.problem import Problem
from discrepancy.search.candidates import noise_beneath, ridge
from discrepancy.search.refits import Refits
from messages.arrays import FloatArray
from tests.bench.linear_bench import LinearSimulation
from tests.bench.ported import sled

_N = 2000
_NOISE = 0.1


def whitened_by(columns: FloatArray) -> White:
    """Return the whitening of noise of `_NOISE` beneath a slow misfit and `columns` (m, n)."""
    random = np.random.default_rng(3)
    slow = np.sin(np.linspace(0.0, 9.0, _N))
    measured = slow + _NOISE * random.normal(size=_N)
    problem = Problem(LinearSimulation(measured[:, None], measured[:, None], library=()))
    return noise_beneath(problem, measured[None, :], np.stack((slow, *columns))[:, None, :])


def deviation(white: White) -> float:
    """Return by how much a sample scatters that comes out as 1."""
    return float(np.exp(0.5 * white.log_det / white.count))


@pytest.mark.parametrize("count", [1, 30])
def test_columns_of_last_digits_explain_nothing(count: int) -> None:
    digits = 1e-13 * np.random.default_rng(7).normal(size=(count, _N))
    assert deviation(whitened_by(digits)) == pytest.approx(deviation(whitened_by(digits[:0])), rel=1e-6)


def test_the_last_digits_of_a_recording_tell_nothing_of_its_noise() -> None:
    """A third of the generic library changes nothing where it begins: its columns are what rounding leaves."""
    simulation = sled(1)
    names = [effect.name for effect in simulation.effects]
    found = []
    for share in (0.0, 1e-11, 3e-11):
        channels = replace(simulation.channels, values=simulation.channels.values * (1.0 + share))
        refits = Refits(Problem(replace(simulation, channels=channels)), names)
        found.append((refits.white.log_det, refits.base.chi2))
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert found[2] == pytest.approx(found[0], rel=1e-6)


def test_a_column_without_power_has_no_weight() -> None:
    rows = np.array([[1.0, 2.0, 0.0], [1e-14, -1e-14, 2e-14], [0.0, 1.0, 1.0]])
    weights = ridge(rows @ rows.T, rows @ np.array([1.0, 3.0, 1.0]))
    assert weights == pytest.approx([1.0, 0.0, 1.0], abs=1e-6)

"""Effects that say the same are declared so, others only as often as chance makes their fits alike."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.equivalents import SAME_CHI2, equivalents
from discrepancy.search.search import Search
from messages.arrays import FloatArray
from tests.bench.linear_bench import Columns, LinearSimulation, likely_counts

_SEED = 7306
_N = 1000


def correlated(rng: np.random.Generator, rho: float, n: int = _N) -> tuple[FloatArray, FloatArray]:
    """Return two columns (n,) of unit power with exactly this correlation."""
    raw = rng.normal(size=(2, n))
    x, y = np.linalg.qr((raw - raw.mean(axis=1, keepdims=True)).T)[0].T * np.sqrt(n)
    return x, rho * x + np.sqrt(1.0 - rho**2) * y


def effect(name: str, *rows: FloatArray) -> Columns:
    return Columns(name, {f"p{k}": row[:, None] for k, row in enumerate(rows)})


def told(
    measured: FloatArray, library: Sequence[Columns], causes: tuple[str, ...] = ("cause",)
) -> tuple[Mapping[str, Mapping[str, float]], Mapping[str, float]]:
    """Return what is declared equivalent to these causes, and the best rival that is not, of a recording (n,)."""
    simulation = LinearSimulation(measured[:, None], measured[:, None], library=library)
    search = Search(Problem(simulation), [each.name for each in library], 1)
    best, found = search.refits.base, tuple(_candidate(search, name) for name in causes)
    for each in found:
        best = search.refits.joined(best, each)
    return equivalents(search, best, found)


def _candidate(search: Search, name: str) -> Candidate:
    return next(each for each in search.refits.candidates if each.effect == name)


def test_two_effects_of_one_column_are_equivalent_whatever_their_units() -> None:
    rng = np.random.default_rng(_SEED)
    x, y = correlated(rng, 0.3)
    same, other = told(x + rng.normal(size=_N), [effect("cause", x), effect("twin", -40.0 * x), effect("apart", y)])
    assert list(same["cause"]) == ["twin"]
    assert same["cause"]["twin"] == pytest.approx(0.0, abs=0.1)
    assert other == {}


def test_a_separable_rival_that_comes_near_is_told_with_its_rise_and_one_far_off_is_not() -> None:
    rng = np.random.default_rng(_SEED)
    x, near = correlated(rng, 0.9)
    _, far = correlated(rng, 0.0)
    noise = rng.normal(size=_N)
    same, other = told(x + noise, [effect("cause", x), effect("near", near), effect("far", far)])
    assert same == {"cause": {}}
    drop = [float((row @ (x + noise)) ** 2 / (row @ row)) for row in (x, near)]
    assert other["cause"] == pytest.approx(drop[0] - drop[1], rel=0.1)  # of unit noise, which is estimated
    assert told(x + noise, [effect("cause", x), effect("far", far)]) == ({"cause": {}}, {})


def test_an_equivalent_needs_at_most_one_parameter_more() -> None:
    rng = np.random.default_rng(_SEED)
    x, y = correlated(rng, 0.0)
    z = rng.normal(size=_N)
    measured = 2.0 * x + rng.normal(size=_N)
    assert list(told(measured, [effect("cause", x), effect("two", x, y)])[0]["cause"]) == ["two"]
    same, other = told(measured, [effect("cause", x), effect("three", x, y, z)])
    assert same == {"cause": {}}
    assert other["cause"] < SAME_CHI2


def test_each_of_two_causes_has_its_own_equivalents_the_best_first_three_at_most() -> None:
    rng = np.random.default_rng(_SEED)
    x, y = correlated(rng, 0.0)
    noisy = [x + size * rng.normal(size=_N) for size in (0.0, 0.02, 0.04, 0.06)]
    library = [effect("cause", x), effect("second", y), effect("twin", 2.0 * y)]
    library += [effect(f"like_{k}", row) for k, row in reversed(list(enumerate(noisy)))]
    same, _ = told(x + y + rng.normal(size=_N), library, ("cause", "second"))
    assert list(same["second"]) == ["twin"]
    assert len(same["cause"]) == 3
    assert list(same["cause"].values()) == sorted(same["cause"].values())
    assert set(same["cause"]) < {f"like_{k}" for k in range(4)}


@pytest.mark.long
@pytest.mark.parametrize("rho", [0.8, 0.97])
def test_a_separable_rival_is_declared_the_same_as_often_as_chance_makes_it_fit_as_well(rho: float) -> None:
    # With z, z' normal of correlation ρ the cause lowers χ² by (√λ + z)², its rival by (ρ √λ + z')².
    rng = np.random.default_rng(_SEED)
    draws, lambda_ = 500, 150.0
    z = rng.normal(size=(2, 1_000_000))
    rival = rho * z[0] + np.sqrt(1.0 - rho**2) * z[1]
    expected = [
        float(np.mean((1.0 + share) * ((np.sqrt(lambda_) + z[0]) ** 2 - (rho * np.sqrt(lambda_) + rival) ** 2) < 10.0))
        for share in (0.05, -0.05)  # the noise's power is estimated, to about 5 %
    ]
    same = 0
    for _ in range(draws):
        x, y = correlated(rng, rho, 300)
        measured = np.sqrt(lambda_ / 300) * x + rng.normal(size=300)
        same += bool(told(measured, [effect("cause", x), effect("rival", y)])[0]["cause"])
    least, most = likely_counts(draws, expected[0])[0], likely_counts(draws, expected[1])[1]
    assert least <= same <= most, f"seed {_SEED}: {same} of {draws}, {expected} expected"
    assert expected[1] < 0.01 if rho < 0.9 else expected[0] > 0.3

"""How many cases of a run must be right: a good finder hardly ever fails by chance, a broken one always does.

In the quick tier: nothing is drawn here but what a run would draw.
"""

from collections import Counter

import pytest

from lab.court.plan import SYSTEMS
from lab.hidden.case import Kind
from tests.bench.hidden_cases import (
    BROKEN_RATE,
    CASES,
    KINDS,
    LOOK_ALIKE_CASES,
    LOOK_ALIKE_RATE,
    broken_pass,
    counts_of,
    drawn,
    false_failure,
    fewest_right,
)

COUNTS = [
    *(counts_of(kinds) for kinds in KINDS.values()),
    *(counts_of(Kind, [system]) for system in SYSTEMS),
    {LOOK_ALIKE_RATE: LOOK_ALIKE_CASES},
]


def test_a_finder_with_the_declared_rates_fails_in_fewer_than_one_of_ten_thousand_runs() -> None:
    assert sum(false_failure(counts) for counts in COUNTS) <= 1e-4


def test_a_finder_that_always_says_the_same_or_guesses_fails() -> None:
    assert all(broken_pass(counts) < 0.01 for counts in COUNTS)
    single, _, clean, unknown = (broken_pass(counts_of(kinds)) for kinds in KINDS.values())
    assert single < 1e-15  # who always says nothing, or unknown, or guesses a name
    assert clean < 1e-6  # who always names something
    assert unknown < 1e-3


def test_a_finder_that_works_on_two_systems_of_three_fails() -> None:
    assert all(broken_pass(counts_of(Kind, [system])) < 1e-3 for system in SYSTEMS)


def test_the_fewest_are_the_tail_of_the_binomial() -> None:
    assert fewest_right({0.9: 1}) == 0
    assert fewest_right({0.5: 20}) == 1
    assert false_failure({0.5: 20}) == pytest.approx(1.0 / 2**20)
    two_rates = {0.5: 20, 0.75: 2}
    assert fewest_right(two_rates) == 2
    assert false_failure(two_rates) == pytest.approx((0.0625 + 20 * 0.0625 + 2 * 0.75 * 0.25) / 2**20)
    assert broken_pass(two_rates) == pytest.approx(
        1.0 - (1 - BROKEN_RATE) ** 22 - 22 * BROKEN_RATE * (1 - BROKEN_RATE) ** 21
    )


def test_a_run_follows_from_its_seed_and_has_all_its_cases() -> None:
    cases = drawn(5)
    assert cases == drawn(5)
    assert cases != drawn(6)
    assert len({case.seed for case in cases}) == len(cases)
    counted = Counter((case.system, case.kind) for case in cases)
    assert counted == {(system, kind): count for system, counts in CASES.items() for kind, count in counts.items()}

"""What is hidden is named, where nothing is hidden nothing is named, what nobody knows is unknown: counted over a run.

`gaiteyes explain court` asks the same of more cases and tells rates.
"""

import pytest

from lab.court.plan import SYSTEMS
from lab.hidden.case import Kind
from tests.bench.hidden_cases import KINDS, Judged, counts_of, fewest_right

pytestmark = pytest.mark.hidden


def assert_enough(judged: list[Judged], fewest: int) -> None:
    right = sum(each.right for each in judged)
    assert right >= fewest, "\n".join(each.line for each in judged if not each.right)


def test_no_case_ends_in_an_error(all_judged: list[Judged]) -> None:
    assert [(each.line, each.failure) for each in all_judged if each.failure] == []


@pytest.mark.parametrize("kinds", KINDS.values(), ids=KINDS)
def test_enough_cases_of_a_kind_are_right(kinds: tuple[Kind, ...], all_judged: list[Judged]) -> None:
    assert_enough([each for each in all_judged if each.case.kind in kinds], fewest_right(counts_of(kinds)))


@pytest.mark.parametrize("system", SYSTEMS)
def test_enough_cases_of_a_system_are_right(system: str, all_judged: list[Judged]) -> None:
    assert_enough([each for each in all_judged if each.case.system == system], fewest_right(counts_of(Kind, [system])))

"""One run of the hidden tier draws everything from one seed, which is printed first, and judges on all processors."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext

import pytest

from lab.hidden.case import Case
from tests.bench.hidden_cases import Judged, drawn, in_processes, judged


@pytest.fixture(scope="session")
def tell(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Return a function that prints a line at once, whatever pytest captures."""
    capture = request.config.pluginmanager.getplugin("capturemanager")

    def tell(line: str) -> None:
        with nullcontext() if capture is None else capture.global_and_fixture_disabled():
            print(line, flush=True)

    return tell


@pytest.fixture(scope="session")
def hidden_seed(request: pytest.FixtureRequest, tell: Callable[[str], None]) -> int:
    """Return the seed of this run."""
    seed: int = request.config.getoption("--hidden-seed")
    tell(f"\nhidden effects are drawn from --hidden-seed {seed}")
    return seed


Judge = Callable[[Callable[[Case], Judged], Sequence[Case]], list[Judged]]


@pytest.fixture(scope="session")
def judge_all(tell: Callable[[str], None]) -> Judge:
    """Return a function that judges cases in parallel and prints each as it ends."""

    def judge_all(judge: Callable[[Case], Judged], cases: Sequence[Case]) -> list[Judged]:
        found = []
        for each in in_processes(judge, cases):
            found.append(each)
            tell(f"{len(found)} of {len(cases)} {each.line}")
        return found

    return judge_all


@pytest.fixture(scope="session")
def all_judged(hidden_seed: int, judge_all: Judge) -> list[Judged]:
    """Return the cases of all systems and kinds."""
    return judge_all(judged, drawn(hidden_seed))

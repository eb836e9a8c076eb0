"""How far a work is, for whoever follows a log instead of a terminal."""

import itertools
from collections.abc import Callable

import pytest

from cli import progress


def ticking(step_s: float) -> Callable[[], float]:
    """Return a clock that each look finds `step_s` later."""
    return itertools.count(0.0, step_s).__next__


def test_a_log_gets_a_line_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(progress.counted("abcdef", 6, "walking", ticking(6.0))) == list("abcdef")
    assert capsys.readouterr().err.splitlines() == [
        "gaiteyes: walking: 0 of 6",
        "gaiteyes: walking: 2 of 6, 12 s",
        "gaiteyes: walking: 4 of 6, 24 s",
        "gaiteyes: walking: 6 of 6, 36 s",
    ]


def test_quick_work_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(progress.progress([1, 2, 3], "checking")) == [1, 2, 3]
    assert capsys.readouterr().err == "gaiteyes: checking: 0 of 3\n"


def test_work_of_unknown_length_goes_on_audibly(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.001)
    told = list[str]()
    with progress.working("reading") as tell:
        while "reading, 0 s" not in "".join(told):
            told.append(capsys.readouterr().err)
        tell("searching")
    assert "".join(told).startswith("gaiteyes: reading\n")
    assert "gaiteyes: searching\n" in capsys.readouterr().err


def test_what_passes_is_counted() -> None:
    told = list[str]()
    assert len(list(progress.passing(range(25), told.append, "inputs", ticking(1.0)))) == 25
    assert told == ["inputs: 9 so far", "inputs: 19 so far"]


def test_durations_are_read_at_a_glance(capsys: pytest.CaptureFixture[str]) -> None:
    list(progress.counted("ab", 2, "x", ticking(100.0)))
    assert capsys.readouterr().err.splitlines()[1:] == [
        "gaiteyes: x: 1 of 2, 1:40 min",
        "gaiteyes: x: 2 of 2, 3:20 min",
    ]

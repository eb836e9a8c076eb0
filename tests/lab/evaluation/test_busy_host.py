"""When a host counts as too busy for a measurement in real time."""

import itertools
from pathlib import Path

import pytest

from lab.evaluation import busy_host
from lab.evaluation.busy_host import Burden, ProcessorPressure, waited_s

LINES = "some avg10=3.00 avg60=2.00 avg300=1.00 total=2500000\nfull avg10=0.00 avg60=0.00 avg300=0.00 total=0\n"


@pytest.mark.parametrize(
    ("burden", "told"),
    [
        (Burden(waiting=0.3, frames=200, frames_late=4, heard=1000, held_up=50), ""),
        (Burden(waiting=None, frames=200), ""),
        (Burden(waiting=0.61), "programs waited for a processor 61 % of the time"),
        (Burden(waiting=0.1, frames=200, frames_late=5), "5 of 200 frames were rendered too late"),
        (Burden(waiting=None, heard=1000, held_up=51), "51 of 1000 messages came while the listener was held up"),
        (Burden(waiting=0.8, frames=10, frames_late=9), "programs waited for a processor 80 % of the time, 9 of 10"),
    ],
)
def test_what_is_too_much_is_told(burden: Burden, told: str) -> None:
    assert burden.too_much.startswith(told)
    assert bool(burden.too_much) is bool(told)


def test_the_kernels_pressure_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(busy_host, "_PRESSURE", tmp_path / "cpu")
    assert ProcessorPressure().share() is None
    (tmp_path / "cpu").write_text(LINES)
    assert waited_s() == 2.5


def test_the_share_is_of_the_time_that_has_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(busy_host, "waited_s", itertools.count(100.0, 3.0).__next__)
    monkeypatch.setattr("lab.evaluation.busy_host.time.monotonic", itertools.count(5.0, 4.0).__next__)
    assert ProcessorPressure().share() == 0.75

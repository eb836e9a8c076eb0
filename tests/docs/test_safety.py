"""The page on safety keeps up with the code: every reason is told, every hazard has a number and what shows it."""

import re

from lab.faults.catalogue import CATALOGUE
from messages import Reason
from tests.docs.pages import ROOT

PAGE = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
ROWS = [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.splitlines() if line.startswith("|")]
HAZARDS = [row for row in ROWS if re.fullmatch(r"H\d+", row[0])]


def test_every_reason_says_what_helps() -> None:
    told = {word for row in ROWS for word in re.findall(r"`(\w+)`", row[0])}
    assert {reason.value for reason in Reason} - told == {Reason.NONE.value}


def test_hazards_are_numbered_without_a_gap_and_each_is_shown_by_something_that_exists() -> None:
    assert [row[0] for row in HAZARDS] == [f"H{number}" for number in range(1, len(HAZARDS) + 1)]
    for row in HAZARDS:
        number, shown_by = row[0], row[3]
        names = re.findall(r"`([^`]+)`", shown_by)
        assert names or "campaign" in shown_by, number
        for name in names:
            if re.fullmatch(r"[a-z]+-[a-z-]*", name):
                assert any(fault.startswith(name) for fault in CATALOGUE), (number, name)
            elif name.startswith("benchmarks."):
                assert ROOT.joinpath(*name.split(".")).with_suffix(".py").is_file(), (number, name)
            elif name.startswith("tests/"):
                assert (ROOT / name).is_file(), (number, name)


def test_every_reason_that_refuses_ground_is_named_by_a_hazard() -> None:
    detected = " ".join(row[2] for row in HAZARDS)
    at_the_start = {Reason.NONE, Reason.STARTING, Reason.NOT_AT_REST}
    assert {reason for reason in Reason if f"`{reason.value}`" not in detected} == at_the_start

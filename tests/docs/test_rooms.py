"""docs/architecture.md lists every room of the project with its lines, and no room holds too much of it."""

from tests.docs.rooms import PAGE, ROOT, lines_of, packages, rooms, told

MOST_OFF = 100
"""Lines by which a row may differ before the table must be brought up to date."""

LARGEST_SHARE = 0.22
"""Of all lines but the tests'."""


def test_every_room_has_one_row() -> None:
    names = [room for room, _ in told(PAGE.read_text(encoding="utf-8"))]
    assert sorted(names) == sorted(rooms())


def test_the_lines_are_those_of_today() -> None:
    today = rooms()
    stated = dict(told(PAGE.read_text(encoding="utf-8")))
    off = {room: (stated[room], lines) for room, lines in today.items() if abs(stated[room] - lines) > MOST_OFF}
    assert not off, "stated and real lines differ; write them: python -m tests.docs.rooms"


def test_no_package_holds_more_than_its_share() -> None:
    lines = {package: rooms()[f"{package}/"] for package in packages()}
    whole = sum(lines.values()) + lines_of(ROOT / "benchmarks") + lines_of(ROOT / "examples")
    assert max(lines.values()) <= LARGEST_SHARE * whole

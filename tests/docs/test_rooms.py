"""docs/architecture.md lists every room of the project with its lines and its job, and no room holds too much of it."""

from tests.docs.rooms import PAGE, ROOT, lines_of, packages, rooms, rows

MOST_OFF = 100
"""Lines by which a row may differ before the table must be brought up to date."""

LARGEST_SHARE = 0.22
"""Of all lines but the tests'."""

MEND = "mend the table: python -m tests.docs.rooms"


def test_every_room_has_one_row_with_its_job() -> None:
    stated = rows(PAGE.read_text(encoding="utf-8"))
    assert sorted(room for room, _, _ in stated) == sorted(rooms()), MEND
    assert [room for room, _, job in stated if not job] == []


def test_the_lines_are_those_of_today() -> None:
    today = rooms()
    stated = rows(PAGE.read_text(encoding="utf-8"))
    off = {room: (lines, today[room]) for room, lines, _ in stated if abs(lines - today[room]) > MOST_OFF}
    assert not off, MEND


def test_no_package_holds_more_than_its_share() -> None:
    lines = {package: rooms()[f"{package}/"] for package in packages()}
    whole = sum(lines.values()) + lines_of(ROOT / "benchmarks") + lines_of(ROOT / "examples")
    assert max(lines.values()) <= LARGEST_SHARE * whole

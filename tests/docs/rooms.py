"""The table of rooms in docs/architecture.md: `python -m tests.docs.rooms` brings its lines of code up to date.

A room is a package, or a folder of one. Lines are rounded, so that the table need not change with every commit. A room
that is new gets a row, whose last cell is for its job; the row of one that is gone leaves.
"""

import re
from pathlib import Path

import tomli

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
ROUNDED_TO = 50

_ROW = re.compile(r"^\| `(?P<room>[a-z_]+/(?:[a-z_]+/)?)` \| (?P<lines>[\d,]+) \|(?P<job>.*)\|$", re.MULTILINE)
_BESIDE = {"tests", "benchmarks"}
"""Under the import contracts too, but no rooms of the product."""


def packages() -> list[str]:
    """Return the names of the project's packages, as the import contracts list them."""
    project = tomli.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    names: list[str] = project["tool"]["importlinter"]["root_packages"]
    return [name for name in names if name not in _BESIDE]


def lines_of(folder: Path) -> int:
    """Return how many lines the Python files below `folder` have."""
    return sum(path.read_bytes().count(b"\n") for path in folder.rglob("*.py"))


def rooms() -> dict[str, int]:
    """Return the lines of every package and of each folder directly below it that holds code."""
    found: dict[str, int] = {}
    for package in packages():
        found[f"{package}/"] = lines_of(ROOT / package)
        below = sorted(path for path in (ROOT / package).iterdir() if path.is_dir())
        found |= {f"{package}/{path.name}/": lines_of(path) for path in below if any(path.rglob("*.py"))}
    return found


def rows(page: str) -> list[tuple[str, int, str]]:
    """Return the rooms of the table in `page` with the lines and the job that it states."""
    found = _ROW.finditer(page)
    return [(row["room"], int(row["lines"].replace(",", "")), row["job"].strip()) for row in found]


def up_to_date(page: str) -> str:
    """Return `page` with a row for each room of today, in the order that the table has."""
    order = [room for room, _, _ in rows(page)]
    jobs = {room: job for room, _, job in rows(page)}
    today = rooms()
    for room in today:
        if room not in jobs:
            beside = [known for known in order if known.startswith(f"{room.split('/')[0]}/")]
            order.insert(order.index(beside[-1]) + 1 if beside else len(order), room)
    table = [
        f"| `{room}` | {ROUNDED_TO * round(today[room] / ROUNDED_TO):,} | {jobs.get(room, '')} |"
        for room in order
        if room in today
    ]
    matches = list(_ROW.finditer(page))
    return page[: matches[0].start()] + "\n".join(table) + page[matches[-1].end() :]


if __name__ == "__main__":
    PAGE.write_text(up_to_date(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

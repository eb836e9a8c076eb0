"""The table of rooms in docs/architecture.md: `python -m tests.docs.rooms` brings its lines of code up to date.

A room is a package, or a folder of one. Lines are rounded, so that the table need not change with every commit.
"""

import re
from pathlib import Path

import tomli

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
ROUNDED_TO = 50

_ROW = re.compile(r"^(\| `(?P<room>[a-z_]+/(?:[a-z_]+/)?)` \| )(?P<lines>[\d,]+)( \|)", re.MULTILINE)


def packages() -> list[str]:
    """Return the names of the project's packages, as the import contracts list them."""
    project = tomli.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    names: list[str] = project["tool"]["importlinter"]["root_packages"]
    return names


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


def told(page: str) -> list[tuple[str, int]]:
    """Return the rooms of the table in `page` with the lines that it states."""
    return [(row["room"], int(row["lines"].replace(",", ""))) for row in _ROW.finditer(page)]


def up_to_date(page: str) -> str:
    """Return `page` with the lines of today; rows of rooms that are gone stay as they are."""
    today = rooms()

    def row(match: re.Match[str]) -> str:
        lines = today.get(match["room"])
        stated = match["lines"] if lines is None else f"{ROUNDED_TO * round(lines / ROUNDED_TO):,}"
        return f"{match[1]}{stated}{match[4]}"

    return _ROW.sub(row, page)


if __name__ == "__main__":
    PAGE.write_text(up_to_date(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

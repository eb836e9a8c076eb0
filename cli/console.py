"""What the commands share in front of a person: tables, JSON files."""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.table import Table

from lab.evaluation.floor import FloorScore
from lab.evaluation.score import Score
from messages.errors import UserError
from reports.content import Table as ReportTable

_WIDTH_OF_A_FILE = 110

RECORDING_CUT = 3
"""The exit code of a command that did its work, but whose recording ends early: it does not hold all that there was."""
VOID = 4
"""The exit code of a measurement in real time on a host that was too busy for it: its figures tell nothing."""

console = Console(markup=False, highlight=False, width=None if sys.stdout.isatty() else _WIDTH_OF_A_FILE)
"""Prints what it gets: the [square brackets] of a file's name or of a unit are no markup."""


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], *, words: bool = False) -> None:
    """Print a table; the first column is text, the others are numbers, unless all of them are words."""
    sheet = Table(title=title, title_justify="left")
    for place, column in enumerate(columns):
        sheet.add_column(column, justify="right" if place and not words else "left")
    for row in rows:
        sheet.add_row(*row)
    console.print(sheet)


def show(sheet: ReportTable) -> None:
    """Print a table as it stands in a report, with its note."""
    table(sheet.title, sheet.columns, sheet.rows, words=sheet.words)
    if sheet.note:
        console.print(sheet.note)


def score_table(title: str, scores: dict[str, Score], by: str = "ground") -> ReportTable:
    """Return the accuracy on each kind of ground, or of whatever else the scores are told apart by."""
    return ReportTable(
        title,
        [by, "frames", "valid", "sagittal RMS", "P99", "frontal RMS", "height RMS", "within 95 %"],
        [
            [
                kind,
                str(score.frames),
                f"{100 * score.valid_share:.1f} %",
                f"{score.slope_sagittal_rms_deg:.2f}°",
                f"{score.slope_sagittal_p99_deg:.2f}°",
                f"{score.slope_frontal_rms_deg:.2f}°",
                f"{score.height_rms_mm:.1f} mm",
                f"{100 * score.coverage:.0f} %",
            ]
            for kind, score in scores.items()
        ],
    )


def floor_table(title: str, scores: dict[str, FloorScore]) -> None:
    """Print the errors on a level floor, one column for each attitude that was used."""
    rows = {
        "frames": [str(s.frames) for s in scores.values()],
        "slope ahead, RMS": [f"{s.slope_sagittal_rms_deg:.2f}°" for s in scores.values()],
        "slope across, RMS": [f"{s.slope_frontal_rms_deg:.2f}°" for s in scores.values()],
        "angle to the level, RMS": [f"{s.angle_rms_deg:.2f}°" for s in scores.values()],
        "camera's height": [f"{s.height_mean_m:.4f} m" for s in scores.values()],
        "minus the true height": [f"{s.height_error_mean_mm:+.1f} mm" for s in scores.values()],
    }
    table(title, ["", *scores], [[name, *cells] for name, cells in rows.items()])


def write_json(path: Path, facts: Any) -> None:
    """Write `facts` as indented JSON; a number that is not finite becomes null.

    Raises UserError where the file cannot be written.
    """
    try:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(facts), indent=2) + b"\n")
    except OSError as error:
        raise UserError(f"--json {path}: {error.strerror}") from error


def seed_list(text: str) -> list[int]:
    """Return the seeds that `1,2,5` or `1-8` stands for; raises UserError for anything else."""
    try:
        seeds: list[int] = []
        for part in text.split(","):
            first, _, last = part.partition("-")
            seeds += range(int(first), int(last or first) + 1)
    except ValueError as error:
        raise UserError(f"--seeds {text}: expected numbers such as 1,2,5 or a range such as 1-8") from error
    return seeds


def check_writable(path: Path | None, option: str = "--json") -> None:
    """Raise UserError now, before the long work, if a file that is to be written later cannot be."""
    if path is not None and not path.absolute().parent.is_dir():
        raise UserError(f"{option} {path}: its folder does not exist")

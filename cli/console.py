"""What the commands share in front of a person: tables, progress, JSON files."""

import math
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from rich.console import Console
from rich.live import Live
from rich.progress import track
from rich.table import Table
from rich.text import Text

from lab.evaluation.floor import FloorScore
from lab.evaluation.score import Score
from messages.errors import UserError

T = TypeVar("T")
_WIDTH_OF_A_FILE = 110
_TELL_EVERY_S = 5.0

RECORDING_CUT = 3
"""The exit code of a command that did its work, but whose recording ends early: it does not hold all that there was."""
VOID = 4
"""The exit code of a measurement in real time on a host that was too busy for it: its figures tell nothing."""

console = Console() if sys.stdout.isatty() else Console(width=_WIDTH_OF_A_FILE)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], *, words: bool = False) -> None:
    """Print a table; the first column is text, the others are numbers, unless all of them are words."""
    sheet = Table(title=title, title_justify="left")
    for place, column in enumerate(columns):
        sheet.add_column(column, justify="right" if place and not words else "left")
    for row in rows:
        sheet.add_row(*row)
    console.print(sheet)


def score_table(title: str, scores: dict[str, Score], by: str = "ground") -> None:
    """Print the accuracy on each kind of ground, or of whatever else the scores are told apart by."""
    table(
        title,
        [by, "frames", "valid", "sagittal RMS", "frontal RMS", "height RMS", "within 95 %"],
        [
            [
                kind,
                str(score.frames),
                f"{100 * score.valid_share:.1f} %",
                f"{score.slope_sagittal_rms_deg:.2f}°",
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


def progress(items: Sequence[T], what: str) -> Iterable[T]:
    """Yield `items` behind a progress bar."""
    return track(items, description=what, console=console)


class LiveLine:
    """One line that is kept up to date: in its place at a terminal, else printed at most every five seconds."""

    def __init__(self) -> None:
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
        self._told_s = -math.inf

    def __enter__(self) -> "LiveLine":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_error: object) -> None:
        if self._live is not None:
            self._live.stop()

    def tell(self, line: str) -> None:
        """Show `line` in place of the one before."""
        if self._live is not None:
            self._live.update(Text(line), refresh=True)
        elif time.monotonic() - self._told_s >= _TELL_EVERY_S:
            self._told_s = time.monotonic()
            console.print(line, highlight=False, markup=False, soft_wrap=True)


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


def check_writable(path: Path | None) -> None:
    """Raise UserError now, before the long work, if a file that is to be written later cannot be."""
    if path is not None and not path.absolute().parent.is_dir():
        raise UserError(f"--json {path}: its folder does not exist")

"""Writes an explanation: verdict.json, held_out.csv, extended.toml and, for a person, report.html."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from discrepancy.explanation import Explanation
from discrepancy.report.extended import extended_text
from discrepancy.simulation import Channels
from discrepancy.verdict import to_json
from messages.arrays import FloatArray
from messages.errors import UserError
from reports.page import check_page

VERDICT, HELD_OUT, EXTENDED, REPORT = "verdict.json", "held_out.csv", "extended.toml", "report.html"


def check_report() -> None:
    """Raise UserError, with what to install, if the report cannot be drawn."""
    check_page(f"{REPORT} (left out with --no-report)")


def write_report(explanation: Explanation, folder: Path, *, report: bool = True, files: Sequence[Path] = ()) -> None:
    """Write all files into `folder`, which is made; the report names `files`, the recordings it was made from, with
    their checksums. Raises UserError where it cannot."""
    view = explanation.held_out
    written = {
        VERDICT: to_json(explanation.verdict).decode(),
        HELD_OUT: beside_text(view.channels, view.base, view.extended),
        EXTENDED: extended_text(explanation),
    }
    if report:
        check_report()
        from discrepancy.report.page import page

        written[REPORT] = page(explanation, files)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in written.items():
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"--out {folder}: {error.strerror}") from error


def beside_text(channels: Channels, base: FloatArray, extended: FloatArray) -> str:
    """Return the CSV of t_s and, per channel, what was measured and what base and extended model predict, (n, c).

    An empty cell is a number that is missing.
    """
    columns = ["t_s", *(f"{kind}_{name}" for name in channels.names for kind in ("measured", "base", "extended"))]
    sides = np.stack((channels.values, base, extended), axis=2)  # (n, c, 3)
    rows = np.column_stack((channels.t_s, sides.reshape(len(channels.t_s), -1)))
    text = io.StringIO()
    np.savetxt(text, rows, fmt="%.10g", delimiter=",")
    return ",".join(columns) + "\n" + text.getvalue().replace("nan", "")

"""`gaiteyes calibrate rows`: does the pair's calibration still hold? Asked of pictures of anything, without a board."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.calibrate_target import SideBySide
from cli.options import JsonFile

if TYPE_CHECKING:
    from calib.stereo.rows import RowsCheck


def rows(
    file: Annotated[
        Path, typer.Argument(help="A unit's calibration, Kalibr's camchain, a ZED's .conf or DepthAI's .json.")
    ],
    source: Annotated[Path, typer.Option("--from", help="Recording, EuRoC folder, folder of pictures, or two videos.")],
    pairs: Annotated[int, typer.Option(min=1, max=500, help="How many pairs to look at, spread over all.")] = 24,
    side_by_side: SideBySide = False,
    json: JsonFile = None,
) -> None:
    """Check, without a board, that both eyes see things on one row, and name what has moved; exit code 1 if it has."""
    import cv2

    from calib.stereo.pair_files import load_pair
    from calib.stereo.pairs import read_pairs
    from calib.stereo.rows import check_rows
    from cli.console import check_writable, write_json

    check_writable(json)
    cv2.setNumThreads(1)
    known = load_pair(file)
    count = sum(1 for _ in read_pairs(source, side_by_side=side_by_side))
    step = max(1, count // pairs)
    chosen = (pair for k, pair in enumerate(read_pairs(source, side_by_side=side_by_side)) if k % step == 0)
    found = check_rows(known, chosen, str(source))
    _tell_rows(found, file, source)
    if json is not None:
        write_json(json, found.facts)
    if found.is_fault:
        raise typer.Exit(1)


def _tell_rows(found: "RowsCheck", file: Path, source: Path) -> None:
    from cli.console import console, table

    unit = {name: "" if name == "focal lengths" else "°" for name in found.values}
    factor = {name: 100.0 if name == "focal lengths" else math.degrees(1.0) for name in found.values}
    table(
        f"{source} with {file}: {found.matches} matches in {found.pairs} pairs",
        ["right eye against left", "value", "1 σ", "rows, px RMS"],
        [
            [
                name,
                f"{factor[name] * value:+.3f}{unit[name] or ' %'}",
                f"{factor[name] * found.stds[name]:.3f}",
                f"{found.shares_px[name]:.2f}",
            ]
            for name, value in found.values.items()
        ],
    )
    head = f"rows differ by {found.rms_px:.2f} ± {found.rms_std_px:.2f} px RMS, {found.most_px:.1f} px at most"
    verdict = (
        f"FAULT  {head}; most of it is {found.cause} of the right eye: calibrate the pair again (calibrate stereo)"
        if found.is_fault
        else f"{head}: no fault"
    )
    console.print(verdict, soft_wrap=True, highlight=False, markup=False)

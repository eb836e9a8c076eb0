"""Which file a new pair goes into: options and rule of all commands that bring one."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from messages import Calibration

Out = Annotated[Path | None, typer.Option(help="File to write; by default the one of --into, else calibration.yaml.")]
Into = Annotated[Path | None, typer.Option(help="Take all but the stereo pair from this calibration file.")]
Unit = Annotated[str | None, typer.Option(help="Name of the unit; by default made of the source's name.")]
SideBySide = Annotated[bool, typer.Option(help="A folder's pictures show both eyes beside each other.")]

_CALIBRATION = Path("calibration.yaml")


def target(out: Path | None, into: Path | None) -> "tuple[Path, Calibration | None]":
    """Return the file to write and the unit whose pair is to change, None for a new unit.

    Raises UserError where another unit's file would be overwritten, or where there is no pair to change.
    """
    from calib.files import load_calibration
    from messages import Calibration, UserError

    file = out or into or _CALIBRATION
    if file.exists() and (into is None or not file.samefile(into)):
        raise UserError(f"{file}: exists already; --into {file} changes its pair, --out names another file")
    if into is None:
        return file, None
    known = load_calibration(into)
    if not isinstance(known, Calibration):
        raise UserError(f"--into {into}: is of a depth camera, which has no pair")
    return file, known

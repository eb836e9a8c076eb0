"""`gaiteyes replay`: a recording, or a folder in the ASL layout, through the same pipeline as live."""

from pathlib import Path
from typing import Annotated

import typer


def replay(
    source: Annotated[Path, typer.Argument(help="An MCAP recording, or a folder in the EuRoC/ASL layout.")],
    out: Annotated[Path | None, typer.Option(help="Write every estimate as one JSON object a line.")] = None,
    config: Annotated[Path | None, typer.Option(help="Use this configuration, not the recorded one.")] = None,
    calibration: Annotated[Path | None, typer.Option(help="Use this calibration, not the source's own.")] = None,
    json: Annotated[Path | None, typer.Option(help="Write the summary for a program.")] = None,
) -> None:
    """Replay SOURCE; the same source gives the same bytes."""

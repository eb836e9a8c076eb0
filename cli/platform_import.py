"""`gaiteyes platform import`: a recording out of motion capture's C3D file."""

from pathlib import Path
from typing import Annotated

import typer


def import_c3d(
    file: Annotated[Path, typer.Argument(help="The C3D file.")],
    layout: Annotated[Path, typer.Argument(help="A platform.toml with a table [c3d]; see docs/platform.md.")],
    out: Annotated[Path, typer.Option(help="Folder to write the recording to.")],
) -> None:
    """Bring a C3D file into the recording format, checked."""
    from cli.console import console
    from cli.progress import working
    from impedance.recording.c3d import read_c3d

    with working("reading"):
        recording = read_c3d(file, layout)
    recording.save(out)
    for note in recording.notes:
        console.print(note)
    console.print(f"{out}: {len(recording.t_s)} poses, {len(recording.force_t_s)} wrenches")

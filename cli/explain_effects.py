"""`gaiteyes explain effects`: what the libraries hold."""

from pathlib import Path
from typing import Annotated

import typer


def effects(
    out: Annotated[Path | None, typer.Option(help="Markdown file to write: the page with all parameters.")] = None,
) -> None:
    """List every effect of every system's library."""
    from cli.console import console, table
    from messages.errors import UserError
    from systems.listing import libraries, page

    by_system = libraries()
    for system, library in by_system.items():
        table(system, ["effect", "what it is"], [[effect.name, effect.explanation] for effect in library], words=True)
    if out is not None:
        try:
            out.write_text(page(by_system), encoding="utf-8")
        except OSError as error:
            raise UserError(f"--out {out}: {error.strerror}") from error
        console.print(f"written to {out}")

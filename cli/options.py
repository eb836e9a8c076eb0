"""Options that mean the same in every command that has them."""

from pathlib import Path
from typing import Annotated

import typer

ConfigFile = Annotated[Path, typer.Option("--config", help="Configuration file (TOML); `gaiteyes init` writes one.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="File to write: the same facts for a program.")]
Workers = Annotated[int, typer.Option("--workers", min=1, help="Processes on this machine.")]

CONFIG_FILE = Path("gaiteyes.toml")

"""How `--help` lists commands: with the whole first sentence of each, which the library would cut to one line."""

from typing import Any

from typer.core import TyperGroup


class Commands(TyperGroup):
    """A command of commands."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for command in self.commands.values():
            command.short_help = " ".join((command.help or "").split("\n\n")[0].split())

"""The command line as a whole: version, help, completion, and options that mean the same everywhere."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tomli
from typer.main import get_command

from cli.main import app, main

HOME = Path(__file__).parents[2]
HEAVY = ("numpy", "messages", "rich", "cv2", "scipy")
_LOADED = "import sys; from cli.main import main; sys.argv = ['gaiteyes', '--help']\ntry: main()\nexcept SystemExit: {}"


def commands(command: Any, name: str = "gaiteyes") -> Iterator[tuple[str, Any]]:
    """Yield every command that does something, by its whole name."""
    for sub, each in getattr(command, "commands", {}).items():
        yield from commands(each, f"{name} {sub}")
    if not hasattr(command, "commands"):
        yield name, command


ALL = dict(commands(get_command(app)))


def options(name: str) -> dict[str, Any]:
    """Return the option called `name` of every command that has it."""
    return {command: p for command, each in ALL.items() for p in each.params if name in p.opts}


def run(*arguments: str) -> tuple[int, str, str]:
    """Return exit code, stdout and stderr of the command in a process of its own."""
    command = [sys.executable, "-m", "cli.main", *arguments]
    done = subprocess.run(command, cwd=HOME, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def test_help_loads_nothing_that_it_does_not_print() -> None:
    shown = f"print(*(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", _LOADED.format(shown)], cwd=HOME, capture_output=True, text=True, check=False
    )
    assert "Usage: " in done.stdout
    assert done.stderr.strip() == ""


@pytest.mark.parametrize(("asked", "threads"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_linear_algebra_takes_one_thread_unless_the_caller_says_otherwise(asked: dict[str, str], threads: str) -> None:
    shown = "import os, numpy; print(os.environ['OPENBLAS_NUM_THREADS'], file=sys.stderr)"
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")} | asked
    done = subprocess.run(
        [sys.executable, "-c", _LOADED.format(shown)], cwd=HOME, env=environment, capture_output=True, text=True
    )
    assert done.stderr.strip() == threads


def test_the_version_is_the_projects(capsys: pytest.CaptureFixture[str]) -> None:
    assert "version" in tomli.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dynamic"]
    app(["--version"], standalone_mode=False)
    stated = re.search(r'^__version__ = "(.*)"$', (HOME / "gaiteyes" / "__init__.py").read_text(), re.MULTILINE)
    assert stated is not None
    assert capsys.readouterr().out == f"gaiteyes {stated[1]}\n"


def test_commands_are_completed() -> None:
    asked = {"_MAIN_COMPLETE": "complete_bash", "COMP_WORDS": "gaiteyes plat", "COMP_CWORD": "1"}
    command = [sys.executable, "-c", "import sys; sys.argv = ['main']; from cli.main import main; main()"]
    done = subprocess.run(command, cwd=HOME, env={**os.environ, **asked}, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["platform"]


@pytest.mark.parametrize("name", ALL)
def test_help_swallows_nothing(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    app([*name.split()[1:], "--help"], standalone_mode=False)
    shown = re.sub(r"\s+|-\n", "", capsys.readouterr().out)
    for parameter in ALL[name].params:
        if getattr(parameter, "help", None):
            assert re.sub(r"\s+", "", parameter.help) in shown, parameter.name


def test_a_command_without_arguments_explains_itself_and_an_unknown_one_is_one_line() -> None:
    code, _, told = run("platform")
    assert code == 2
    assert told.startswith("Usage: ")
    assert run("plattform") == (2, "", "gaiteyes: No such command 'plattform'. Did you mean 'platform'?\n")


@pytest.mark.parametrize("name", ["--json", "--workers"])
def test_an_option_is_the_same_everywhere(name: str) -> None:
    found = options(name)
    assert len(found) > 1
    assert len({each.help for each in found.values()}) == 1


def test_processes_are_workers_and_what_is_written_is_a_file_or_a_folder() -> None:
    assert not options("--processes")
    for command, each in options("--out").items():
        assert re.search(r"\b(file|folder)\b", each.help, re.IGNORECASE), command


def test_square_brackets_of_a_files_name_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    from cli.console import console, table

    console.print("written to run[1]/[red]")
    table("run[2]", ["unit[3]"], [["[bold]"]])
    shown = capsys.readouterr().out
    assert all(text in shown for text in ("run[1]/[red]", "run[2]", "unit[3]", "[bold]"))


def test_main_is_what_is_installed() -> None:
    scripts = tomli.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    assert scripts == {"gaiteyes": f"{main.__module__}:{main.__name__}"}

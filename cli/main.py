"""The `gaiteyes` command. Wiring only: every command imports what it needs when it is called, so --help is fast."""

import logging
import os
import sys
from typing import Annotated

import typer

from cli.calibrate import calibrate
from cli.check import check
from cli.demo import demo
from cli.evaluate import evaluate
from cli.explain import explain
from cli.faults import faults
from cli.init import init
from cli.platform import platform
from cli.replay import replay
from cli.run import run
from cli.summaries import Commands
from cli.view import view

app = typer.Typer(
    name="gaiteyes",
    cls=Commands,
    no_args_is_help=True,
    rich_markup_mode=None,  # which takes [square brackets] for its own, and twice the time
    pretty_exceptions_enable=False,
)
app.command()(init)
app.command()(check)
app.command()(run)
app.command()(demo)
app.command()(view)
app.command()(replay)
app.command()(faults)
app.add_typer(evaluate, name="evaluate", cls=Commands)
app.add_typer(calibrate, name="calibrate", cls=Commands)
app.add_typer(platform, name="platform", cls=Commands)
app.add_typer(explain, name="explain", cls=Commands)


def _tell_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"gaiteyes {version('gaiteyes')}")
        raise typer.Exit


@app.callback()
def gaiteyes(
    version: Annotated[
        bool, typer.Option("--version", callback=_tell_version, is_eager=True, help="Tell the version and stop.")
    ] = False,
) -> None:
    """Eyes for a powered ankle prosthesis: slope and height of the ground at the next foothold."""


_THREADS_OF_ALGEBRA = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 where the caller has not set them: on matrices as small as these a second thread mostly waits, which takes a
processor and makes nothing quicker. Read when numpy is loaded, and by processes that a command starts."""


def main() -> None:
    """Run the command line; a user's mistake is one line on stderr and exit code 2, a failed service exit code 1."""
    from cli.logs import configure_logs

    for name in _THREADS_OF_ALGEBRA:
        os.environ.setdefault(name, "1")
    configure_logs()
    try:
        code = app(standalone_mode=False)
    except typer.TyperException as error:
        sys.exit(_told(error.format_message(), code=2))
    except (typer.Abort, KeyboardInterrupt):
        sys.exit(130)
    except Exception as error:
        from messages.errors import ServiceError, UserError  # not before: with numpy it takes as long as all of --help

        if not isinstance(error, UserError | ServiceError):
            raise
        sys.exit(_told(str(error), code=2 if isinstance(error, UserError) else 1))
    sys.exit(code)


def _told(line: str, *, code: int) -> int:
    if line.startswith("Usage: "):  # a command that is called without its arguments explains itself
        typer.echo(line, err=True)
    else:
        logging.getLogger("gaiteyes").error("%s", line)
    return code


if __name__ == "__main__":
    main()

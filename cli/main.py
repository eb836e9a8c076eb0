"""The `gaiteyes` command. Wiring only: every command imports what it needs when it is called, so --help is fast."""

import logging
import sys

import typer

from cli.calibrate import calibrate
from cli.check import check
from cli.demo import demo
from cli.evaluate import evaluate
from cli.explain import explain
from cli.faults import faults
from cli.platform import platform
from cli.replay import replay
from cli.run import run
from cli.view import view

app = typer.Typer(
    name="gaiteyes",
    help="Eyes for a powered ankle prosthesis: slope and height of the ground at the next foothold.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(run)
app.command()(check)
app.command()(demo)
app.command()(view)
app.command()(replay)
app.command()(faults)
app.add_typer(evaluate, name="evaluate")
app.add_typer(calibrate, name="calibrate")
app.add_typer(platform, name="platform")
app.add_typer(explain, name="explain")


def main() -> None:
    """Run the command line; a user's mistake is one line on stderr and exit code 2, a failed service exit code 1."""
    from cli.logs import configure_logs
    from messages.errors import ServiceError, UserError

    configure_logs()
    try:
        code = app(standalone_mode=False)
    except UserError as error:
        sys.exit(_told(str(error), code=2))
    except ServiceError as error:
        sys.exit(_told(str(error), code=1))
    except typer.TyperException as error:
        sys.exit(_told(error.format_message(), code=2))
    except (typer.Abort, KeyboardInterrupt):
        sys.exit(130)
    sys.exit(code)


def _told(line: str, *, code: int) -> int:
    if line:  # help alone says nothing more
        logging.getLogger("gaiteyes").error("%s", line)
    return code


if __name__ == "__main__":
    main()

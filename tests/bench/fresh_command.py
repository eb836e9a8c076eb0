"""The command in a process of its own that has its imports behind it: they take longer than many an explanation.

Each call is forked from a server that has imported what `gaiteyes explain` needs and done nothing else.
"""

import os
import sys
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

from cli.main import main

_IMPORTED = (
    *("cli.main", "cli.console", "cli.progress", "discrepancy.finder", "discrepancy.report.output"),
    *("systems.platform", "systems.imu", "systems.wearable"),
)
_SERVER = get_context("forkserver")
_SERVER.set_forkserver_preload([__name__, *_IMPORTED])


def run(arguments: Sequence[str], log: Path, longest_s: float) -> int:
    """Run `gaiteyes` with these arguments, what it tells into `log`; return its exit code, negative if it was ended."""
    process = _SERVER.Process(target=_command, args=(list(arguments), str(log)))
    process.start()
    process.join(longest_s)
    if process.exitcode is None:
        process.kill()
        process.join()
    code = process.exitcode
    process.close()
    return -1 if code is None else code


def _command(arguments: list[str], log: str) -> None:
    told = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    for stream in (1, 2):
        os.dup2(told, stream)
    sys.argv = ["gaiteyes", *arguments]
    main()

"""What an example prints, run as a user runs it: in a process of its own."""

import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"
PATIENCE_S = 60.0


def heard(example: str, *arguments: str, enough: Callable[[list[str]], bool]) -> list[str]:
    """Return the lines that the example prints until they are `enough`.

    A busy machine adds lines before and between: what is refused or late. So wait for lines, not for a number of them.
    Raises AssertionError with what was heard, and what the example complained of, if `PATIENCE_S` do not bring enough.
    """
    command = [sys.executable, str(EXAMPLES / example), *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        watchdog = threading.Timer(PATIENCE_S, process.kill)
        watchdog.start()
        assert process.stdout is not None
        assert process.stderr is not None
        lines = list[str]()
        for line in process.stdout:
            lines.append(line.rstrip())
            if enough(lines):
                break
        watchdog.cancel()
        process.kill()
        assert enough(lines), "\n".join([f"not enough in {PATIENCE_S} s:", *lines, process.stderr.read()])
        return lines

"""Fuzzes every decoder guided by coverage: `python -m tests.fuzz.guided [--seconds 60] [--only NAME] [--keep DIR]`.

Where `python -m tests.fuzz` damages sound input blindly, this keeps what reaches new branches of the project's code,
and changes that further (atheris, libFuzzer). Each decoder runs in a process of its own, from its sound samples and
from what earlier runs kept in DIR. What breaks it is written there, and the exit code is 1.
"""

import argparse
import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from tests.fuzz.decoders import chosen_decoders

_SECONDS_BEYOND = 120
"""What a process may take beyond its time, to start and to end."""


class Guided(NamedTuple):
    """What one decoder's process did: inputs it was given, those kept because they reached something new, branches
    reached, and its exit code."""

    inputs: int
    kept: int
    branches: int
    exit_code: int


def fuzz(name: str, keep: Path, seconds: int) -> Guided:
    """Return what becomes of `seconds` of inputs to the decoder called `name`; its log stands beside what it kept."""
    folder = keep / name.replace(" ", "-").replace(",", "")
    folder.mkdir(parents=True, exist_ok=True)
    ended = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.guided_process", name, str(folder), str(seconds)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=seconds + _SECONDS_BEYOND,
        check=False,
    )
    (folder / "log.txt").write_text(ended.stdout)
    return Guided(
        _last(r"stat::number_of_executed_units:\s+(\d+)", ended.stdout),
        _last(r"stat::new_units_added:\s+(\d+)", ended.stdout),
        _last(r"cov: (\d+)", ended.stdout),
        ended.returncode,
    )


def _last(pattern: str, text: str) -> int:
    found = re.findall(pattern, text)
    return int(found[-1]) if found else 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=60, help="for each decoder")
    parser.add_argument("--only", help="names that begin so")
    parser.add_argument("--keep", type=Path, default=Path("build/fuzz-guided"), help="where corpus, logs and faults go")
    arguments = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        sys.exit("atheris is not installed: it has wheels for CPython 3.11 on x86-64 alone (extra dev)")
    chosen, faults = chosen_decoders(arguments.only), 0
    print(f"{'decoder':28}{'inputs':>9}{'kept':>9}{'branches':>9}{'exit':>6}", flush=True)
    for decoder in chosen:
        done = fuzz(decoder.name, arguments.keep, arguments.seconds)
        faults += done.exit_code != 0
        print(f"{decoder.name:28}{done.inputs:9}{done.kept:9}{done.branches:9}{done.exit_code:6}", flush=True)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()

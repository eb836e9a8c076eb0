"""One case: its recordings are written, the command runs on them in processes of its own, and what it told is read.

The command sees two folders of nameless recordings and nothing else; the truth is in this process's memory alone.
"""

import math
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import msgspec
import numpy as np

from lab.court.plan import PORTED, Slot, asked, hidden_system
from lab.court.result import Errors, Result, Told
from lab.hidden.case import Case, Kind

_HOME = Path(__file__).parents[2]
_LONGEST_S = 600.0  # after which a command counts as failed


def judged(slot: Slot, case: Case) -> Result:
    """Return the result of a case. A pure function of its arguments but for the time it took: it runs anywhere."""
    with tempfile.TemporaryDirectory(prefix="gaiteyes-case-") as name:
        folder = Path(name)
        fit, held_out, out = folder / "fit", folder / "held_out", folder / "out"
        truth = hidden_system(case.system).write(case, fit, held_out)
        command = [*asked(case.system, fit, held_out), "--no-report"]
        without = ["--without", ",".join(slot.left_out)] if slot.left_out else []
        began_s, began_cpu_s = time.monotonic(), _cpu_s()
        failure = _run([*command, *without, "--out", str(out)])
        seconds, cpu_seconds = time.monotonic() - began_s, _cpu_s() - began_cpu_s
        told = None if failure else msgspec.json.decode((out / "verdict.json").read_bytes(), type=Told)
        errors = None if failure else held_out_errors(out / "held_out.csv")
        oracle = None
        if case.kind in (Kind.SINGLE, Kind.PAIR) and case.system not in PORTED:
            known = folder / "known"
            if not _run([*command, "--only", ",".join(case.effects), "--out", str(known)]):
                oracle = held_out_errors(known / "held_out.csv")
    return Result(truth, slot.left_out, told, errors, oracle, seconds, cpu_seconds, failure)


def held_out_errors(path: Path) -> Errors:
    """Return the NRMSE of base and extended model from held_out.csv, over what all three have.

    The RMS over the channels, each divided by the standard deviation of what was measured.
    """
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        table = np.genfromtxt(file, delimiter=",", ndmin=2)
    sides = table[:, 1:].reshape(len(table), -1, 3)  # (n, c, measured | base | extended)
    if [name.split("_", 1)[0] for name in names[1:4]] != ["measured", "base", "extended"]:
        raise ValueError(f"{path}: columns {names[1:4]}; expected measured, base, extended")
    sides[~np.isfinite(sides).all(axis=2)] = np.nan
    used = np.isfinite(sides[:, :, 0]).any(axis=0)
    spread = np.nanstd(sides[:, used, 0], axis=0)
    misses = sides[:, used, :1] - sides[:, used, 1:]
    squares = np.nanmean(misses**2, axis=0)[spread > 0.0] / spread[spread > 0.0, None] ** 2  # (c, base | extended)
    before, after = np.sqrt(squares.mean(axis=0)).tolist() if len(squares) else (math.nan, math.nan)
    return Errors(*(error if math.isfinite(error) else None for error in (before, after)))


def _cpu_s() -> float:
    """Return what this process's ended children have computed."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _run(arguments: list[str]) -> str:
    """Run the command line; return nothing, or the last line of what it complained of."""
    command = [sys.executable, "-m", "cli.main", *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST_S, cwd=_HOME, check=False)
    except subprocess.TimeoutExpired:
        return f"took longer than {_LONGEST_S:g} s"
    return (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1] if done.returncode else ""

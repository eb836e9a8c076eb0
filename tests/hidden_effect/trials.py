"""Cases drawn one after another until a finder has proved itself, or has failed."""

import secrets
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from discrepancy.verdict import Verdict, from_json
from sim_rig.hidden.case import Case, Kind, System, Truth

AHEAD = 3
"""Right less wrong verdicts that end the trial. Who is right in nine of ten fails once in 700 trials, who is right in
half fails every other one."""


def drawn(name: str, system: System, effects: Sequence[str], mechanisms: Sequence[str]) -> Case:
    """Return a case with a seed that nobody knew: half of them hide an effect, a quarter a mechanism of no library."""
    kind = secrets.choice((Kind.SINGLE, Kind.SINGLE, Kind.CLEAN, Kind.OUTSIDE if mechanisms else Kind.CLEAN))
    hidden = {Kind.SINGLE: effects, Kind.OUTSIDE: mechanisms}.get(kind)
    assert set(effects) <= set(system.EFFECTS)
    assert set(mechanisms) <= set(system.OUTSIDE)
    return Case(name, 1000 + secrets.randbelow(1 << 30), kind, (secrets.choice(hidden),) if hidden else ())


def judged(system: System, case: Case, folder: Path) -> tuple[Truth, Verdict]:
    """Return what `case` hides and what a fresh process says, which gets the two folders and nothing else."""
    truth = system.write(case, folder / "fit", folder / "held_out")
    command = [sys.executable, "-m", "cli.main", "explain", case.system, str(folder / "fit")]
    options = ["--held-out", str(folder / "held_out"), "--out", str(folder / "out"), "--no-report"]
    subprocess.run([*command, *options], check=True, capture_output=True, timeout=300)
    return truth, from_json((folder / "out" / "verdict.json").read_bytes())


def is_right(truth: Truth, verdict: Verdict) -> bool:
    """Return whether the verdict is what the case asks for: the names, half of the excess removed; nothing; unknown."""
    if truth.kind is Kind.CLEAN:
        return verdict.verdict == "nothing" and not verdict.causes
    if truth.kind is Kind.OUTSIDE:
        return verdict.verdict == "unknown"
    told = [{cause.name, *cause.equivalents} for cause in verdict.causes[: len(truth.causes)]]
    named = all(any(cause.name in names for names in told) for cause in truth.causes)
    removed = verdict.gain.share_of_excess_removed
    return verdict.verdict == "named" and named and removed is not None and removed >= 0.5


def prevails(system: System, next_case: Callable[[], Case], folder: Path) -> bool:
    """Return whether right verdicts come to be `AHEAD` before wrong ones do; every case is printed."""
    ahead = number = 0
    while abs(ahead) < AHEAD:
        case, number = next_case(), number + 1
        truth, verdict = judged(system, case, folder / str(number))
        right = is_right(truth, verdict)
        ahead += 1 if right else -1
        print(f"{'right' if right else 'WRONG'}: {case}: {verdict.verdict} {verdict.causes}; true {truth.causes}")
    return ahead > 0

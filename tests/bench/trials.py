"""Cases drawn one after another until a finder has proved itself, or has failed."""

import secrets
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from discrepancy.verdict import Verdict, from_json
from lab.court.plan import look_alikes
from lab.hidden.case import Case, Kind, System, TrueCause, Truth

KINDS = (*[Kind.SINGLE] * 4, Kind.PAIR, Kind.CLEAN, Kind.OUTSIDE, Kind.WITHHELD)
AHEAD = 3
"""Right less wrong verdicts that end the trial. Who is right in nine of ten fails once in 700 trials, who is right in
half fails every other one."""


def drawn(name: str, system: System, kinds: Sequence[Kind]) -> Case:
    """Return a case of one of the kinds with a seed that nobody knew."""
    kind = secrets.choice(kinds)
    asked: dict[Kind, Sequence[tuple[str, ...]]] = {
        Kind.CLEAN: ((),),
        Kind.PAIR: system.PAIRS,
        Kind.OUTSIDE: [(mechanism,) for mechanism in system.OUTSIDE],
    }
    hidden = secrets.choice(asked.get(kind, [(effect,) for effect in system.EFFECTS]))
    return Case(name, 1000 + secrets.randbelow(1 << 30), kind, hidden)


def judged(system: System, case: Case, folder: Path) -> tuple[Truth, Verdict]:
    """Return what `case` hides and what a fresh process says, which gets the two folders and nothing else.

    Of an effect that is withheld it gets a library without it and its look-alikes.
    """
    truth = system.write(case, folder / "fit", folder / "held_out")
    return truth, explained(
        case.system, folder, look_alikes(system, *case.effects) if case.kind is Kind.WITHHELD else ()
    )


def explained(name: str, folder: Path, left_out: Sequence[str] = ()) -> Verdict:
    """Return what a fresh process says of the recordings in `folder`, its library without what is left out."""
    command = [sys.executable, "-m", "cli.main", "explain", name, str(folder / "fit")]
    options = ["--held-out", str(folder / "held_out"), "--out", str(folder / "out"), "--no-report"]
    if left_out:
        options += ["--without", ",".join(left_out)]
    subprocess.run([*command, *options], check=True, capture_output=True, timeout=300)
    return from_json((folder / "out" / "verdict.json").read_bytes())


def is_right(truth: Truth, verdict: Verdict) -> bool:
    """Return whether the verdict is what the case asks for.

    That is `nothing`, or `unknown`, or the names, half of the excess removed and, of a single cause told by its own
    name, most parameters in their intervals.
    """
    if truth.kind is Kind.CLEAN:
        return verdict.verdict == "nothing" and not verdict.causes
    if truth.kind in (Kind.OUTSIDE, Kind.WITHHELD):
        return verdict.verdict == "unknown"
    told = [{cause.name, *cause.equivalents} for cause in verdict.causes[: len(truth.causes)]]
    named = all(any(cause.name in names for names in told) for cause in truth.causes)
    removed = verdict.gain.share_of_excess_removed
    sized = truth.kind is Kind.PAIR or _is_sized(truth.causes[0], verdict)
    return verdict.verdict == "named" and named and sized and removed is not None and removed >= 0.5


def _is_sized(true: TrueCause, verdict: Verdict) -> bool:
    told = next((cause.parameters for cause in verdict.causes if cause.name == true.name), None)
    if told is None or not true.parameters:
        return True
    inside = 0
    for name, value in true.parameters.items():
        quantity = told.get(name)
        if quantity is not None and quantity.low is not None and quantity.high is not None:
            inside += quantity.low <= value <= quantity.high
    return 2 * inside > len(true.parameters)


def prevails(name: str, system: System, folder: Path, kinds: Sequence[Kind] = KINDS) -> bool:
    """Return whether right verdicts come to be `AHEAD` before wrong ones do; every case is printed."""
    ahead = number = 0
    while abs(ahead) < AHEAD:
        case, number = drawn(name, system, kinds), number + 1
        truth, verdict = judged(system, case, folder / str(number))
        right = is_right(truth, verdict)
        ahead += 1 if right else -1
        print(f"{'right' if right else 'WRONG'}: {case}: {verdict.verdict} {verdict.causes}; true {truth.causes}")
    return ahead > 0

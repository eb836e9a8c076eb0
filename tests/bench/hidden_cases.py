"""Hidden cases of all systems: drawn from one seed, each written and explained in a process of its own, and counted.

How often a finder must be right of how many cases is computed from the rates that are declared here, so that one with
these rates fails in fewer than one of 10 000 runs.
"""

import os
import random
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binom

from discrepancy.verdict import Verdict, from_json
from lab.court.plan import DEVELOPMENT_SEEDS, SYSTEMS, hidden_system, look_alikes
from lab.court.run import executor
from lab.hidden.case import Case, Kind, System, TrueCause, Truth
from tests.bench import fresh_command

CASES: dict[str, dict[Kind, int]] = {
    "platform": {Kind.SINGLE: 14, Kind.PAIR: 6, Kind.CLEAN: 6, Kind.OUTSIDE: 4, Kind.WITHHELD: 5},
    "imu": {Kind.SINGLE: 20, Kind.PAIR: 8, Kind.CLEAN: 8, Kind.OUTSIDE: 6, Kind.WITHHELD: 6},
    "wearable": {Kind.SINGLE: 10, Kind.PAIR: 3, Kind.CLEAN: 3, Kind.OUTSIDE: 2, Kind.WITHHELD: 2},
}
"""How many cases of each kind a run draws: fewer where a case takes longer."""

RATES = {Kind.SINGLE: 0.85, Kind.PAIR: 0.8, Kind.CLEAN: 0.93, Kind.OUTSIDE: 0.72, Kind.WITHHELD: 0.72}
"""How often a finder is right that is no worse than the one of docs/court.md, with a margin of some 0.05: its rates
were counted over 20 to 90 cases each."""

KINDS = {
    "one effect": (Kind.SINGLE,),
    "two effects": (Kind.PAIR,),
    "nothing": (Kind.CLEAN,),
    "in no library": (Kind.OUTSIDE, Kind.WITHHELD),
}
"""What a run counts apart."""

LOOK_ALIKE_CASES, LOOK_ALIKE_RATE = 12, 0.85
"""Cases whose recordings cannot tell two effects apart, and how often a finder says so."""

BROKEN_RATE = 1.0 / 15.0
"""How often a finder is right that always says the same, or names effects of its library (15 or more) at random."""

FALSE_FAILURE = 1e-5
"""How often one count may be too low by chance. A run makes fewer than ten."""

LONGEST_S = 600.0


class ExplainError(Exception):
    """The command that explains a case failed: what it told."""


@dataclass(frozen=True)
class Judged:
    """A case, whether the verdict was right, and both in a line. A finder that crashed leaves `failure`."""

    case: Case
    right: bool
    line: str
    failure: str = ""


def drawn(seed: int) -> list[Case]:
    """Return all cases of a run; every one follows from `seed`. Effects of a kind repeat only when all had a turn."""
    source = random.Random(seed)
    cases = []
    for name, counts in CASES.items():
        system = hidden_system(name)
        for kind, count in counts.items():
            choices = hideable(system, kind)
            effects = [
                choice for _ in range(-(-count // len(choices))) for choice in source.sample(choices, len(choices))
            ]
            cases += [Case(name, drawn_seed(source), kind, each) for each in effects[:count]]
    source.shuffle(cases)
    return cases


def drawn_seed(source: random.Random) -> int:
    """Return the seed of one case, none of those that development looks at."""
    return DEVELOPMENT_SEEDS.stop + source.randrange(2**62)


def hideable(system: System, kind: Kind) -> Sequence[tuple[str, ...]]:
    """Return what a case of a kind may hide."""
    if kind is Kind.CLEAN:
        return [()]
    if kind is Kind.PAIR:
        return system.PAIRS
    return [(name,) for name in (system.OUTSIDE if kind is Kind.OUTSIDE else system.EFFECTS)]


def in_processes(judge: Callable[[Case], Judged], cases: Sequence[Case]) -> Iterator[Judged]:
    """Yield the judged cases as they end, on all processors."""
    with executor(os.cpu_count() or 1, None) as workers:
        for future in as_completed([workers.submit(judge, case) for case in cases]):
            yield future.result()


def judged(case: Case) -> Judged:
    """Write a case and return whether a fresh process, given its two folders alone, tells what it asks for."""
    system = hidden_system(case.system)
    left_out = look_alikes(system, *case.effects) if case.kind is Kind.WITHHELD else ()
    with tempfile.TemporaryDirectory(prefix="gaiteyes-hidden-") as name:
        folder = Path(name)
        truth = system.write(case, folder / "fit", folder / "held_out")
        try:
            verdict = explained(case.system, folder, left_out)
        except ExplainError as error:
            return Judged(case, False, f"FAILED: {described(case)}", str(error))
    right = is_right(truth, verdict)
    answer = "; ".join(" or ".join((cause.name, *cause.equivalents)) for cause in verdict.causes)
    return Judged(case, right, f"{'right' if right else 'WRONG'}: {described(case)}: {verdict.verdict} {answer}")


def described(case: Case) -> str:
    """Return a case in a few words."""
    return f"{case.system} {case.kind.value} {' and '.join(case.effects)} (seed {case.seed})"


def explained(name: str, folder: Path, left_out: Sequence[str] = ()) -> Verdict:
    """Return what a fresh process says of `folder`'s fit/ and held_out/, its library without what is left out.

    Raises ExplainError where it fails.
    """
    command = ["explain", name, str(folder / "fit"), "--held-out", str(folder / "held_out")]
    options = ["--out", str(folder / "out"), "--no-report"]
    if left_out:
        options += ["--without", ",".join(left_out)]
    log = folder / "log"
    code = fresh_command.run([*command, *options], log, LONGEST_S)
    if code:
        raise ExplainError(f"exit code {code}: {log.read_text(encoding='utf-8')}")
    return from_json((folder / "out" / "verdict.json").read_bytes())


def is_right(truth: Truth, verdict: Verdict) -> bool:
    """Return whether the verdict is what the case asks for.

    That is `nothing`, or `unknown`, or the names, half of the excess removed and, of a single cause named by its own
    name, most parameters in their intervals.
    """
    if truth.kind is Kind.CLEAN:
        return verdict.verdict == "nothing" and not verdict.causes
    if truth.kind in (Kind.OUTSIDE, Kind.WITHHELD):
        return verdict.verdict == "unknown"
    answers = [{cause.name, *cause.equivalents} for cause in verdict.causes[: len(truth.causes)]]
    named = all(any(cause.name in names for names in answers) for cause in truth.causes)
    gain = verdict.gain
    before, after = gain.held_out_nrmse_before, gain.held_out_nrmse_after
    removed = gain.share_of_excess_removed
    # A share is told only where the noise is known; elsewhere the error on the recording held out must have fallen.
    gained = removed >= 0.5 if removed is not None else before is not None and after is not None and after < before
    sized = truth.kind is Kind.PAIR or _is_sized(truth.causes[0], verdict)
    return verdict.verdict == "named" and named and sized and gained


def _is_sized(true: TrueCause, verdict: Verdict) -> bool:
    estimated = next((cause.parameters for cause in verdict.causes if cause.name == true.name), None)
    if estimated is None or not true.parameters:
        return True
    inside = 0
    for name, value in true.parameters.items():
        quantity = estimated.get(name)
        if quantity is not None and quantity.low is not None and quantity.high is not None:
            inside += quantity.low <= value <= quantity.high
    return 2 * inside > len(true.parameters)


def fewest_right(counts: dict[float, int]) -> int:
    """Return the fewest right of so many cases at each rate that do not fail: fewer come by chance 1e-5 of the time."""
    return int(np.searchsorted(np.cumsum(_probabilities(counts)), FALSE_FAILURE))


def false_failure(counts: dict[float, int]) -> float:
    """Return how often a finder with these rates, and so many cases at each, has fewer right than it needs."""
    return float(_probabilities(counts)[: fewest_right(counts)].sum())


def broken_pass(counts: dict[float, int]) -> float:
    """Return how often a finder that is right at BROKEN_RATE has as many right of the same cases as it needs."""
    return float(binom.sf(fewest_right(counts) - 1, sum(counts.values()), BROKEN_RATE))


def _probabilities(counts: dict[float, int]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the probability of 0, 1, 2 … right."""
    all_kinds = np.ones(1)
    for rate, count in counts.items():
        all_kinds = np.convolve(all_kinds, binom.pmf(np.arange(count + 1), count, rate))
    return all_kinds


def counts_of(kinds: Iterable[Kind], systems: Iterable[str] = SYSTEMS) -> dict[float, int]:
    """Return how many cases a run draws at each declared rate."""
    counts: dict[float, int] = {}
    for name in systems:
        for kind in kinds:
            counts[RATES[kind]] = counts.get(RATES[kind], 0) + CASES[name][kind]
    return counts

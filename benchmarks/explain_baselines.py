"""The finder beside what else could be done about a simulation that is wrong, on a court's own cases.

    python -m benchmarks.explain_baselines COURT [--systems platform,imu] [--cases 40] [--out FOLDER] [--json FILE]

COURT is a folder that `gaiteyes explain court --out COURT` filled. Each case is written again out of its seed, and
the baselines of `benchmarks.baseline_models` are fitted to the one recording and judged on the other, as the finder
was. The share of the excess removed is the finder's, (before² − after²) / (before² − floor²), with one floor for
all: the least that the declared noise, the oracle, any method, or the finder's own rule on any residual tells. Sparse
regression and Gaussian process need the extra `baselines`. One file per case in --out; what is there is not computed
again.
"""

import argparse
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.baseline_models import BASELINES, Case
from cli.console import console, progress, table, write_json
from discrepancy.evidence.adequacy import Probe
from discrepancy.evidence.gain import gain, nrmse
from discrepancy.evidence.whitening import whitening
from discrepancy.problem import Problem
from lab.court.plan import SYSTEMS, hidden_system
from lab.court.result import Result
from lab.hidden import case as hidden
from lab.hidden.case import Kind
from messages.errors import UserError

FINDER = "finder"
_LEAST_EXCESS = 0.05  # of before²: below, there is nothing to remove
_WINS_BY = 0.05
_PROBE_SEED = 1
_ROWS = {
    "one effect": (Kind.SINGLE,),
    "two effects": (Kind.PAIR,),
    "outside the library": (Kind.OUTSIDE, Kind.WITHHELD),
    "nothing hidden": (Kind.CLEAN,),
}


class JudgedCase(msgspec.Struct, frozen=True):
    """One case: held-out NRMSE of the base model, its floor, and after each method; seconds; what each said."""

    system: str
    kind: Kind
    effects: tuple[str, ...]
    seed: int
    before: float
    floor: float
    after: dict[str, float]
    seconds: dict[str, float]
    says: dict[str, str]

    @property
    def has_excess(self) -> bool:
        """Tell whether there is anything to remove."""
        return self.before**2 - self.floor**2 > _LEAST_EXCESS * self.before**2

    def share(self, method: str) -> float:
        """Return the share of the excess that a method removes, −1 for all that is worse than doubling it."""
        removed = (self.before**2 - self.after[method] ** 2) / (self.before**2 - self.floor**2)
        return float(np.clip(removed, -1.0, 1.0))


def main() -> None:
    arguments = _arguments()
    out = arguments.out or arguments.court / "baselines"
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--out {out}: {error.strerror}") from error
    judged: list[JudgedCase] = []
    for system in arguments.systems.split(","):
        files = _spread(sorted(arguments.court.glob(f"{system}-*.json")), arguments.cases)
        if not files:
            raise UserError(f"{arguments.court}: no results of {system}; run gaiteyes explain court --out there first")
        judged += [_of_file(file, out / file.name) for file in progress(files, system)]
    for system in dict.fromkeys(case.system for case in judged):
        _print(system, [case for case in judged if case.system == system])
    if arguments.json is not None:
        write_json(arguments.json, judged)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="The finder's baselines on a court's cases.")
    parser.add_argument("court", type=Path)
    parser.add_argument("--systems", default=",".join(SYSTEMS))
    parser.add_argument("--cases", type=int, help="of each system, spread evenly; all by default")
    parser.add_argument("--out", type=Path, help="folder of results, COURT/baselines by default")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def _spread(files: Sequence[Path], count: int | None) -> list[Path]:
    if count is None or count >= len(files):
        return list(files)
    return [files[place * len(files) // count] for place in range(count)]


def _of_file(court: Path, kept: Path) -> JudgedCase:
    if kept.exists():
        return msgspec.json.decode(kept.read_bytes(), type=JudgedCase)
    found = judged(Result.load(court))
    part = kept.with_name(kept.name + ".part")
    part.write_bytes(msgspec.json.encode(found))
    os.replace(part, kept)
    return found


def judged(result: Result) -> JudgedCase:
    """Return a case of the court with all baselines; its recordings are drawn again from its seed."""
    truth = result.truth
    case = hidden.Case(truth.system, truth.seed, truth.kind, _as_drawn(result))
    with tempfile.TemporaryDirectory(prefix="gaiteyes-baselines-") as name:
        fit, held_out = Path(name) / "fit", Path(name) / "held_out"
        hidden_system(truth.system).write(case, fit, held_out)
        load = import_module(f"systems.{truth.system}").load
        began_s = time.monotonic()
        both = Case.of(Problem(load(fit)), Problem(load(held_out)))
        seconds = {"base model": time.monotonic() - began_s}
        after, says = {}, {}
        before = nrmse(both.held, both.residual_held)
        floors = [_floor(both, both.predicted_held)]
        for baseline in BASELINES:
            began_s = time.monotonic()
            told = baseline.told(both)
            seconds[baseline.name] = time.monotonic() - began_s
            after[baseline.name] = nrmse(both.held, both.held.difference(told.predicted))
            says[baseline.name] = told.says
            floors.append(_floor(both, told.predicted))
    told_names = [cause.name for cause in result.told.causes] if result.told is not None else []
    errors, oracle = result.errors, result.oracle
    share_left = errors.after / errors.before if errors is not None and errors.before and errors.after else 1.0
    after[FINDER] = before * share_left
    if oracle is not None and oracle.before and oracle.after:
        floors.append(before * oracle.after / oracle.before)
    seconds[FINDER] = result.seconds
    says[FINDER] = ", ".join(told_names) or ("failed" if result.told is None else result.told.verdict)
    return JudgedCase(
        truth.system,
        truth.kind,
        tuple(cause.name for cause in truth.causes),
        truth.seed,
        before,
        min(*floors, *after.values()),
        after,
        seconds,
        says,
    )


def _as_drawn(result: Result) -> tuple[str, ...]:
    """Return a case's effects in the order in which it was drawn; a truth tells them strongest first."""
    effects = tuple(cause.name for cause in result.truth.causes)
    if result.truth.kind is not Kind.PAIR:
        return effects
    pairs = hidden_system(result.truth.system).PAIRS
    return next((pair for pair in pairs if set(pair) == set(effects)), effects)


def _floor(case: Case, predicted: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Return the noise floor that the finder would tell of the held-out residual."""
    residual = case.held.difference(predicted)
    probe = Probe(case.held, whitening(residual, case.held.valid), case.predicted_held, _PROBE_SEED)
    signal = probe.predictable(residual).signal
    floor = gain(case.held, case.residual_held, residual, signal, True).noise_floor_nrmse
    return np.inf if floor is None else floor


def _print(system: str, cases: Sequence[JudgedCase]) -> None:
    methods = [FINDER, *(baseline.name for baseline in BASELINES)]
    names = {FINDER: "the cause", **{baseline.name: baseline.names for baseline in BASELINES}}
    rows = []
    for method in methods:
        cells = [method, names[method]]
        for title, kinds in _ROWS.items():
            of_kind = [case for case in cases if case.kind in kinds]
            if title == "nothing hidden":
                grown = [(case.after[method] / case.before) ** 2 - 1.0 for case in of_kind]
                cells.append(f"{100 * np.mean(grown):+.1f} %" if grown else "–")
            else:
                mean, count = _macro([case for case in of_kind if case.has_excess], method)
                cells.append(f"{100 * mean:.0f} % of {count}" if count else "–")
        excess = [case for case in cases if case.has_excess and case.kind is not Kind.CLEAN]
        wins = sum(case.share(method) > case.share(FINDER) + _WINS_BY for case in excess)
        cells.append("–" if method == FINDER else f"{wins} of {len(excess)}")
        cells.append(f"{np.median([case.seconds[method] for case in cases]):.1f} s")
        rows.append(cells)
    table(
        f"{system}: share of the held-out excess removed, averaged over effects; error power added to clean data",
        ["", "names", *_ROWS, "beats the finder", "median time"],
        rows,
    )
    best = sorted(
        (
            (case.share(baseline.name) - case.share(FINDER), baseline.name, case)
            for baseline in BASELINES
            for case in cases
            if case.has_excess and case.kind is not Kind.CLEAN
        ),
        key=lambda each: -each[0],
    )
    table(
        f"{system}: where a baseline beats the finder",
        ["hidden", "baseline", "its share", "finder's share", "finder said", "baseline said"],
        [
            [
                f"{case.kind.value}: {' + '.join(case.effects)}",
                name,
                f"{case.share(name):.2f}",
                f"{case.share(FINDER):.2f}",
                case.says[FINDER],
                case.says[name],
            ]
            for lead, name, case in best[:15]
            if lead > _WINS_BY
        ],
        words=True,
    )


def _macro(cases: Sequence[JudgedCase], method: str) -> tuple[float, int]:
    """Return the mean over effects of the mean share, and over how many cases."""
    by_effect: dict[tuple[str, ...], list[float]] = defaultdict(list)
    for case in cases:
        by_effect[case.effects].append(case.share(method))
    if not by_effect:
        return float("nan"), 0
    return float(np.mean([np.mean(shares) for shares in by_effect.values()])), sum(map(len, by_effect.values()))


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        console.print(str(error), highlight=False, markup=False)
        raise SystemExit(2) from None

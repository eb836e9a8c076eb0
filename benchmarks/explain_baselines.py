"""The finder beside what else could be done about a simulation that is wrong, on a court's own cases.

    python -m benchmarks.explain_baselines COURT [--systems platform,imu] [--cases 40] [--out FOLDER] [--json FILE]

COURT is a folder that `gaiteyes explain court --out COURT` filled. Each case is written again out of its seed, and
the baselines of `lab.baselines` are fitted to the one recording and judged on the other, as the finder was. Sparse
regression and Gaussian process need the extra `baselines`. One file per case in --out; what is there is not computed
again.
"""

import argparse
import os
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from cli.console import console, table, write_json
from cli.progress import progress
from lab.baselines.judged_case import FINDER, JudgedCase, judged
from lab.baselines.models import BASELINES
from lab.court.plan import SYSTEMS
from lab.court.result import Result
from lab.hidden.case import Kind
from messages.errors import UserError

_WINS_BY = 0.05
_ROWS = {
    "one effect": (Kind.SINGLE,),
    "two effects": (Kind.PAIR,),
    "outside the library": (Kind.OUTSIDE, Kind.WITHHELD),
    "nothing hidden": (Kind.CLEAN,),
}


def main() -> None:
    arguments = _arguments()
    out = arguments.out or arguments.court / "baselines"
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--out {out}: {error.strerror}") from error
    cases: list[JudgedCase] = []
    for system in arguments.systems.split(","):
        files = _spread(sorted(arguments.court.glob(f"{system}-*.json")), arguments.cases)
        if not files:
            raise UserError(f"{arguments.court}: no results of {system}; run gaiteyes explain court --out there first")
        cases += [_of_file(file, out / file.name) for file in progress(files, system)]
    for system in dict.fromkeys(case.system for case in cases):
        _print(system, [case for case in cases if case.system == system])
    if arguments.json is not None:
        write_json(arguments.json, cases)


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

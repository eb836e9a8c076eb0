"""What is constructed where no library names the cause: `python -m benchmarks.constructed [--cases N] [--out FILE]`.

Five systems unlike each other, modelled with ports and no library at all; something is hidden in each, or nothing. In
every second case the noise is not declared. Seeds from 1000 on, of which nothing was tuned on; `--development` takes
those from 1 on. Each case is a line of FILE as soon as it is done, and is not done again.
"""

import argparse
import json
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from discrepancy import explain
from discrepancy.verdict import Verdict
from lab.hidden.five.studied import CLEAN, STUDIED, studied
from lab.undeclared.five_systems import simulation

JUDGED, DEVELOPMENT = 1000, 1
OTHER = 500
"""Added to a seed: the recording held out."""
NEAR = 1.5
"""Times the noise's share of the held-out deviation: an error below it is as good as the truth's."""


def told(system: str, hidden: str, seed: int, *, declared: bool) -> dict[str, object]:
    """Return what was said of one case."""
    recorded = [studied(system, hidden, each) for each in (seed, seed + OTHER)]
    fit, held_out = (simulation(system, each, declared=declared) for each in recorded)
    floor = float(np.sqrt(np.mean((recorded[1].noise / recorded[1].readings.std(axis=0)) ** 2)))
    begun = time.process_time()
    verdict = explain(fit, held_out, seed=1).verdict
    return {
        "verdict": verdict.verdict,
        "formulas": [term.formula for term in verdict.constructed],
        "forms": [term.form for term in verdict.constructed],
        "before": verdict.gain.held_out_nrmse_before,
        "after": verdict.gain.held_out_nrmse_after,
        "floor": floor,
        "sizes": _sizes(verdict),
        "remainder": verdict.remainder.present,
        "cpu_s": time.process_time() - begun,
    }


def _sizes(verdict: Verdict) -> dict[str, list[float | None]]:
    return {
        f"{cause.name}.{name}": [q.value, q.low, q.high]
        for cause in verdict.causes
        for name, q in cause.parameters.items()
    }


def cases(count: int, first: int) -> list[tuple[str, str, int, bool]]:
    """Return system, what is hidden, seed and whether the noise is declared, of `count` cases of each kind."""
    kinds = [(system, hidden) for system, each in STUDIED.items() for hidden in (*each, CLEAN)]
    return [
        (system, hidden, first + k, (k + j) % 2 == 0) for k in range(count) for j, (system, hidden) in enumerate(kinds)
    ]


def main() -> None:
    """Run what is not in the file yet, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=2, help="of each system and kind")
    parser.add_argument("--development", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("constructed.jsonl"))
    arguments = parser.parse_args()
    done: dict[str, dict[str, object]] = {}
    if arguments.out.exists():
        for line in arguments.out.read_text(encoding="utf-8").splitlines():
            done.update(json.loads(line))
    wanted = cases(arguments.cases, DEVELOPMENT if arguments.development else JUDGED)
    with arguments.out.open("a", encoding="utf-8") as file:
        for system, hidden, seed, declared in wanted:
            name = f"{system} {hidden} {seed} {'declared' if declared else 'undeclared'}"
            if name not in done:
                done[name] = told(system, hidden, seed, declared=declared)
                file.write(json.dumps({name: done[name]}) + "\n")
                file.flush()
    _print({name: done[name] for name in (f"{s} {h} {k} {'declared' if d else 'undeclared'}" for s, h, k, d in wanted)})


def _print(done: Mapping[str, Mapping[str, object]]) -> None:
    print("| system | hidden | constructed | at the noise | held-out error | constructed (first) | CPU s |")
    print("| --- | --- | ---: | ---: | --- | --- | ---: |")
    for kind in dict.fromkeys(tuple(name.split()[:2]) for name in done):
        rows = [each for name, each in done.items() if tuple(name.split()[:2]) == kind]
        made = [each for each in rows if each["verdict"] == "constructed"]
        near = [each for each in made if _number(each["after"]) <= NEAR * _number(each["floor"])]
        before, after = (100.0 * float(np.median([_number(each[key]) for each in rows])) for key in ("before", "after"))
        first = next((str(each["formulas"]) for each in made), ", ".join(sorted({str(r["verdict"]) for r in rows})))
        cpu = max(_number(each["cpu_s"]) for each in rows)
        print(
            f"| {kind[0]} | {kind[1]} | {len(made)} of {len(rows)} | {len(near)} | {before:.2f} → {after:.2f} % "
            f"| {first} | {cpu:.0f} |"
        )


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")


if __name__ == "__main__":
    main()

"""The court of five systems unlike each other: `python -m benchmarks.five_systems [--rounds N] [--out FILE]`.

Pendulum, motor with gearbox, quarter car, two tanks, heater, each modelled with ports and the generic library; hidden
is an effect that the library holds, one that it does not, or nothing. In every second case the noise is not declared.
Seeds from 3000 on, of which nothing was tuned on; `--development` takes those from 1 on. Each case is a line of FILE as
soon as it is done, and is not done again. A case counts where knowing what is hidden lowers χ² by 25 or more under the
true noise.
"""

import argparse
import json
import re
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy import explain
from discrepancy.explanation import Explanation
from lab.hidden.five_kinds import FIVE, KINDS, Case, case
from lab.hidden.five_systems import CLEAN, Recorded
from lab.undeclared.five_oracle import ORACLE, oracle
from lab.undeclared.five_systems import simulation

JUDGED, DEVELOPMENT = 3000, 1
OTHER = 500
"""Added to a seed: the recording held out."""
CLEAN_OF_A_SYSTEM = 2
"""Cases without anything hidden, in a round."""
TELLING = 25.0
"""Of χ², by which the true cause must lower it: less nobody could tell."""
_MOST_TIMES = 30.0
"""Stronger, or longer, than the first recording: more is asked of nobody."""

Row = dict[str, Any]


def told(one: Case, *, declared: bool) -> Row:
    """Return what was said of one case, and what who knows it would."""
    fit, held_out = one.recorded(), one.recorded(OTHER)
    begun = time.process_time()
    found = _explained(one, fit, held_out, declared=declared)
    row = {"cpu_s": time.process_time() - begun, **_said(found), "noise": one.noise_share, **one.constants}
    if one.kind is not None:
        row |= _known(one, fit, held_out)
    if found.verdict.verdict == "cannot_tell":
        row["asked"] = found.verdict.next_experiment
        row["settled"] = _said(_again(one, str(row["asked"]), declared=declared))
    return row


def _explained(one: Case, fit: Recorded, held_out: Recorded, *, declared: bool) -> Explanation:
    return explain(*(simulation(one.system, each, declared=declared, bare=False) for each in (fit, held_out)), seed=1)


def _said(found: Explanation) -> Row:
    verdict = found.verdict
    return {
        "verdict": verdict.verdict,
        "causes": [[cause.name, *cause.equivalents] for cause in verdict.causes],
        "formulas": [term.formula for term in verdict.constructed],
        "remainder": verdict.remainder.present,
        "after": _error(found, extended=True),
        "before": _error(found, extended=False),
    }


def _error(found: Explanation, *, extended: bool) -> float:
    view = found.held_out
    left = view.residual_after if extended else view.residual_before
    return float(np.sqrt(np.mean((left / view.channels.values.std(axis=0)) ** 2)))


def _known(one: Case, fit: Recorded, held_out: Recorded) -> Row:
    """Return by how much the true cause lowers χ² under the true noise, and the held-out errors around it."""
    assert one.kind is not None
    sides = [simulation(one.system, each, declared=True, bare=False) for each in (fit, held_out)]
    if not one.kind.effect:
        sides = [oracle(each, one.hidden, one.constants) for each in sides]
    best = explain(*sides, seed=1, only=(one.kind.effect or ORACLE,))
    chi2 = [float(np.sum((each / fit.noise) ** 2)) for each in (best.fit.residual_before, best.fit.residual_after)]
    floor = float(np.sqrt(np.mean((held_out.noise / held_out.readings.std(axis=0)) ** 2)))
    return {
        "known_chi2": chi2[0] - chi2[1],
        "known_before": _error(best, extended=False),
        "known_after": _error(best, extended=True),
        "floor": floor,
    }


def _again(one: Case, asked: str, *, declared: bool) -> Explanation:
    """Return what is said of the recordings that were asked for."""
    strong = re.search(r"([\d.]+) times as strong", asked)
    if strong is not None:
        times = min(float(strong[1]), _MOST_TIMES)
        return _explained(one, *(one.recorded(other, strength=times) for other in (0, OTHER)), declared=declared)
    return _explained(one, one.recorded(), one.recorded(), declared=declared)


def cases(rounds: int, first: int) -> list[tuple[Case, bool]]:
    """Return the cases of so many rounds, and whether the noise of each is declared."""
    kinds = [(system, hidden) for system in FIVE for hidden in (*KINDS[system], *[CLEAN] * CLEAN_OF_A_SYSTEM)]
    seeds = ((k, j, first + len(kinds) * k + j) for k in range(rounds) for j in range(len(kinds)))
    return [(case(*kinds[j], seed), (k + j) % 2 == 0) for k, j, seed in seeds]


def main() -> None:
    """Run what is not in the file yet, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=6, help="of 37 cases")
    parser.add_argument("--development", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("five_systems.jsonl"))
    parser.add_argument("--only", default="", help="cases whose name holds this")
    arguments = parser.parse_args()
    done: dict[str, Row] = {}
    if arguments.out.exists():
        for line in arguments.out.read_text(encoding="utf-8").splitlines():
            done.update(json.loads(line))
    wanted = {
        f"{one.system} {one.hidden} {one.seed} {'declared' if declared else 'undeclared'}": (one, declared)
        for one, declared in cases(arguments.rounds, DEVELOPMENT if arguments.development else JUDGED)
    }
    wanted = {name: each for name, each in wanted.items() if arguments.only in name}
    with arguments.out.open("a", encoding="utf-8") as file:
        for name, (one, declared) in wanted.items():
            if name not in done:
                done[name] = told(one, declared=declared)
                file.write(json.dumps({name: done[name]}) + "\n")
                file.flush()
    _print({name: (wanted[name][0], done[name]) for name in wanted})


Rows = Iterable[tuple[Case, Row]]


def _print(done: Mapping[str, tuple[Case, Row]]) -> None:
    rows = list(done.values())
    inside = [(one, row) for one, row in rows if one.kind is not None and one.kind.effect]
    outside = [(one, row) for one, row in rows if one.kind is not None and not one.kind.effect]
    clean = [(one, row) for one, row in rows if one.kind is None]
    telling = [each for each in inside if each[1]["known_chi2"] >= TELLING]
    beyond = [each for each in outside if each[1]["known_chi2"] >= TELLING and _removed(each[1], "known_after") >= 0.5]
    made = [each for each in beyond if each[1]["verdict"] == "constructed"]
    asked = [each for each in rows if "settled" in each[1]]
    for what, k, n in (
        ("right first name", sum(_first(each) for each in telling), len(telling)),
        ("the same, or a look-alike with it", sum(_among(each) for each in telling), len(telling)),
        ("clean: named", sum(bool(row["causes"]) for _, row in clean), len(clean)),
        ("outside: constructed", len(made), len(beyond)),
        ("outside: named by another's name", sum(row["verdict"] == "named" for _, row in beyond), len(beyond)),
        (
            "constructed: 80 % of the oracle's gain",
            sum(_removed(row, "after") >= 0.8 * _removed(row, "known_after") for _, row in made),
            len(made),
        ),
        ("cannot tell", len(asked), len(rows)),
        ("settled by what it asks for", sum(_settled(each) for each in asked), len(asked)),
    ):
        print(f"| {what} | {k} of {n} |")
    print(f"| longest verdict | {max(row['cpu_s'] for _, row in rows):.0f} s |")
    for name, (one, row) in done.items():
        right = _first((one, row)) if one.kind is not None and one.kind.effect else row["verdict"] != "named"
        if not right:
            print(f"  {name}: {row['verdict']} {[each[0] for each in row['causes']]} {row.get('known_chi2', 0.0):.0f}")


def _first(each: tuple[Case, Row]) -> bool:
    one, row = each
    return bool(row["causes"]) and one.kind is not None and row["causes"][0][0] == one.kind.effect


def _among(each: tuple[Case, Row]) -> bool:
    one, row = each
    return bool(row["causes"]) and one.kind is not None and one.kind.effect in row["causes"][0]


def _removed(row: Row, after: str) -> float:
    excess = row["known_before"] ** 2 - row["floor"] ** 2
    return float((row["known_before"] ** 2 - row[after] ** 2) / excess) if excess > 0.0 else 0.0


def _settled(each: tuple[Case, Row]) -> bool:
    """Return whether the second recording tells what is hidden, or that nothing is."""
    one, row = each
    again = row["settled"]
    if one.kind is None:
        return bool(again["verdict"] == "nothing")
    return bool(again["causes"]) if not one.kind.effect else _first((one, again))


if __name__ == "__main__":
    main()

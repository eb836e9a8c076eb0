"""Effects planted into real motion, told as changes: `python -m benchmarks.real_motion [--cases N] [--file FILE]`.

Trials of BROAD and rooms of TUM VI have effects of their own. Each is explained as it is, one half fitted and the
other held out; then an effect is planted into both halves (lab.hidden.imu.planted) and all is explained again. An
effect is named where it is told anew, or changed by the planted size. Seeds from 1000 on and trials that nothing was
tuned on; `--development` takes seeds from 1 on and the other trials. Each case is a line of FILE as soon as it is done,
and is not done again. Reads $GAITEYES_DATA/broad and tumvi_rooms_imu.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
from scipy.stats import binomtest

from discrepancy import explain
from discrepancy.problem import Problem
from discrepancy.search.refits import Refits
from discrepancy.verdict import Verdict
from lab.court.change import Change, change
from lab.court.result import Told
from lab.evaluation.measured.broad_recordings import simulation_of
from lab.evaluation.measured.moved_imus import JUDGED, TUNING, halves
from lab.hidden.case import TrueCause
from lab.hidden.imu.planted import EFFECTS, Recorded, drawn
from messages.errors import UserError
from systems.imu.recording import ImuRecording
from systems.imu.simulation import ImuSimulation

FIRST_SEED, DEVELOPMENT_SEED = 1000, 1


class Line(msgspec.Struct, frozen=True):
    """A case that was judged, or with `seed` null a trial as it is."""

    trial: str
    seed: int | None
    planted: TrueCause | None
    told: Told
    same_causes: dict[str, float]
    cpu_s: float

    @property
    def place(self) -> tuple[str, int | None]:
        """Return what tells a line from all others."""
        return self.trial, self.seed


def case_of(seed: int, trials: Sequence[str]) -> tuple[str, str]:
    """Return trial and effect of a case: effects take turns, trials within each too."""
    turn, place = divmod(seed, len(EFFECTS))
    return trials[(turn + place) % len(trials)], EFFECTS[place]


halves_of = cache(halves)


def plain(recording: ImuRecording) -> Recorded:
    return Recorded(**{each.name: getattr(recording, each.name) for each in fields(Recorded)})


def with_it(recorded: Recorded) -> ImuSimulation:
    return simulation_of(ImuRecording(**{each.name: getattr(recorded, each.name) for each in fields(Recorded)}))


def unplanted(trial: str) -> Line:
    """Return what is told of a trial as it is."""
    both = halves_of(trial)
    begun = time.process_time()
    verdict = explain(simulation_of(both.first), simulation_of(both.second), seed=1).verdict
    return Line(trial, None, None, _told(verdict), {}, time.process_time() - begun)


def judged(seed: int, trial: str, effect: str) -> Line:
    """Return what is told of a trial with an effect planted."""
    both = halves_of(trial)
    planting = drawn(effect, np.random.default_rng(np.random.SeedSequence(seed)), plain(both.first))
    begun = time.process_time()
    verdict = explain(*(with_it(planting.planted(plain(each))) for each in (both.first, both.second)), seed=1).verdict
    seconds = time.process_time() - begun
    return Line(trial, seed, planting.cause, _told(verdict), _same_causes(both.first, verdict), seconds)


def _told(verdict: Verdict) -> Told:
    return msgspec.convert(msgspec.to_builtins(verdict), Told)


def _same_causes(recording: ImuRecording, verdict: Verdict) -> dict[str, float]:
    """Return the parameters of the verdict's causes, fitted to a recording."""
    begun = {
        f"{cause.name}.{name}": q.value
        for cause in verdict.causes
        for name, q in cause.parameters.items()
        if q.value is not None
    }
    if not begun:
        return {}
    refits = Refits(Problem(simulation_of(recording)), tuple(dict.fromkeys(key.split(".")[0] for key in begun)))
    found = refits.recoloured(refits.fitted({**refits.base.values, **begun}, tuple(begun)))
    return {key: found.values[key] for key in begun}


def described(line: Line, told: Change | None) -> str:
    causes = "; ".join(
        f"{cause.name} ("
        + ", ".join(f"{name} {q.value:.4g}" for name, q in cause.parameters.items() if q.value is not None)
        + ")"
        + (f" or {', '.join(cause.equivalents)}" if cause.equivalents else "")
        for cause in line.told.causes
    )
    if line.planted is None or told is None:
        return f"{line.trial} as it is: {line.told.verdict} {causes}"
    marks = "".join(
        letter if is_so else "-"
        for letter, is_so in (("N", told.named), ("v", told.in_interval), ("l", told.like_for_like))
    )
    what = ", ".join(f"{name} {value:.4g}" for name, value in line.planted.parameters.items())
    where = f"{line.seed} {line.trial}"
    return f"{marks} {where} {line.planted.name} ({what}): {causes or line.told.verdict}"


def table(lines: Sequence[Line], before: dict[str, Line]) -> list[str]:
    """Return the counts, by effect and in all, with 95 % confidence bounds of the whole."""
    changes = {
        line.place: change(line.planted, before[line.trial].told, line.told, line.same_causes)
        for line in lines
        if line.planted is not None
    }
    rows = [
        "| planted | cases | named | change in its interval | against the verdict before |",
        "| --- | --- | --- | --- | --- |",
    ]

    def row(name: str, of_it: Sequence[Change]) -> str:
        right = [each.named and each.like_for_like for each in of_it]
        strict = [each.named and each.in_interval for each in of_it]
        return f"| {name} | {len(of_it)} | {sum(each.named for each in of_it)} | {sum(right)} | {sum(strict)} |"

    for effect in EFFECTS:
        of_it = [changes[line.place] for line in lines if line.planted is not None and line.planted.name == effect]
        if of_it:
            rows.append(row(effect, of_it))
    every = list(changes.values())
    rows.append(row("all", every))
    for words, count in (
        ("named", sum(each.named for each in every)),
        ("named with the change in its interval", sum(each.named and each.like_for_like for each in every)),
        ("the same against the verdict before", sum(each.named and each.in_interval for each in every)),
    ):
        bounds = binomtest(count, len(every)).proportion_ci(method="exact")
        rows.append(
            f"{words}: {count} of {len(every)}, {100.0 * count / len(every):.0f} % "
            f"({100.0 * bounds.low:.0f} to {100.0 * bounds.high:.0f} %)"
        )
    rows.append(f"causes told anew beside: {sum(len(each.beside) for each in every)} in {len(every)} cases")
    seconds = [line.cpu_s for line in lines]
    rows.append(f"CPU time of a verdict: {np.median(seconds):.1f} s at the median, {max(seconds):.1f} s at most")
    return rows


def main() -> None:
    """Run what is not in the file yet, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=80)
    parser.add_argument("--first", type=int, help="seed of the first case")
    parser.add_argument("--development", action="store_true")
    parser.add_argument("--file", type=Path, default=Path("real_motion.jsonl"))
    arguments = parser.parse_args()
    trials = TUNING if arguments.development else JUDGED
    first = arguments.first or (DEVELOPMENT_SEED if arguments.development else FIRST_SEED)
    done: dict[tuple[str, int | None], Line] = {}
    if arguments.file.exists():
        found = [msgspec.json.decode(each, type=Line) for each in arguments.file.read_bytes().splitlines()]
        done = {each.place: each for each in found}
    lines = []
    before: dict[str, Line] = {}
    with arguments.file.open("ab") as file:

        def kept(line: Line) -> Line:
            if line.place not in done:
                done[line.place] = line
                file.write(msgspec.json.encode(line) + b"\n")
                file.flush()
            return line

        for seed in range(first, first + arguments.cases):
            trial, effect = case_of(seed, trials)
            if trial not in before:
                before[trial] = kept(done.get((trial, None)) or unplanted(trial))
                print(described(before[trial], None), flush=True)
            line = kept(done.get((trial, seed)) or judged(seed, trial, effect))
            lines.append(line)
            assert line.planted is not None
            told = change(line.planted, before[trial].told, line.told, line.same_causes)
            print(described(line, told), flush=True)
    print("\n".join(table(lines, before)))


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        raise SystemExit(str(error)) from error

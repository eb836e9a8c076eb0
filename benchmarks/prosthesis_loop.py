"""The service and a prosthesis in one loop: level, a ramp up and one down, stairs, told by eyes, foot and truth.

    python -m benchmarks.prosthesis_loop [--seeds 1000-1019] [--file F] [--loss 0.05] [--delay-s 0.02] [--babble-hz 0]
        [--without covered | loop]

Each seed is one walk of `sim_rig.walk.loop_walks` on a unit with the calibration that it would have, by a person of a
mass and a side of their own, on a virtual prosthesis (`sim_rig.prosthesis`) behind a CAN bus with these faults. The
torque's error is that against the impedance for the true ground, in the same state of the ankle, over stance; "foot" is
the thesis's one-step-delayed inertial slope (`lab.prosthesis.controls`). One line of JSON is added to F for each
finished trial; those there are not walked again. Seeds below 1000 are for tuning, from 1000 on for judging.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import cv2
import msgspec
import numpy as np

from lab.prosthesis.judge import JudgedStep
from lab.prosthesis.trial import ONE_STEP_S, CoveredTrial, LoopTrial, covered_trial, loop_trial
from sim_rig.prosthesis.bus_faults import BusFaults


class Done(msgspec.Struct, kw_only=True, omit_defaults=True):
    """A finished trial and the faults of its bus."""

    faults: BusFaults
    loop: LoopTrial | None = None
    covered: CoveredTrial | None = None

    @property
    def key(self) -> tuple[str, int]:
        """Return which trial it is."""
        return (
            ("loop", self.loop.seed) if self.loop is not None else ("covered", self.covered.seed if self.covered else 0)
        )


def report(trials: Sequence[LoopTrial]) -> None:
    """Print the figures of the loop."""
    units, contacts = len(trials), sum(trial.contacts for trial in trials)
    print(
        f"{units} units, {contacts} contacts, of which {sum(trial.followed for trial in trials)} followed a set-point"
    )
    refused = sum((Counter(trial.refused) for trial in trials), Counter())
    print(f"set-points heard {sum(trial.heard for trial in trials)}, refused", {k.value: n for k, n in refused.items()})
    states, bad = sum(trial.ankle_states for trial in trials), sum(trial.ankle_refused for trial in trials)
    print(f"ankle's states taken by the service {states}, refused {bad}")
    print(f"{'torque error, Nm/kg, RMS over stance':40}{'steps':>7}{'eyes':>8}{'foot':>8}{'less by':>9}")
    _row("first two steps after a change", trials, _is_new)
    _row("elsewhere", trials, _is_old)
    for kind in ("ramp", "level", "stairs"):
        _row(f"  new {kind}", trials, partial(_is_new_on, kind))
    shares = [1.0 - _mean(trial.eyes, _is_new) / _mean(trial.foot, _is_new) for trial in trials]
    print(f"less by, unit for unit: {np.min(shares):.0%} to {np.max(shares):.0%}")
    for name in ("eyes", "foot", "truth"):
        steps = [step for trial in trials for step in getattr(trial, name)]
        unsafe = Counter(what for step in steps for what in step.unsafe)
        print(f"unsafe steps, {name}: {sum(bool(step.unsafe) for step in steps)} of {len(steps)} {dict(unsafe)}")
    worst = max((step for trial in trials for step in trial.eyes), key=lambda step: step.error_nm_per_kg)
    print(f"worst step by eyes: {worst.error_nm_per_kg:.3f} Nm/kg on {worst.kind} of {worst.slope_deg:+.1f}°")


def report_covered(trials: Sequence[CoveredTrial]) -> None:
    """Print what was done after the camera was covered."""
    late = [since_s for trial in trials for since_s, followed in trial.after if followed and since_s > ONE_STEP_S]
    last = [max((since_s for since_s, followed in trial.after if followed), default=0.0) for trial in trials]
    contacts = sum(len(trial.after) for trial in trials)
    print(
        f"camera covered on a ramp: {len(trials)} units, {sum(trial.before for trial in trials)} contacts on set-points"
        f" before, {contacts} contacts after; the last on a set-point came {max(last):.2f} s after, {len(late)} later "
        f"than a step of {ONE_STEP_S} s"
    )


def _row(name: str, trials: Sequence[LoopTrial], chosen: Callable[[JudgedStep], bool]) -> None:
    eyes = _mean([step for trial in trials for step in trial.eyes], chosen)
    foot = _mean([step for trial in trials for step in trial.foot], chosen)
    count = sum(chosen(step) for trial in trials for step in trial.eyes)
    print(f"{name:40}{count:7}{eyes:8.3f}{foot:8.3f}{1.0 - eyes / foot if foot else float('nan'):9.0%}")


def _is_new(step: JudgedStep) -> bool:
    return step.is_new


def _is_old(step: JudgedStep) -> bool:
    return not step.is_new


def _is_new_on(kind: str, step: JudgedStep) -> bool:
    return step.is_new and step.kind == kind


def _mean(steps: Sequence[JudgedStep], chosen: Callable[[JudgedStep], bool]) -> float:
    errors = [step.error_nm_per_kg for step in steps if chosen(step)]
    return float(np.mean(errors)) if errors else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="1000-1019", help="units, first-last")
    parser.add_argument("--file", type=Path, help="finished trials, kept and gone on from")
    parser.add_argument("--loss", type=float, default=0.05, help="share of frames lost")
    parser.add_argument("--delay-s", type=float, default=0.02, help="added to every frame, either way")
    parser.add_argument("--babble-hz", type=float, default=0.0, help="frames a second of a node that babbles")
    parser.add_argument("--without", choices=("loop", "covered"), help="leave these trials out")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    first, last = map(int, options.seeds.split("-"))
    faults = BusFaults(loss=options.loss, delay_s=options.delay_s, babble_hz=options.babble_hz)
    lines = options.file.read_text().splitlines() if options.file and options.file.exists() else []
    known = [msgspec.json.decode(line, type=Done) for line in lines]
    done = {each.key: each for each in known if each.faults == faults and first <= each.key[1] <= last}
    for seed in range(first, last + 1):
        for name in ("loop", "covered"):
            if name == options.without or (name, seed) in done:
                continue
            if name == "loop":
                found = Done(faults=faults, loop=loop_trial(seed, faults))
            else:
                found = Done(faults=faults, covered=covered_trial(seed, faults))
            done[found.key] = found
            if options.file:
                with options.file.open("ab") as file:
                    file.write(msgspec.json.encode(found) + b"\n")
    if loops := [each.loop for each in done.values() if each.loop is not None]:
        report(loops)
    if covered := [each.covered for each in done.values() if each.covered is not None]:
        report_covered(covered)


if __name__ == "__main__":
    main()

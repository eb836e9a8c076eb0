"""Which of the platform's effects look alike: `python -m benchmarks.platform_look_alikes`.

On three clean recordings (plate known, plate unknown, foot) every effect is put in at the geometric mean of its range
of sizes, to first order: χ² is what it does beside the base model's own parameters, under the noise of the recording.
Then each other effect is fitted in its place. Where less than 10 is left, or less than a hundredth, no finder can tell
them apart, or hardly.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.refits import Refits
from lab.hidden.case import Case, Kind
from lab.hidden.platform import SIZES, write
from messages.arrays import FloatArray
from systems.platform import load

NOT_TOLD, HARDLY = 10.0, 0.01
SEEDS = {"plate known": 12, "plate unknown": 11, "foot": 1}


def rows(folder: Path) -> list[tuple[str, float, str, float]]:
    """Return for each candidate with one parameter its χ², its nearest rival and what is left beside that."""
    problem = Problem(load(folder))
    refits = Refits(problem, list(problem.effects))
    columns = refits.library.whitened(refits.white).astype(np.float64)
    base = np.linalg.qr(columns[: refits.library.base].T)[0] if refits.library.base else None
    free = columns if base is None else columns - (columns @ base) @ base.T
    found = []
    for own in refits.library.candidates:
        signal = _signal(problem, own, free)
        if signal is None:
            continue
        chi2 = float(signal @ signal)
        left, rival = min(
            (
                (_left(signal, free[list(other.columns)]), other.effect)
                for other in refits.library.candidates
                if other.effect != own.effect
            ),
            default=(chi2, ""),
        )
        found.append((f"{own.effect} {', '.join(own.choice)}", chi2, rival, left))
    return found


def _signal(problem: Problem, own: Candidate, free: FloatArray) -> FloatArray | None:
    """Return what an effect of medium size does, or None where its neutral value tells no direction."""
    if own.start or len(own.choice) > 1 or own.effect not in SIZES:
        return None
    sizes = SIZES[own.effect]
    if sizes.unit not in ("s", "1", "m", "rad", "N·m/rad", "N·m·s/rad", "N·m", "N or 0.2 N·m"):
        return None
    scales = float(np.sqrt(sizes.low * sizes.high)) / problem.parameters[own.keys[0]].scale
    if own.effect == "tare_error" and own.choice[0].startswith("t"):
        scales *= 0.2
    return np.asarray(scales * free[own.columns[0]])


def _left(signal: FloatArray, others: FloatArray) -> float:
    weights = np.linalg.lstsq(others.T, signal, rcond=None)[0]
    return float(np.sum((signal - weights @ others) ** 2))


def main() -> None:
    for what, seed in SEEDS.items():
        with tempfile.TemporaryDirectory() as place:
            folder = Path(sys.argv[1]) / f"clean-{seed}" / "fit" if len(sys.argv) > 1 else Path(place) / "fit"
            if len(sys.argv) == 1:
                write(Case("platform", seed, Kind.CLEAN, ()), folder, Path(place) / "held_out")
            print(f"{what} (seed {seed}): effect, χ² at medium size, nearest rival, χ² left beside it")
            for name, chi2, rival, left in rows(folder):
                note = "not told" if left < NOT_TOLD else "hardly" if left < HARDLY * chi2 else ""
                print(f"  {name:32s} {chi2:12.1f}  {rival:20s} {left:12.1f}  {note}")


if __name__ == "__main__":
    main()

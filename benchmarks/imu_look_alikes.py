"""Which effects of the IMU look alike, from the Fisher matrix: `python -m benchmarks.imu_look_alikes [CASES]`.

For each effect A and each other B, on clean recordings, the share of A's χ² that B with all its parameters cannot take
over, the noise being what the clean residual tells. A is each of its parameters alone, by its `scale`, small enough to
be linear; the least share over parameters and the median over recordings are printed. 0 is a perfect double.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from discrepancy.evidence.whitening import Whitening, whitening
from discrepancy.simulation import Effect
from discrepancy.values import predicted
from lab.hidden.case import Case, Kind
from lab.hidden.imu import write
from messages.arrays import FloatArray
from systems.imu import load
from systems.imu.simulation import ImuSimulation

PRINTED = 0.5


def columns(simulation: ImuSimulation, white: Whitening, effect: Effect) -> FloatArray:
    """Return the whitened changes (p, samples) that the effect's parameters make, each by its scale."""
    start = {effect.qualified(name): value for each in effect.starts[-1:] for name, value in each.items()}
    base = predicted(simulation, start)
    found = []
    for parameter in effect.parameters:
        key = effect.qualified(parameter.name)
        at = start.get(key, parameter.neutral)
        if np.isfinite(at):
            change = predicted(simulation, {**start, key: at + parameter.scale}) - base
            found.append(white(np.nan_to_num(change.T)).reshape(-1))
    return np.array(found)


def left_over(a: FloatArray, b: FloatArray) -> float:
    """Return the least share of a row's square in `a` that the rows of `b` leave."""
    size = np.linalg.norm(b, axis=1)
    basis, kept = np.linalg.qr((b[size > 0.0] / size[size > 0.0, None]).T)
    basis = basis[:, np.abs(np.diag(kept)) > 1e-6]
    power = (a**2).sum(axis=1)
    taken = ((a @ basis) ** 2).sum(axis=1)
    told = power > 1e-9
    return float((1.0 - taken[told] / power[told]).min()) if told.any() else float("nan")


def shares_of(simulation: ImuSimulation) -> FloatArray:
    """Return the shares (e, e): row A, column B."""
    residual = (simulation.channels.values - predicted(simulation, {})).T
    white = whitening(np.nan_to_num(residual), np.isfinite(residual))
    every = [columns(simulation, white, effect) for effect in simulation.effects]
    return np.array([[left_over(a, b) for b in every] for a in every])


def main() -> None:
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    found = []
    for seed in range(1, cases + 1):
        with tempfile.TemporaryDirectory() as folder:
            write(Case("imu", seed, Kind.CLEAN, ()), Path(folder) / "fit", Path(folder) / "held_out")
            simulation = load(Path(folder) / "fit")
        found.append(shares_of(simulation))
    names = [effect.name for effect in simulation.effects]
    shares = np.nanmedian(found, axis=0)
    print(f"share of A's chi2 that B cannot take over, median of {cases} recordings; below {PRINTED:g} only")
    for row, a in enumerate(names):
        near = [(shares[row, k], b) for k, b in enumerate(names) if b != a and shares[row, k] < PRINTED]
        print(f"{a}: " + (", ".join(f"{b} {share:.3f}" for share, b in sorted(near)) or "none"))


if __name__ == "__main__":
    main()

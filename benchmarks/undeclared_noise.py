"""What the finder says of a pendulum whose noise nobody declared: `python -m benchmarks.undeclared_noise [--cases N]`.

A true effect is taken out of the library, or left in, or nothing is hidden. Seeds from 1000 on, of which nothing was
tuned on; `--development` takes those from 1 on.
"""

import argparse
from collections import Counter

import numpy as np

from discrepancy import explain
from discrepancy.evidence.whitening import whitening
from discrepancy.problem import Problem
from discrepancy.search.refits import base_of
from lab.hidden.pendulum import SIZES, drawn
from lab.undeclared.pendulum import simulation

NOISE_RAD = 1e-3
JUDGED, DEVELOPMENT = 1000, 1
OTHER = 500
"""Added to a seed: the recording held out."""


def told(effect: str, seed: int, size: float, *, withheld: bool) -> tuple[str, float, float]:
    """Return verdict and names, and residual and innovations of the base model over the true noise."""
    left_out = (effect,) if withheld and effect else ()
    fit, held_out = (
        simulation(drawn(each, effect, size=size, noise_rad=NOISE_RAD), left_out) for each in (seed, seed + OTHER)
    )
    problem = Problem(fit)
    residual = base_of(problem)[0].residual
    innovations = whitening(residual, problem.valid).innovations(residual)
    verdict = explain(fit, held_out, seed=1).verdict
    names = " and ".join(cause.name for cause in verdict.causes)
    return f"{verdict.verdict} {names}".strip(), float(residual.std()) / NOISE_RAD, float(innovations.std()) / NOISE_RAD


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10)
    parser.add_argument("--development", action="store_true")
    parser.add_argument("--sizes", type=float, nargs="+", default=[1.0, 0.3])
    arguments = parser.parse_args()
    first = DEVELOPMENT if arguments.development else JUDGED
    print("| hidden | in the library | residual / noise | innovations / noise | verdicts |")
    print("| --- | --- | ---: | ---: | --- |")
    hidden = [(effect, size) for effect in SIZES for size in arguments.sizes]
    for effect, size, withheld in [(e, s, w) for w in (True, False) for e, s in hidden] + [("", 1.0, False)]:
        found = [told(effect, first + case, size, withheld=withheld) for case in range(arguments.cases)]
        counts = ", ".join(f"{count} {verdict}" for verdict, count in Counter(each[0] for each in found).most_common())
        loud, coloured = np.median([each[1:] for each in found], axis=0)
        what = f"{effect} {size * SIZES[effect]:.3g}" if effect else "nothing"
        print(f"| {what} | {'no' if withheld else 'yes'} | {loud:.1f} | {coloured:.2f} | {counts} |", flush=True)


if __name__ == "__main__":
    main()

"""What the ideal IMU simulation gets wrong on real trials: `python -m benchmarks.explain_broad [--seconds S]`.

Three pairs of BROAD's trials were recorded with the sensor in the same state, which the
resting gyroscope shows. The first of each pair is explained, the second shows what the same extension, frozen, gains.
"""

import argparse

import numpy as np

from discrepancy import explain
from discrepancy.explanation import Explanation
from lab.evaluation.measured.broad_recordings import simulation_of, stretch, trial
from lab.evaluation.measured.data_folder import data_folder

PAIRS = (("01", "15"), ("07", "18"), ("24", "26"))
FIRST_S = 30.0
"""Every trial rests until then, or nearly so."""


def told(explanation: Explanation) -> list[str]:
    verdict = explanation.verdict
    lines = []
    for cause in verdict.causes:
        values = ", ".join(
            f"{name} {q.value:.4g} ({q.low:.4g} to {q.high:.4g}) {q.unit}"
            for name, q in cause.parameters.items()
            if q.value is not None and q.low is not None and q.high is not None
        )
        same = f"; or {', '.join(cause.equivalents)}" if cause.equivalents else ""
        lines.append(f"  {cause.name}: {values}{same}; chi2 {cause.evidence.get('chi2') or np.nan:.0f}")
    gain = verdict.gain
    lines.append(
        f"  held out: NRMSE {gain.held_out_nrmse_before} before, {gain.held_out_nrmse_after} after, floor "
        f"{gain.noise_floor_nrmse}; share of the excess removed {gain.share_of_excess_removed}"
    )
    lines.append(f"  remainder: {verdict.remainder.present}, share {verdict.remainder.share}")
    lines.extend(f"  note: {note}" for note in explanation.notes)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--pairs", type=int, default=len(PAIRS))
    arguments = parser.parse_args()
    folder = data_folder("broad")
    for first, second in PAIRS[: arguments.pairs]:
        fit, held_out = (
            simulation_of(stretch(trial(folder, number), FIRST_S, arguments.seconds)) for number in (first, second)
        )
        explanation = explain(fit, held_out, seed=1)
        print(
            f"trial {first} explained, gain on trial {second}: {explanation.verdict.verdict}; band {fit.band_hz:.1f} Hz"
        )
        print("\n".join(told(explanation)), flush=True)


if __name__ == "__main__":
    main()

"""What the ideal IMU simulation gets wrong on real trials: `python -m benchmarks.explain_broad [FOLDER] [--seconds S]`.

FOLDER holds the data set `broad`. Three pairs of trials were recorded with the sensor in the same state, which the
resting gyroscope shows. The first of each pair is explained, the second shows what the same extension, frozen, gains.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from discrepancy.explain import explain
from discrepancy.explanation import Explanation
from systems.imu.broad import read_trial
from systems.imu.motion import reading_of
from systems.imu.recording import ImuRecording
from systems.imu.simulation import ImuSimulation

BESIDE = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "broad"
PAIRS = (("01", "15"), ("07", "18"), ("24", "26"))
FIRST_S = 30.0
"""Every trial rests until then, or nearly so."""


def simulation_of(recording: ImuRecording) -> ImuSimulation:
    return ImuSimulation.of(reading_of(recording))


def stretch(recording: ImuRecording, first_s: float, seconds: float) -> ImuRecording:
    """Return a part of a recording; its stamps begin at zero."""
    kept = (recording.t_s >= first_s) & (recording.t_s < first_s + seconds)
    seen = (recording.reference_t_s >= first_s) & (recording.reference_t_s < first_s + seconds)
    return replace(
        recording,
        t_s=recording.t_s[kept] - first_s,
        w_radps=recording.w_radps[kept],
        sf_mps2=recording.sf_mps2[kept],
        reference_t_s=recording.reference_t_s[seen] - first_s,
        q_WS=recording.q_WS[seen],
        p_W_m=recording.p_W_m[seen],
    )


def trial(folder: Path, number: str) -> ImuRecording:
    """Return the trial whose name begins with `number`; raises FileNotFoundError where it is absent."""
    paths = sorted(folder.glob(f"{number}_*.npz"))
    if not paths:
        raise FileNotFoundError(f"{folder}: no trial {number}_*.npz")
    return read_trial(paths[0])


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
    parser.add_argument("folder", type=Path, nargs="?", default=BESIDE)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--pairs", type=int, default=len(PAIRS))
    arguments = parser.parse_args()
    for first, second in PAIRS[: arguments.pairs]:
        fit, held_out = (
            simulation_of(stretch(trial(arguments.folder, number), FIRST_S, arguments.seconds))
            for number in (first, second)
        )
        explanation = explain(fit, held_out, seed=1)
        print(
            f"trial {first} explained, gain on trial {second}: {explanation.verdict.verdict}; band {fit.band_hz:.1f} Hz"
        )
        print("\n".join(told(explanation)), flush=True)


if __name__ == "__main__":
    main()

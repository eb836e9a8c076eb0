"""How near the identification comes to its bound, how often its intervals are right, and what it costs.

    python -m benchmarks.platform_identification [--draws 20] [--seed 1000] [--propagated 2000] [--json FILE]

The thesis's noise, tare, springs and hidden frame, instruments that are exact; actuators at 40 Hz for 60 s; noise seeds
from --seed on. The bound is the information of the noise-free motion. The foot is identified, by both estimators, with
the plate's inertia exact.
Propagated draws are noise of the whole record taken through the estimator to first order; the intervals are those that
the first of the --draws claims. The plate's mass is weighed for one second, as the thesis does.
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cli.console import console, table, write_json
from cli.progress import progress
from impedance.identification.bound import propagated, true_information
from impedance.identification.fitted_run import BAND_SHARE, KnownBody, problem_of
from impedance.identification.identification import Identification, identify, weighing_deviation_kg
from impedance.identification.mechanism import FreeBody, Mechanism, UniversalJoint
from impedance.identification.noise_level import NoiseLevel
from impedance.identification.observability import NAMES, about_cog, about_cog_slope, moving
from impedance.identification.spectra import Spectra
from impedance.recording.recording import PlatformRecording
from impedance.recording.synchronous import synchronous
from impedance.thesis.estimator import Variant, foot_residual, least_residual, plate_residual
from messages.arrays import FloatArray
from messages.constants import NORMAL_95
from sim_rig.platform.rig import FOOT, PLATE, THESIS_NOISE, Rig
from sim_rig.platform.run import RunSettings, SimulatedRun, measured, simulate

LENGTHS_S = (15.0, 30.0, 60.0, 120.0)
SHOWN = np.array([1.0, *(1e3,) * 9])
UNITS = ("kg", *("mm",) * 3, *("g m²",) * 6)


@dataclass(frozen=True)
class Judged:
    """What (10,) each parameter's errors are: root mean squares of ours and the first estimator's, bound, coverage."""

    title: str
    bound: FloatArray
    rms: FloatArray
    first_rms: FloatArray
    coverage: FloatArray
    consistent: bool
    seconds: float

    @property
    def rows(self) -> list[list[str]]:
        """Return the ten parameters for a table."""
        return [
            [
                f"{name}, {unit}",
                f"{self.bound[k] * SHOWN[k]:.2g}",
                f"{self.rms[k] * SHOWN[k]:.2g}",
                f"{self.rms[k] / self.bound[k]:.2f}",
                f"{self.first_rms[k] * SHOWN[k]:.2g}",
                f"{self.first_rms[k] / self.rms[k]:.1f}",
                f"{100.0 * self.coverage[k]:.1f} %",
            ]
            for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
        ]


def judged(run: SimulatedRun, mechanism: Mechanism, draws: int, seed: int, many: int) -> Judged:
    foot = run.settings.rig.foot
    body, plate = (PLATE, None) if foot is None else (foot, PLATE)
    truth = about_cog(body.vector)
    ours, first, durations = [], [], []
    claimed: Identification | None = None
    for draw in progress(range(draws), "identifying"):
        recording = measured(run, seed=seed + draw, plate=plate).exact
        began = time.process_time()
        found = identify(recording, joint=isinstance(mechanism, UniversalJoint))
        durations.append(time.process_time() - began)
        claimed = claimed or found
        ours.append(found)
        first.append(about_cog(first_estimate(recording)) - truth)
    assert claimed is not None

    still = measured(run, noise=None, plate=plate)
    streams = synchronous(still)
    noise = NoiseLevel(**vars(THESIS_NOISE))
    known = None if plate is None else KnownBody(PLATE.vector, np.zeros((10, 10)))
    problem = problem_of(streams, mechanism, noise, known)
    spectra = Spectra.of(streams.rate_hz, streams.valid, BAND_SHARE * streams.rate_hz)
    whole = run.settings.rig.above_sensor.vector
    to_eta = about_cog_slope(body.vector) @ (np.eye(10) if foot is None else moving(np.array(Rig().foot_origin_m)))
    covariance = np.linalg.inv(true_information(problem, spectra, whole))
    errors = np.array(list(propagated(problem, spectra, whole, many, seed)))
    if foot is None:
        deviation_kg = weighing_deviation_kg(noise.force_n, streams.rate_hz)
        gain = covariance[:, 0] / (covariance[0, 0] + deviation_kg**2)
        weighed_off = deviation_kg * np.random.default_rng((seed, 1)).standard_normal(many)
        errors = errors + (weighed_off - errors[:, 0])[:, None] * gain
        covariance = covariance - np.outer(gain, covariance[0])
    covariance, errors = to_eta @ covariance @ to_eta.T, errors @ to_eta.T
    return Judged(
        title=f"{'plate' if foot is None else 'foot'}, joint {'used' if found.constrained else 'not used'}",
        bound=np.sqrt(np.diag(covariance)),
        rms=np.sqrt(np.mean([(found.estimate - truth) ** 2 for found in ours], axis=0)),
        first_rms=np.sqrt(np.mean(np.square(first), axis=0)),
        coverage=np.mean(np.abs(errors) <= NORMAL_95 * claimed.observability.deviation, axis=0),
        consistent=all(found.body.is_consistent for found in ours),
        seconds=float(np.median(durations)),
    )


def first_estimate(recording: PlatformRecording) -> FloatArray:
    """Return π (10,) of the thesis's estimator: the plate with its mass known, or the foot with the plate known."""
    if recording.foot is None:
        residual = plate_residual(recording, Variant())
        return least_residual(residual, PLATE.mass_kg, moments_bounded=False).vector
    return least_residual(foot_residual(recording, PLATE, Variant()), None, moments_bounded=False).vector


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--propagated", type=int, default=2000)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    joint = UniversalJoint(Rig().joint_to_surface_m)
    every = []
    for foot in (None, FOOT):
        run = simulate(RunSettings(rig=Rig(foot=foot)), options.seed)
        for mechanism in (joint, FreeBody()):
            every.append(judged(run, mechanism, options.draws, options.seed, options.propagated))
            table(
                f"{every[-1].title}: {options.draws} draws from seed {options.seed}, {options.propagated} propagated",
                ["", "bound", "RMS error", "RMS / bound", "thesis's", "times smaller", "95 % covers"],
                every[-1].rows,
            )
            console.print(
                f"every estimate can exist: {every[-1].consistent}; median {every[-1].seconds:.2f} s of one core\n"
            )
    costs = []
    for length_s in LENGTHS_S:
        recording = measured(simulate(RunSettings(duration_s=length_s), options.seed), seed=options.seed).exact
        durations = []
        for _ in range(3):
            began = time.process_time()
            identify(recording)
            durations.append(time.process_time() - began)
        costs.append([f"{length_s:g} s", f"{min(durations):.2f} s", f"{1e3 * min(durations) / length_s:.1f} ms"])
    table("Cost, plate with the joint", ["recorded", "identified in", "per second"], costs)
    if options.json is not None:
        write_json(
            options.json,
            [
                vars(each) | {k: v.tolist() for k, v in vars(each).items() if isinstance(v, np.ndarray)}
                for each in every
            ],
        )


if __name__ == "__main__":
    main()

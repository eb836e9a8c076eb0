"""How well stiffness and damping over stance are identified: `python -m benchmarks.ankle_impedance [--seeds 1000-1019]
[--delay-ms 1]`.

Simulated people and noise of the judging seeds, which nothing was tuned on. SNR counts the perturbed intrinsic moment
against the moment's white noise; voluntary drift, fatigue, reflex and balance come on top. The mean error is that of
the relative error over stance. VAF is that of K x + B ẋ + I θ̈, fitted against true, noise-free; I as the moment tells
it. The bound is the mean error of the best estimate that knows everything else (Cramér and Rao): K and B of five
splines each, and I, in white noise alone. With --delay-ms the wrench is late, or early, by a time drawn for each person
within that, of which nothing is told but the usual deviation. The equilibrium angle is that of the person, not of these
steps. An axis is refused as the table refuses it.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from impedance.ankle.impedance import AXES, identify
from impedance.ankle.motion import bodies_of, motion_of
from impedance.ankle.shapes import spline
from impedance.ankle.table import table_of
from impedance.ankle.trial import Perturbation
from messages.arrays import BoolArray, FloatArray
from sim_rig.platform.ankle import AnkleRun, walk
from sim_rig.platform.ankle_known import FLAT_FOOT
from sim_rig.platform.ankle_measured import AT_15_DB, SENSOR_NOISE, AnkleNoise, late, measured
from sim_rig.platform.ankle_person import person
from sim_rig.platform.ankle_truth import true_equilibrium

CASES = (
    ("random, 10 cycles, 15 dB", Perturbation.RANDOM, 10, 0, AT_15_DB),
    ("random, 10 cycles, the sensors' own noise", Perturbation.RANDOM, 10, 0, SENSOR_NOISE),
    ("ramps, 10 cycles + 10 unperturbed, 15 dB", Perturbation.RAMP, 10, 10, AT_15_DB),
    ("ramps, 10 cycles + 10 unperturbed, the sensors' own noise", Perturbation.RAMP, 10, 10, SENSOR_NOISE),
)
_BOUND_SPLINES = 5
_MEAN_OF_NORMAL = float(np.sqrt(2.0 / np.pi))


@dataclass(frozen=True)
class Outcome:
    """Of one seed, both axes (2,): mean errors and bounds (shares of the truth), coverage of 95 % intervals, VAF."""

    stiffness_error: FloatArray
    damping_error: FloatArray
    stiffness_bound: FloatArray
    damping_bound: FloatArray
    stiffness_covered: FloatArray
    damping_covered: FloatArray
    vaf: FloatArray
    equilibrium_deg: FloatArray
    equilibrium_covered: FloatArray
    refused: FloatArray
    inertia_off: FloatArray
    """The foot's moment of inertia minus the truth, in its own standard deviations."""


def outcome(
    kind: Perturbation, cycles: int, unperturbed: int, noise: AnkleNoise, seed: int, within_s: float = 0.0
) -> Outcome:
    """Return how well one seed's trial is identified, its wrench late by a time drawn within ± `within_s`."""
    run = walk(person(seed), [kind] * cycles + [Perturbation.NONE] * unperturbed, seed)
    delay_s = within_s * float(np.random.default_rng((seed, 4)).uniform(-1.0, 1.0))
    heard = late(run, delay_s) if delay_s else run
    trial = measured(heard, noise, seed)
    found = identify(trial)
    rest = true_equilibrium(run, found.stance)
    shown = table_of(trial, found)
    counted = run.perturbed & np.isin(np.arange(len(run.t_s)), found.rows)
    noise_nm = np.std((trial.wrench - heard.wrench)[:, [5, 3]], axis=0)
    truths = run.person.stiffness(found.stance), run.person.damping(found.stance)
    noise_free = motion_of(measured(run, AnkleNoise(0.0, 0.0, 0.0, 0.0), seed), bodies_of(trial.settings))
    rows = []
    for axis, one in enumerate(found.axes):
        (K, B), curves = (truth[:, axis] for truth in truths), (one.stiffness, one.damping)
        errors = [float(np.abs(curve.value / true - 1.0).mean()) for curve, true in zip(curves, (K, B), strict=True)]
        covered = [
            float(((curve.low <= true) & (true <= curve.high)).mean())
            for curve, true in zip(curves, (K, B), strict=True)
        ]
        off = one.fitted_nm - noise_free.moment[np.isin(noise_free.rows, found.rows), axis]
        vaf = 1.0 - off[run.perturbed[found.rows]].var() / run.intrinsic_nm[counted, axis].var()
        inertia_off = (one.inertia_kgm2 - run.foot_about_ankle_kgm2[axis]) / one.inertia_deviation_kgm2
        off_deg = float(np.rad2deg(np.abs(one.equilibrium.value - rest[:, axis]).mean()))
        inside = (one.equilibrium.low <= rest[:, axis]) & (rest[:, axis] <= one.equilibrium.high)
        refused = float(any("refused" in reason for reason in shown.axes()[axis].not_identifiable))
        bounds = _bounds(run, counted, axis, float(noise_nm[axis]), found.stance, K, B)
        rows.append([*errors, *bounds, *covered, vaf, off_deg, float(inside.mean()), refused, inertia_off])
    return Outcome(*np.array(rows).T)


def _bounds(
    run: AnkleRun, counted: BoolArray, axis: int, noise_nm: float, stance: FloatArray, K: FloatArray, B: FloatArray
) -> tuple[float, float]:
    """Return the least mean errors of K and B."""
    shapes = spline(run.stance[counted], FLAT_FOOT, _BOUND_SPLINES)
    asked = spline(stance, FLAT_FOOT, _BOUND_SPLINES)
    columns = np.hstack(
        (
            shapes * run.turn[counted, axis, None],
            shapes * run.rate[counted, axis, None],
            run.acceleration[counted, axis, None],
        )
    )
    covariance = noise_nm**2 * np.linalg.inv(columns.T @ columns)
    first, second = slice(0, _BOUND_SPLINES), slice(_BOUND_SPLINES, 2 * _BOUND_SPLINES)
    least = [
        _MEAN_OF_NORMAL * float((np.sqrt(np.einsum("ki,ij,kj->k", asked, covariance[part, part], asked)) / true).mean())
        for part, true in ((first, K), (second, B))
    ]
    return least[0], least[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1000-1019", help="first-last")
    parser.add_argument("--delay-ms", type=float, default=0.0, help="greatest delay of the wrench, either way")
    parser.add_argument("--only", default="", help="cases whose name holds this")
    arguments = parser.parse_args()
    first, last = (int(each) for each in arguments.seeds.split("-"))
    for name, kind, cycles, unperturbed, noise in (case for case in CASES if arguments.only in case[0]):
        within_s = 1e-3 * arguments.delay_ms
        outcomes = [outcome(kind, cycles, unperturbed, noise, seed, within_s) for seed in range(first, last + 1)]
        print(f"{name}; seeds {first} to {last}")
        for axis, label in enumerate(AXES):
            got = {key: np.array([getattr(each, key)[axis] for each in outcomes]) for key in Outcome.__annotations__}
            for what in ("stiffness", "damping"):
                error = 100.0 * got[f"{what}_error"]
                print(
                    f"  {label}, {what}: mean error {error.mean():.2f} % (median {np.median(error):.2f}, worst "
                    f"{error.max():.2f}; bound {100 * got[f'{what}_bound'].mean():.2f}), 95 % intervals cover "
                    f"{100 * got[f'{what}_covered'].mean():.1f} %"
                )
            off_deg = got["equilibrium_deg"]
            print(
                f"  {label}, equilibrium angle: mean error {off_deg.mean():.2f}° (worst {off_deg.max():.2f}), 95 % "
                f"intervals cover {100 * got['equilibrium_covered'].mean():.1f} %; refused {got['refused'].sum():.0f}"
            )
            vaf = 100.0 * got["vaf"]
            print(
                f"  {label}: VAF mean {vaf.mean():.2f} %, least {vaf.min():.2f} %; foot's inertia off by "
                f"{np.sqrt((got['inertia_off'] ** 2).mean()):.2f} of its deviation, RMS",
                flush=True,
            )


if __name__ == "__main__":
    main()

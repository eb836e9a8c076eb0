"""How well stiffness and damping over stance are identified: `python -m benchmarks.ankle_impedance [--seeds 1000-1019]
[--delay-ms 1]`.

Simulated people and noise of the judging seeds, which nothing was tuned on. SNR counts the perturbed intrinsic moment
against the moment's white noise; voluntary drift, fatigue, reflex and balance come on top. The mean error is that of
the relative error over stance. VAF is that of K x + B ẋ + I θ̈, fitted against true, noise-free; I as the moment tells
it. The bound is the mean error of the best estimate that knows everything else (Cramér and Rao): K and B of five
splines each, and I, in white noise alone. With --delay-ms the wrench is late, or early, by a time drawn for each person
within that, of which nothing is told but the usual deviation. The equilibrium angle is that of the person, not of these
steps. An axis is refused as the table refuses it. Mock-ups have springs and dampers drawn for each seed, every other
one on a rubber sole.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from impedance.ankle.impedance import AXES, identify
from impedance.ankle.motion import bodies_of, motion_of
from impedance.ankle.shapes import spline
from impedance.ankle.table import table_of
from impedance.ankle.trial import Ankle, AnkleTrial, Perturbation
from messages.arrays import BoolArray, FloatArray
from sim_rig.platform.ankle import AnkleRun, walk
from sim_rig.platform.ankle_known import FLAT_FOOT
from sim_rig.platform.ankle_measured import AT_15_DB, SENSOR_NOISE, AnkleNoise, late, measured
from sim_rig.platform.ankle_person import Person, mockup, person
from sim_rig.platform.ankle_truth import true_equilibrium


def _shod(seed: int) -> Person:
    return person(seed, shod=True)


def _mockup(seed: int) -> Person:
    """Return a mock-up whose spring and damper differ from seed to seed."""
    rng = np.random.default_rng((seed, 5))
    return mockup(float(rng.uniform(120.0, 450.0)), float(rng.uniform(0.8, 3.0)), shod=bool(seed % 2))


@dataclass(frozen=True)
class Case:
    """Who walks how, and what is known: the ankle's centre to `centre_m`, the foot's angle unless it is `unseen`."""

    name: str
    kind: Perturbation = Perturbation.RANDOM
    cycles: int = 10
    unperturbed: int = 0
    noise: AnkleNoise = AT_15_DB
    who: Callable[[int], Person] = person
    centre_m: float | None = None
    unseen: bool = False


CASES = (
    Case("random, 10 cycles, 15 dB"),
    Case("random, 10 cycles, the sensors' own noise", noise=SENSOR_NOISE),
    Case("protocol, 10 cycles + 20 unperturbed, ankle's centre to 0.5 mm, 15 dB", unperturbed=20, centre_m=5e-4),
    Case("shod, 10 cycles, 15 dB", who=_shod),
    Case("shod but the foot unseen, 10 cycles, 15 dB", who=_shod, unseen=True),
    Case("mock-up, 10 runs of 1.5 s, the sensors' own noise", noise=SENSOR_NOISE, who=_mockup),
    Case("ramps, 10 cycles + 10 unperturbed, 15 dB", Perturbation.RAMP, unperturbed=10),
    Case("ramps, 10 cycles + 10 unperturbed, the sensors' own noise", Perturbation.RAMP, 10, 10, SENSOR_NOISE),
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
    cross_error: FloatArray
    cross_covered: FloatArray
    inertia_off: FloatArray
    """The foot's moment of inertia minus the truth, in its own standard deviations."""


def outcome(case: Case, seed: int, within_s: float = 0.0) -> Outcome:
    """Return how well one seed's trial is identified, its wrench late by a time drawn within ± `within_s`."""
    run = walk(case.who(seed), [case.kind] * case.cycles + [Perturbation.NONE] * case.unperturbed, seed)
    delay_s = within_s * float(np.random.default_rng((seed, 4)).uniform(-1.0, 1.0))
    heard = late(run, delay_s) if delay_s else run
    trial = known(measured(heard, case.noise, seed), run.person, case, seed)
    found = identify(trial)
    rest = true_equilibrium(run, found.stance)
    shown = table_of(trial, found)
    counted = run.perturbed & np.isin(np.arange(len(run.t_s)), found.rows)
    noise_nm = np.std((trial.wrench - heard.wrench)[:, [5, 3]], axis=0)
    truths = run.person.stiffness(found.stance), run.person.damping(found.stance)
    exact = replace(measured(run, AnkleNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), seed), settings=trial.settings)
    noise_free = motion_of(exact, bodies_of(trial.settings))
    both = np.isin(found.rows, noise_free.rows)
    rows = []
    for axis, one in enumerate(found.axes):
        (K, B), curves = (truth[:, axis] for truth in truths), (one.stiffness, one.damping)
        errors = [float(np.abs(curve.value / true - 1.0).mean()) for curve, true in zip(curves, (K, B), strict=True)]
        covered = [
            float(((curve.low <= true) & (true <= curve.high)).mean())
            for curve, true in zip(curves, (K, B), strict=True)
        ]
        off = one.fitted_nm[both] - noise_free.moment[np.isin(noise_free.rows, found.rows), axis]
        vaf = 1.0 - off[run.perturbed[found.rows[both]]].var() / run.intrinsic_nm[counted, axis].var()
        inertia_off = (one.inertia_kgm2 - run.foot_about_ankle_kgm2[axis]) / one.inertia_deviation_kgm2
        off_deg = float(np.rad2deg(np.abs(one.equilibrium.value - rest[:, axis]).mean()))
        inside = (one.equilibrium.low <= rest[:, axis]) & (rest[:, axis] <= one.equilibrium.high)
        refused = float(any("refused" in reason for reason in shown.axes()[axis].not_identifiable))
        bounds = _bounds(run, counted, axis, float(noise_nm[axis]), found.stance, K, B)
        across, cross = run.person.cross_stiffness(found.stance), one.cross_stiffness
        held = float(((cross.low <= across) & (across <= cross.high)).mean())
        off_across = float(np.abs(cross.value - across).mean())
        rows.append(
            [*errors, *bounds, *covered, vaf, off_deg, float(inside.mean()), refused, off_across, held, inertia_off]
        )
    return Outcome(*np.array(rows).T)


def known(trial: AnkleTrial, who: Person, case: Case, seed: int) -> AnkleTrial:
    """Return the trial with what the case knows of the ankle's centre and of the foot."""
    if case.unseen:
        trial = replace(trial, foot_rad=None, heel_rise_m=None)
    if case.centre_m is None:
        return trial
    x, y, z = (who.ankle_P_m + case.centre_m * np.random.default_rng((seed, 6)).standard_normal(3)).tolist()
    ankle = Ankle((x, y, z), case.centre_m)
    return replace(trial, settings=msgspec.structs.replace(trial.settings, ankle=ankle))


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
    for case in (case for case in CASES if arguments.only in case.name):
        within_s = 1e-3 * arguments.delay_ms
        outcomes = [outcome(case, seed, within_s) for seed in range(first, last + 1)]
        print(f"{case.name}; seeds {first} to {last}")
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
            print(
                f"  {label}, stiffness by the other axis: mean error {got['cross_error'].mean():.2f} N·m/rad, 95 % "
                f"intervals cover {100 * got['cross_covered'].mean():.1f} %"
            )
            vaf = 100.0 * got["vaf"]
            print(
                f"  {label}: VAF mean {vaf.mean():.2f} %, least {vaf.min():.2f} %; foot's inertia off by "
                f"{np.sqrt((got['inertia_off'] ** 2).mean()):.2f} of its deviation, RMS",
                flush=True,
            )


if __name__ == "__main__":
    main()

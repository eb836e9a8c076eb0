"""Attitude from IMU and camera, on units and walks that nothing was tuned on, without a picture:

    python -m benchmarks.visual_inertial [--units 20] [--first-seed 1000] [--rows start,bus] [--json FILE]

The simulated chip's samples come through the real driver; steps of the odometer are made from the truth, with noise and
with the residual of the unit's calibration (`lab.evaluation.told_steps`). Each unit is another chip, mounting, gait,
pace and drift. Errors are angles of the vertical over the valid samples from the row's first second that counts; "in
95 %" is the share of them inside the stated ellipse, wrong what `lab.faults.criteria` calls so, valid and wrong in
shares of all samples from the first valid one on. Beside it the same filter without steps, and VQF. Seeds below 1000
are for tuning.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.told_walks import START_NS, asked, by_row, pace_of, walking_on
from cli.console import write_json
from lab.evaluation.attitude import coverage, tilt_errors_W, vqf_up_B
from lab.evaluation.told_steps import OdometerNoise, ToldStep, attitudes, told_steps
from lab.faults.criteria import SIGMAS, WRONG_TILT_RAD
from messages import Attitude, ImuSample, Status
from messages.arrays import BoolArray, FloatArray
from perception import so3
from perception.attitude.imu_model import corrected
from perception.attitude.track import AttitudeTrack
from sim_rig.imu.drift import Drift
from sim_rig.walk.scenario import Pace, Scenario, scenario
from sim_rig.wearer import SimulatedWearer

_RATE_HZ = 100.0
_JUMP_S, _COVERED_FROM_S = 15.0, 10.0
_NEVER_S = 1e9
_WITH, _WITHOUT, _VQF = "with camera", "without", "VQF"


@dataclass(frozen=True)
class Row:
    """A kind of walk: `walk` returns that of a unit, given its pace and a random generator.

    The camera is covered from `covered_from_s` on; samples count from `from_s` on.
    """

    name: str
    seconds: float
    walk: Callable[[Pace, np.random.Generator], Scenario]
    covered_from_s: float = _NEVER_S
    from_s: float = 0.0


@dataclass(frozen=True)
class Judged:
    """Of one estimator on one unit, by sample from the first that counts: error (rad), inside, wrong, valid."""

    error_rad: FloatArray
    inside: BoolArray
    wrong: BoolArray
    valid: BoolArray


class Figures(msgspec.Struct, frozen=True, kw_only=True):
    """One estimator on all units of a row; angles in degrees, shares from 0 to 1. `worst_seed` has the largest RMS.
    NaN where no sample was valid."""

    rms_deg: float
    p99_deg: float
    max_deg: float
    in_95: float
    valid: float
    wrong: float
    held: float
    worst_seed: int
    worst_rms_deg: float


def named(name: str) -> Callable[[Pace, np.random.Generator], Scenario]:
    return lambda pace, _: scenario(name, pace)


def starts(pace: Pace, chance: np.random.Generator) -> Scenario:
    return scenario("start", replace(pace, acceleration_mps2=float(chance.uniform(0.8, 2.0))))


def drifting(radps2: float) -> Callable[[Pace, np.random.Generator], Scenario]:
    """Return walks whose gyroscope's biases all move at this rate, each in a direction of its own."""

    def walk(pace: Pace, chance: np.random.Generator) -> Scenario:
        x, y, z = (float(sign) for sign in radps2 * chance.choice((-1.0, 1.0), 3))
        return replace(walking_on(pace), drift=Drift(w_rate_radps2=(x, y, z)))

    return walk


def jumping(pace: Pace, chance: np.random.Generator) -> Scenario:
    """Return a walk whose gyroscope's bias jumps by 0.8 to 2 °/s in any direction."""
    direction = chance.standard_normal(3)
    jump = np.radians(chance.uniform(0.8, 2.0)) * direction / np.linalg.norm(direction)
    x, y, z = (float(each) for each in jump)
    return replace(walking_on(pace), drift=Drift(w_steps=((_JUMP_S, (x, y, z)),)))


def warming(pace: Pace, chance: np.random.Generator) -> Scenario:
    """Return a walk out of a warm room, of a chip that has just been switched on."""
    cold_K = float(chance.uniform(15.0, 30.0))
    return replace(walking_on(pace), drift=Drift(warming_K=12.0, air_steps=((30.0, -cold_K),)))


_DEG_A_MINUTE = np.radians(1.0) / 60.0
ROWS = (
    Row("start, 0.8 to 2 m/s²", 25.0, starts),
    Row("level", 30.0, named("level")),
    Row("ramps", 45.0, named("ramps")),
    Row("turns", 45.0, named("turns")),
    Row("limping", 30.0, named("limping")),
    Row("stops", 40.0, named("stops")),
    Row("stairs", 30.0, named("stairs")),
    Row("sitting", 25.0, named("sitting")),
    Row("stumbling", 25.0, named("stumbling")),
    Row("standing", 20.0, named("standing")),
    Row("drift, 3 °/s in 3 min", 180.0, drifting(_DEG_A_MINUTE)),
    Row("drift, 1 °/s in 20 s", 40.0, drifting(3.0 * _DEG_A_MINUTE)),
    Row("jump, 0.8 to 2 °/s", 35.0, jumping),
    Row("warming, then outdoors", 150.0, warming),
    Row("covered", 60.0, lambda pace, _: walking_on(pace), _COVERED_FROM_S),
    Row("covered, 1 °/s in 1 min", 60.0, drifting(_DEG_A_MINUTE), _COVERED_FROM_S),
    Row("covered, jump, 10 s later", 45.0, jumping, _COVERED_FROM_S, _JUMP_S + 10.0),
    Row("bus", 40.0, named("bus")),
    Row("bus, walking", 40.0, named("bus-walking")),
    Row("slow bus", 45.0, named("bus-slow")),
    Row("slow bus, walking", 45.0, named("bus-slow-walking")),
    Row("lift", 30.0, named("lift")),
    Row("lift, walking", 30.0, named("lift-walking")),
)


def judged(said: list[Attitude], truth_R_WB: FloatArray) -> Judged:
    valid = np.array([attitude.status is Status.VALID for attitude in said])
    found = [attitude for attitude in said if attitude.status is Status.VALID]
    R_WB = np.array([so3.matrix_from_quaternion(attitude.q_WB) for attitude in found]).reshape(-1, 3, 3)
    upper = np.array([attitude.rotation_cov_W_rad2 for attitude in found]).reshape(-1, 6)
    cov_W = upper[:, [0, 1, 1, 3]].reshape(-1, 2, 2)
    tilt_W = tilt_errors_W(R_WB, truth_R_WB[valid])
    error = np.linalg.norm(tilt_W, axis=1)
    deviation = np.sqrt(np.linalg.eigvalsh(cov_W)[:, -1])
    wrong = ~(error <= np.maximum(WRONG_TILT_RAD, SIGMAS * deviation))
    inside = np.array([coverage(tilt_W[[k]], cov_W[[k]]) > 0.0 for k in range(len(error))], dtype=np.bool_)
    return Judged(error, inside, wrong, valid)


def of_one_unit(task: tuple[int, int, OdometerNoise]) -> dict[str, Judged]:
    """Return what each estimator makes of one unit of one row."""
    index, seed, noise = task
    row = ROWS[index]
    chance = np.random.default_rng([seed, 15])
    wearer = SimulatedWearer(seed, row.walk(pace_of(chance), chance), START_NS)
    samples = list(wearer.offline_samples(row.seconds))
    covered_ns = START_NS + round(1e9 * min(row.covered_from_s, row.seconds))
    steps = [told for told in told_steps(wearer, row.seconds, noise, seed) if told.step.t_after_ns < covered_ns]
    t_ns = np.array([sample.t_sample_ns for sample in samples])
    counts = t_ns >= START_NS + round(1e9 * row.from_s)
    truth = wearer.gait.at(t_ns).R_WB

    def on(told: list[ToldStep]) -> Judged:
        said = attitudes(AttitudeTrack(wearer.calibration), samples, iter(told))
        return judged([each for each, counted in zip(said, counts, strict=True) if counted], truth[counts])

    return {
        _WITH: on(steps),
        _WITHOUT: on([]),
        _VQF: vqf(wearer, samples, counts),
    }


def vqf(wearer: SimulatedWearer, samples: list[ImuSample], counts: BoolArray) -> Judged:
    """Return VQF on the calibrated samples: its attitude is that at the end of a sample's period, always valid."""
    calibrated = [corrected(sample, wearer.calibration.imu) for sample in samples]
    sf_B, w_B = np.array([each.sf_B_mps2 for each in calibrated]), np.array([each.w_WB_B_radps for each in calibrated])
    t_end_ns = np.array([sample.t_sample_ns for sample in samples]) + round(0.5e9 / _RATE_HZ)
    true_up_B = wearer.gait.at(t_end_ns).R_WB[:, 2, :]
    up_B = vqf_up_B(sf_B, w_B, _RATE_HZ)
    error = np.arctan2(np.linalg.norm(np.cross(up_B, true_up_B), axis=1), np.sum(up_B * true_up_B, axis=1))
    counts = counts & (t_end_ns > START_NS + round(1e9))
    states_none = np.zeros(np.count_nonzero(counts), dtype=np.bool_)
    return Judged(error[counts], states_none, states_none, ~states_none)


def figures(units: dict[int, Judged]) -> Figures:
    """Return the figures of all units, by seed; valid is the share from each unit's first valid sample on."""
    errors = np.degrees(np.concatenate([unit.error_rad for unit in units.values()]))
    from_first_valid = [unit.valid[np.argmax(unit.valid) :] for unit in units.values()]
    valid = np.concatenate(from_first_valid)
    inside, wrong = (
        np.concatenate([getattr(unit, name) for unit in units.values()]).astype(np.float64)
        for name in ("inside", "wrong")
    )
    if len(errors) == 0:
        errors = inside = np.full(1, np.nan)
    rms_deg = {
        seed: float(np.degrees(np.sqrt(np.mean(unit.error_rad**2)))) if len(unit.error_rad) else np.nan
        for seed, unit in units.items()
    }
    worst_seed = max(rms_deg, key=lambda seed: -1.0 if np.isnan(rms_deg[seed]) else rms_deg[seed])
    return Figures(
        rms_deg=float(np.sqrt(np.mean(errors**2))),
        p99_deg=float(np.percentile(errors, 99.0)),
        max_deg=float(errors.max()),
        in_95=float(inside.mean()),
        valid=float(valid.mean()),
        wrong=float(wrong.sum() / len(valid)),
        held=float(1.0 - np.sum(inside == 0.0) / len(valid)),
        worst_seed=worst_seed,
        worst_rms_deg=rms_deg[worst_seed],
    )


def main() -> int:
    names = [row.name for row in ROWS]
    options = asked(__doc__, names, units=8, velocity_noise_mmps=12.0, rate_noise_degps=0.4)
    found = by_row(of_one_unit, options)
    first, last = options.seeds[0], options.seeds[-1]
    table = Table(title=f"Tilt error in degrees, units {first} to {last}", title_justify="left")
    columns = ("RMS", "P99", "max", "in 95 %", "valid", "wrong", "in or not valid", "worst unit", "without: RMS")
    table.add_column("", no_wrap=True)
    for column in (*columns, "in 95 %", "wrong", "VQF: RMS"):
        table.add_column(column, justify="right")
    facts: dict[str, dict[str, Figures]] = {}
    for index, units in found.items():
        by = {who: figures({seed: unit[who] for seed, unit in units.items()}) for who in (_WITH, _WITHOUT, _VQF)}
        facts[ROWS[index].name] = by
        ours, alone = by[_WITH], by[_WITHOUT]
        table.add_row(
            ROWS[index].name,
            *(f"{angle:.2f}" for angle in (ours.rms_deg, ours.p99_deg, ours.max_deg)),
            *(f"{100 * share:.1f}" for share in (ours.in_95, ours.valid, ours.wrong, ours.held)),
            f"{ours.worst_rms_deg:.2f} ({ours.worst_seed})",
            f"{alone.rms_deg:.2f}",
            *(f"{100 * share:.1f}" for share in (alone.in_95, alone.wrong)),
            f"{by[_VQF].rms_deg:.2f}",
        )
    Console(width=150).print(table)
    if options.json is not None:
        write_json(options.json, facts)
    return 0


if __name__ == "__main__":
    sys.exit(main())

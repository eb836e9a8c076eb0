"""A camera that slips on its mount, and distances that are wrong, found while walking, without a picture:

    python -m benchmarks.camera_faults [--units 20] [--first-seed 1000] [--rows slip,toe-in] [--json FILE]

Units and gaits are those of `benchmarks.visual_inertial`, the odometer's noise is what `benchmarks.odometry` measures.
A slip turns the camera about a random axis after 10 s; wrong distances are too long by one share from the start on,
that of the toe-in 1.2 m from the camera. Found is the first reason that an attitude track gives not to use camera and
IMU together, after the fault began; before it, and in the row without a fault, it is a false alarm. Height left is the
error of 0.9 m after the correction where nothing is flagged.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from multiprocessing import Pool
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.visual_inertial import START_NS, pace_of, walking_on
from lab.evaluation.told_steps import OdometerNoise, ToldStep, told_steps
from messages import Reason, vec3
from perception import so3
from perception.attitude.track import AttitudeTrack
from sim_rig.wearer import SimulatedWearer

_SLIP_AT_S = 10.0
_HEIGHT_MM = 900.0


@dataclass(frozen=True)
class Row:
    """A fault: the camera turns by `slip_rad`, or distances are `scale` too long; `within_s` is the goal."""

    name: str
    seconds: float
    within_s: float
    slip_rad: float = 0.0
    scale: float = 0.0


ROWS = (
    Row("none", 60.0, 60.0),
    Row("slip of 1°", 20.0, 3.0, slip_rad=float(np.radians(1.0))),
    Row("toe-in off by 0.1°", 60.0, 60.0, scale=0.0175),
    Row("toe-in off by 0.05°", 120.0, 120.0, scale=0.0087),
    Row("baseline off by 1 %", 120.0, 120.0, scale=0.01),
)


class Found(msgspec.Struct, frozen=True, kw_only=True):
    """Of one unit: seconds from the fault to the first reason, None for none; the reason; a reason before the fault;
    and the share by which distances are wrong after the correction."""

    after_s: float | None
    reason: str
    false_alarm: bool
    scale_left: float


def faulty(steps: Iterator[ToldStep], row: Row, chance: np.random.Generator) -> Iterator[ToldStep]:
    """Yield the steps as a camera with the row's fault tells them."""
    axis = chance.standard_normal(3)
    turn = so3.exp(row.slip_rad * axis / np.linalg.norm(axis))
    for told in steps:
        step = told.step
        slipped = row.slip_rad > 0.0 and step.t_before_ns >= START_NS + round(1e9 * _SLIP_AT_S)
        R = turn if slipped else np.eye(3)
        travel_B = (1.0 + row.scale) * R @ np.array(step.travel_B)
        yield replace(told, step=replace(step, turn_B=vec3(R @ np.array(step.turn_B)), travel_B=vec3(travel_B)))


def of_one_unit(task: tuple[int, int, OdometerNoise]) -> Found:
    """Return what is found on one unit of one row."""
    index, seed, noise = task
    row, chance = ROWS[index], np.random.default_rng([seed, 16])
    wearer = SimulatedWearer(seed, walking_on(pace_of(chance)), START_NS)
    track = AttitudeTrack(wearer.calibration)
    steps = faulty(told_steps(wearer, row.seconds, noise, seed), row, chance)
    following = next(steps, None)
    fault_ns = START_NS + round(1e9 * (_SLIP_AT_S if row.slip_rad > 0.0 else 0.0))
    fault_ns = fault_ns if row.slip_rad > 0.0 or row.scale > 0.0 else 2**62
    false_alarm = False
    for sample in wearer.offline_samples(row.seconds):
        track.add_sample(sample)
        while following is not None and following.t_told_ns <= sample.t_arrival_ns:
            track.add_camera_step(following.step)
            following = next(steps, None)
            reason = track.contradiction
            if reason is Reason.NONE:
                track.checkpoint()
            elif sample.t_sample_ns > fault_ns:
                after_s = 1e-9 * (sample.t_sample_ns - fault_ns)
                return Found(after_s=after_s, reason=reason.value, false_alarm=false_alarm, scale_left=np.nan)
            else:
                false_alarm = True
    left = (1.0 + row.scale) / (1.0 + track.distance_scale) - 1.0
    return Found(after_s=None, reason="", false_alarm=false_alarm, scale_left=left)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--units", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--rows", default="", help="only rows whose name begins with one of these, such as slip,toe-in")
    parser.add_argument("--velocity-noise-mmps", type=float, default=6.0)
    parser.add_argument("--rate-noise-degps", type=float, default=0.25)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    noise = OdometerNoise(1e-3 * options.velocity_noise_mmps, float(np.radians(options.rate_noise_degps)))
    chosen = [k for k, row in enumerate(ROWS) if row.name.startswith(tuple(options.rows.split(",")))]
    seeds = range(options.first_seed, options.first_seed + options.units)
    with Pool(2) as pool:
        found = pool.map(of_one_unit, [(k, seed, noise) for k in chosen for seed in seeds], 1)
    table = Table("fault", "in time", "median s", "worst s", "reasons", "false alarms", "height left, RMS mm", "hours")
    for place, k in enumerate(chosen):
        row, units = ROWS[k], found[place * len(seeds) : (place + 1) * len(seeds)]
        times_s = [unit.after_s for unit in units if unit.after_s is not None]
        left = np.array([unit.scale_left for unit in units])
        left_mm = _HEIGHT_MM * np.sqrt(np.nanmean(left**2)) if np.isfinite(left).any() else np.nan
        table.add_row(
            row.name,
            f"{sum(t <= row.within_s for t in times_s)} of {len(units)} in {row.within_s:g} s",
            f"{np.median(times_s):.1f}" if times_s else "",
            f"{max(times_s):.1f}" if times_s else "",
            ", ".join(sorted({unit.reason for unit in units if unit.reason})),
            str(sum(unit.false_alarm for unit in units)),
            f"{left_mm:.1f}",
            f"{len(units) * row.seconds / 3600.0:.2f}",
        )
    Console().print(table)
    if options.json is not None:
        rows = {ROWS[k].name: found[p * len(seeds) : (p + 1) * len(seeds)] for p, k in enumerate(chosen)}
        options.json.write_bytes(msgspec.json.encode(rows))


if __name__ == "__main__":
    main()

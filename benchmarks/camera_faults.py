"""A camera that slips on its mount, and distances that are wrong, found while walking, without a picture:

    python -m benchmarks.camera_faults [--units 20] [--first-seed 1000] [--rows slip,toe-in] [--json FILE]

Units and gaits are those of `benchmarks.visual_inertial`, the odometer's noise is what `benchmarks.odometry` measures.
A slip turns the camera about a random axis after 10 s; wrong distances are too long on units of odd seeds, too short on
the others, by one share from the start on, that of the toe-in 1.2 m from the camera. Found is the first reason that an
attitude track gives not to use camera and IMU together, after the fault began; before it, and in the row without a
fault, it is a false alarm. Height left is the error of 0.9 m after the correction where nothing is flagged; corrected
are the units on which that is 5 mm at most: where the calibration's own error makes up for most of the fault, the two
together are within what the calibration leaves.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.told_walks import START_NS, asked, by_row, pace_of, walking_on
from cli.console import write_json
from lab.evaluation.told_steps import OdometerNoise, ToldStep, attitudes, depth_error, told_steps
from messages import Reason, vec3
from messages.arrays import rms
from perception import so3
from perception.attitude.track import AttitudeTrack
from sim_rig.wearer import SimulatedWearer

_SLIP_AT_S = 10.0
_HEIGHT_MM, _MOST_LEFT_MM = 900.0, 5.0


@dataclass(frozen=True)
class Row:
    """A fault: the camera turns by `slip_rad`, or distances are wrong by `scale`; `within_s` is the goal."""

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
    """Of one unit: seconds from the fault to the first reason, None for none; the reason; what was told before the
    fault, reasons with the seconds from the first to the last of each; the share by which distances are wrong by the
    calibration alone, and after the correction with what the calibration leaves."""

    after_s: float | None
    reason: str
    false_alarms: dict[str, tuple[float, float]]
    calibration_scale: float
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
    row = replace(row, scale=row.scale if seed % 2 else -row.scale)
    wearer = SimulatedWearer(seed, walking_on(pace_of(chance)), START_NS)
    track = AttitudeTrack(wearer.calibration)
    steps = faulty(told_steps(wearer, row.seconds, noise, seed), row, chance)
    fault_ns = START_NS + round(1e9 * (_SLIP_AT_S if row.slip_rad > 0.0 else 0.0))
    fault_ns = fault_ns if row.slip_rad > 0.0 or row.scale != 0.0 else 2**62
    calibration_scale = depth_error(wearer.unit, wearer.calibration)
    found_s, found, false_alarms = None, Reason.NONE, dict[str, tuple[float, float]]()
    for attitude in attitudes(track, wearer.offline_samples(row.seconds), steps):
        if track.contradiction is Reason.NONE:
            continue
        if attitude.t_sample_ns > fault_ns:
            found_s, found = 1e-9 * (attitude.t_sample_ns - fault_ns), track.contradiction
            break
        at_s = 1e-9 * (attitude.t_sample_ns - START_NS)
        first_s, _ = false_alarms.get(track.contradiction.value, (at_s, at_s))
        false_alarms[track.contradiction.value] = (first_s, at_s)
    left = (1.0 + row.scale) * (1.0 + calibration_scale) / (1.0 + track.distance_scale) - 1.0
    return Found(
        after_s=found_s,
        reason="" if found is Reason.NONE else found.value,
        false_alarms=false_alarms,
        calibration_scale=calibration_scale,
        scale_left=left if found_s is None else np.nan,
    )


def main() -> None:
    names = [row.name for row in ROWS]
    options = asked(__doc__, names, units=20, velocity_noise_mmps=6.0, rate_noise_degps=0.25)
    found = {ROWS[k]: list(units.values()) for k, units in by_row(of_one_unit, options).items()}
    columns = ("in time", "median s", "worst s", "reasons", "corrected", "height left, RMS mm", "false alarms", "hours")
    table = Table("fault", *columns)
    for row, units in found.items():
        times_s = [unit.after_s for unit in units if unit.after_s is not None]
        left_mm = _HEIGHT_MM * np.array([unit.scale_left for unit in units if unit.after_s is None])
        table.add_row(
            row.name,
            f"{sum(t <= row.within_s for t in times_s)} of {len(units)} in {row.within_s:g} s",
            f"{np.median(times_s):.1f}" if times_s else "",
            f"{max(times_s):.1f}" if times_s else "",
            ", ".join(sorted({unit.reason for unit in units if unit.reason})),
            str(np.count_nonzero(np.abs(left_mm) <= _MOST_LEFT_MM)),
            f"{rms(left_mm):.1f}" if len(left_mm) else "",
            str(sum(bool(unit.false_alarms) for unit in units)),
            f"{len(units) * row.seconds / 3600.0:.2f}",
        )
    console = Console(width=150)
    console.print(table)
    for row, units in found.items():
        for seed, unit in zip(options.seeds, units, strict=True):
            for reason, (first_s, last_s) in unit.false_alarms.items():
                console.print(
                    f"{row.name}, unit {seed}: {reason} from {first_s:.1f} to {last_s:.1f} s; "
                    f"its calibration's distances are {100.0 * unit.calibration_scale:+.2f} % off"
                )
    if options.json is not None:
        write_json(options.json, {row.name: units for row, units in found.items()})


if __name__ == "__main__":
    main()

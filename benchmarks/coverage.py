"""How often the truth lies inside the stated 95 % intervals, unit by unit, and with one error of calibration alone.

    python -m benchmarks.coverage [--cases standing …] [--seeds 1000-1059] [--seconds 3] [--file F] [--workers 1]

The whole pipeline, faster than real time, on units of the rig with the calibration that they would have: true values
plus one draw of the residual that it states. All causes of one unit are made of its one walk, by changing what its
calibration says. Frames with an edge of the ground in the foothold region are left out, and those before the ground is
first valid. The errors of a unit hardly change from frame to frame, so intervals are bootstrapped by unit. One line
of JSON is added to F for each finished unit and case, which is not run again. Seeds below 1000 are for tuning.
"""

import argparse
import math
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from typing import NamedTuple

import cv2
import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from messages import Calibration, Frame, GroundPlane, ImuSample, Status, Tick, vec3
from messages.arrays import FloatArray
from messages.constants import NORMAL_95, STANDARD_GRAVITY_MPS2
from perception.ground.foothold import FootholdSettings
from sim_rig.unit import RESIDUAL
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
BOOTSTRAPS = 4000

Recalibrated = Callable[[SimulatedWearer], Calibration]


def as_calibrated(wearer: SimulatedWearer) -> Calibration:
    return wearer.calibration


def by_default(wearer: SimulatedWearer) -> Calibration:
    """Return a calibration that does not state the newer terms of its residual and leaves what is usual of them."""
    unstated = {"focal_length": msgspec.UNSET, "baseline": msgspec.UNSET, "specific_force_mps2_per_K": msgspec.UNSET}
    residual = msgspec.structs.replace(RESIDUAL, **unstated)
    return wearer.unit.calibration(np.random.default_rng([seed_of(wearer), 6]), residual)


def seed_of(wearer: SimulatedWearer) -> int:
    return int(wearer.unit.name.rpartition("-")[2])


def other_focal_length(share: float, wearer: SimulatedWearer) -> Calibration:
    """Return a calibration whose left eye has a focal length that is longer by `share` than it should be."""
    calibration = wearer.calibration
    left = calibration.stereo.left
    left = msgspec.structs.replace(left, fx_px=(1.0 + share) * left.fx_px, fy_px=(1.0 + share) * left.fy_px)
    return msgspec.structs.replace(calibration, stereo=msgspec.structs.replace(calibration.stereo, left=left))


def other_baseline(share: float, wearer: SimulatedWearer, stated: float | None = None) -> Calibration:
    """Return a calibration whose baseline is longer by `share`, and says that it may be by as much as `stated`, 1 σ."""
    calibration = wearer.calibration
    X_RL = calibration.stereo.X_RL
    X_RL = msgspec.structs.replace(X_RL, p_m=vec3((1.0 + share) * np.array(X_RL.p_m)))
    residual = calibration.residual
    if stated is not None:
        residual = msgspec.structs.replace(residual, baseline=stated)
    stereo = msgspec.structs.replace(calibration.stereo, X_RL=X_RL)
    return msgspec.structs.replace(calibration, stereo=stereo, residual=residual)


def made_warmer(by_K: float, axis: int, change_mg: float, wearer: SimulatedWearer) -> Calibration:
    """Return a calibration made when the die was warmer by `by_K`, since when one axis has changed by `change_mg`;
    what is usual of that is stated."""
    calibration = wearer.calibration
    imu, bias_mps2 = calibration.imu, list(calibration.imu.sf_bias_mps2)
    bias_mps2[axis] -= 1e-3 * STANDARD_GRAVITY_MPS2 * change_mg
    there_degC = wearer.unit.chip.temperature_degC + by_K
    imu = msgspec.structs.replace(imu, sf_bias_mps2=vec3(bias_mps2), temperature_degC=there_degC)
    residual = msgspec.structs.replace(calibration.residual, specific_force_mps2_per_K=msgspec.UNSET)
    return msgspec.structs.replace(calibration, imu=imu, residual=residual)


class Case(NamedTuple):
    """A scenario and what the calibration says of its unit."""

    scenario: str
    calibration: Recalibrated


CAUSES: dict[str, Recalibrated] = {
    "": as_calibrated,
    "-default": by_default,
    "-focal-0.1%": partial(other_focal_length, 0.001),
    "-focal-0.3%": partial(other_focal_length, 0.003),
    "-baseline-1%": partial(other_baseline, 0.01),
    "-baseline-1%-stated": partial(other_baseline, 0.01, stated=0.01),
    "-cold-z+40mg": partial(made_warmer, 47.0, 2, 40.0),
}
CASES = {
    f"{name}{cause}": Case(walk, calibration)
    for name, walk in (("standing", "standing"), ("walking", "mixed"))
    for cause, calibration in CAUSES.items()
}


class Covered(msgspec.Struct, frozen=True, kw_only=True):
    """One unit in one case: frames since the first valid one, those valid, and of these, for (slope ahead, slope
    across, height), how many have the truth inside, and the sums of squares of errors and of stated deviations, in rad
    and m."""

    case: str
    seed: int
    seconds: float
    frames: int
    valid: int
    inside: tuple[int, int, int]
    error_squares: tuple[float, float, float]
    stated_squares: tuple[float, float, float]


def covered(
    case: str, seed: int, seconds: float, wearer: SimulatedWearer, inputs: Sequence[ImuSample | Tick | Frame]
) -> Covered:
    """Return what becomes of a walk's `inputs` with the calibration of a case."""
    pipeline = Pipeline(CASES[case].calibration(wearer), FootholdSettings())
    frames = 0
    rows: list[tuple[tuple[float, float, float], list[float]]] = []
    for message in inputs:
        for ground in pipeline.step(message):
            if not isinstance(ground, GroundPlane) or ground.frame_seq < 0:
                continue
            truth = wearer.truth_of(ground)
            valid = ground.status is Status.VALID
            if truth.transition or not (valid or rows):
                continue
            frames += 1
            if valid:
                error = (
                    ground.slope_sagittal_rad - truth.slope_sagittal_rad,
                    ground.slope_frontal_rad - truth.slope_frontal_rad,
                    ground.height_m - truth.height_m,
                )
                rows.append((error, [ground.covariance[k] for k in (0, 3, 5)]))
    errors, variances = np.array(rows).reshape(-1, 2, 3).swapaxes(0, 1)
    squares = errors**2
    return Covered(
        case=case,
        seed=seed,
        seconds=seconds,
        frames=frames,
        valid=len(rows),
        inside=tuple((squares <= NORMAL_95**2 * variances).sum(axis=0).tolist()),
        error_squares=tuple(squares.sum(axis=0).tolist()),
        stated_squares=tuple(variances.sum(axis=0).tolist()),
    )


def of_one_unit(task: tuple[int, float, tuple[str, ...]]) -> list[Covered]:
    """Return one unit in all `cases` asked for, each walk rendered once."""
    seed, seconds, cases = task
    cv2.setNumThreads(1)
    found = []
    for walk in dict.fromkeys(CASES[case].scenario for case in cases):
        wearer = SimulatedWearer(seed, scenario(walk), START_NS)
        inputs = list(wearer.offline_inputs(seconds))
        found += [covered(case, seed, seconds, wearer, inputs) for case in cases if CASES[case].scenario == walk]
    return found


def bootstrapped(inside: FloatArray, valid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the 2.5 and 97.5 % points (3,) of the share inside, over units drawn anew: `inside` (units, 3), `valid`
    (units,) are frames."""
    drawn = np.random.default_rng(0).integers(len(valid), size=(BOOTSTRAPS, len(valid)))
    shares = inside[drawn].sum(axis=1) / valid[drawn].sum(axis=1)[:, None]
    low, high = np.percentile(shares, (2.5, 97.5), axis=0)
    return low, high


def table(found: Sequence[Covered]) -> None:
    """Print one line for each case and number."""
    print(f"{'':26}units ever valid  then  {'':8}error RMS  stated sd   inside 95 % (bootstrap by unit)")
    for case in [case for case in CASES if any(each.case == case for each in found)]:
        units = [each for each in found if each.case == case]
        valid = np.array([each.valid for each in units], dtype=np.float64)
        total, frames = valid.sum(), sum(each.frames for each in units)
        ever = f"{np.count_nonzero(valid)} of {len(units)}"
        if total == 0.0:
            print(f"{case:26}{ever:>11}")
            continue
        inside = np.array([each.inside for each in units], dtype=np.float64)
        error, stated = (
            np.sqrt(np.sum([getattr(each, name) for each in units], axis=0) / total)
            for name in ("error_squares", "stated_squares")
        )
        low, high = bootstrapped(inside[valid > 0], valid[valid > 0])
        for k, name in enumerate(("ahead", "across", "height")):
            start = f"{case:26}{ever:>11} {total / frames:8.1%}" if k == 0 else ""
            values = (1e3 * error[k], 1e3 * stated[k]) if k == 2 else (math.degrees(error[k]), math.degrees(stated[k]))
            numbers = "{:6.2f} mm  {:6.2f} mm" if k == 2 else "{:7.3f}°   {:7.3f}°"
            share = inside.sum(axis=0)[k] / total
            print(f"{start:47}{name:8}{numbers.format(*values)}   {share:6.1%} ({low[k]:.1%} to {high[k]:.1%})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=["standing", "walking"], choices=CASES, metavar="CASE")
    parser.add_argument("--seeds", default="1000-1059", help="rig units, first-last")
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--file", type=Path, help="finished units, kept and gone on from")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    known = options.file.read_text().splitlines() if options.file and options.file.exists() else []
    found = [msgspec.json.decode(line, type=Covered) for line in known]
    done = {(each.case, each.seed, each.seconds) for each in found}
    missing = (
        (seed, options.seconds, tuple(c for c in options.cases if (c, seed, options.seconds) not in done))
        for seed in range(first, last + 1)
    )
    with Pool(options.workers) as pool:
        for of_unit in pool.imap(of_one_unit, [task for task in missing if task[2]]):
            found += of_unit
            if options.file:
                with options.file.open("ab") as file:
                    file.writelines(msgspec.json.encode(each) + b"\n" for each in of_unit)
    table([f for f in found if first <= f.seed <= last and f.case in options.cases and f.seconds == options.seconds])


if __name__ == "__main__":
    main()

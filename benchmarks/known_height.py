"""How long until the first plane whatever the configured height, and what the wearer's known height tells of a camera.

    python -m benchmarks.known_height [--cases start-0.5 slipped-4 …] [--seeds 1000-1019] [--file F]

The whole pipeline, faster than real time, on units of the rig with the calibration that they would have; each seed
draws the wearer's height, 0.8 to 1.1 m. All cases but `walk` see the same walk, on level ground, for 12 s.

`start-N`: `nominal_height_m` is N, the wearer stands for 3.5 s; how long after the attitude is valid is
the first valid plane? In all others the wearer's height is known, measured with the deviation that it states, 5 mm, but
where the case ends in "-unknown". `none`: nothing is wrong. `shoes+30`, `shoes-30`: it was measured in shoes 30 mm
thinner, or thicker. `slipped-N`: from 5 s on the right eye's picture is N px to the right of where it was; from before
the start on where "-first" follows.
`walk`: by turns of the seeds stairs, ramps, sitting, bending and mixed ground, 17 s each, without a fault,
in the shoes of the measurement and in others by turns.
A false alarm is `height_contradicts` in Health without a slip. Errors of height and sagittal slope are RMS, away from
edges, from 3 s on, or from the slip on; 95 % is the share of frames within 1.96 of their deviations; "settled" are the
last 3 s alone. One line of JSON is added to F for each finished trial; those there are not repeated.
Seeds below 1000 are for tuning, from 1000 on for judging.
"""

import argparse
import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from lab.faults import image_changes
from lab.faults.criteria import errors_of
from messages import (
    Attitude,
    Frame,
    GroundPlane,
    GroundTruth,
    Health,
    ImuSample,
    Status,
    StereoFrame,
    Tick,
    WearerHeight,
)
from messages.constants import NORMAL_95
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
SETTLED_S = 3.0
SLIP_S = 5.0
KNOWN_STD_M = 0.005
SHOES_M = 0.03
START_S, LEVEL_S, WALK_S, LAST_S = 3.5, 12.0, 17.0, 3.0

WALKS = ("stairs", "ramps", "sitting", "bending", "mixed")
STARTS = ("start-0.5", "start-0.97", "start-1.4")
SLIPS = tuple(f"slipped-{px}{how}" for how in ("", "-unknown", "-first", "-first-unknown") for px in (2, 3, 4))
CASES = (*STARTS, "none", "shoes+30", "shoes-30", *SLIPS, "walk")


class Errors(msgspec.Struct, kw_only=True):
    """Sums over frames of squared errors and stated variances of height and sagittal slope."""

    frames: int = 0
    height_m2: float = 0.0
    height_var_m2: float = 0.0
    height_within: int = 0
    slope_rad2: float = 0.0
    slope_var_rad2: float = 0.0
    slope_within: int = 0

    def add(self, ground: GroundPlane, truth: GroundTruth) -> None:
        """Add one valid frame."""
        height_m, slope_rad = ground.height_m - truth.height_m, ground.slope_sagittal_rad - truth.slope_sagittal_rad
        self.frames += 1
        self.height_m2 += height_m**2
        self.height_var_m2 += ground.covariance[5]
        self.height_within += height_m**2 < NORMAL_95**2 * ground.covariance[5]
        self.slope_rad2 += slope_rad**2
        self.slope_var_rad2 += ground.covariance[0]
        self.slope_within += slope_rad**2 < NORMAL_95**2 * ground.covariance[0]

    def row(self) -> str:
        """Return RMS error, RMS deviation and share within 95 %, of the height and of the slope."""
        count = max(1, self.frames)
        height, height_std = (1e3 * math.sqrt(square / count) for square in (self.height_m2, self.height_var_m2))
        slope, slope_std = (
            math.degrees(math.sqrt(square / count)) for square in (self.slope_rad2, self.slope_var_rad2)
        )
        return (
            f"{height:9.1f}{height_std:7.1f}{self.height_within / count:6.0%}"
            f"{slope:9.2f}{slope_std:7.2f}{self.slope_within / count:6.0%}"
        )


class Trial(msgspec.Struct, kw_only=True):
    """One walk. `first_valid_s` counts from the first valid attitude, NaN if no plane was valid; `alarm_s` from the
    slip, or the start, NaN if there was none. Sums are of `judged` frames."""

    case: str
    seed: int
    walk: str
    height_m: float
    first_valid_s: float | None = None
    alarm_s: float | None = None
    off_m: float | None = None
    frames: int = 0
    valid: int = 0
    wrong: int = 0
    seen: dict[str, int] = msgspec.field(default_factory=dict)
    errors: Errors = msgspec.field(default_factory=lambda: Errors())
    settled: Errors = msgspec.field(default_factory=lambda: Errors())

    @property
    def seconds(self) -> float:
        """Return how long it takes."""
        return START_S if self.case in STARTS else WALK_S if self.case == "walk" else LEVEL_S

    @property
    def slip_px(self) -> int | None:
        """Return by how much the right eye slips."""
        return int(self.case.split("-")[1]) if self.case.startswith("slipped") else None

    @property
    def slips_s(self) -> float:
        """Return when the eye slips."""
        return 0.0 if self.slip_px is None or "first" in self.case else SLIP_S

    def add(self, ground: GroundPlane, truth: GroundTruth) -> None:
        """Judge one frame."""
        since_s = _since_s(ground.t_exposure_ns)
        if since_s < max(SETTLED_S, self.slips_s):
            return
        self.frames += 1
        if ground.status is not Status.VALID:
            self.seen[ground.reason.value] = self.seen.get(ground.reason.value, 0) + 1
            return
        self.valid += 1
        self.wrong += errors_of(ground, truth).wrong
        if not truth.transition:
            self.errors.add(ground, truth)
            if since_s > self.seconds - LAST_S:
                self.settled.add(ground, truth)


class Run:
    """The pipeline of one trial."""

    def __init__(self, trial: Trial, wearer: SimulatedWearer) -> None:
        chance = np.random.default_rng([trial.seed, 41])
        foothold, calibration = FootholdSettings(), wearer.calibration
        if trial.case in STARTS:
            foothold = FootholdSettings(nominal_height_m=float(trial.case.split("-")[1]))
        elif not trial.case.endswith("unknown"):
            camera_m = trial.height_m + float(wearer.unit.X_BL.p_m[2]) + chance.normal(0.0, KNOWN_STD_M)
            shoes_m = (0.0, SHOES_M, -SHOES_M)[trial.seed % 3] if trial.case == "walk" else 0.0
            camera_m -= {"shoes+30": SHOES_M, "shoes-30": -SHOES_M}.get(trial.case, shoes_m)
            known = WearerHeight(camera_height_m=camera_m, std_m=KNOWN_STD_M)
            calibration = msgspec.structs.replace(calibration, wearer=known)
        self.trial, self._wearer = trial, wearer
        self._pipeline = Pipeline(calibration, foothold)
        self._attitude_s: float | None = None

    def add(self, message: ImuSample | Tick | Frame) -> None:
        """Give the pipeline one input, and judge what it makes of it."""
        slip_px = self.trial.slip_px
        if isinstance(message, StereoFrame) and slip_px and self._slipped(message):
            left, right = image_changes.right_shifted(0, slip_px)((message.left, message.right))
            message = msgspec.structs.replace(message, left=left, right=right)
        for estimate in self._pipeline.step(message):
            if isinstance(estimate, Attitude) and estimate.status is Status.VALID and self._attitude_s is None:
                self._attitude_s = _since_s(estimate.t_sample_ns)
            elif isinstance(estimate, Health):
                self._take_health(estimate)
            elif isinstance(estimate, GroundPlane) and estimate.frame_seq >= 0:
                self._take_ground(estimate)

    def _slipped(self, frame: StereoFrame) -> bool:
        return _since_s(frame.header.t_exposure_ns) >= self.trial.slips_s

    def _take_health(self, health: Health) -> None:
        trial = self.trial
        trial.off_m = None if math.isnan(health.height_off_m) else health.height_off_m
        if health.height_contradicts and trial.alarm_s is None:
            trial.alarm_s = _since_s(health.t_ns) - trial.slips_s

    def _take_ground(self, ground: GroundPlane) -> None:
        trial = self.trial
        if ground.status is Status.VALID and trial.first_valid_s is None and self._attitude_s is not None:
            trial.first_valid_s = _since_s(ground.t_exposure_ns) - self._attitude_s
        trial.add(ground, self._wearer.truth_of(ground))


def tried(trials: Sequence[Trial]) -> None:
    """Fill in what becomes of trials on one and the same walk."""
    one = trials[0]
    wearer = SimulatedWearer(one.seed, replace(scenario(one.walk), hip_height_m=one.height_m), START_NS)
    runs = [Run(trial, wearer) for trial in trials]
    for message in wearer.offline_inputs(max(trial.seconds for trial in trials)):
        t_s = _since_s(message.header.t_arrival_ns if isinstance(message, Frame) else _t_ns(message))
        for run in runs:
            if t_s < run.trial.seconds:
                run.add(message)


def _t_ns(message: ImuSample | Tick) -> int:
    return message.t_ns if isinstance(message, Tick) else message.t_arrival_ns


def _since_s(t_ns: int) -> float:
    return 1e-9 * (t_ns - START_NS)


def table(trials: Sequence[Trial]) -> None:
    """Print one line for each case."""
    numbers = f"{'height':>9}{'sd':>7}{'95 %':>6}{'slope':>9}{'sd':>7}{'95 %':>6}"
    print(
        f"{'':18}{'trials':>7}{'first plane, s':>17}{'valid':>8}{'wrong':>7}{numbers}{'settled':>9}{numbers[9:]}"
        f"{'alarms':>8}{'after s':>9}{'off mm':>13}  not valid because"
    )
    for case in dict.fromkeys(trial.case for trial in trials):
        of_case = [trial for trial in trials if trial.case == case]
        first_s = [t.first_valid_s for t in of_case if t.first_valid_s is not None]
        alarms_s = [t.alarm_s for t in of_case if t.alarm_s is not None]
        off_mm = [1e3 * t.off_m for t in of_case if t.off_m is not None] or [math.nan]
        first = f"{len(first_s)}: {np.median(first_s):.2f}, {max(first_s):.2f}" if first_s else "0"
        reasons = Counter[str]()
        for trial in of_case:
            reasons.update(trial.seen)
        valid = sum(t.valid for t in of_case) / max(1, sum(t.frames for t in of_case))
        print(
            f"{case:18}{len(of_case):7}{first:>17}{valid:8.1%}{sum(t.wrong for t in of_case):7}"
            f"{summed([t.errors for t in of_case]).row()}{summed([t.settled for t in of_case]).row()}"
            f"{len(alarms_s):8}{np.median(alarms_s or [math.nan]):9.1f}{min(off_mm):+7.0f}{max(off_mm):+6.0f}  "
            + ", ".join(f"{reason} {count}" for reason, count in reasons.most_common(3))
        )


def summed(errors: Sequence[Errors]) -> Errors:
    """Return all of them as one."""
    return Errors(**{name: sum(getattr(each, name) for each in errors) for name in Errors.__struct_fields__})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=CASES, metavar="CASE")
    parser.add_argument("--seeds", default="1000-1019", help="rig units, first-last")
    parser.add_argument("--walk", default="", help="for the case walk, instead of all by turns")
    parser.add_argument("--file", type=Path, help="finished trials, kept and gone on from")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    first, last = map(int, options.seeds.split("-"))
    known = options.file.read_text().splitlines() if options.file and options.file.exists() else []
    done = {(t.case, t.seed, t.walk): t for t in (msgspec.json.decode(line, type=Trial) for line in known)}
    trials = []
    for seed in range(first, last + 1):
        height_m = float(np.random.default_rng([seed, 40]).uniform(0.8, 1.1))
        walk = options.walk or WALKS[seed % len(WALKS)]
        wanted = [
            Trial(case=c, seed=seed, walk=walk if c == "walk" else "level", height_m=height_m) for c in options.cases
        ]
        for together in ([t for t in wanted if t.case != "walk"], [t for t in wanted if t.case == "walk"]):
            missing = [t for t in together if (t.case, t.seed, t.walk) not in done]
            if missing:
                tried(missing)
            if missing and options.file:
                with options.file.open("a") as file:
                    file.writelines(json.dumps(msgspec.to_builtins(trial)) + "\n" for trial in missing)
        trials += [done.get((t.case, t.seed, t.walk), t) for t in wanted]
    trials.sort(key=lambda t: CASES.index(t.case))
    table(trials)


if __name__ == "__main__":
    main()

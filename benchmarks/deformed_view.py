"""A drop, a bent window, a covered, blurred or dirty eye, pictures that turn over in mid-walk: is any plane wrong?

    python -m benchmarks.deformed_view [--cases drop-2 none …] [--seeds 1000-1009] [--seconds 7] [--file F]

The whole pipeline, faster than real time, on units of the rig with the calibration that they would have; each seed
walks on level ground, on ramps or over mixed ground, and all cases of a seed see the same walk. The fault begins after
3.5 to 4.5 s, or before the first frame where the case ends in "-first", and stays. Wrong is what `lab.faults.criteria`
calls so. A warp's number is its size in px of the raw picture; those of `rows-` have no vertical part, those of `thin-`
have 0.3 px of it; `stretched-` grows evenly with the column. Pictures turn over as they are, or, `aligned-`, about the
rectified picture's centre, with nothing left between the eyes' rows. One line of JSON is added to F for each finished
trial; those there are not repeated.
The false alarms of the case `none` are runs of frames with the reason `view_deformed`, a second apart or more.
Seeds below 1000 are for tuning, from 1000 on for judging.
"""

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import cv2
import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from lab.faults import deformed_view as view
from lab.faults.criteria import errors_of, flags
from lab.faults.faulty_camera import ImageChange
from messages import Frame, GroundPlane, GroundTruth, ImuSample, Status, StereoCalibration, StereoFrame, Tick
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
SETTLED_NS = 2_000_000_000
APART_NS = 1_000_000_000
WALKS = ("level", "ramps", "mixed")
WARPS = (
    *(f"{kind}-{px:g}{when}" for kind in ("drop", "bent") for px in (0.3, 0.5, 1, 2, 5) for when in ("", "-first")),
    *(f"thin-{px:g}" for px in (1, 2, 5)),
    *(f"rows-{px:g}" for px in (0.5, 1, 2, 5)),
)
OTHERS = ("half-covered", "blur-5", "blur-9", "blur-15", "dirt", "mirrored", "upside-down", "turned-round")
ALIGNED = ("aligned-mirrored", "aligned-upside-down", "aligned-turned-round")
STRETCHED = ("stretched-1", "stretched-2")
CASES = ("none", *WARPS, *OTHERS, *ALIGNED, *STRETCHED)


class Trial(msgspec.Struct, kw_only=True):
    """One walk with one fault, counted from its beginning on.

    `vertical_px` and `along_rows_px` are the warp's. `noticed_s` is when the first flag came, NaN if none did; `seen`
    counts the reasons of frames that are not valid, `alarms` the runs of VIEW_DEFORMED before the fault or without one.
    """

    case: str
    seed: int
    seconds: float
    walk: str
    vertical_px: float = 0.0
    along_rows_px: float = 0.0
    frames: int = 0
    valid: int = 0
    wrong: int = 0
    noticed_s: float | None = None
    worst_deg: float = 0.0
    stated_deg: float = 0.0
    seen: dict[str, int] = msgspec.field(default_factory=dict)
    alarms: int = 0

    def add(self, ground: GroundPlane, truth: GroundTruth, since_s: float) -> None:
        """Judge one frame's ground, `since_s` after the fault began."""
        self.frames += 1
        if ground.status is Status.VALID:
            errors = errors_of(ground, truth)
            self.valid += 1
            self.wrong += errors.wrong
            if not truth.transition and np.degrees(errors.slope_rad) > self.worst_deg:
                self.worst_deg = float(np.degrees(errors.slope_rad))
                self.stated_deg = float(np.degrees(np.sqrt(max(ground.covariance[0], ground.covariance[3]))))
        else:
            self.seen[ground.reason.value] = self.seen.get(ground.reason.value, 0) + 1
        if flags(ground, truth) and self.noticed_s is None:
            self.noticed_s = since_s


def drawn_change(trial: Trial, chance: np.random.Generator, stereo: StereoCalibration) -> ImageChange | None:
    """Return what happens to the pictures, and put its size down in `trial`."""
    kind, _, size = trial.case.removesuffix("-first").partition("-")
    left = bool(chance.integers(2))
    if kind in ("drop", "bent", "thin", "rows"):
        make = view.drop if kind == "drop" or (kind != "bent" and chance.integers(2)) else view.bent
        warp = make(chance).of_size(float(size))
        warp = warp.with_vertical({"thin": 0.3, "rows": 0.0}[kind]) if kind in ("thin", "rows") else warp
        trial.vertical_px, trial.along_rows_px = warp.vertical_px, warp.along_rows_px
        return view.warped(warp, left=left)
    if kind == "stretched":
        warp = view.stretched(float(size))
        trial.along_rows_px = warp.along_rows_px
        return view.warped(warp, left=left)
    if kind == "blur":
        return view.blurred(int(size), left=left)
    if kind == "half":
        return view.covered(str(chance.choice(["left", "right", "upper", "lower"])), left=left)
    if kind == "dirt":
        return view.dirty(chance, left=left)
    if kind == "aligned":
        return view.turned_over(stereo, across=size != "upside-down", down=size != "mirrored")
    return {"mirrored": view.mirrored, "upside": view.upside_down, "turned": view.turned_round}.get(kind)


def changed(frame: StereoFrame, change: ImageChange) -> StereoFrame:
    """Return the frame with its pictures changed."""
    left, right = change((frame.left, frame.right))
    return msgspec.structs.replace(frame, left=left, right=right)


def tried(trial: Trial, wearer: SimulatedWearer, inputs: Sequence[ImuSample | Tick | Frame]) -> Trial:
    """Return what the pipeline makes of one fault on a walk."""
    chance = np.random.default_rng([trial.seed, CASES.index(trial.case)])
    onset_s = 0.0 if trial.case.endswith("-first") else chance.uniform(3.5, 4.5)
    change = drawn_change(trial, chance, wearer.unit.stereo)
    onset_ns = START_NS + (SETTLED_NS if change is None else round(1e9 * onset_s))
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    alarmed_ns = 0
    for message in inputs:
        if change is not None and isinstance(message, StereoFrame) and message.header.t_exposure_ns >= onset_ns:
            message = changed(message, change)
        for ground in pipeline.step(message):
            if not isinstance(ground, GroundPlane) or ground.frame_seq < 0:
                continue
            t_ns = ground.t_exposure_ns
            if ground.reason.value == "view_deformed" and (change is None or t_ns < onset_ns):
                trial.alarms += t_ns - alarmed_ns > APART_NS
                alarmed_ns = t_ns
            if t_ns >= max(onset_ns, START_NS + SETTLED_NS):
                trial.add(ground, wearer.truth(t_ns), 1e-9 * (t_ns - onset_ns))
    return trial


def table(trials: Sequence[Trial]) -> None:
    """Print one line for each case."""
    print(
        f"{'':21} trials wrong  frames wrong  valid   noticed  after s  worst, its sd  alarms  h    not valid because"
    )
    for case in dict.fromkeys(trial.case for trial in trials):
        of_case = [trial for trial in trials if trial.case == case]
        times = [trial.noticed_s for trial in of_case if trial.noticed_s is not None]
        reasons: Counter[str] = Counter()
        for trial in of_case:
            reasons.update(trial.seen)
        worst = max(of_case, key=lambda trial: trial.worst_deg)
        frames = sum(trial.frames for trial in of_case)
        wrong = [trial for trial in of_case if trial.wrong]
        print(
            f"{case:21}{len(wrong):4} of {len(of_case):<4}{sum(t.wrong for t in wrong):8}"
            f"{sum(t.valid for t in of_case) / max(1, frames):12.1%}{len(times):7} {np.median(times or [np.nan]):8.2f}"
            f"{worst.worst_deg:9.1f}° {worst.stated_deg:4.1f}°{sum(t.alarms for t in of_case):8}"
            f"{sum(t.seconds for t in of_case) / 3600.0:6.2f}  "
            + ", ".join(f"{reason} {count}" for reason, count in reasons.most_common(5))
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=CASES, metavar="CASE")
    parser.add_argument("--seeds", default="1000-1009", help="rig units, first-last")
    parser.add_argument("--seconds", type=float, default=7.0)
    parser.add_argument("--walk", help="instead of level, ramps and mixed by turns")
    parser.add_argument("--file", type=Path, help="finished trials, kept and gone on from")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    first, last = map(int, options.seeds.split("-"))
    known = options.file.read_text().splitlines() if options.file and options.file.exists() else []
    trials = [msgspec.json.decode(line, type=Trial) for line in known]
    for seed in range(first, last + 1):
        walk = options.walk or WALKS[seed % len(WALKS)]
        wanted = {case: Trial(case=case, seed=seed, seconds=options.seconds, walk=walk) for case in options.cases}
        done = {t.case for t in trials if (t.seed, t.seconds, t.walk) == (seed, options.seconds, walk)}
        missing = [trial for case, trial in wanted.items() if case not in done]
        if not missing:
            continue
        wearer = SimulatedWearer(seed, scenario(walk), START_NS)
        inputs = list(wearer.offline_inputs(options.seconds))
        for trial in missing:
            trials.append(tried(trial, wearer, inputs))
            if options.file:
                with options.file.open("a") as file:
                    file.write(json.dumps(msgspec.to_builtins(trial)) + "\n")
    trials = [t for t in trials if first <= t.seed <= last and t.case in options.cases and t.seconds == options.seconds]
    trials.sort(key=lambda t: CASES.index(t.case))
    table(trials)


if __name__ == "__main__":
    main()

"""A drop, a bent window, a covered, blurred or dirty eye, pictures that turn over in mid-walk: is any plane wrong?

    python -m benchmarks.deformed_view [--cases drop-2 none …] [--seeds 1000-1009] [--seconds 7] [--file F]

The whole pipeline, faster than real time, on units of the rig with the calibration that they would have; each seed
walks on level ground, on ramps or over mixed ground, and all cases of a seed see the same walk. The fault begins after
3.5 to 4.5 s, or before the first frame where the case ends in "-first", and stays. Wrong is what `lab.faults.criteria`
calls so. A warp's number is its size in px of the raw picture; those of `rows-` have no vertical part, those of `thin-`
have 0.3 px of it; `stretched-` grows evenly with the column. `toed-` and `rolled-` turn one eye by so many degrees
about the upright axis of its picture, or the optical one. Pictures turn over as they are, or, `aligned-`, about the
rectified picture's centre, with nothing left between the eyes' rows. One line of JSON is added to F for each finished
trial; those there are not repeated.
The false alarms of the case `none` are runs of frames with the reason `view_deformed`, a second apart or more.
Seeds below 1000 are for tuning, from 1000 on for judging.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from lab.faults import deformed_view as view
from lab.faults.faulty_camera import ImageChange
from lab.faults.offline import (
    FOR_EVER_NS,
    SETTLED_NS,
    START_NS,
    WALKS,
    Judged,
    OfflineWalk,
    Strike,
    keep_trial,
    known_trials,
    pictures,
    struck,
)
from messages import Attitude, GroundPlane, StereoCalibration

APART_NS = 1_000_000_000
WARPS = (
    *(f"{kind}-{px:g}{when}" for kind in ("drop", "bent") for px in (0.3, 0.5, 1, 2, 5) for when in ("", "-first")),
    *(f"thin-{px:g}" for px in (1, 2, 5)),
    *(f"rows-{px:g}" for px in (0.5, 1, 2, 5)),
)
OTHERS = ("half-covered", "blur-5", "blur-9", "blur-15", "dirt", "mirrored", "upside-down", "turned-round")
ALIGNED = ("aligned-mirrored", "aligned-upside-down", "aligned-turned-round")
STRETCHED = ("stretched-1", "stretched-2")
TURNED = tuple(f"{kind}{when}" for kind in ("toed-0.2", "toed-0.4", "toed-1", "rolled-0.5") for when in ("", "-first"))
CASES = ("none", *WARPS, *OTHERS, *ALIGNED, *STRETCHED, *TURNED)


class Trial(Judged, kw_only=True):
    """One walk with one fault, counted from its beginning on.

    `vertical_px` and `along_rows_px` are the warp's; `alarms` counts the runs of VIEW_DEFORMED before the fault or
    without one.
    """

    case: str
    seed: int
    seconds: float
    walk: str
    vertical_px: float = 0.0
    along_rows_px: float = 0.0
    alarms: int = 0


def drawn_change(trial: Trial, chance: np.random.Generator, stereo: StereoCalibration) -> ImageChange | None:
    """Return what happens to the pictures, and put its size down in `trial`."""
    if trial.case == "none":
        return None
    kind, _, size = trial.case.removesuffix("-first").partition("-")
    change, warp = view.drawn(kind, size, chance, stereo)
    if warp is not None:
        trial.vertical_px, trial.along_rows_px = warp.vertical_px, warp.along_rows_px
    return change


def tried(trial: Trial, walk: OfflineWalk) -> Trial:
    """Return what the pipeline makes of one fault on a walk."""
    wearer = walk.wearer
    chance = np.random.default_rng([trial.seed, CASES.index(trial.case)])
    onset_s = 0.0 if trial.case.endswith("-first") else chance.uniform(3.5, 4.5)
    change = drawn_change(trial, chance, wearer.unit.stereo)
    onset_ns = START_NS + (SETTLED_NS if change is None else round(1e9 * onset_s))
    strikes = [] if change is None else [Strike(pictures(change), onset_ns, FOR_EVER_NS)]
    pipeline = walk.new_pipeline()
    alarmed_ns = 0
    for message in struck(walk.inputs, strikes):
        for told in pipeline.step(message):
            if isinstance(told, Attitude) and told.t_sample_ns >= onset_ns:
                trial.add_attitude(told, wearer)
            if not isinstance(told, GroundPlane) or told.frame_seq < 0:
                continue
            t_ns = told.t_exposure_ns
            if told.reason.value == "view_deformed" and (change is None or t_ns < onset_ns):
                trial.alarms += t_ns - alarmed_ns > APART_NS
                alarmed_ns = t_ns
            if t_ns >= max(onset_ns, START_NS + SETTLED_NS):
                trial.add(told, wearer.truth_of(told), 1e-9 * (t_ns - onset_ns))
    return trial


def table(trials: Sequence[Trial]) -> None:
    """Print one line for each case."""
    print(
        f"{'':21} trials wrong  frames wrong  valid   noticed  after s  worst, its sd  attitudes wrong, worst"
        "  alarms  h    not valid because"
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
            f"{worst.worst_deg:9.1f}° {worst.stated_deg:4.1f}°"
            f"{sum(t.wrong_attitudes for t in of_case):9} of {sum(t.attitudes for t in of_case):<7}"
            f"{max(t.worst_tilt_deg for t in of_case):6.1f}°{sum(t.alarms for t in of_case):6}"
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
    trials = known_trials(options.file, Trial)
    for seed in range(first, last + 1):
        name = options.walk or WALKS[seed % len(WALKS)]
        wanted = {case: Trial(case=case, seed=seed, seconds=options.seconds, walk=name) for case in options.cases}
        done = {t.case for t in trials if (t.seed, t.seconds, t.walk) == (seed, options.seconds, name)}
        missing = [trial for case, trial in wanted.items() if case not in done]
        if not missing:
            continue
        walk = OfflineWalk(seed, name, options.seconds)
        for trial in missing:
            trials.append(tried(trial, walk))
            keep_trial(options.file, trial)
    trials = [t for t in trials if first <= t.seed <= last and t.case in options.cases and t.seconds == options.seconds]
    trials.sort(key=lambda t: CASES.index(t.case))
    table(trials)


if __name__ == "__main__":
    main()

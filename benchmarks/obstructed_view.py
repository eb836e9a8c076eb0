"""Walks with things in the picture, on floors that repeat or show nothing, and at dusk: what is measured, what is not?

    python -m benchmarks.obstructed_view [--cases tray dusk …] [--seeds 1000-1019] [--seconds 8] [--file F]

The whole pipeline, faster than real time, on units of the rig with the calibration that they would have. Frames count
whose foothold region the rig says is at least 30 % usable (`sim_rig.camera.usable_region`). Wrong is what
`lab.faults.criteria` calls so, of all valid frames. One line of JSON is added to F for each finished walk; walks whose
line is there are not walked again. Seeds below 1000 are for tuning, from 1000 on for judging.
"""

import argparse
import json
import math
from collections import Counter
from collections.abc import Iterable
from functools import partial
from multiprocessing import Pool
from pathlib import Path

import cv2
import msgspec

from daemon.pipeline import Pipeline
from lab.faults.criteria import errors_of
from messages import GroundPlane, Status
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
SETTLED_NS = 2_000_000_000
"""Frames before this are left out: the attitude starts with a second at rest. Here the walk begins."""
LEAST_USABLE = 0.30
JUDGED_EVERY = 2
"""Frames of which one is judged; its region's usable share takes as long as rendering it."""
CASES = (
    "level",
    "tray",
    "trolley",
    "bag",
    "rollator",
    "white-cane",
    "own-legs",
    "passers-by",
    "mosaic-6cm",
    "mosaic-6cm-varied",
    "mosaic-2.5cm",
    "mosaic-2.5cm-varied",
    "plain-floor",
    "rough-ground",
    "dusk",
    "polished-floor",
)


class Walked(msgspec.Struct, kw_only=True):
    """One walk: frames judged, of those usable, of those valid, and why the others are not.

    `wrong` of `valid_anywhere` are over all judged frames; the squares are sums over valid ones away from edges, of
    which there are `measured`, each with two slopes.
    """

    case: str
    seed: int
    seconds: float
    judged: int = 0
    usable: int = 0
    valid: int = 0
    reasons: dict[str, int] = msgspec.field(default_factory=dict)
    valid_anywhere: int = 0
    wrong: int = 0
    measured: int = 0
    slope_rad2: float = 0.0
    height_m2: float = 0.0

    def add(self, ground: GroundPlane, wearer: SimulatedWearer) -> None:
        """Judge one frame's ground."""
        self.judged += 1
        usable = wearer.region_seen(ground.t_exposure_ns).usable >= LEAST_USABLE
        valid = ground.status is Status.VALID
        self.usable += usable
        self.valid += usable and valid
        if usable and not valid:
            self.reasons[ground.reason.value] = self.reasons.get(ground.reason.value, 0) + 1
        if valid:
            truth = wearer.truth_of(ground)
            self.valid_anywhere += 1
            self.wrong += errors_of(ground, truth).wrong
            if not truth.transition:
                self.measured += 1
                self.slope_rad2 += (ground.slope_sagittal_rad - truth.slope_sagittal_rad) ** 2
                self.slope_rad2 += (ground.slope_frontal_rad - truth.slope_frontal_rad) ** 2
                self.height_m2 += (ground.height_m - truth.height_m) ** 2


def walked(task: tuple[str, int], seconds: float) -> Walked:
    """Return what the pipeline makes of one unit's walk through one case."""
    case, seed = task
    cv2.setNumThreads(1)
    wearer = SimulatedWearer(seed, scenario(case), START_NS)
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    found = Walked(case=case, seed=seed, seconds=seconds)
    for message in wearer.offline_inputs(seconds):
        for ground in pipeline.step(message):
            if not isinstance(ground, GroundPlane) or ground.frame_seq < 0 or ground.frame_seq % JUDGED_EVERY:
                continue
            if ground.t_exposure_ns >= START_NS + SETTLED_NS:
                found.add(ground, wearer)
    return found


def table(walks: Iterable[Walked]) -> None:
    """Print one line for each case."""
    of_case: dict[str, list[Walked]] = {}
    for walk in walks:
        of_case.setdefault(walk.case, []).append(walk)
    print(f"{'':20} walks  judged  usable   valid  valid and wrong  slope RMS  height RMS  not valid because")
    for case, found in of_case.items():
        total = partial(_total, found)
        reasons: Counter[str] = Counter()
        for walk in found:
            reasons.update(walk.reasons)
        measured = max(1, total("measured"))
        slope_deg = math.degrees(math.sqrt(total("slope_rad2") / (2 * measured)))
        height_mm = 1e3 * math.sqrt(total("height_m2") / measured)
        share = total("valid") / max(1, total("usable"))
        print(
            f"{case:20}{len(found):6}{total('judged'):8.0f}{total('usable'):8.0f}{share:8.1%}"
            f"{total('wrong'):8.0f} of {total('valid_anywhere'):<5.0f}{slope_deg:8.2f}°{height_mm:9.1f} mm  "
            + ", ".join(f"{reason} {count}" for reason, count in reasons.most_common())
        )


def _total(walks: list[Walked], name: str) -> float:
    return float(sum(getattr(walk, name) for walk in walks))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=list(CASES))
    parser.add_argument("--seeds", default="1000-1019", help="rig units, first-last")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--file", type=Path, help="finished walks, kept and gone on from")
    parser.add_argument("--processes", type=int, choices=(1, 2), default=2)
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    wanted = [(case, seed) for seed in range(first, last + 1) for case in options.cases]
    known = options.file.read_text().splitlines() if options.file and options.file.exists() else []
    walks = [msgspec.json.decode(line, type=Walked) for line in known]
    walks = [w for w in walks if (w.case, w.seed) in wanted and w.seconds == options.seconds]
    done = {(w.case, w.seed) for w in walks}
    missing = [task for task in wanted if task not in done]
    with Pool(options.processes) as pool:
        for walk in pool.imap_unordered(partial(walked, seconds=options.seconds), missing):
            walks.append(walk)
            if options.file:
                with options.file.open("a") as file:
                    file.write(json.dumps(msgspec.to_builtins(walk)) + "\n")
    walks.sort(key=lambda w: options.cases.index(w.case))
    table(walks)


if __name__ == "__main__":
    main()

"""Things that are no ground, and rough ground: what do they take from its height, and which are told as obstacles?

    python -m benchmarks.not_ground [--cases posts shoes …] [--seeds 1-3] [--seconds 8] [--file F]

The whole pipeline, faster than real time, on units of the rig with the calibration that they would have, each walking
over the same level ground without anything (`level`), with one kind of thing, or with bumps. A thing that stands on the
path is found if it is told before it is `FOUND_BEFORE_M` away, within `MATCH_M` of where it is. A told obstacle farther
than `FALSE_FROM_M` is false where nothing that the wearer does not carry or push is within `FALSE_M` of it; false ones
in a row of frames count once. Distances are compared in all frames in which a standing thing within `COMPARED_M` is
told, heights of those whose top is in view. One line of JSON is added to F for each finished walk; walks whose line is
there are not walked again. Seeds below 1000 are for tuning, from 1000 on for judging.
"""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from multiprocessing import Pool
from pathlib import Path

import cv2
import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from lab.faults.criteria import errors_of
from messages import GroundPlane, Status, Terrain, TerrainObstacle
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.obstacle_truth import ObstacleTruth
from sim_rig.walk.relief import Relief
from sim_rig.walk.scenario import Pace, Scenario, over_level, scenario
from sim_rig.walk.world import World
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
SETTLED_NS = 2_000_000_000
FOUND_BEFORE_M = 0.8
MATCH_M = 0.15
FALSE_M, FALSE_FROM_M = 0.25, 0.3
WIDE_M = 0.45
"""What stands just beside the path is no false obstacle."""
COMPARED_M = (0.5, 1.5)
TOP_IN_VIEW_M = 0.30
ROUGH_RMS_M = {"rough-3cm": 0.03, "rough-5cm": 0.05}
CASES = (
    "level",
    "own-legs",
    "posts",
    "shoes",
    "walker-ahead",
    "passers-by",
    "trolley",
    "rollator",
    "white-cane",
    "bag",
    "polished-floor",
    *ROUGH_RMS_M,
)


class Walked(msgspec.Struct, kw_only=True):
    """One walk. Deviations and errors of the ground's height are those of its valid frames, in metres."""

    case: str
    seed: int
    seconds: float
    frames: int = 0
    height_sd_m: list[float] = []
    height_error_m: list[float] = []
    wrong: int = 0
    walked_m: float = 0.0
    standing: int = 0
    found: int = 0
    false: int = 0
    distance_error_m: list[float] = []
    obstacle_height_error_m: list[float] = []


def walked(task: tuple[str, int], seconds: float) -> Walked:
    """Return what the pipeline makes of one unit's walk among one kind of thing."""
    case, seed = task
    cv2.setNumThreads(1)
    wearer = SimulatedWearer(seed, _walk(case), START_NS)
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    walk = Walked(case=case, seed=seed, seconds=seconds)
    standing = _Standing()
    for message in wearer.offline_inputs(seconds):
        for estimate in pipeline.step(message):
            if isinstance(estimate, GroundPlane | Terrain) and estimate.frame_seq >= 0:
                if estimate.t_exposure_ns < START_NS + SETTLED_NS:
                    continue
                if isinstance(estimate, GroundPlane):
                    _judge_ground(walk, estimate, wearer)
                else:
                    _judge_obstacles(walk, standing, estimate, wearer)
    walk.standing, walk.found = standing.passed, standing.found
    return walk


def _walk(case: str) -> Scenario:
    bare = over_level(Pace(), case, "nothing on it")
    if case == "level":
        return bare
    if case in ROUGH_RMS_M:
        return replace(bare, world=World(bare.world.lap, Relief.of_rms(ROUGH_RMS_M[case], _SMOOTH_M, _RELIEF)))
    return scenario(case)


def _judge_ground(walk: Walked, ground: GroundPlane, wearer: SimulatedWearer) -> None:
    walk.frames += 1
    if ground.status is Status.VALID:
        truth = wearer.truth_of(ground)
        walk.height_sd_m.append(math.sqrt(ground.covariance[5]))
        walk.height_error_m.append(ground.height_m - truth.height_m)
        walk.wrong += errors_of(ground, truth).wrong


class _Standing:
    """Follows each thing that stands: was it told by the time it was near?"""

    def __init__(self) -> None:
        self.passed = self.found = 0
        self.before_false = False
        self.at_m: float | None = None
        self._told_of: dict[int, bool] = {}
        self._done: set[int] = set()

    def add(self, x_W_m: float, distance_m: float, *, told: bool) -> None:
        """Take one thing in one frame; `x_W_m` is its name."""
        name = round(x_W_m / _APART_M)
        if name in self._done:
            return
        if distance_m > FOUND_BEFORE_M:
            self._told_of[name] = self._told_of.get(name, False) or told
        elif name in self._told_of:
            self._done.add(name)
            self.passed += 1
            self.found += self._told_of[name]


def _judge_obstacles(walk: Walked, standing: _Standing, terrain: Terrain, wearer: SimulatedWearer) -> None:
    true = wearer.obstacles(terrain.t_exposure_ns)
    t_ns = wearer.shutter.true_of(terrain.t_exposure_ns)
    x_W_m = float(wearer.gait.at(np.array([t_ns])).p_WB_m[0, 0])
    walk.walked_m += 0.0 if standing.at_m is None else abs(x_W_m - standing.at_m)
    standing.at_m = x_W_m
    for one in (each for each in true if each.stands):
        same = [told for told in terrain.obstacles if _apart_m(told, one) < MATCH_M]
        standing.add(x_W_m + one.distance_m, one.distance_m, told=bool(same))
        if same and COMPARED_M[0] < one.distance_m < COMPARED_M[1]:
            told = min(same, key=lambda each: each.distance_m)
            walk.distance_error_m.append(told.distance_m - one.distance_m)
            if one.height_m < TOP_IN_VIEW_M:
                walk.obstacle_height_error_m.append(told.height_m - one.height_m)
    wide = wearer.obstacles(terrain.t_exposure_ns, WIDE_M)
    others = [each for each in (*true, *wide) if not each.moves_with_wearer or walk.case == "walker-ahead"]
    false = any(
        told.distance_m > FALSE_FROM_M and all(_apart_m(told, one) > FALSE_M for one in others)
        for told in terrain.obstacles
    )
    walk.false += false and not standing.before_false
    standing.before_false = false


def _apart_m(told: TerrainObstacle, true: ObstacleTruth) -> float:
    return math.hypot(told.distance_m - true.distance_m, told.left_m - true.left_m)


def table(walks: Sequence[Walked]) -> None:
    """Print one line for each case."""
    print(
        f"{'':14}walks  valid  height sd mean, P90, max     error RMS  wrong   found        false in 100 m"
        "  distance MAE  height MAE"
    )
    for case in dict.fromkeys(walk.case for walk in walks):
        of_case = [walk for walk in walks if walk.case == case]
        sd_mm, error_mm, distance_mm, height_mm = (
            1e3 * np.array([value for walk in of_case for value in getattr(walk, name)])
            for name in ("height_sd_m", "height_error_m", "distance_error_m", "obstacle_height_error_m")
        )
        frames, walked_m = sum(w.frames for w in of_case), sum(w.walked_m for w in of_case)
        passed, found = sum(w.standing for w in of_case), sum(w.found for w in of_case)
        print(
            f"{case:14}{len(of_case):5}{len(sd_mm) / max(1, frames):7.1%}"
            f"{sd_mm.mean():9.1f}{np.quantile(sd_mm, 0.9):7.1f}{sd_mm.max():7.1f} mm"
            f"{np.sqrt(np.mean(error_mm**2)):10.1f} mm{sum(w.wrong for w in of_case):6}"
            f"{f'{found} of {passed}' if passed else '':>13}{100 * sum(w.false for w in of_case) / walked_m:14.1f}"
            f"{_mean_size(distance_mm):>15}{_mean_size(height_mm):>12}"
        )


def _mean_size(errors_mm: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> str:
    return f"{np.abs(errors_mm).mean():.0f} mm" if len(errors_mm) else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=CASES)
    parser.add_argument("--seeds", default="1-3", help="rig units, first-last")
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
    with Pool(options.processes) as pool:
        for walk in pool.imap_unordered(partial(walked, seconds=options.seconds), [t for t in wanted if t not in done]):
            walks.append(walk)
            if options.file:
                with options.file.open("a") as file:
                    file.write(json.dumps(msgspec.to_builtins(walk)) + "\n")
    walks.sort(key=lambda w: options.cases.index(w.case))
    table(walks)


_SMOOTH_M, _RELIEF = 0.15, 7
_APART_M = 0.3  # of places in W, farther than the truth's own blur and nearer than two things

if __name__ == "__main__":
    main()

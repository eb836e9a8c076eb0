"""The ground ahead against the truth: edges, kinds, footholds and heights, on walks that a seed draws.

    python -m benchmarks.terrain [--estimators service columns grid plane] [--seeds 1000-1019] [--file F]

Each seed is one walk of `sim_rig.walk.terrain_walks` on a unit with the calibration that it would have: stairs, kerbs,
steps, ramps, dropped kerbs, rough and plain ground, met square or at an angle, in light and shadow, alone or among
people. All estimators get the same messages, in the order of the pipeline. What is counted is said in
`lab.evaluation.terrain_score`. One line of JSON is added to F for each finished walk and estimator; those there are not
walked again. Seeds below 1000 are for tuning, from 1000 on for judging; every 20 hold each case as often as the next.
With --photographs the pictures are those of a second renderer (`sim_rig.ray_caster`) on ground covered with
photographs, read from $GAITEYES_DATA; walks on rough ground are left out, as are things and shadows.
"""

import argparse
import json
import math
from collections.abc import Callable, Iterable, Sequence
from multiprocessing import Pool
from pathlib import Path
from typing import NamedTuple

import cv2
import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from lab.baselines.elevation_grid import GridTerrain
from lab.baselines.terrain_peers import ColumnMedians, PublishedPlane
from lab.evaluation.measured.photographs import photographs
from lab.evaluation.terrain_said import KINDS, Foothold, TerrainEstimator, TerrainSaid
from lab.evaluation.terrain_said import Terrain as Said
from lab.evaluation.terrain_score import EdgeCounts, JudgedFrame, WalkScore, mean_recall, score
from messages import Calibration, GroundPlane, Input, NextFoothold, Side, Status, Terrain, full_matrix
from messages.constants import NORMAL_95
from perception.ground.foothold import FootholdSettings
from sim_rig.ray_caster import RayCaster, is_flat
from sim_rig.walk.terrain_walks import STANDING_S, terrain_walk
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
SETTLED_NS = round(1e9 * STANDING_S)


SIDE = Side.RIGHT
"""The prosthetic side: only its footholds are said, and judged."""


class Published:
    """What the service publishes on the topic `terrain`, and of a frame's ground, where no landing is predicted."""

    def __init__(self, calibration: Calibration) -> None:
        self._pipeline = Pipeline(calibration, FootholdSettings(side=SIDE))
        self._ground: GroundPlane | None = None

    def step(self, message: Input) -> Iterable[TerrainSaid]:
        """Take one input and yield the valid terrain that it completes."""
        for estimate in self._pipeline.step(message):
            if isinstance(estimate, GroundPlane):
                self._ground = estimate
            if isinstance(estimate, Terrain) and estimate.status is Status.VALID and self._ground is not None:
                foothold = _foothold(estimate.foothold, self._ground)
                yield Said(estimate.t_exposure_ns, estimate.kind.value, estimate.edges, foothold)


def _foothold(told: NextFoothold, ground: GroundPlane) -> Foothold | None:
    """Return what is said of the ground under the foot that lands next, or in the measured region where none is known.

    The message tells the height of the plane below the camera, the judge asks for that where the foot lands.
    """
    landing = math.isfinite(told.ahead_m)
    if not landing and ground.status is not Status.VALID:
        return None
    if landing and not math.isfinite(told.height_m):
        ground = msgspec.structs.replace(ground, height_m=math.nan)
    ahead_m, left_m = (told.ahead_m, told.left_m) if landing else (ground.ahead_m, ground.left_m)
    place = np.array([-ahead_m, -left_m, 1.0])
    cov = full_matrix(ground.covariance)
    slopes = np.array([math.tan(ground.slope_sagittal_rad), math.tan(ground.slope_frontal_rad), ground.height_m])
    return Foothold(
        ahead_m=ahead_m,
        left_m=left_m,
        height_m=float(place @ slopes),
        height_sd_m=math.sqrt(max(float(place @ cov @ place), 0.0)) if ground.status is Status.VALID else math.nan,
        slope_sagittal_rad=ground.slope_sagittal_rad,
        slope_sagittal_sd_rad=told.slope_sagittal_sd_rad if landing else math.sqrt(cov[0, 0]),
        slope_frontal_rad=ground.slope_frontal_rad,
        slope_frontal_sd_rad=told.slope_frontal_sd_rad if landing else math.sqrt(cov[1, 1]),
        time_to_contact_s=told.time_to_contact_s,
    )


ESTIMATORS: dict[str, Callable[[Calibration], TerrainEstimator]] = {
    "service": Published,
    "columns": ColumnMedians,
    "grid": GridTerrain,
    "plane": PublishedPlane,
}


class Walked(msgspec.Struct, kw_only=True):
    """What one estimator made of one walk."""

    estimator: str
    seed: int
    case: str
    seconds: float
    dimensions: dict[str, float]
    score: WalkScore


class Task(NamedTuple):
    """A walk, for some estimators, drawn by the rig's renderer or the one with `photographs`."""

    seed: int
    names: Sequence[str]
    photographs: bool


def walked(task: Task) -> list[Walked]:
    """Return what each estimator makes of one seed's walk; nothing where it cannot be drawn."""
    seed, names, with_photographs = task
    cv2.setNumThreads(1)
    walk = terrain_walk(seed)
    if with_photographs and not is_flat(walk.scenario.world):
        return []
    wearer = SimulatedWearer(seed, walk.scenario, START_NS, rolling_shutter=not with_photographs)
    camera = RayCaster(wearer, photographs(), seed) if with_photographs else None
    estimators = {name: ESTIMATORS[name](wearer.calibration) for name in names}
    said: dict[str, dict[int, TerrainSaid]] = {name: {} for name in names}
    stamps_ns: list[int] = []
    for message in wearer.offline_inputs(walk.seconds, camera):
        for name, estimator in estimators.items():
            said[name].update({terrain.t_exposure_ns: terrain for terrain in estimator.step(message)})
        header = getattr(message, "header", None)
        if header is not None and header.t_exposure_ns >= START_NS + SETTLED_NS:
            stamps_ns.append(header.t_exposure_ns)
    truths = [wearer.terrain(t_ns, SIDE) for t_ns in stamps_ns]
    found = []
    for name in names:
        frames = []
        for truth in truths:
            terrain = said[name].get(truth.t_exposure_ns)
            foothold = None if terrain is None else terrain.foothold
            under = None if foothold is None else wearer.surface(truth.t_exposure_ns, foothold.ahead_m, foothold.left_m)
            frames.append(JudgedFrame(truth, terrain, under))
        found.append(
            Walked(
                estimator=name,
                seed=seed,
                case=walk.case,
                seconds=walk.seconds,
                dimensions=walk.dimensions,
                score=score(frames, plain=walk.case == "plain"),
            )
        )
    return found


def report(walks: Sequence[Walked]) -> None:
    """Print the figures of one estimator."""
    scores = [walk.score for walk in walks]
    frames, said = sum(s.frames for s in scores), sum(s.said for s in scores)
    print(f"\n{walks[0].estimator}: {len(walks)} walks, {frames} frames, something said in {said / max(1, frames):.1%}")
    for way, of_way in (("up", [s.up for s in scores]), ("down", [s.down for s in scores])):
        print(f"edges {way:5} {_edges(of_way)}")
    plain_m, false = sum(s.plain_m for s in scores), sum(s.false_edges for s in scores)
    print(f"false edges {false} in {plain_m:.0f} m of plain walking, {100.0 * false / max(plain_m, 1e-9):.2f} in 100 m")
    for name, what in (
        ("rise_up_m", "riser up"),
        ("rise_down_m", "drop, 6 cm of what is below in view"),
        ("distance_up_m", "distance at 0.9 to 1.1 m, up"),
        ("distance_down_m", "distance at 0.9 to 1.1 m, down"),
        ("tread_m", "tread"),
        ("landing_ahead_m", "foothold 250 ms before, ahead"),
        ("landing_left_m", "foothold 250 ms before, to the left"),
    ):
        print(f"{what:36} {_errors([1e3 * e for s in scores for e in getattr(s, name)], 'mm')}")
    print(f"{'time of contact 250 ms before':36} {_errors([1e3 * e for s in scores for e in s.landing_s], 'ms')}")
    print(f"{'landings said':36} {sum(len(s.landing_s) for s in scores)} of {sum(s.landings for s in scores)}")
    bounds = sum(s.bounds for s in scores)
    print(f"bounds of drops {bounds}, of which hold {sum(s.bounds_hold for s in scores) / max(1, bounds):.1%}")
    print(_heights(scores))
    standing = sum(s.before_drop for s in scores)
    print(f"standing above stairs: told in {sum(s.drop_told for s in scores)} of {standing} frames")
    _print_kinds(scores)


def _edges(counts: Iterable[EdgeCounts]) -> str:
    all_counts = list(counts)
    edges, known, transitions, before_contact, unseen = (
        sum(getattr(c, name) for c in all_counts) for name in ("edges", "in_time", "transitions", "known", "unseen")
    )
    return (
        f"known when the toe is 0.6 m away {known} of {edges}, {known / max(1, edges):.1%} ({unseen} more unseen); "
        f"transitions known 0.8 s before contact {before_contact} of {transitions}, "
        f"{before_contact / max(1, transitions):.1%}"
    )


def _errors(errors: Sequence[float], unit: str) -> str:
    if not errors:
        return "none"
    size = np.abs(errors)
    return (
        f"MAE {size.mean():6.1f} {unit}, P95 {np.quantile(size, 0.95):6.1f} {unit}, "
        f"mean {np.mean(errors):+6.1f} {unit}, {len(errors)} of them"
    )


def _heights(scores: Sequence[WalkScore]) -> str:
    near, frames = [n for s in scores for n in s.near], sum(s.near_frames for s in scores)
    wrong, valid = sum(s.wrong for s in scores), sum(s.valid for s in scores)
    walks = sum(s.wrong > 0 for s in scores)
    line = f"wrong and valid {wrong} of {valid} frames, in {walks} of {len(scores)} walks"
    if not near:
        return f"heights near edges: none in {frames} frames; {line}"
    errors, sd = np.array([n.error_m for n in near]), np.array([n.sd_m for n in near])
    return (
        f"heights near edges: said in {len(near)} of {frames} frames, {_errors([1e3 * e for e in errors], 'mm')}; "
        f"sd ≤ 15 mm in {np.mean(sd <= 0.015):.1%}, "
        f"95 % intervals hold {np.mean(np.abs(errors) <= NORMAL_95 * sd):.1%}; {line}"
    )


def _print_kinds(scores: Sequence[WalkScore]) -> None:
    counts: dict[str, int] = {}
    for s in scores:
        for name, count in s.confusion.items():
            counts[name] = counts.get(name, 0) + count
    columns = [*KINDS, "unknown", "none"]
    print(f"kind right {mean_recall(counts):.1%}, averaged over kinds; rows are true, columns said:")
    print(" " * 12 + "".join(f"{name:>12}" for name in columns))
    for kind in KINDS:
        row = [counts.get(f"{kind}>{name}", 0) for name in columns]
        share = counts.get(f"{kind}>{kind}", 0) / sum(row) if sum(row) else math.nan
        print(f"{kind:12}" + "".join(f"{count:12}" for count in row) + f"{share:9.1%}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--estimators", nargs="+", default=list(ESTIMATORS), choices=list(ESTIMATORS))
    parser.add_argument("--seeds", default="1000-1019", help="walks, first-last")
    parser.add_argument("--file", type=Path, help="finished walks, kept and gone on from")
    parser.add_argument("--processes", type=int, choices=(1, 2), default=2)
    parser.add_argument("--photographs", action="store_true", help="the second renderer; a FILE of its own")
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    known = options.file.read_text().splitlines() if options.file and options.file.exists() else []
    walks = [msgspec.json.decode(line, type=Walked) for line in known]
    walks = [walk for walk in walks if first <= walk.seed <= last and walk.estimator in options.estimators]
    done = {(walk.seed, walk.estimator) for walk in walks}
    missing = {seed: [e for e in options.estimators if (seed, e) not in done] for seed in range(first, last + 1)}
    with Pool(options.processes) as pool:
        for found in pool.imap_unordered(
            walked, [Task(s, names, options.photographs) for s, names in missing.items() if names]
        ):
            walks += found
            if options.file:
                with options.file.open("a") as file:
                    file.writelines(json.dumps(msgspec.to_builtins(walk)) + "\n" for walk in found)
    for name in options.estimators:
        of_one = sorted((walk for walk in walks if walk.estimator == name), key=lambda walk: walk.seed)
        if of_one:
            report(of_one)


if __name__ == "__main__":
    main()

"""Walks without any fault: is anything flagged or wrong, and where is the ground not valid?

    python -m benchmarks.sound_walks [--seeds 31-35] [--scenario mixed] [--seconds 60]

The whole pipeline, faster than real time, on units of the rig with the calibration that they would have. Wrong is what
`lab.faults.criteria` calls so; a transition is a frame with an edge of the ground inside the foothold region.
"""

import argparse
from collections import Counter
from multiprocessing import Pool

import cv2

from daemon.pipeline import Pipeline
from lab.faults.criteria import errors_of, flags
from messages import GroundPlane, Status
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
SETTLED_NS = 3_000_000_000
"""Frames before this are left out: the attitude starts with a second at rest."""


def counted(task: tuple[int, str, float]) -> Counter[str]:
    """Return how many frames of one unit's walk there were, valid, flagged and wrong, apart where the ground has an
    edge."""
    seed, name, seconds = task
    cv2.setNumThreads(1)
    wearer = SimulatedWearer(seed, scenario(name), START_NS)
    pipeline = Pipeline(wearer.calibration, FootholdSettings())
    found: Counter[str] = Counter()
    for message in wearer.offline_inputs(seconds):
        for ground in pipeline.step(message):
            if not isinstance(ground, GroundPlane) or ground.frame_seq < 0:
                continue
            if ground.t_exposure_ns < START_NS + SETTLED_NS:
                continue
            truth = wearer.truth_of(ground)
            where = "at an edge" if truth.transition else "elsewhere"
            found["frames"] += 1
            found[f"frames {where}"] += 1
            found["flagged"] += flags(ground, truth)
            if ground.status is Status.VALID:
                found[f"valid {where}"] += 1
                found["wrong"] += errors_of(ground, truth).wrong
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="31-35", help="rig units, first-last")
    parser.add_argument("--scenario", default="mixed")
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    tasks = [(seed, options.scenario, options.seconds) for seed in range(first, last + 1)]
    found: Counter[str] = Counter()
    with Pool(2) as pool:
        for of_unit in pool.imap(counted, tasks):
            found += of_unit
    print(f"{found['frames']} frames: {found['flagged']} flagged, {found['wrong']} valid and wrong")
    for where in ("at an edge", "elsewhere"):
        if found[f"frames {where}"]:
            share = found[f"valid {where}"] / found[f"frames {where}"]
            print(f"  {where:10} {found[f'frames {where}']:6} frames, {share:7.2%} valid")


if __name__ == "__main__":
    main()

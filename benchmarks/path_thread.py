"""What matching the path in a thread of its own saves: each frame both ways, by turns, in one process.

    python -m benchmarks.path_thread [--scenario mixed] [--seconds 8]

The pipeline alone on rendered frames of the rig, faster than real time and without devices, publishers or other
threads. From a frame's turn on: wall-clock time until the ground is told, until the terrain is, and until the frame is
done with. The estimates are the same, which is checked. The gain depends on whether there is a second processor, and on
whether that is a core of its own.
"""

import argparse
import gc
import math
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from daemon.pipeline import Pipeline
from messages import TOPIC_OF, GroundPlane, Input, Terrain
from messages.codec import encode_line
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
SETTLED_FRAMES = 20
TOLD = ("ground", "terrain", "done")


def step_ms(pipeline: Pipeline, message: Input) -> tuple[list[float] | None, bytes]:
    """Return when ground and terrain were told, and when the step was over, ms after it began, and all that was told;
    None for a message that completes no terrain."""
    begun_s, told = time.perf_counter(), b""
    ground_ms = terrain_ms = np.nan
    for estimate in pipeline.step(message):
        now_ms = 1e3 * (time.perf_counter() - begun_s)
        if isinstance(estimate, GroundPlane):
            ground_ms = now_ms
        elif isinstance(estimate, Terrain):
            terrain_ms = now_ms
        told += encode_line(TOPIC_OF[type(estimate)], estimate)
    done_ms = 1e3 * (time.perf_counter() - begun_s)
    return (None if math.isnan(terrain_ms) else [ground_ms, terrain_ms, done_ms]), told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="mixed")
    parser.add_argument("--seconds", type=float, default=8.0)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    sys.setswitchinterval(5e-4)
    wearer = SimulatedWearer(1, scenario(options.scenario), START_NS)
    inputs = list(wearer.offline_inputs(options.seconds))
    times: dict[str, list[list[float]]] = {"one thread": [], "two": []}
    with ThreadPoolExecutor(1) as thread:
        pipelines = {name: Pipeline(wearer.calibration, FootholdSettings()) for name in times}
        pipelines["two"].match_path_beside(lambda work: thread.submit(work).result)
        gc.freeze()
        gc.disable()
        for number, message in enumerate(inputs):
            said = {}
            for name in sorted(times, reverse=number % 2 == 1):
                found, said[name] = step_ms(pipelines[name], message)
                times[name] += [] if found is None else [found]
            if said["one thread"] != said["two"]:
                raise SystemExit(f"message {number}: the estimates differ")
    print(f"{'':12}{'frames':>7}" + "".join(f"{told + ', p50':>16}{'P90':>6}" for told in TOLD) + "   ms")
    for name, of_name in times.items():
        of_frames = np.array(of_name[SETTLED_FRAMES:])
        spread = np.quantile(of_frames, (0.5, 0.9), axis=0).T
        print(f"{name:12}{len(of_frames):7}" + "".join(f"{p50:16.1f}{p90:6.1f}" for p50, p90 in spread))


if __name__ == "__main__":
    main()

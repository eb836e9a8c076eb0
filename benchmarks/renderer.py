"""How long the rig takes for a stereo pair on one core: `python -m benchmarks.renderer [--scenario mixed]`, two laps.

The first lap builds the surfaces as they come into sight; the second is what lasts. A frame must take less than 50 ms.
"""

import argparse
import time

import cv2
import numpy as np

from sim_rig.camera.rendered_frames import Scene
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, draw_unit
from sim_rig.walk.scenario import scenario

PERIOD_S = 0.05
EXPOSURE_S = 0.006


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="mixed")
    cv2.setNumThreads(1)
    scene = Scene(draw_unit(1), scenario(parser.parse_args().scenario), 1, 0)
    renderer, frames_a_lap = scene.renderer(), round(scene.gait().lap_s / PERIOD_S)
    left, right = np.empty((2, HEIGHT_PX, WIDTH_PX), np.uint8)
    for lap in ("first", "second"):
        taken_ms = []
        for k in range(frames_a_lap):
            began_s = time.process_time()
            renderer.render(k * 50_000_000, EXPOSURE_S, k, left, right)
            taken_ms.append(1e3 * (time.process_time() - began_s))
        p50, p99, most = np.percentile(taken_ms, [50, 99, 100])
        print(f"{lap} lap: p50 {p50:.1f} ms, p99 {p99:.1f} ms, max {most:.1f} ms of CPU for a pair of 1280×720")


if __name__ == "__main__":
    main()

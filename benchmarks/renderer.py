"""How long the rig takes for a stereo pair on one core, over two laps: `python -m benchmarks.renderer`.

The first lap builds the surfaces as they come into sight; the second is what lasts. A frame must take less than 50 ms.
"""

import time

import cv2
import numpy as np

from sim_rig.camera.rendered_frames import Scene
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, draw_unit
from sim_rig.walk.scenario import scenario

FRAMES_A_LAP = 1005
EXPOSURE_S = 0.006


def main() -> None:
    cv2.setNumThreads(1)
    renderer = Scene(draw_unit(1), scenario("mixed"), 1, 0).renderer()
    left, right = np.empty((2, HEIGHT_PX, WIDTH_PX), np.uint8)
    for lap in ("first", "second"):
        taken_ms = []
        for k in range(FRAMES_A_LAP):
            began_s = time.process_time()
            renderer.render(k * 50_000_000, EXPOSURE_S, k, left, right)
            taken_ms.append(1e3 * (time.process_time() - began_s))
        p50, p99, most = np.percentile(taken_ms, [50, 99, 100])
        print(f"{lap} lap: p50 {p50:.1f} ms, p99 {p99:.1f} ms, max {most:.1f} ms of CPU for a pair of 1280×720")


if __name__ == "__main__":
    main()

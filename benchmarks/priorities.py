"""How late do the IMU's and the pipeline's threads wake beside busy processes, with and without priorities?

    python -m benchmarks.priorities --seconds 10 --hogs 2

Threads with the periods of the service and work of about its size: some Python, which needs the interpreter's lock,
and one matching, which does not. Each row is a process of its own. `imu, can` gives a priority to these two alone.
"""

import argparse
import multiprocessing
import os
import threading
import time
from collections.abc import Callable

import cv2
import numpy as np

from daemon import realtime

SCHEMES: dict[str, tuple[str, ...]] = {
    "none": (),
    "imu, can": ("imu", "can"),
    "all but the pipeline": ("imu", "timer", "can", "camera", "main"),
    "as in the service": tuple(realtime.FIFO_PRIORITIES),
}
_PERIODS_S = {"imu": 0.010, "timer": 0.010, "can": 0.050, "camera": 0.050, "pipeline": 0.050, "main": 0.250}
_PYTHON_S = {"imu": 0.0003, "timer": 0.00005, "can": 0.0002, "camera": 0.0001, "pipeline": 0.002, "main": 0.001}
_SHOWN = ("imu", "pipeline")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--hogs", type=int, default=2)
    options = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    for scheme in SCHEMES:
        hogs = [context.Process(target=_hog, daemon=True) for _ in range(options.hogs)]
        measured = context.Process(target=_measure, args=(scheme, options.seconds))
        for process in (*hogs, measured):
            process.start()
        measured.join()
        for hog in hogs:
            hog.kill()
            hog.join()


def _hog() -> None:
    while True:
        pass


def _measure(scheme: str, seconds: float) -> None:
    image = np.random.default_rng(1).integers(0, 255, (360, 640), np.uint8)
    matcher = cv2.StereoSGBM.create(0, 48, 5, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY)
    end_s = time.monotonic() + seconds
    late_s: dict[str, list[float]] = {name: [] for name in _PERIODS_S}

    def beat(name: str) -> None:
        if name in SCHEMES[scheme]:
            realtime.set_priority(name)
        due_s = time.monotonic()
        while due_s < end_s:
            time.sleep(max(0.0, due_s - time.monotonic()))
            late_s[name].append(time.monotonic() - due_s)
            _compute(_PYTHON_S[name])
            if name == "pipeline":
                matcher.compute(image, image)
            due_s = max(due_s + _PERIODS_S[name], time.monotonic())

    with realtime.paced_interpreter():
        threads = [threading.Thread(target=_bound(beat, name)) for name in _PERIODS_S if name != "main"]
        for thread in threads:
            thread.start()
        beat("main")
        for thread in threads:
            thread.join()
    shown = "   ".join(f"{name} {_spread(late_s[name])}" for name in _SHOWN)
    print(f"{scheme:22s} {shown}   load {os.getloadavg()[0]:.1f}", flush=True)


def _bound(beat: Callable[[str], None], name: str) -> Callable[[], None]:
    return lambda: beat(name)


def _compute(seconds: float) -> None:
    end_s = time.thread_time() + seconds
    while time.thread_time() < end_s:
        pass


def _spread(late_s: list[float]) -> str:
    p50, p99 = np.percentile(late_s, (50, 99)) * 1e3
    return f"p50 {p50:6.2f}  p99 {p99:6.2f}  max {1e3 * max(late_s):6.1f} ms late"


if __name__ == "__main__":
    main()

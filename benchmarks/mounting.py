"""What a minute of walking tells of the camera's place: `python -m benchmarks.mounting`.

Units whose camera stands otherwise than calibrated by 1° (1 σ an axis) and whose stamps are off by 5 ms (1 σ) walk for
a minute; `calibrate mount` has to find both. The camera's steps are told from the truth, without a picture.
"""

import argparse

import numpy as np
from rich.console import Console
from rich.progress import track as progress

from lab.evaluation.mounting import Trial
from messages import UserError
from messages.arrays import BoolArray, FloatArray
from messages.constants import NORMAL_95


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mounting", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1299), metavar=("FIRST", "LAST"))
    first, last = parser.parse_args().seeds
    angles, lags, refused = list[FloatArray](), list[float](), 0
    angle_inside, lag_inside = list[BoolArray](), list[bool]()
    stds = list[float]()
    for seed in progress(range(first, last + 1), "walking", console=Console(stderr=True)):
        trial = Trial(seed)
        try:
            found = trial.found()
        except UserError as error:
            refused += 1
            print(error)
            continue
        turn, lag_s = trial.errors(found.calibration)
        angles.append(np.abs(turn))
        lags.append(abs(lag_s))
        angle_inside.append(np.abs(turn) <= NORMAL_95 * found.turn_std)
        lag_inside.append(abs(lag_s) <= NORMAL_95 * found.lag_std)
        stds.append(float(found.turn_std.max()))
    off = np.degrees(np.array(angles))
    print(
        f"units {first} to {last}: {refused} refused; camera to IMU off by {np.sqrt((off**2).mean()):.3f}° RMS, "
        f"{off.max():.3f}° at most, stated {np.degrees(np.mean(stds)):.3f}°, 95 % intervals hold "
        f"{100 * np.mean(angle_inside):.1f} %; stamps off by {1e3 * np.sqrt(np.mean(np.square(lags))):.2f} ms RMS, "
        f"{1e3 * max(lags):.2f} ms at most, intervals hold {100 * np.mean(lag_inside):.1f} %"
    )


if __name__ == "__main__":
    main()

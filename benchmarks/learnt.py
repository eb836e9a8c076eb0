"""What a unit gains, switched on while walking, from what it learnt before: `python -m benchmarks.learnt`."""

import argparse

import cv2
import numpy as np

from cli.progress import progress
from lab.evaluation.warm_start import PowerUp, warm_start


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.learnt", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(314, 319), metavar=("FIRST", "LAST"))
    first, last = parser.parse_args().seeds
    cv2.setNumThreads(1)
    found: dict[str, list[PowerUp]] = {"calibration alone": [], "with what was learnt": []}
    for seed in progress(list(range(first, last + 1)), "units"):
        _, cold, warm = warm_start(seed)
        found["calibration alone"].append(cold)
        found["with what was learnt"].append(warm)
    print(f"units {first} to {last}, medians (worst)")
    for name, starts in found.items():
        columns = np.array(starts).T
        worst = columns.max(axis=1)
        attitude_s, ground_s, bias_radps, slope_rad, _ = np.median(columns, axis=1)
        print(
            f"{name}: first attitude {attitude_s:.2f} s ({worst[0]:.2f}), "
            f"first ground {ground_s:.2f} s ({worst[1]:.2f}), "
            f"bias then off by {np.degrees(bias_radps):.2f} °/s ({np.degrees(worst[2]):.2f}), "
            f"slope ahead RMS {np.degrees(slope_rad):.2f}° ({np.degrees(worst[3]):.2f}), "
            f"frames {columns[4].min():.0f} to {worst[4]:.0f}"
        )


if __name__ == "__main__":
    main()

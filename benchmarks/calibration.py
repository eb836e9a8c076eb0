"""How good calibrations are, and whether their 95 % intervals hold: `python -m benchmarks.calibration`.

Units within their data sheets: accelerometer and gyroscope from poses by hand, the pair from views of a board whose
corners have noise. `benchmarks.mounting` does the same for the camera's place.
"""

import argparse

import numpy as np
from rich.console import Console
from rich.progress import track as progress

from calib.imu.accelerometer import fit_accelerometer
from calib.stereo.board import Board
from calib.stereo.fit import fit_pair
from lab.evaluation.calibration_trials import (
    POSES,
    drawn_rests,
    drawn_values,
    drawn_views,
    true_values,
)
from messages.arrays import BoolArray, FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, draw_unit

_BOARD = Board(9, 6, 0.03)
_VIEWS, _CORNER_STD_PX = 14, 0.15


def accelerometers(seeds: range) -> str:
    """Return a line about accelerometers in fourteen poses."""
    off, inside = list[FloatArray](), list[BoolArray]()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        true = drawn_values(rng)
        fit = fit_accelerometer(drawn_rests(rng, true, POSES), STANDARD_GRAVITY_MPS2)
        off.append(np.abs(fit.values - true))
        inside.append(off[-1] <= fit.half_width)
    bias, scale = (np.array(off)[:, part] for part in (slice(0, 3), slice(3, 6)))
    return (
        f"accelerometer, {len(seeds)} units: bias off by {1e3 * np.percentile(bias, 95.0):.2f} mg (95 %), "
        f"{1e3 * bias.max():.2f} mg at most; scale {100 * np.percentile(scale, 95.0):.3f} % (95 %), "
        f"{100 * scale.max():.3f} % at most; intervals hold {100 * np.mean(inside):.1f} %"
    )


def pairs(seeds: range) -> str:
    """Return a line about pairs from views of a board."""
    inside, depth, depth_inside = list[bool](), list[float](), list[bool]()
    for seed in progress(seeds, "pairs", console=Console(stderr=True)):
        rng = np.random.default_rng(seed)
        true = draw_unit(seed).stereo
        views = drawn_views(rng, true, _BOARD, _VIEWS, _CORNER_STD_PX)
        fit = fit_pair(views, _BOARD, (WIDTH_PX, HEIGHT_PX), f"unit {seed}", board_error=0.0)
        for name, value in true_values(true).items():
            quantity = fit.quantities[name]
            inside.append(quantity.low <= value <= quantity.high)
        found, told = (each.left.fx_px * float(np.linalg.norm(each.X_RL.p_m)) for each in (fit.stereo, true))
        depth.append(abs(found / told - 1.0))
        baseline = fit.quantities["baseline_m"]
        depth_inside.append(baseline.low <= float(np.linalg.norm(true.X_RL.p_m)) <= baseline.high)
    return (
        f"pairs, {len(seeds)} units, {_VIEWS} views, corners to {_CORNER_STD_PX} px: focal length times "
        f"baseline off by {100 * np.percentile(depth, 95.0):.3f} % (95 %), {100 * max(depth):.3f} % at most; "
        f"intervals of lenses and pair hold {100 * np.mean(inside):.1f} %, "
        f"of the baseline {100 * np.mean(depth_inside):.1f} %"
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.calibration", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1299), metavar=("FIRST", "LAST"))
    first, last = parser.parse_args().seeds
    seeds = range(first, last + 1)
    print(accelerometers(seeds))
    print(pairs(seeds))


if __name__ == "__main__":
    main()

"""The odometer against the truth, by texture and by what else is in the picture.

    python -m benchmarks.odometry [--cases brick concrete … tray dusk …] [--seeds 1000-1002] [--seconds 8] [--exact]

Units of the rig walk, each with the calibration that it would have, or with the true one (`--exact`): the scale of
the distances is then that of the pictures alone. Odometer and attitude filter run as in the service: what the filter
foretells tells where to look. Of the steps from 1.5 s on: their share, root mean squares and 99 % quantiles of the
errors of velocity and rate (all axes of B), the largest mean error of the rate over a second, mean χ² over 6 of both
with the stated covariance, and by how much more than the truth was walked. Seeds below 1000 are for tuning, from 1000
on for judging.
"""

import argparse
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pool

import cv2
import numpy as np

from lab.evaluation.odometer_errors import odometer_steps, step_error
from messages.arrays import FloatArray, rms
from sim_rig.walk.scenario import Pace, Scenario, over_level, scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
SETTLED_NS = START_NS + 1_500_000_000
GROUNDS = ("brick", "concrete", "asphalt", "grass", "gravel", "paving", "wood")
OBSTRUCTED = ("tray", "trolley", "bag", "passers-by", "mosaic-6cm-varied", "mosaic-6cm", "plain-floor", "dusk")


@dataclass(frozen=True)
class Walked:
    """Errors (n, 6) of n steps, rate (rad/s) first, then velocity (m/s); their χ² (n,); true velocities (n, 3), in B;
    and how many steps there might have been."""

    errors: FloatArray
    square: FloatArray
    velocities: FloatArray
    frames: int

    @property
    def lean_radps(self) -> float:
        """Return the largest mean error of the rate, on any axis, over `_SECOND` steps; 0 where there are fewer."""
        sums = np.cumsum(np.vstack((np.zeros(3), self.errors[:, :3])), axis=0)
        means: FloatArray = (sums[_SECOND:] - sums[:-_SECOND]) / _SECOND
        return float(np.abs(means).max(initial=0.0))


def walk_over(case: str, seed: int) -> Scenario:
    """Return the walk over one texture, or the scenario, of that name, at a pace that `seed` draws."""
    chance = np.random.default_rng([seed, 21])
    pace = Pace(float(chance.uniform(0.8, 1.6)), float(chance.uniform(1.5, 2.1)))
    return over_level(pace, case, case, *[case] * 4) if case in GROUNDS else scenario(case, pace)


def walked(task: tuple[str, int], seconds: float, exact: bool) -> Walked:
    """Return what the odometer makes of one unit's walk."""
    cv2.setNumThreads(1)
    case, seed = task
    wearer = SimulatedWearer(seed, walk_over(case, seed), START_NS, perfect_calibration=exact)
    told = [step for t_ns, step in odometer_steps(wearer, seconds) if t_ns >= SETTLED_NS]
    steps, frames = [step for step in told if step is not None], len(told)
    errors, squares, velocities = [], [], []
    for step in steps:
        error, velocity = step_error(step, wearer, wearer.calibration)
        errors.append(error / step.duration_s)
        squares.append(float(error @ np.linalg.solve(step.covariance, error)))
        velocities.append(velocity)
    return Walked(np.array(errors).reshape(-1, 6), np.array(squares), np.array(velocities).reshape(-1, 3), frames)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=[*GROUNDS, *OBSTRUCTED])
    parser.add_argument("--seeds", default="1000-1002", help="rig units, first-last")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--exact", action="store_true", help="the true calibration")
    parser.add_argument("--processes", type=int, choices=(1, 2), default=2)
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    print(f"{'':20} steps   velocity RMS, P99   rate RMS, P99, of a second    χ²/6   walked")
    with Pool(options.processes) as pool:
        run = partial(walked, seconds=options.seconds, exact=options.exact)
        for case in options.cases:
            found = pool.map(run, [(case, seed) for seed in range(first, last + 1)], 1)
            errors, square, v = (
                np.concatenate([getattr(each, name) for each in found]) for name in ("errors", "square", "velocities")
            )
            share = len(errors) / max(1, sum(each.frames for each in found))
            print(f"{case:20}{share:6.1%}", end="")
            if len(errors):
                lean_degps = np.degrees(max(each.lean_radps for each in found))
                w_degps, v_mmps = np.degrees(errors[:, :3]), 1e3 * errors[:, 3:]
                moved = (v**2).sum(axis=1) > _WALKS_MPS**2
                more = (v * errors[:, 3:])[moved].sum() / (v**2)[moved].sum()
                print(
                    f"{rms(v_mmps):9.1f} {np.quantile(np.abs(v_mmps), 0.99):5.0f} mm/s"
                    f"{rms(w_degps):8.2f} {np.quantile(np.abs(w_degps), 0.99):5.2f} {lean_degps:5.2f} °/s"
                    f"{square.mean() / 6:8.2f}{more:+9.2%}",
                    end="",
                )
            print(flush=True)


_SECOND = 20
"""Steps."""
_WALKS_MPS = 0.5
"""Faster than anyone sways."""


if __name__ == "__main__":
    main()

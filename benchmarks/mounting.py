"""What a minute of walking tells of the camera's place: `python -m benchmarks.mounting --file trials.jsonl`.

Units whose camera stands otherwise than calibrated by 1° (1 σ an axis) and whose stamps are off by 5 ms (1 σ) walk for
a minute; `calibrate mount` has to find both, and the scale of their distances. The camera's steps are told from the
truth, with the errors that the odometer has on rendered walks of other units (`--rendered`, kept in the folder
`--errors`, as they are or seen in a mirror). Each trial is kept in the file; ended at any time, the count goes on from
there.
"""

import argparse
import json
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.progress import track as progress

from lab.evaluation.mounting import Trial, rendered_errors
from lab.evaluation.odometer_errors import RenderedErrors
from messages import UserError
from messages.arrays import BoolArray
from messages.constants import NORMAL_95


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mounting", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1299), metavar=("FIRST", "LAST"))
    parser.add_argument("--rendered", type=int, nargs=2, default=(2000, 2011), metavar=("FIRST", "LAST"))
    parser.add_argument("--errors", type=Path, default=Path("odometer_errors"), help="folder, filled as needed")
    parser.add_argument("--file", type=Path, default=Path("mounting.jsonl"), help="a line for each trial")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    options.errors.mkdir(parents=True, exist_ok=True)
    rendered = range(options.rendered[0], options.rendered[1] + 1)
    for seed in _shown(rendered, "rendering"):
        path = options.errors / f"{seed}.npz"
        if not path.exists():
            rendered_errors(seed).write(path)

    lines = options.file.read_text(encoding="utf-8").splitlines() if options.file.exists() else []
    trials = {trial["seed"]: trial for trial in map(json.loads, lines)}
    wanted = range(options.seeds[0], options.seeds[1] + 1)
    with options.file.open("a", encoding="utf-8") as file:
        for seed in _shown(wanted, "walking"):
            if seed not in trials:
                chance = np.random.default_rng([seed, 24])
                trials[seed] = _trial(seed, _errors(options.errors / f"{chance.choice(rendered)}.npz"))
                file.write(json.dumps(trials[seed]) + "\n")
                file.flush()
    _tell([trials[seed] for seed in wanted])


@cache
def _errors(path: Path) -> RenderedErrors:
    return RenderedErrors.read(path)


def _shown(seeds: range, what: str) -> "list[int]":
    return progress(seeds, what, console=Console(stderr=True))  # type: ignore[return-value]  # an iterable of the same


def _trial(seed: int, errors: RenderedErrors) -> dict[str, Any]:
    """Return by what that which was found is off, rad and s, each with what is stated of it; or why it was refused."""
    trial = Trial(seed, errors)
    try:
        found = trial.found()
    except UserError as error:
        return {"seed": seed, "refused": str(error)}
    turn, lag_s = trial.errors(found.calibration)
    told: dict[str, Any] = {
        "turn": (turn.tolist(), found.turn_std.tolist()),
        "lag": (lag_s, found.lag_std),
        "found_scale": (found.scale - trial.pair_off(trial.given).distances, found.scale_std),
    }
    if found.pair is not None:
        left = trial.pair_off(found.calibration)
        told["scale"] = (left.distances, found.pair.scale_std)
        told["baseline"] = (left.baseline, found.pair.baseline_std)
        told["toe_in"] = (left.toe_in_rad, found.pair.toe_in_std_rad)
    return {"seed": seed, "scale_before": trial.pair_off(trial.given).distances} | told


def _tell(trials: list[dict[str, Any]]) -> None:
    found = [trial for trial in trials if "refused" not in trial]
    print(f"{len(found)} of {len(trials)} units told, {len(trials) - len(found)} refused")
    for trial in trials:
        if "refused" in trial:
            print(trial["refused"])
    before = np.array([trial["scale_before"] for trial in found])
    print(f"scale of distances before: off by {100 * np.sqrt((before**2).mean()):.3f} % RMS")
    print(f"taken over for {sum('scale' in trial for trial in found)} units")
    degrees = np.degrees(1.0)
    for what, name, factor, unit, goal in (
        ("camera to IMU", "turn", degrees, "°", 0.1),
        ("stamps", "lag", 1e3, "ms", 1.0),
        ("scale of distances as found", "found_scale", 1e2, "%", 0.3),
        ("scale of distances as taken over", "scale", 1e2, "%", 0.3),
        ("its baseline", "baseline", 1e2, "%", 0.3),
        ("its toe-in", "toe_in", degrees, "°", 0.03),
    ):
        told = [trial[name] for trial in found if name in trial]
        off, std = np.abs(np.array([each for each, _ in told])), np.array([each for _, each in told])
        print(
            f"{what}: off by {factor * np.sqrt((off**2).mean()):.3f} {unit} RMS, {factor * np.quantile(off, 0.95):.3f} "
            f"{unit} (95 % of them), {factor * off.max():.3f} {unit} at most; stated {factor * std.mean():.3f} {unit}; "
            f"95 % intervals hold {100 * np.mean(off <= NORMAL_95 * std):.1f} %; beyond {goal} {unit} in "
            f"{_units(factor * off > goal)} units, beyond three deviations in {_units(off > 3.0 * std)}"
        )


def _units(beyond: BoolArray) -> int:
    """Return for how many units it is so, of any axis."""
    return int(np.count_nonzero(beyond.reshape(len(beyond), -1).any(axis=1)))


if __name__ == "__main__":
    main()

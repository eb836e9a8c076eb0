"""What a minute of walking tells of the camera's place: `python -m benchmarks.mounting --file trials.jsonl`.

Units whose camera stands otherwise than calibrated by 1° (1 σ an axis) and whose stamps are off by 5 ms (1 σ) walk for
a minute; `calibrate mount` has to find both. The camera's steps are told from the truth, with the errors that the
odometer has on rendered walks of other units (`--rendered`, kept in the folder `--errors`, as they are or seen in a
mirror). Each trial is kept in the file; ended at any time, the count goes on from there.
"""

import argparse
import json
from functools import cache
from pathlib import Path

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


def _trial(seed: int, errors: RenderedErrors) -> dict[str, object]:
    """Return by what the mounting found is off, rad and s, and what is stated of that; or why it was refused."""
    trial = Trial(seed, errors)
    try:
        found = trial.found()
    except UserError as error:
        return {"seed": seed, "refused": str(error)}
    turn, lag_s = trial.errors(found.calibration)
    return {
        "seed": seed,
        "turn": turn.tolist(),
        "turn_std": found.turn_std.tolist(),
        "lag": lag_s,
        "lag_std": found.lag_std,
        "scale": found.scale - trial.scale,
        "scale_std": found.scale_std,
    }


def _tell(trials: list[dict[str, object]]) -> None:
    found = [trial for trial in trials if "refused" not in trial]
    print(f"{len(trials)} units, {len(trials) - len(found)} refused")
    for trial in trials:
        if "refused" in trial:
            print(trial["refused"])
    for what, name, factor, unit, goal in (
        ("camera to IMU", "turn", np.degrees(1.0), "°", 0.1),
        ("stamps", "lag", 1e3, "ms", 1.0),
        ("scale of distances, not taken over", "scale", 1e2, "%", 0.3),
    ):
        off = np.abs(np.array([trial[name] for trial in found]))
        std = np.array([trial[f"{name}_std"] for trial in found])
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

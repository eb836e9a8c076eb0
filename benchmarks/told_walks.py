"""Walks whose camera steps are told from the truth, without a picture: what benchmarks on them share."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing import Pool
from pathlib import Path
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.progress import track as progress

from lab.evaluation.told_steps import OdometerNoise
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Pace, Scenario
from sim_rig.walk.world import WorldBuilder

T = TypeVar("T")

START_NS = 10_000_000_000


def walking_on(pace: Pace) -> Scenario:
    """Return a walk on level ground without a stop, after 1.5 s at rest."""
    world = WorldBuilder().level(20.0, "concrete").level(20.0, "asphalt").build()
    return Scenario("walking on", "level ground without a stop", world, (Stand(1.5), pace.to(400.0), Stand(0.5)))


def pace_of(chance: np.random.Generator) -> Pace:
    """Return a pace with the cadence that people choose for its speed, about that of its square root."""
    speed_mps = chance.uniform(0.8, 1.6)
    return Pace(float(speed_mps), float(1.8 * np.sqrt(speed_mps / 1.2) + chance.normal(0.0, 0.05)))


@dataclass(frozen=True)
class Options:
    """What was asked for: numbers of rows, seeds of units, the odometer's noise, and the file for the facts, if any."""

    rows: Sequence[int]
    seeds: range
    noise: OdometerNoise
    json: Path | None


def asked(
    doc: str, names: Sequence[str], *, units: int, velocity_noise_mmps: float, rate_noise_degps: float
) -> Options:
    """Return what the command line of a benchmark with rows of these names asks for; numbers are what it asks for if
    it says nothing. `doc` begins with the line for `--help`."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--units", type=int, default=units)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--rows", default="", help="only rows whose name begins with one of these, such as start,bus")
    parser.add_argument("--velocity-noise-mmps", type=float, default=velocity_noise_mmps)
    parser.add_argument("--rate-noise-degps", type=float, default=rate_noise_degps)
    parser.add_argument("--json", type=Path)
    found = parser.parse_args()
    return Options(
        rows=[k for k, name in enumerate(names) if name.startswith(tuple(found.rows.split(",")))],
        seeds=range(found.first_seed, found.first_seed + found.units),
        noise=OdometerNoise(1e-3 * found.velocity_noise_mmps, float(np.radians(found.rate_noise_degps))),
        json=found.json,
    )


def by_row(of_one_unit: Callable[[tuple[int, int, OdometerNoise]], T], options: Options) -> dict[int, dict[int, T]]:
    """Return by row and seed what `of_one_unit` makes of row, seed and noise, computed by two processes."""
    tasks = [(row, seed, options.noise) for row in options.rows for seed in options.seeds]
    with Pool(2) as pool:
        shown = progress(pool.imap(of_one_unit, tasks), "walking", len(tasks), console=Console(stderr=True))
        found: dict[int, dict[int, T]] = {row: {} for row in options.rows}
        for (row, seed, _), of_unit in zip(tasks, shown, strict=True):
            found[row][seed] = of_unit
    return found

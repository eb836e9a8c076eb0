"""The thesis's Tables 1 and 2 with this simulation's figures beside the printed ones, as rows for a person."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance.body.rigid_body import Inertia
from lab.thesis.printed import CUBOID_SIZE_M, FOOT, PLATE, RATES_HZ, ROWS, UNITS, PrintedTable, cuboid, rows_of
from messages.arrays import FloatArray

Pair = tuple[Inertia, Inertia]
"""Plate and foot."""


@dataclass(frozen=True)
class Reproduced:
    """One table's figures: `experiment` (3, 10) values, one draw of noise at each update rate; errors of the others.

    `noisy` (draws, 10) and `noise_free` (10,) are errors against the reference, at one update rate.
    """

    experiment: FloatArray
    noisy: FloatArray
    noise_free: FloatArray

    @property
    def facts(self) -> dict[str, object]:
        """Return the same for a program."""
        return {
            "rows": ROWS,
            "experiment_values": self.experiment.tolist(),
            "noisy_errors": self.noisy.tolist(),
            "noise_free_errors": self.noise_free.tolist(),
        }


def reproduced(experiments: Sequence[Pair], noisy: Sequence[Pair], noise_free: Pair) -> tuple[Reproduced, Reproduced]:
    """Return the figures of Tables 1 and 2: pairs of each update rate, of each draw of noise, and one without noise."""

    def table(body: int, printed: PrintedTable) -> Reproduced:
        return Reproduced(
            np.array([rows_of(pair[body]) for pair in experiments]),
            np.array([rows_of(pair[body]) for pair in noisy]) - printed.reference,
            rows_of(noise_free[body]) - printed.reference,
        )

    return table(0, PLATE), table(1, FOOT)


def cuboid_rows() -> FloatArray:
    """Return the ideal cuboid's column (10,), computed."""
    return rows_of(cuboid(PLATE.reference[0], CUBOID_SIZE_M))


def value_columns(printed: PrintedTable) -> list[str]:
    """Return the headings of `value_rows`."""
    rates = [f"{hz} Hz {whose}" for whose in ("printed", "here") for hz in RATES_HZ]
    ideal = ["cuboid printed", "computed"] if printed.cuboid is not None else []
    return ["", "", *ideal, "ref.", *rates]


def value_rows(printed: PrintedTable, found: Reproduced) -> list[list[str]]:
    """Return parameter, unit, cuboid (if any), reference, and the experiments' values: printed, then simulated."""
    ideal = np.empty((0, 10)) if printed.cuboid is None else np.stack([np.array(printed.cuboid), cuboid_rows()])
    values = np.vstack([ideal, [printed.reference], printed.experiment, found.experiment])
    return [
        [name, unit, *(f"{x:.1f}" if k else f"{x:.2f}" for x in column)]
        for k, (name, unit, column) in enumerate(zip(ROWS, UNITS, values.T, strict=True))
    ]


ERROR_COLUMNS = ["", "", "w/ noise printed", "here", "no noise printed", "here"]


def error_rows(printed: PrintedTable, found: Reproduced) -> list[list[str]]:
    """Return parameter, unit, and the simulation's signed errors: printed beside reproduced, with and without noise."""
    mean, deviation = found.noisy.mean(axis=0), found.noisy.std(axis=0, ddof=1)
    return [
        [
            name,
            unit,
            f"{printed.noisy_mean[k]:.2f} ± {printed.noisy_deviation[k]:.2f}",
            f"{mean[k]:.2f} ± {deviation[k]:.2f}",
            f"{printed.noise_free[k]:.2f}",
            f"{found.noise_free[k]:.2f}",
        ]
        for k, (name, unit) in enumerate(zip(ROWS, UNITS, strict=True))
    ]

"""The figures of the thesis's Tables 1 and 2, as printed: what this platform's simulation is set beside.

Source: the thesis's chapter 2, "Inertia Estimation using the Instrumented Vibrating Platform", Table 1 (force plate)
and Table 2 (mockup foot). Rows are m (kg), x0, y0, z0 (mm), then the tensor about the centre of gravity (g m²) in the
order Jx, Jy, Jz, Jyz, Jxz, Jxy. The columns called "absolute error" there are signed.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from impedance.body.rigid_body import Inertia
from messages.arrays import FloatArray

ROWS: Final = ("m", "x0", "y0", "z0", "Jx", "Jy", "Jz", "Jyz", "Jxz", "Jxy")
UNITS: Final = ("kg", "mm", "mm", "mm", *("g m²",) * 6)
RATES_HZ: Final = (29, 40, 67)
CUBOID_SIZE_M: Final = (0.5, 0.0288, 0.2985)  # x, y, z: not printed, but what the printed cuboid column follows from


@dataclass(frozen=True)
class PrintedTable:
    """One table, ten rows each: the reference, the three experiments, and the simulation's errors.

    `reference` and `experiment` (3, 10) are values; `noisy_mean`, `noisy_deviation` and `noise_free` are errors against
    the reference. `cuboid` are the values of the homogeneous cuboid, where there is such a column.
    """

    reference: tuple[float, ...]
    experiment: tuple[tuple[float, ...], ...]
    noisy_mean: tuple[float, ...]
    noisy_deviation: tuple[float, ...]
    noise_free: tuple[float, ...]
    cuboid: tuple[float, ...] | None = None


PLATE: Final = PrintedTable(
    reference=(4.64, 5.03, -26.20, -0.97, 40.40, 118.07, 105.27, 1.37, -0.47, 8.13),
    experiment=(
        (4.64, 5.5, -29.9, -0.9, 41.0, 113.4, 105.5, -0.6, -2.4, 13.0),
        (4.64, 7.2, -27.3, -0.9, 40.4, 102.6, 106.7, 2.5, 2.1, 9.1),
        (4.64, 2.4, -21.4, -1.1, 39.8, 138.2, 103.6, 2.2, -1.1, 2.3),
    ),
    noisy_mean=(0.00, 0.06, -0.31, 0.03, -0.43, -0.60, 1.03, 0.04, -0.23, -0.08),
    noisy_deviation=(0.00, 0.01, 0.20, 0.01, 0.07, 6.72, 0.23, 0.01, 0.06, 0.03),
    noise_free=(0.00, -0.00, 0.00, 0.00, -0.00, 0.01, 0.00, 0.00, 0.00, 0.00),
    cuboid=(4.64, 0.0, -14.4, 0.0, 34.8, 131.1, 97.0, 0.0, 0.0, 0.0),
)

FOOT: Final = PrintedTable(
    reference=(22.68, 0.0, -90.7, 0.0, 81.1, 127.0, 137.2, 0.0, 0.0, 0.0),
    experiment=(
        (22.98, -0.3, -73.1, -0.73, 0.0, 13.6, 146.4, -1.1, 2.0, 4.4),
        (23.04, -0.3, -72.5, -0.9, 0.0, 169.8, 145.8, -1.5, -1.4, 2.9),
        (23.10, -0.1, -73.9, -1.0, 0.0, 200.5, 159.7, -0.6, -0.0, 2.8),
    ),
    noisy_mean=(-3.58, -0.0, 2.5, -0.0, -11.7, 121.7, -6.4, -0.2, -0.6, 0.0),
    noisy_deviation=(0.5, 0.0, 0.1, 0.0, 0.4, 57.2, 0.6, 1.1, 0.3, 1.1),
    noise_free=(-0.00, -0.0, 0.2, 0.0, -0.5, -133.9, -0.9, -0.2, -0.1, 0.6),
)


def rows_of(body: Inertia) -> FloatArray:
    """Return `body` as the ten rows of a table, (10,), in their units."""
    return np.concatenate(([body.mass_kg], 1e3 * body.cog_m, 1e3 * body.about_cog()))


def body_of(rows: tuple[float, ...]) -> Inertia:
    """Return the body that a column of a table describes; it need not be one that can exist."""
    return Inertia.about(rows[0], 1e-3 * np.array(rows[1:4]), 1e-3 * np.array(rows[4:]))


def cuboid(mass_kg: float, size_m: tuple[float, float, float]) -> Inertia:
    """Return a homogeneous cuboid with its origin at the centre of its upper (+Y) side."""
    squares = np.square(size_m)
    J = mass_kg / 12.0 * np.diag(squares.sum() - squares)
    return Inertia(mass_kg, np.array([0.0, -0.5 * size_m[1], 0.0]), J)

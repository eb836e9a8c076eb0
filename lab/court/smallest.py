"""The smallest size of an effect from which on it is found in 95 % of cases."""

from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.optimize import isotonic_regression

from lab.hidden.case import Sizes

_FOUND_SHARE = 0.95


class Smallest(msgspec.Struct, frozen=True):
    """`size` is the smallest drawn one from which on the share found is ≥ 95 %; null where even the largest is missed.

    The share is a monotone function of size, fitted by least squares to found or not. `low` and `high` are the range
    that sizes were drawn from, `cases` how many there were, `found` how many of them were found.
    """

    size: float | None
    unit: str
    low: float | None
    high: float | None
    cases: int
    found: int


def smallest_found(cases: Sequence[tuple[float, bool]], sizes: Sizes | None) -> Smallest:
    """Return it from (size, found) of every case of an effect; at least one case is needed."""
    ordered = sorted(cases)
    found = np.array([float(right) for _, right in ordered])
    share = isotonic_regression(found, increasing=True).x
    enough = np.flatnonzero(share >= _FOUND_SHARE)
    return Smallest(
        size=ordered[enough[0]][0] if len(enough) else None,
        unit="" if sizes is None else sizes.unit,
        low=None if sizes is None else float(sizes.low),
        high=None if sizes is None else float(sizes.high),
        cases=len(ordered),
        found=int(found.sum()),
    )

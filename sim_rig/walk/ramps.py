"""Quantities that go from one value to the next without a jump in their first two derivatives."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

SMOOTHSTEP = (6.0, -15.0, 10.0, 0.0, 0.0, 0.0)
"""6τ⁵ − 15τ⁴ + 10τ³ from τ = 0 to 1: first and second derivative 0 at both ends."""

Derivatives = tuple[PPoly, PPoly, PPoly]
"""A quantity over time with its first and second derivative."""


class Change(NamedTuple):
    """From `from_s` on, for `duration_s`, a quantity changes `by` so much."""

    from_s: float
    duration_s: float
    by: float


def ramped(changes: Iterable[Change], end_s: float) -> PPoly:
    """Return a quantity that begins at 0 and changes, as a polynomial in time from 0 to `end_s`.

    Raises ValueError where two changes overlap, or one lasts beyond `end_s`.
    """
    knots, pieces, value = [0.0], [], 0.0

    def hold(until_s: float) -> None:
        if until_s > knots[-1]:
            knots.append(until_s)
            pieces.append(np.array([0.0] * 5 + [value]))

    for change in sorted(changes):
        if change.from_s < knots[-1] - _ROUNDING_S:
            raise ValueError(f"a change begins at {change.from_s:.2f} s, the one before lasts until {knots[-1]:.2f} s")
        hold(change.from_s)
        duration_s = change.from_s + change.duration_s - knots[-1]
        piece = change.by * np.array(SMOOTHSTEP) / duration_s ** np.arange(5, -1, -1)
        piece[-1] += value
        pieces.append(piece)
        knots.append(knots[-1] + duration_s)
        value += change.by
    if knots[-1] > end_s + _ROUNDING_S:
        raise ValueError(f"a change lasts until {knots[-1]:.2f} s, beyond the end at {end_s:.2f} s")
    hold(end_s)
    return PPoly(np.array(pieces).T, knots)


def with_derivatives(quantity: PPoly) -> Derivatives:
    """Return `quantity` with its first and second derivative."""
    return quantity, quantity.derivative(1), quantity.derivative(2)


_ROUNDING_S = 1e-9

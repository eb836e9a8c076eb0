"""What an extension gains on a recording it was not fitted to, all parameters frozen."""

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from discrepancy.evidence.adequacy import LEVEL
from discrepancy.problem import Problem
from discrepancy.verdict import Gain, number
from messages.arrays import FloatArray


def nrmse(problem: Problem, residual: FloatArray) -> float:
    """Return the RMS over channels of a residual (c, n), each divided by the measured standard deviation.

    A channel that does not vary is left out; NaN if none does.
    """
    return _root_mean(_shares(problem, _squares(problem, residual)))


def gain(problem: Problem, before: FloatArray, after: FloatArray, signal: FloatArray, named: bool) -> Gain:
    """Return the gain on the held-out recording of `problem` from its residuals (c, n), the noise taken for what is
    left of it: `told` makes of it what can be said where the noise is unknown.

    `signal` (c, n) is what of the residual after still follows from the inputs. The noise floor is what is left without
    it. A declared noise is a property of the sensor, off by more than a small effect is large, and lowers the floor
    only in channels where what is left is so far above it that it cannot be noise. Without a named cause no share is
    removed; it is null where there is no excess.
    """
    first, second = nrmse(problem, before), nrmse(problem, after)
    left = np.minimum(_squares(problem, after - signal), _squares(problem, after))
    known = problem.noise
    if known is not None and known.whole:
        noise = problem.valid.sum(axis=1) * known.std**2
        left = np.where(_squares(problem, after) > LEVEL**2 * noise, np.minimum(left, noise), left)
    floor = _root_mean(_shares(problem, left))
    excess = first**2 - floor**2
    share = (first**2 - second**2) / excess if excess > 0.0 else float("nan")
    return Gain(number(first), number(second), number(floor), number(share if named else 0.0 * share))


def pooled(gains: Sequence[Gain]) -> Gain:
    """Return the gain over several recordings, each weighing as much: the root mean squares of theirs."""
    if len(gains) == 1:
        return gains[0]
    first, second, floor = (
        _root_mean(np.array([told for each in gains if (told := getattr(each, name)) is not None]) ** 2)
        for name in ("held_out_nrmse_before", "held_out_nrmse_after", "noise_floor_nrmse")
    )
    excess = first**2 - floor**2
    share = (first**2 - second**2) / excess if excess > 0.0 else float("nan")
    return Gain(number(first), number(second), number(floor), number(share))


def told(problem: Problem, found: Gain) -> Gain:
    """Return a gain without its share of an excess, where the noise that begins it is known only from what is left."""
    return found if problem.noise is not None and problem.noise.whole else replace(found, share_of_excess_removed=None)


def _squares(problem: Problem, residual: FloatArray) -> FloatArray:
    return np.asarray(np.where(problem.valid, residual**2, 0.0).sum(axis=1), dtype=np.float64)


def _root_mean(shares: FloatArray) -> float:
    return float(np.sqrt(np.mean(shares))) if len(shares) else float("nan")


def _shares(problem: Problem, squares: FloatArray) -> FloatArray:
    measured = np.where(problem.valid, problem.channels.values.T, np.nan)
    there = problem.valid.sum(axis=1)
    out = []
    for row in range(problem.c):
        if there[row] > 1:
            spread = float(np.nanstd(measured[row]))
            if spread > 0.0:
                out.append(squares[row] / there[row] / spread**2)
    return np.array(out)

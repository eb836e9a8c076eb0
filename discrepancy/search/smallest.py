"""From which size an effect would have been seen: what a verdict of `nothing` means, and whether it means anything.

A parameter of size s, in units of its scale, lowers χ² by about s² F, F its Fisher information beside the base model
under the noise as it was estimated: colour that the effect might hide in counts as noise. It is seen nineteen times
of twenty where

    √(s² F) > √(threshold + penalty) + 1.645                                                                       (1)

and is larger than what matters, m scales, where s > m + (z₉₇.₅ + z₉₅) / √F.                                        (2)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from discrepancy.problem import Problem
from discrepancy.search.candidates import Candidate, Library
from discrepancy.search.scores import PENALTY, Products
from messages.constants import NORMAL_95

_NORMAL_90 = 1.6448536
"""Deviations of a normal that one of twenty exceeds on one side."""
_MOST_OF_OUTPUT = 0.3
"""Of a channel's own deviation: an effect that changes it by more must be seen, or the recording tells nothing."""
_UNTOLD = 0.5
"""Of the effects: where so many could be there unseen, whatever their size, nothing can be told."""


@dataclass(frozen=True)
class Smallest:
    """Sizes from which parameters would have been seen, by key, infinite where none within bounds would have been.

    `unseen` is the share of effects that could change some channel by a third of its deviation unseen, and `short` by
    how much the recording's signal over noise falls short of showing half of the effects; 1 where it does not.
    """

    sizes: dict[str, float]
    unseen: float
    short: float

    @property
    def telling(self) -> bool:
        """Return whether a recording that shows nothing tells anything."""
        return self.unseen < _UNTOLD


def smallest(
    problem: Problem, library: Library, found: Products, candidates: Sequence[Candidate], least: float
) -> Smallest:
    """Return the sizes for products `found` at the base fit and a `least` fall of χ² that is no chance.

    An effect that has no direction at its neutral values (a resonance, a threshold) is left out.
    """
    spread = np.nanstd(np.where(problem.valid, problem.measured, np.nan), axis=1)
    sizes: dict[str, float] = {}
    needed: dict[str, float] = {}
    for each in candidates:
        if each.offset is not None:
            continue
        for key, row in zip(each.keys, each.columns, strict=True):
            p = problem.parameters[key]
            place = row - library.base
            information = float(found.gram[place, place] / found.inflation[place])
            root = np.sqrt(information) if information > 0.0 else 0.0
            s = inf
            if root > 0.0:
                surely = p.least / p.scale + (NORMAL_95 + _NORMAL_90) / root
                s = max((np.sqrt(least + PENALTY) + _NORMAL_90) / root, surely)
            furthest = max(abs(p.low - p.neutral), abs(p.high - p.neutral))
            size = float(s * p.scale)
            sizes[key] = size if size <= furthest else inf
            changed = np.sqrt((library.columns[row] ** 2 * problem.valid).mean(axis=1))
            share = np.where(spread > 0.0, changed / np.maximum(spread, np.finfo(float).tiny), 0.0)
            short = max(size / furthest, s * float(share.max()) / _MOST_OF_OUTPUT) if isfinite(s) else inf
            needed[each.effect] = min(needed.get(each.effect, inf), short)
    shorts = np.array(list(needed.values()))
    if not len(shorts):
        return Smallest(sizes, 0.0, 1.0)
    return Smallest(sizes, float(np.mean(shorts > 1.0)), max(float(np.median(shorts)), 1.0))

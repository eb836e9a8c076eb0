"""Trajectories solved of late: begun with one of parameters near its own, the method of `marching` needs few rounds."""

from collections import OrderedDict
from collections.abc import Sequence

import numpy as np

from discrepancy.ports.marching import Near
from discrepancy.simulation import Values
from messages.arrays import FloatArray

_MOST_BYTES = 2**25
_EACH = 4
"""Of one choice of parameters: fits that begin at several places go on side by side."""

Layout = tuple[object, ...]
"""What tells whose states lie where in a trajectory, beside the model's."""


class Trajectories:
    """Keeps the newest trajectories of each choice of parameters; the oldest choices make room."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[Layout, frozenset[str]], list[tuple[Values, FloatArray]]] = OrderedDict()
        self._bytes = 0

    def __reduce__(self) -> "tuple[type[Trajectories], tuple[()]]":
        """Return how a copy for another process is made: empty."""
        return Trajectories, ()

    def near(self, layout: Layout, sets: Sequence[Values], begun: FloatArray, n: int) -> Near | None:
        """Return trajectories (s, k, n) near those of k `sets` of parameters, which begin at `begun` (s, k).

        Of a set that has none near it, the states are those it begins with. None where no set has.
        """
        found = [self._nearest(layout, values) for values in sets]
        if all(path is None for path in found):
            return None
        path = np.repeat(begun[:, :, None], n, axis=2)
        for k, each in enumerate(found):
            if each is not None:
                path[:, k] = each
        return Near(path, np.arange(len(sets)))

    def keep(self, layout: Layout, sets: Sequence[Values], path: FloatArray) -> None:
        """Keep the trajectories (s, k, n) of k `sets` of parameters, as far as they are finite."""
        for k, values in enumerate(sets):
            each = path[:, k]
            if not np.isfinite(each).all():
                continue
            kind = layout, frozenset(values)
            kept = self._kept.setdefault(kind, [])
            self._kept.move_to_end(kind)
            kept.append((values, each.copy()))
            self._bytes += each.nbytes
            if len(kept) > _EACH:
                self._bytes -= kept.pop(0)[1].nbytes
        while self._bytes > _MOST_BYTES and len(self._kept) > 1:
            _, oldest = self._kept.popitem(last=False)
            self._bytes -= sum(each.nbytes for _, each in oldest)

    def _nearest(self, layout: Layout, values: Values) -> FloatArray | None:
        kept = self._kept.get((layout, frozenset(values)), ())
        return min(kept, key=lambda each: _apart(each[0], values), default=(None, None))[1]


def _apart(one: Values, other: Values) -> float:
    """Return by how much two choices of values for the same parameters are apart, each by its size."""
    return sum(abs(one[key] - other[key]) / max(abs(one[key]) + abs(other[key]), _TINY) for key in one)


_TINY = 1e-300

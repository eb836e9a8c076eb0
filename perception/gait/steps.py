"""Steps out of the hip's bob: it is lowest once a step, while both feet stand, and highest over the standing foot."""

import math
from dataclasses import dataclass, field

import numpy as np

from perception.gait.trail import HipTrail


@dataclass
class Steps:
    """The rows of the trail (between two) at which the hip was lowest in the last steps, and the time of a step in
    rows; NaN before the second one."""

    contacts: list[float] = field(default_factory=list)
    step: float = math.nan


class StepWatch:
    """Follows the bob row by row; without steps for a while, or while they are no walk's, it knows none."""

    def __init__(self) -> None:
        self.steps = Steps()
        self._next = 0
        self._bob_mps = 0.0
        self._swing_mps = 0.0

    def clear(self) -> None:
        """Forget the steps: another trail begins."""
        self.steps, self._next, self._bob_mps, self._swing_mps = Steps(), 0, 0.0, 0.0

    def add(self, trail: HipTrail) -> None:
        """Take what has been added to `trail`; the bob is its rise about the mean of a stride."""
        first, last = max(self._next, trail.first + _HALF_SMOOTH), trail.count - _HALF_SMOOTH
        if last <= first:
            return
        way = np.concatenate(([0.0], np.cumsum(trail.rise_mps(trail.first, trail.count))))
        for row in range(first, last):
            end = row - trail.first + _HALF_SMOOTH + 1
            smooth = (way[end] - way[end - 2 * _HALF_SMOOTH - 1]) / (2 * _HALF_SMOOTH + 1)
            stride = min(end, round(2.0 * self.steps.step) if math.isfinite(self.steps.step) else _USUAL_STRIDE)
            self._take(row, float(smooth - (way[end] - way[end - stride]) / stride))
        self._next = last

    def _take(self, row: int, bob_mps: float) -> None:
        before, self._bob_mps = self._bob_mps, bob_mps
        if before < 0.0 <= bob_mps:
            if self._swing_mps < -_LEAST_BOB_MPS:
                self._contact(row - bob_mps / (bob_mps - before))
            self._swing_mps = 0.0
        elif before > 0.0 >= bob_mps or abs(bob_mps) > abs(self._swing_mps):
            self._swing_mps = bob_mps
        steps = self.steps
        longest = 1.7 * steps.step if math.isfinite(steps.step) else _LONGEST_STEP
        if steps.contacts and row - steps.contacts[-1] > longest:
            self.steps = Steps()

    def _contact(self, at: float) -> None:
        steps = self.steps
        if steps.contacts:
            since = at - steps.contacts[-1]
            if since < (0.6 * steps.step if math.isfinite(steps.step) else SHORTEST_STEP):
                return
            steps.step = since if math.isnan(steps.step) else steps.step + _FOLLOWS * (since - steps.step)
        steps.contacts = [*steps.contacts[-_MOST_CONTACTS:], at]


SHORTEST_STEP, _LONGEST_STEP = 28.0, 120.0
_HALF_SMOOTH = 3
_USUAL_STRIDE = 100
_LEAST_BOB_MPS = 0.05
_FOLLOWS = 0.35
_MOST_CONTACTS = 5

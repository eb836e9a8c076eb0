"""How long after the hip is lowest the foot strikes: a strike shakes the hip, which else moves smoothly.

The hip is lowest in double support (Perry, Burnfield, Gait Analysis); how the camera's own lowest point lies to the
strike differs with the wearer and with where the camera is worn. So the jerk about it is averaged over the steps; where
it begins to rise, the foot strikes. Until that is clear, or where no strike is felt, the two are taken for one, give or
take 20 ms.
"""

import numpy as np

from messages.arrays import FloatArray
from perception.gait.trail import HipTrail


class StrikeDelay:
    """Averages the jerk about each step's lowest point; `rows` and `sigma` say when the strike is, after that."""

    unknown_rows = 2.0
    known_rows = 0.7
    least_steps = 3

    def __init__(self) -> None:
        self._mean: FloatArray = np.zeros(_BEFORE + _AFTER)
        self._steps = 0
        self.rows, self.sigma = 0.0, self.unknown_rows

    @property
    def rows_needed(self) -> int:
        """Return how many rows after the lowest point have to be there."""
        return _AFTER + 3

    def add(self, trail: HipTrail, lowest: float) -> None:
        """Take the step whose lowest point was at row `lowest`, `rows_needed` ago."""
        at = round(lowest)
        if at - _BEFORE - 2 < trail.first:
            return
        rise = trail.rise_mps(at - _BEFORE - 2, at + _AFTER + 2)
        jerk = np.abs(np.diff(rise, 3))[: _BEFORE + _AFTER]
        if len(jerk) < _BEFORE + _AFTER:
            return
        # the lowest point lies between two rows: shift the jerk to whole rows about it
        places = np.arange(_BEFORE + _AFTER, dtype=np.float64)
        jerk = np.interp(places + (lowest - at), places, jerk)
        self._steps += 1
        self._mean = self._mean + (jerk - self._mean) / min(self._steps, _MOST_STEPS)
        smooth = np.convolve(self._mean, (0.25, 0.5, 0.25), "same")
        quiet, strike = float(np.median(smooth[:_QUIET])), smooth[_EARLIEST:]
        peak = float(strike.max())
        if self._steps >= self.least_steps and peak > max(_CLEAR * quiet, _LEAST_JERK_MPS):
            onset = quiet + _ONSET * (peak - quiet)
            first = _EARLIEST + int(np.argmax(strike > onset))
            rises = float(smooth[first] - smooth[first - 1])
            back = (float(smooth[first]) - onset) / rises if rises > 0.0 else 0.0
            self.rows, self.sigma = first - min(back, 1.0) - _BEFORE - _JERK_AFTER, self.known_rows

    def told(self, rows: float) -> None:
        """Take a strike that the ankle told, `rows` after the hip was lowest."""
        self.rows += _TOLD_FOLLOWS * (rows - self.rows)
        self.sigma = self.known_rows


_BEFORE, _AFTER = 12, 14
_QUIET, _EARLIEST = 6, 8
_MOST_STEPS = 12
_CLEAR = 4.0
_LEAST_JERK_MPS = 0.006
"""Change from row to row of the change of the acceleration: 20 times what a smooth bob has."""
_ONSET = 0.25
_JERK_AFTER = 0.5  # a third difference stands for half a row before its place here, and rises within a row
_TOLD_FOLLOWS = 0.3

"""After the camera was out of order: have turn and velocity agreed with the IMU for long enough to be believed again?

While no step of the camera is accepted nothing bounds what the gyroscope may have done, and a step that comes alone may
itself be wrong. Steps are believed once they have agreed with each other, by way of the IMU, for `confirm_s` in one
piece: the squares of the innovations, and the turns that were missing together, have been usual.
"""

import math
from dataclasses import dataclass

import numpy as np

from perception.attitude.agreement import Innovation


@dataclass(frozen=True, kw_only=True)
class ConfirmationSettings:
    """Without an accepted step for `lost_s` all has to be confirmed, for `confirm_s`: once tilt, pace and gyroscope's
    bias have been found, after `found_s`, squares are below `usual_squares` on average, 1 being expected, and turns
    missing together no more than `most_rad`."""

    lost_s: float = 0.5
    confirm_s: float = 1.0
    usual_squares: float = 3.0
    average_s: float = 0.2
    found_s: float = 0.25
    most_rad: float = math.radians(0.9)


class Confirmation:
    """Takes note of each step that was accepted; tells whether IMU and camera are yet to agree again."""

    def __init__(self, settings: ConfirmationSettings | None = None) -> None:
        self.settings = settings or ConfirmationSettings()
        self.accepted_ns: int | None = None
        self.is_due = False
        """Whether what was known has been discarded since, because it contradicted the camera."""
        self.begin()

    def accept(self, t_after_ns: int) -> None:
        """Take note of a step that ends at `t_after_ns` and has corrected the filter."""
        self.accepted_ns, self.is_due = t_after_ns, False

    def demand(self) -> None:
        """Take note that what the IMU has measured was discarded, as it contradicted the camera; before the first step
        nothing has been confirmed that could be lost."""
        self.is_due = self.accepted_ns is not None

    def is_pending(self, now_ns: int) -> bool:
        """Return whether no step has been accepted for `lost_s`; before the first one nothing has been lost."""
        return self.accepted_ns is not None and 1e-9 * (now_ns - self.accepted_ns) > self.settings.lost_s

    def begin(self) -> None:
        """Let a run of steps begin."""
        self._run_s, self._missing_rad, self._squares = 0.0, np.zeros(3), 1.0
        self.fastest_radps = 0.0
        """How fast the camera turned in the fastest step of the run."""

    def add(self, step: Innovation) -> bool:
        """Take the next step of the run, an accepted one; return whether it is usual."""
        settings = self.settings
        self._run_s += step.duration_s
        self.fastest_radps = max(self.fastest_radps, step.seen_radps)
        if self._run_s <= settings.found_s:
            return True
        self._missing_rad = self._missing_rad + step.missing_rad
        gain = min(1.0, step.duration_s / settings.average_s)
        self._squares += gain * (step.squares - self._squares)
        return self._squares <= settings.usual_squares and float(np.linalg.norm(self._missing_rad)) <= settings.most_rad

    @property
    def is_complete(self) -> bool:
        """Return whether the run has been long enough."""
        return self._run_s >= self.settings.confirm_s

"""The turn that the IMU measured beside the turn that the camera saw, step by step: known before a window is full.

What matters of a wrong rate is the attitude that it spoils, so its integral is watched: with r_k the difference
of the two turns in one step of Δt, less the usual one b Δt (the gyroscope's bias),

    θ_k = exp(−Δt/τ) θ_(k−1) + r_k                                                             (1)

contradicts beyond a bound. No lag is looked for: that between the clocks moves θ by no more than lag times rate.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from messages.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class TurnBalanceSettings:
    """τ and the bound of (1): `most_rad` + `share` of the turn that was seen, faded in the same way.

    b is the mean over about `usual_s`, once `known_s` have been observed. What contradicted agrees again when the steps
    of the last `settled_s` differ by less than `settled_rad` together.
    """

    memory_s: float = 1.0  # about a stride, over which the camera's own errors average out
    most_rad: float = math.radians(1.7)  # above what noise and the clocks' lag leave in a stride
    share: float = 0.05  # for errors that grow with the turn: lenses, scale, lag
    usual_s: float = 6.0  # some strides: a bias changes far more slowly
    known_s: float = 1.0  # before it, the bias is not known and nothing contradicts
    settled_s: float = 0.4  # some steps in one piece, so that one lucky step is not enough
    settled_rad: float = math.radians(0.9)  # about half of `most_rad`, so that it does not contradict at once again


class Turn(NamedTuple):
    """One step of `duration_s`: the rotation vectors (3,) in B, small, that the IMU measured and the camera saw."""

    duration_s: float
    imu_rad: FloatArray
    camera_rad: FloatArray


class TurnBalance:
    """Takes one step after the other. `contradicted` holds from the step that contradicts until some that agree."""

    def __init__(self, settings: TurnBalanceSettings | None = None) -> None:
        self.settings = settings or TurnBalanceSettings()
        self.contradicted = False
        self._usual_radps: FloatArray = np.zeros(3)
        self._observed_s = 0.0
        self._difference_rad: FloatArray = np.zeros(3)
        self._camera_rad: FloatArray = np.zeros(3)
        self._recent: deque[tuple[float, FloatArray]] = deque()

    def add_provisional(self, turn: Turn) -> None:
        """Judge by the newest step, as far as it is known yet; it will come again."""
        faded = math.exp(-turn.duration_s / self.settings.memory_s)
        difference_rad = faded * self._difference_rad + self._unusual(turn)
        self._check_bound(difference_rad, faded * self._camera_rad + turn.camera_rad)

    def add(self, turn: Turn) -> bool:
        """Take a step that is known; return whether the two agree again after a contradiction."""
        settings = self.settings
        unusual_rad, faded = self._unusual(turn), math.exp(-turn.duration_s / settings.memory_s)
        self._difference_rad = faded * self._difference_rad + unusual_rad
        self._camera_rad = faded * self._camera_rad + turn.camera_rad
        self._check_bound(self._difference_rad, self._camera_rad)
        if self.contradicted:
            return self._settles(turn.duration_s, unusual_rad)
        self._observed_s = min(self._observed_s + turn.duration_s, settings.usual_s)
        self._usual_radps = self._usual_radps + unusual_rad / self._observed_s
        return False

    def interrupt(self) -> None:
        """Take note that a step is missing: what agrees again must do so in one piece."""
        self._recent.clear()

    def _unusual(self, turn: Turn) -> FloatArray:
        unusual: FloatArray = turn.imu_rad - turn.camera_rad - self._usual_radps * turn.duration_s
        return unusual

    def _check_bound(self, difference_rad: FloatArray, camera_rad: FloatArray) -> None:
        most_rad = self.settings.most_rad + self.settings.share * float(np.linalg.norm(camera_rad))
        if self._observed_s >= self.settings.known_s and float(np.linalg.norm(difference_rad)) > most_rad:
            self.contradicted = True

    def _settles(self, duration_s: float, unusual_rad: FloatArray) -> bool:
        self._recent.append((duration_s, unusual_rad))
        while sum(s for s, _ in self._recent) - self._recent[0][0] >= self.settings.settled_s:
            self._recent.popleft()
        together_rad = np.sum([rad for _, rad in self._recent], axis=0)
        long_enough = sum(s for s, _ in self._recent) >= self.settings.settled_s
        if long_enough and float(np.linalg.norm(together_rad)) < self.settings.settled_rad:
            self.contradicted = False
            self._difference_rad, self._camera_rad = np.zeros(3), np.zeros(3)
            self._recent.clear()
            return True
        return False

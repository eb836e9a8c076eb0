"""Does the IMU measure the motion that the camera sees? Judged by the innovations of the attitude filter, step by step.

With y_k the innovation of the turn in one step of Δt, as the filter has it after its biases and the ground's own turn,

    θ_k = exp(−Δt/τ) θ_(k−1) + y_k                                                             (1)

contradicts beyond a bound: what matters of a wrong rate is the attitude that it spoils. A bias that jumps is followed
before it reaches the bound; a wrong sign or axis is not. The squares of the innovations over their likely ones, of the
turn and of the travel, contradict where their fading mean is far too large.

Pictures that stand still whatever the wearer does agree with the IMU as soon as the wearer stands. Where such pictures
have contradicted, only a motion that they show can make them agree again.
"""

import enum
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from messages.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class AgreementSettings:
    """τ and the bound of (1): `most_rad` + `share` of the turn that was seen, faded in the same way.

    Squares contradict beyond `most_squares`, 1 being expected; one step counts for `most_counted_squares` at most.
    What contradicted agrees again once they have been below `usual_squares`, and the turns missing together below
    `settled_rad`, for `settled_s` in one piece. Until then it is tried every `retry_s` with a state from before.
    """

    memory_s: float = 1.0  # about a stride, over which the camera's own errors average out
    most_rad: float = math.radians(1.7)  # above what noise and the clocks' lag leave in a stride
    share: float = 0.05  # for errors that grow with the turn: lenses, scale, lag
    average_s: float = 0.4  # some steps, so that one wrong step of the odometer is not enough
    most_squares: float = 6.0
    most_counted_squares: float = 40.0
    usual_squares: float = 3.0
    settled_s: float = 0.5
    settled_rad: float = math.radians(0.9)  # about half of `most_rad`, so that it does not contradict at once again
    retry_s: float = 1.2  # to settle, and as long again
    still_radps: float = 0.02  # seen, that is no turn: above the camera's noise, below a walker's turns
    grace_s: float = 0.5  # after a contradiction began: a cause found by then may explain it, and the state is kept


class Innovation(NamedTuple):
    """What one step of `duration_s` said: the turns (3,), rotation vectors in W, that the camera saw and of which the
    gyroscope fell short, the squares of the innovations of turn and travel over their likely ones, the latter None
    where it told nothing of the travel, and whether it led to a cause that may explain what contradicts."""

    duration_s: float
    seen_rad: FloatArray
    missing_rad: FloatArray
    turn_squares: float
    travel_squares: float | None
    explained: bool = False

    @property
    def seen_radps(self) -> float:
        """Return how fast the camera turned."""
        return float(np.linalg.norm(self.seen_rad)) / self.duration_s

    @property
    def squares(self) -> float:
        """Return the larger of its squares."""
        return self.turn_squares if self.travel_squares is None else max(self.turn_squares, self.travel_squares)

    def turn_alone(self, doubtful_radps: float) -> "Innovation":
        """Return what is left where distances are wrong, and turns by a rate of `doubtful_radps`: of turns only what is
        more than that, and nothing of the travel."""
        missing = float(np.linalg.norm(self.missing_rad))
        more = max(0.0, 1.0 - doubtful_radps * self.duration_s / missing) if missing > 0.0 else 0.0
        return self._replace(missing_rad=more * self.missing_rad, travel_squares=None, explained=False)


class Advice(enum.Enum):
    """What to do with the state after a step."""

    KEEP = "keep"
    DISCARD = "discard"
    DISCARD_ALL_BUT_TURNS = "discard all but turns"


class Agreement:
    """Takes one step after the other. `contradicted` holds from the step that contradicts until some that agree, and
    `turn_contradicts` where that is by its turn, which no cause has explained in time."""

    def __init__(self, settings: AgreementSettings | None = None) -> None:
        self.settings = settings or AgreementSettings()
        self.contradicted = False
        self._turn_is_off = self._explained = False
        self._missing_rad: FloatArray = np.zeros(3)
        self._seen_rad: FloatArray = np.zeros(3)
        self._turn_squares = self._travel_squares = 1.0
        self._contradicted_s = self._untried_s = self._settled_s = 0.0
        self._settling_rad: FloatArray = np.zeros(3)
        self._still_share = 0.0
        self._settling_radps = 0.0

    def add(self, step: Innovation) -> Advice:
        """Take a step; return what to do with the state that it has corrected."""
        settings = self.settings
        faded, gain = math.exp(-step.duration_s / settings.memory_s), step.duration_s / settings.average_s
        self._missing_rad = faded * self._missing_rad + step.missing_rad
        self._seen_rad = faded * self._seen_rad + step.seen_rad
        self._turn_squares += gain * (min(step.turn_squares, settings.most_counted_squares) - self._turn_squares)
        if step.travel_squares is not None:
            counted = min(step.travel_squares, settings.most_counted_squares)
            self._travel_squares += gain * (counted - self._travel_squares)
        most_rad = settings.most_rad + settings.share * float(np.linalg.norm(self._seen_rad))
        far = float(np.linalg.norm(self._missing_rad)) > most_rad or self._turn_squares > settings.most_squares
        self._turn_is_off = self._turn_is_off or far
        self.contradicted = self.contradicted or far or self._travel_squares > settings.most_squares
        return self._advice(step) if self.contradicted else Advice.KEEP

    @property
    def missing_rad(self) -> FloatArray:
        """Return by what turn (3,) in W the gyroscope has fallen short of late: θ of (1)."""
        return self._missing_rad

    @property
    def turn_is_off(self) -> bool:
        """Return whether it is by its turn that a step has contradicted."""
        return self.contradicted and self._turn_is_off

    @property
    def turn_contradicts(self) -> bool:
        """Return whether the gyroscope is wrong: no cause has explained in time what contradicts."""
        return self._turn_is_off and not self._explained and self._contradicted_s >= self.settings.grace_s

    def may_agree(self, fastest_radps: float) -> bool:
        """Return whether pictures that have agreed since, and shown a turn of `fastest_radps` at most, may be believed:
        unless it was pictures standing still that contradicted, and they may stand still yet."""
        return self._still_share < _MOSTLY or fastest_radps > self.settings.still_radps

    def interrupt(self) -> None:
        """Take note that a step is missing: what agrees again must do so in one piece."""
        self._settled_s, self._settling_rad, self._settling_radps = 0.0, np.zeros(3), 0.0

    def _advice(self, step: Innovation) -> Advice:
        settings = self.settings
        self._contradicted_s += step.duration_s
        self._explained = (self._explained or step.explained) and self._contradicted_s < 2.0 * settings.grace_s
        self._settled_s += step.duration_s
        self._settling_rad = self._settling_rad + step.missing_rad
        self._settling_radps = max(self._settling_radps, step.seen_radps)
        if not self._is_usual(step) or float(np.linalg.norm(self._settling_rad)) > settings.settled_rad:
            self.interrupt()
        if step.squares > settings.usual_squares:
            still = step.seen_radps < settings.still_radps
            self._still_share += step.duration_s / settings.average_s * (still - self._still_share)
        long_enough = self._settled_s >= settings.settled_s * (0.5 if self._explained else 1.0)
        if long_enough and self.may_agree(self._settling_radps):
            discard = self._turn_is_off and not self._explained
            self._turn_is_off = self._explained = self.contradicted = False
            self._still_share = 0.0
            self._missing_rad, self._seen_rad = np.zeros(3), np.zeros(3)
            self._turn_squares = self._travel_squares = 1.0
            self._contradicted_s = self._untried_s = 0.0
            self.interrupt()
            return Advice.DISCARD if discard else Advice.KEEP
        self._untried_s += step.duration_s
        if self._untried_s < settings.retry_s:
            return Advice.KEEP
        self._untried_s = -settings.retry_s if self._turn_is_off else 0.0  # it first has to find the vertical again
        self._turn_squares = self._travel_squares = settings.usual_squares
        self._missing_rad, self._seen_rad = np.zeros(3), np.zeros(3)
        return Advice.DISCARD if self._turn_is_off else Advice.DISCARD_ALL_BUT_TURNS

    def _is_usual(self, step: Innovation) -> bool:
        """Return whether the innovations are usual; those of the travel tell nothing where the turn is off, and have to
        be there where it is not: an accelerometer that contradicts does not agree by the turn alone."""
        usual = max(step.turn_squares, 0.0 if self._explained else self._turn_squares)
        if not self._turn_is_off or self._explained:
            if step.travel_squares is None:
                return False
            usual = max(usual, step.travel_squares, 0.0 if self._explained else self._travel_squares)
        return usual <= self.settings.usual_squares


_MOSTLY = 0.5
"""Of the steps that contradict."""

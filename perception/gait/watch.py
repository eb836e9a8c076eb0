"""The wearer's steps, brought up to each frame: the hip's trail, its bob, the stride's phase, and which foot lands."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from messages import AnkleState, Side
from messages.arrays import FloatArray
from perception.attitude.history import AttitudeAt
from perception.gait.ankle import AnkleContacts
from perception.gait.impact import StrikeDelay
from perception.gait.own_errors import OwnErrors
from perception.gait.phase import StridePhase
from perception.gait.side import left_landed
from perception.gait.speed import Gone, WalkingSpeed
from perception.gait.steps import StepWatch
from perception.gait.trail import PERIOD_NS, HipTrail


class NextContact(NamedTuple):
    """A foot lands in `rows` of the trail after its newest, give or take `sigma`; a step takes `step` rows."""

    rows: float
    sigma: float
    step: float


class GaitWatch:
    """Follows the steps. `p_BC_m` (3,) is the left optical centre in B."""

    def __init__(self, p_BC_m: FloatArray) -> None:
        self.trail = HipTrail(p_BC_m)
        self._steps = StepWatch()
        self._ankle = AnkleContacts()
        self._phase: StridePhase | None = None
        self._speed = WalkingSpeed(0.0)
        self._strike = StrikeDelay()
        self._errors = OwnErrors()
        self._next_row = 0
        self._contact = math.nan
        self._shaken = math.nan
        self._refused = 0
        self._even_is_left = 0.0
        self._rows: dict[int, float] = {}

    def add_ankle(self, state: AnkleState) -> None:
        """Take what the ankle says of its own foot."""
        self._ankle.add(state)

    def add_frame(self, t_ns: int, at: Callable[[int], AttitudeAt | None], prosthesis: Side) -> None:
        """Come to the exposure of a frame; `at` tells the attitude of an instant of the last second."""
        if not self.trail.extend(t_ns, at):
            self._steps.clear()
        self._steps.add(self.trail)
        found = self._steps.steps
        if len(found.contacts) < 2:
            self._phase = None
            return
        if self._phase is None:
            self._begin(found.contacts[-2], found.step)
        self._follow(found.contacts, prosthesis)

    def theta_at(self, rows: FloatArray) -> FloatArray:
        """Return the phase (n,) at `rows` (n,) of the last stride or two."""
        phase = self._phase
        theta: FloatArray = np.zeros(len(rows)) if phase is None else phase.theta - phase.omega * (phase.row - rows)
        return theta

    def gone(self, rows: float) -> Gone:
        """Return how far the wearer goes, and how fast then, in `rows` of the trail after its newest; where a next
        contact is known."""
        phase = self._phase
        if phase is None:
            return self._speed.ahead(rows * _ROW_S, 0.0, 1.0)
        theta = phase.theta + phase.omega * (self.trail.count - 1 - phase.row)
        return self._speed.ahead(rows * _ROW_S, theta, phase.omega / _ROW_S)

    def next_contact(self, left: bool) -> NextContact | None:
        """Return when the left or the right foot lands next; None where no walk is seen, or not yet which foot is
        which."""
        phase = self._phase
        if phase is None or abs(self._even_is_left) < _LEAST_EVIDENCE:
            return None
        here = math.floor(phase.theta / math.pi)
        wanted = 0 if (self._even_is_left > 0.0) == left else 1
        newest = self.trail.count - 1
        for number in range(here, here + 4):
            if number % 2 != wanted:
                continue
            rows, sigma = phase.rows_to(number)
            rows += phase.row - newest
            late = self._errors.late(number, rows) + self._strike.rows
            if rows + late > 0.0:
                sigma = math.hypot(max(sigma, self._errors.sigma(rows)), self._strike.sigma)
                return NextContact(rows + late, sigma, self._step_rows(phase))
        return None

    def _step_rows(self, phase: StridePhase) -> float:
        """Return the time of a step, in rows: half of the last stride's, for left and right may differ."""
        newest = max(self._rows, default=0)
        stride = self._rows.get(newest, math.nan) - self._rows.get(newest - 2, math.nan)
        return 0.5 * stride if math.isfinite(stride) else math.pi / phase.omega

    def _begin(self, contact: float, step: float) -> None:
        self._phase = StridePhase(contact, step)
        before = self.trail.speed_W_mps(round(contact - step), round(contact)).mean(axis=0)
        self._speed = WalkingSpeed(float(np.hypot(*before)))
        self._errors = OwnErrors()
        self._next_row, self._contact, self._refused, self._even_is_left = round(contact) + 1, contact, 0, 0.0
        self._rows = {0: contact}

    def _follow(self, contacts: list[float], prosthesis: Side) -> None:
        phase, trail = self._phase, self.trail
        if phase is None:
            return
        step = math.pi / phase.omega
        ahead = _direction(trail, step)
        now = ahead @ _turned_since(trail, step)
        for row in range(self._next_row, trail.count - 1, _EVERY):
            phase.see(float(row), _motion(trail, row, ahead))
            speed_mps = float(now @ trail.speed_W_mps(row - 1, row + 2).mean(axis=0))
            self._speed.see(_EVERY * _ROW_S, phase.theta, speed_mps)
            self._next_row = row + _EVERY
        number = math.floor(phase.theta / math.pi) + 1
        rows, _ = phase.rows_to(number)
        self._errors.foretell(number, phase.row + rows, rows)
        self._take_contact(phase, contacts)
        self._take_ankle(phase, prosthesis)
        self._feel(contacts)

    def _take_contact(self, phase: StridePhase, contacts: list[float]) -> None:
        """Take the newest lowest point, once."""
        if contacts[-1] == self._contact:
            return
        before, self._contact = contacts[-2], contacts[-1]
        number = phase.contact(self._contact)
        if number is None:
            self._refused += 1
            if self._refused >= _MOST_REFUSED:
                self._phase = None
            return
        self._refused = 0
        self._errors.happened(number, self._contact)
        self._rows = {n: row for n, row in self._rows.items() if n > number - 3} | {number: self._contact}
        even = 1.0 if number % 2 == 0 else -1.0
        self._even_is_left = _KEEPS * self._even_is_left + even * left_landed(self.trail, before, self._contact)

    def _take_ankle(self, phase: StridePhase, prosthesis: Side) -> None:
        """Take the contacts of the prosthetic foot, which say which foot it is and when it struck."""
        for t_ns in self._ankle.take():
            row = self.trail.index(t_ns)
            number = phase.contact(row - self._strike.rows)
            if number is not None:
                self._strike.told(row - self._contact) if abs(row - self._contact) < _BESIDE_CONTACT else None
                even = 1.0 if number % 2 == 0 else -1.0
                self._even_is_left = even * (_SURE if prosthesis is Side.LEFT else -_SURE)

    def _feel(self, contacts: list[float]) -> None:
        """Take the strike of the newest step of which enough has followed."""
        past = [each for each in contacts if each + self._strike.rows_needed < self.trail.count]
        if past and past[-1] != self._shaken:
            self._shaken = past[-1]
            self._strike.add(self.trail, self._shaken)


def _direction(trail: HipTrail, step: float) -> FloatArray:
    """Return the direction of walking in W (2,) over the last stride."""
    mean = trail.speed_W_mps(trail.count - round(2.0 * step), trail.count).mean(axis=0)
    direction: FloatArray = mean / max(float(np.hypot(*mean)), _LEAST_SPEED_MPS)
    return direction


def _turned_since(trail: HipTrail, step: float) -> FloatArray:
    """Return the rotation (2, 2), to be multiplied from the right, by what turned from the middle of the last stride
    until now."""
    turned_rad = float(trail.rate_W_radps(trail.count - round(2.0 * step), trail.count)[:, 2].mean()) * step * _ROW_S
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    return np.array([[c, s], [-s, c]])


def _motion(trail: HipTrail, row: int, ahead: FloatArray) -> FloatArray:
    """Return the hip's motion (CHANNELS,) about a row: rise, sway, roll, pitch and yaw rate."""
    rise = trail.rise_mps(row - 1, row + 2).mean()
    speed, rate = trail.speed_W_mps(row - 1, row + 2).mean(axis=0), trail.rate_W_radps(row - 1, row + 2).mean(axis=0)
    sway = ahead[0] * speed[1] - ahead[1] * speed[0]
    roll, pitch = ahead @ rate[:2], ahead[0] * rate[1] - ahead[1] * rate[0]
    return np.array([rise, sway, roll, pitch, rate[2]])


_ROW_S = 1e-9 * PERIOD_NS
_EVERY = 2
_LEAST_SPEED_MPS = 0.05
_MOST_REFUSED = 2
_KEEPS = 0.85
_LEAST_EVIDENCE = 0.8
_SURE = 6.0
_BESIDE_CONTACT = 12.0

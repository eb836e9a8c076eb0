"""What a controller does with the set-points that it receives: trust, hold, fall back. `Follower`, the receiver's side.

    LEVEL ──── swing, a fresh set-point ───▶ TRUST ──── contact ───▶ HOLD
      ▲                                        │                      │
      ├──── nothing fresh for MAX_AGE_S ───────┘                      │
      └──── toe-off, LONGEST_STANCE_S, own sensors contradict ────────┘

LEVEL: the ankle's own curve for level ground. TRUST: in swing, the newest set-point is fresh; it is what the foot will
land with. HOLD: from contact on that set-point stays for the whole stance, whatever comes or fails to come: the ground
under the foot was seen before, and no picture shows it any more. What comes in stance is for the next contact and is
kept for that alone.

Every number moves towards the state's curve no faster than the limits allow and never leaves them, so that the ankle is
back at level ground `BACK_S` after any state has become LEVEL. Pure: no clock, no bus, no threads.
"""

import enum
import math
from typing import Final

import numpy as np

from impedance.modulation.curve import Impedance, Limits, StanceCurve
from messages.arrays import FloatArray
from messages.inputs import GaitPhase

MAX_AGE_S: Final = 0.150
"""A set-point whose ground was seen longer ago is not acted upon."""
LONGEST_STANCE_S: Final = 1.5
"""Who stands longer than this does not walk: a held set-point ends."""


class Trust(enum.Enum):
    """What the follower acts on."""

    LEVEL = "level"
    TRUST = "trust"
    HOLD = "hold"


class Follower:
    """Follows set-points within the `limits`. Times are the caller's, in ns of one clock, and never go back."""

    def __init__(self, limits: Limits, t_ns: int) -> None:
        self.state = Trust.LEVEL
        self._limits = limits
        self._t_ns = t_ns
        self._now = limits.level
        self._told: tuple[StanceCurve, int] | None = None
        self._held = limits.level
        self._landed_ns = t_ns
        self._phase = GaitPhase.UNKNOWN

    @property
    def curve(self) -> StanceCurve:
        """Return the curve over stance as far as it has come."""
        return self._now

    def take(self, points: FloatArray, t_exposure_ns: int) -> None:
        """Take a set-point (5, 3) that passed every check of its receiver; an older one than before is not taken.

        Numbers outside the limits are brought to them; one that is not finite makes the whole set-point void.
        """
        if self._told is not None and t_exposure_ns < self._told[1]:
            return
        if points.shape != self._limits.level.points.shape or not np.isfinite(points).all():
            self._told = None
            return
        self._told = self._limits.bounded(points), t_exposure_ns

    def refuse(self) -> None:
        """Take that there is no set-point now: the eyes said so, with a reason."""
        self._told = None

    def step(self, t_ns: int, phase: GaitPhase, share: float, *, contradicted: bool = False) -> Impedance:
        """Return the impedance to act with at `t_ns`, when `share` of stance is over; in swing that of contact.

        `contradicted` says that the ankle's own sensors feel other ground than the set-point was for.
        """
        seconds = 1e-9 * max(t_ns - self._t_ns, 0)
        self._t_ns = max(t_ns, self._t_ns)
        landed = phase is GaitPhase.STANCE and self._phase is not GaitPhase.STANCE
        self._phase = phase
        self._go_on(phase, landed, contradicted)
        wanted = self._limits.level if self.state is Trust.LEVEL else self._held
        self._now = self._limits.approached(self._now, wanted, seconds)
        return self._now.at(min(max(share, 0.0), 1.0) if phase is GaitPhase.STANCE and math.isfinite(share) else 0.0)

    def _go_on(self, phase: GaitPhase, landed: bool, contradicted: bool) -> None:
        """Change the state."""
        if phase is not GaitPhase.STANCE or landed:
            fresh = self._told is not None and self._t_ns - self._told[1] <= 1e9 * MAX_AGE_S
            if fresh and self._told is not None:
                self._held = self._told[0]
            self._landed_ns = self._t_ns
            known = phase is not GaitPhase.UNKNOWN and fresh
            self.state = (Trust.HOLD if landed else Trust.TRUST) if known else Trust.LEVEL
        elif self._t_ns - self._landed_ns > 1e9 * LONGEST_STANCE_S:
            self.state = Trust.LEVEL
        if contradicted:
            self.state = Trust.LEVEL
            self._told = None

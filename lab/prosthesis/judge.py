"""How well a prosthesis was told the ground: its torque against that which the true ground asks for, in one state."""

import math
from collections.abc import Sequence
from typing import Final

import msgspec

from impedance.modulation.curve import StanceCurve
from lab.prosthesis.controls import OfGround
from messages import GaitPhase
from sim_rig.prosthesis.prosthesis import Stance, VirtualProsthesis
from sim_rig.walk.footholds import Foothold

EVERY_NS: Final = 2_000_000
"""The torques are compared so often."""

NEW_STEPS: Final = 2
"""So many prosthetic steps after a change of the ground are those that count."""

MOST_OFF_M: Final = 0.03
MOST_STOP_NM_PER_KG: Final = 1.0
_SAME_SLOPE_RAD: Final = math.radians(1.0)


class JudgedStep(msgspec.Struct, kw_only=True):
    """One prosthetic stance: the ground, the number of prosthetic steps since it changed (0: it has not yet), the root
    mean square of the torque's error over stance in Nm per kg of body mass, and what was unsafe, if anything."""

    t_s: float
    kind: str
    slope_deg: float
    since_change: int
    error_nm_per_kg: float
    unsafe: list[str]

    @property
    def is_new(self) -> bool:
        """Return whether the ground has just changed."""
        return 1 <= self.since_change <= NEW_STEPS


class JudgedProsthesis:
    """Walks with a prosthesis and compares its torques, wherever it stands, with those for the true ground there."""

    def __init__(self, prosthesis: VirtualProsthesis, of_ground: OfGround) -> None:
        self.prosthesis = prosthesis
        self._of_ground = of_ground
        self._true: dict[int, StanceCurve] = {}
        self._squares: dict[int, list[float]] = {}

    def advance_to(self, t_ns: int) -> None:
        """Go on to `t_ns`."""
        prosthesis = self.prosthesis
        while prosthesis.t_ns < t_ns:
            prosthesis.advance_to(min(t_ns, prosthesis.t_ns + EVERY_NS))
            number, stance = len(prosthesis.stances) - 1, prosthesis.stances[-1]
            if prosthesis.phase is not GaitPhase.STANCE or stance.foothold is None:
                continue
            if number not in self._true:
                self._true[number] = self._of_ground.under(prosthesis.ground, stance.foothold)
            told, true = prosthesis.impedance, self._true[number].at(prosthesis.acted_share)
            state = prosthesis.angle_rad, prosthesis.rate_radps
            error_nm = told.torque_nm(*state) - true.torque_nm(*state)
            self._squares.setdefault(number, []).append((error_nm / prosthesis.mass_kg) ** 2)

    def steps(self) -> list[JudgedStep]:
        """Return the stances that are over, each on ground that has been stood on before for `since_change` steps."""
        prosthesis, start_ns = self.prosthesis, self.prosthesis.stances[0].landed_ns
        found: list[JudgedStep] = []
        since, before = 0, None
        for number, stance in enumerate(prosthesis.stances):
            foothold = stance.foothold
            if foothold is None or stance.left_ns is None or number not in self._squares:
                continue
            if before is not None:
                changed = not _same(before, foothold)
                since = 1 if changed else since + (since > 0)
            before = foothold
            squares = self._squares[number]
            found.append(
                JudgedStep(
                    t_s=1e-9 * (stance.landed_ns - start_ns),
                    kind=foothold.kind,
                    slope_deg=math.degrees(foothold.slope_rad),
                    since_change=since,
                    error_nm_per_kg=math.sqrt(math.fsum(squares) / len(squares)),
                    unsafe=unsafe(stance, prosthesis.stumbles_ns, prosthesis.mass_kg),
                )
            )
        return found


def unsafe(stance: Stance, stumbles_ns: Sequence[int], mass_kg: float) -> list[str]:
    """Return what was unsafe in a step: the swing before it met the ground, the foot stands or slid elsewhere than it
    was put, the torque was at the drive's bound, the joint was driven into an end stop."""
    found = []
    if any(0 <= stance.landed_ns - t_ns < 1e9 * _SWING_S for t_ns in stumbles_ns):
        found.append("stumble")
    off_m = [abs(x_m - stance.put_m) for x_m in (stance.flat_sole_m[:1] + stance.flat_sole_m[-1:])]
    if off_m and max(off_m) > MOST_OFF_M:
        found.append("placement")
    if stance.saturated:
        found.append("torque")
    if stance.most_stop_nm > MOST_STOP_NM_PER_KG * mass_kg:
        found.append("end stop")
    return found


def _same(before: Foothold, now: Foothold) -> bool:
    return before.kind == now.kind and abs(before.slope_rad - now.slope_rad) < _SAME_SLOPE_RAD


_SWING_S = 0.5

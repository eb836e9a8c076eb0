"""A virtual prosthesis: an impedance-controlled ankle whose foot walks over the rig's ground. Simulated time alone.

In stance the drive makes τ = K (θ_eq − θ) − B θ̇ with the impedance that its controls give; θ > 0 is dorsiflexion, by
how much the shank leans forward over the foot. In swing it leads the foot to the angle with which it is to land.
"""

import math
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np

from impedance.modulation.curve import Impedance
from messages import AnkleState, GaitPhase, Side, UserError
from sim_rig.prosthesis.foot import STEP_NS, Foot
from sim_rig.prosthesis.leg import STANCE_NS_PER_M, SWING_N_PER_M, SWING_NS_PER_M, Piece, WearersLeg
from sim_rig.prosthesis.profile import Profile
from sim_rig.walk.footholds import Foothold, Footholds
from sim_rig.walk.gait import Gait
from sim_rig.walk.scenario import Scenario

BEARS_N: Final = 60.0
"""From so much load on the foot stands for its own controller, until it bears half of that."""

MOST_NM_PER_KG: Final = 2.5
"""The drive's torque ends there."""


CONTROL_NS: Final = 2_000_000
"""The drive is given another impedance so often."""


class Controls(Protocol):
    """What decides the impedance of the drive."""

    def impedance(self, t_ns: int, phase: GaitPhase, share: float) -> Impedance:
        """Return it at `t_ns`, when the foot is in `phase` and `share` of its stance, 0 to 1, is over."""


@dataclass
class Stance:
    """One time that the foot stood, from when to when, and what it felt.

    It was put with the middle of its sole at `put_m` (x); `flat_pitch_rad` and `flat_sole_m` are pitch and x of that
    middle at each step in which heel and ball bore.
    """

    foothold: Foothold | None
    put_m: float
    landed_ns: int
    left_ns: int | None = None
    most_stop_nm: float = 0.0
    saturated: bool = False
    flat_pitch_rad: list[float] = field(default_factory=list)
    flat_sole_m: list[float] = field(default_factory=list)


class VirtualProsthesis:
    """The prosthesis of `side` on a wearer of `mass_kg` who walks `scenario`; `seed` draws its sensors' errors.

    Raises UserError for walks that leave the plane of walking: turns, a course at an angle, a ride, bumps.
    """

    def __init__(
        self,
        scenario: Scenario,
        gait: Gait,
        footholds: Footholds,
        controls: Controls,
        *,
        side: Side,
        mass_kg: float,
        seed: int,
    ) -> None:
        _check_straight(scenario, gait)
        self.ground = Profile(scenario.world)
        self.mass_kg = mass_kg
        self._controls = controls
        self._leg = WearersLeg(gait, footholds, self.ground, mass_kg, left=side is Side.LEFT)
        self._chance = np.random.default_rng([seed, 40])
        self._angle_off_rad, self._load_gain = (float(e) for e in self._chance.normal((0.0, 1.0), (0.003, 0.02)))
        x_m, z_m = self._leg.planned_ankle(None)
        self.foot = Foot(x_m, z_m, self.ground.slope_rad(x_m))
        self._step = -_SETTLING_STEPS
        self._piece: Piece | None = None
        self._shank_rad = self._shank_radps = 0.0
        self._usual_s = _USUAL_STANCE_S
        self.acted_share = 0.0
        self.impedance = controls.impedance(gait.start_ns, GaitPhase.STANCE, 0.0)
        self.torque_nm = 0.0
        self.phase = GaitPhase.STANCE
        self.stances = [Stance(None, x_m, gait.start_ns)]
        self.stumbles_ns: list[int] = []
        self.advance_to(gait.start_ns)

    @property
    def t_ns(self) -> int:
        """Return the instant that has been reached."""
        return self._leg.start_ns + self._step * STEP_NS

    @property
    def angle_rad(self) -> float:
        """Return the true angle of the ankle."""
        return self._shank_rad + self.foot.pitch_rad

    @property
    def rate_radps(self) -> float:
        """Return the true rate of the ankle."""
        return self._shank_radps + self.foot.pitch_radps

    @property
    def load_n(self) -> float:
        """Return the true load along the shank."""
        x, z = self.foot.ground_n
        return x * math.sin(self._shank_rad) + z * math.cos(self._shank_rad)

    @property
    def stance_share(self) -> float:
        """Return how much of this stance is over, 0 to 1, if it lasts as long as the one before."""
        return min(1e-9 * self._stood_ns / self._usual_s, 1.0)

    @property
    def _stood_ns(self) -> int:
        return self.t_ns - self.stances[-1].landed_ns

    def advance_to(self, t_ns: int) -> None:
        """Go on to `t_ns`."""
        while self.t_ns < t_ns:
            self._advance()

    def state(self) -> AnkleState:
        """Return what the prosthesis measures now, with its encoder's and its load cell's errors."""
        angle_noise, rate_noise, load_noise = (float(each) for each in self._chance.standard_normal(3))
        return AnkleState(
            t_sample_ns=self.t_ns,
            ankle_angle_rad=self.angle_rad + self._angle_off_rad + _ANGLE_NOISE_RAD * angle_noise,
            ankle_rate_radps=self.rate_radps + _RATE_NOISE_RADPS * rate_noise,
            load_n=self._load_gain * self.load_n + _LOAD_NOISE_N * load_noise,
            phase=self.phase,
        )

    def _advance(self) -> None:
        piece = self._piece
        if piece is None or self._step >= piece.end:
            ankle_m = self.foot.x_m, self.foot.z_m
            piece = self._piece = self._leg.piece(self._step, ankle_m, self._shank_rad, _LANDING_RAD)
        k = self._step - piece.first
        self._shank_rad, self._shank_radps = piece.shank_rad[k], piece.shank_radps[k]
        if self._step % _CONTROL_STEPS == 0 and self._step >= 0:
            self.acted_share = self.stance_share
            self.impedance = self._controls.impedance(self.t_ns, self.phase, self.acted_share)
        self.torque_nm = self._drive_nm()
        self.foot.step(self.ground, self._leg_n(piece, k), self.torque_nm, self._shank_rad, self._shank_radps)
        self._step += 1
        if self._step > 0:
            self._follow(piece, k)

    def _drive_nm(self) -> float:
        stance = self.stances[-1]
        if self.phase is GaitPhase.SWING:
            return _SWING.torque_nm(self.angle_rad, self.rate_radps)
        wanted_nm = self.impedance.torque_nm(self.angle_rad, self.rate_radps)
        most_nm = MOST_NM_PER_KG * self.mass_kg
        stance.saturated |= abs(wanted_nm) > most_nm
        return min(max(wanted_nm, -most_nm), most_nm)

    def _leg_n(self, piece: Piece, k: int) -> tuple[float, float]:
        """Return the leg's force on the ankle."""
        foot, x, z = self.foot, piece.leg_x[k], piece.leg_z[k]
        if not piece.swings:
            return x - STANCE_NS_PER_M * foot.vx_mps, z - STANCE_NS_PER_M * foot.vz_mps
        return (
            SWING_N_PER_M * (x - foot.x_m) + SWING_NS_PER_M * (piece.speed_x_mps[k] - foot.vx_mps),
            SWING_N_PER_M * (z - foot.z_m) + SWING_NS_PER_M * (piece.speed_z_mps[k] - foot.vz_mps),
        )

    def _follow(self, piece: Piece, k: int) -> None:
        """Follow the phase as the load tells it, and keep what the foot feels."""
        load_n, stance = self.load_n, self.stances[-1]
        if self.phase is GaitPhase.SWING and load_n > BEARS_N:
            if piece.swings and piece.share[k] < _LANDING_SHARE:
                self._note_stumble(piece.share[k])
                return
            self.phase = GaitPhase.STANCE
            put_m = self.foot.sole_m if piece.foothold is None else self._leg.put_m(piece.foothold)[0]
            self.stances.append(Stance(piece.foothold, put_m, self.t_ns))
        elif self.phase is GaitPhase.STANCE and load_n < 0.5 * BEARS_N and self._stood_ns > _LEAST_STANCE_NS:
            self.phase = GaitPhase.SWING
            stance.left_ns = self.t_ns
            self._usual_s = min(1e-9 * self._stood_ns, _LONGEST_STANCE_S)
        if self.phase is GaitPhase.STANCE:
            stance.most_stop_nm = max(stance.most_stop_nm, abs(self.foot.stop_nm))
            if self.foot.is_flat:
                stance.flat_pitch_rad.append(self.foot.pitch_rad)
                stance.flat_sole_m.append(self.foot.sole_m)

    def _note_stumble(self, share: float) -> None:
        """Count what a foot hits in the middle of a swing, once a swing."""
        left_ns = self.stances[-1].left_ns or 0
        if share > _LEAVING_SHARE and (not self.stumbles_ns or self.stumbles_ns[-1] < left_ns):
            self.stumbles_ns.append(self.t_ns)


def _check_straight(scenario: Scenario, gait: Gait) -> None:
    headings = gait.course(np.arange(0.0, gait.lap_s, 0.05)).heading_rad
    if scenario.ride is not None or float(np.abs(headings).max()) > 0.0:
        raise UserError(
            f"prosthesis: scenario '{scenario.name}' turns or rides; it walks straight on alone, as in mixed or ramps"
        )


_LANDING_RAD = 0.03
_SWING = Impedance(_LANDING_RAD, 60.0, 2.5)
_LEAVING_SHARE, _LANDING_SHARE = 0.15, 0.85
_SETTLING_STEPS = 1000
_CONTROL_STEPS = CONTROL_NS // STEP_NS
_LEAST_STANCE_NS = 100_000_000  # a heel that bounces has not left
_USUAL_STANCE_S, _LONGEST_STANCE_S = 0.7, 1.2
_ANGLE_NOISE_RAD, _RATE_NOISE_RADPS, _LOAD_NOISE_N = 0.0005, 0.02, 3.0

"""The foot of a prosthesis on the ground: three points with springs and dampers, an ankle with a torque, a leg's force.

The foot moves in the plane of walking: its ankle at (x, z) of W, its pitch > 0 with the toes up. What moves with the
ankle weighs `_MASS_KG`, the foot turns about it with `_INERTIA_KGM2`, which holds the drive's, against the gear's
`_JOINT_NMS_PER_RAD`. Each point meets the ground with a spring and Hunt and Crossley's damper along the normal (ASME
Journal of Applied Mechanics 42, 1975: the force is k d (1 + c ḋ), never a pull) and with Coulomb's friction through a
spring that slips (Cundall and Strack, Géotechnique 29, 1979). Steps of `STEP_S`, velocities before places
(semi-implicit Euler).
"""

import math
from dataclasses import dataclass, field
from typing import Final

from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.prosthesis.profile import Profile

STEP_NS: Final = 500_000
STEP_S: Final = 1e-9 * STEP_NS

ANKLE_ABOVE_M: Final = 0.09
ANKLE_BEHIND_M: Final = 0.06
"""Of the middle of the sole, as the rig's own legs have it."""

HEEL_M: Final = (-0.065, -ANKLE_ABOVE_M)
BALL_M: Final = (0.130, -ANKLE_ABOVE_M)
TOE_M: Final = (0.195, -ANKLE_ABOVE_M + 0.012)
POINTS_M: Final = (HEEL_M, BALL_M, TOE_M)
"""Where heel, ball and toe are from the ankle (x, z), the sole level."""

STOPS_RAD: Final = (-0.50, 0.55)
"""The joint's end stops: plantarflexed, dorsiflexed."""

_MASS_KG: Final = 4.0
_INERTIA_KGM2: Final = 0.06
_JOINT_NMS_PER_RAD: Final = 1.5
_STIFFNESS_N_PER_M: Final = 60e3
_DAMPING_S_PER_M: Final = 1.0
_SIDEWAYS_N_PER_M: Final = 40e3
_SIDEWAYS_NS_PER_M: Final = 60.0
_FRICTION: Final = 0.8
_BEARS_N: Final = 60.0
_STOP_NM_PER_RAD: Final = 3000.0
_STOP_NMS_PER_RAD: Final = 10.0


@dataclass
class Foot:
    """Place, pitch and rates of the foot; forces of the last step on heel, ball and toe (x, z), N.

    `stretch_m` is how far each point's friction spring is stretched along the ground.
    """

    x_m: float
    z_m: float
    pitch_rad: float = 0.0
    vx_mps: float = 0.0
    vz_mps: float = 0.0
    pitch_radps: float = 0.0
    stretch_m: list[float] = field(default_factory=lambda: [0.0] * len(POINTS_M))
    forces_n: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, 0.0)] * len(POINTS_M))
    stop_nm: float = 0.0

    @property
    def ground_n(self) -> tuple[float, float]:
        """Return the ground's force on the foot (x, z)."""
        return sum(x for x, _ in self.forces_n), sum(z for _, z in self.forces_n)

    @property
    def is_flat(self) -> bool:
        """Return whether heel and ball bear."""
        return min(self.forces_n[0][1], self.forces_n[1][1]) > _BEARS_N

    @property
    def sole_m(self) -> float:
        """Return x of the middle of the sole."""
        return self.x_m + ANKLE_BEHIND_M * math.cos(self.pitch_rad) + ANKLE_ABOVE_M * math.sin(self.pitch_rad)

    def step(
        self, ground: Profile, leg_n: tuple[float, float], ankle_nm: float, shank_rad: float, shank_radps: float
    ) -> None:
        """Go on by `STEP_S` under the leg's force on the ankle and the drive's torque, > 0 where it lifts the toes.

        The shank leans forward by `shank_rad`.
        """
        cos, sin = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        angle_rad, rate_radps = shank_rad + self.pitch_rad, shank_radps + self.pitch_radps
        self.stop_nm = self._at_stops(angle_rad, rate_radps)
        moment = ankle_nm + self.stop_nm - _JOINT_NMS_PER_RAD * rate_radps
        fx, fz = leg_n[0], leg_n[1] - _MASS_KG * STANDARD_GRAVITY_MPS2
        for k, (ahead_m, up_m) in enumerate(POINTS_M):
            rx, rz = ahead_m * cos - up_m * sin, ahead_m * sin + up_m * cos
            px, pz = self._on_point(ground, k, rx, rz)
            fx, fz, moment = fx + px, fz + pz, moment + rx * pz - rz * px
        self.vx_mps += STEP_S * fx / _MASS_KG
        self.vz_mps += STEP_S * fz / _MASS_KG
        self.pitch_radps += STEP_S * moment / _INERTIA_KGM2
        self.x_m += STEP_S * self.vx_mps
        self.z_m += STEP_S * self.vz_mps
        self.pitch_rad += STEP_S * self.pitch_radps

    def _on_point(self, ground: Profile, k: int, rx: float, rz: float) -> tuple[float, float]:
        met = ground.met(self.x_m + rx, self.z_m + rz)
        if met is None:
            self.stretch_m[k], self.forces_n[k] = 0.0, (0.0, 0.0)
            return 0.0, 0.0
        vx, vz = self.vx_mps - self.pitch_radps * rz, self.vz_mps + self.pitch_radps * rx
        sinking = -(vx * met.normal_x + vz * met.normal_z)
        sliding = vx * met.normal_z - vz * met.normal_x
        press = max(0.0, _STIFFNESS_N_PER_M * met.depth_m * (1.0 + _DAMPING_S_PER_M * sinking))
        most = _FRICTION * press
        self.stretch_m[k] += STEP_S * sliding
        grip = -_SIDEWAYS_N_PER_M * self.stretch_m[k] - _SIDEWAYS_NS_PER_M * sliding
        if abs(grip) > most:
            grip = math.copysign(most, grip)
            self.stretch_m[k] = -grip / _SIDEWAYS_N_PER_M
        force = (
            press * met.normal_x + grip * met.normal_z,
            press * met.normal_z - grip * met.normal_x,
        )
        self.forces_n[k] = force
        return force

    @staticmethod
    def _at_stops(angle_rad: float, rate_radps: float) -> float:
        """Return the torque of an end stop that the joint is driven into."""
        beyond = min(angle_rad - STOPS_RAD[0], 0.0) + max(angle_rad - STOPS_RAD[1], 0.0)
        return -_STOP_NM_PER_RAD * beyond - _STOP_NMS_PER_RAD * rate_radps if beyond else 0.0

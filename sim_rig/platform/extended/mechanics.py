"""The vibrating platform with something wrong in its mechanics, in MuJoCo, at ten times the laboratory's rate."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from mujoco import rollout

from impedance.body import geometry
from impedance.body.geometry import PLATFORM_GRAVITY_MPS2
from impedance.body.rigid_body import Inertia
from messages.arrays import FloatArray
from sim_rig.platform.model import DRIVE_HZ, drive_body, drive_spring, inertial, numbers
from sim_rig.platform.rig import Rig
from sim_rig.platform.run import STEP_S

SETTLE_S: Final = 1.0
_RIG: Final = Rig()
_SAME_NM: Final = 1e-6

Torques = Callable[[FloatArray], FloatArray]
"""From times (n,) in s to torques (n, 2) in N·m about I's Z and P's X."""


@dataclass(frozen=True)
class Mechanics:
    """What stands on the joint, and how.

    `lever_m` (3,) reaches from the joint to P's origin; the sensor sits at `sensor_m` (3,) in P, turned by
    `sensor_turn_rad` (3,), a rotation vector. `masses` are extra point masses (kg, place in P). The foot is rigidly
    mounted, or rocks about P's origin where `tape_hz` (about z, about x) is finite, with `tape_zeta`. `jumps` lets the
    torques act as the steps they are.
    """

    plate: Inertia
    foot: Inertia | None
    foot_origin_m: FloatArray
    lever_m: FloatArray
    sensor_m: FloatArray
    sensor_turn_rad: FloatArray
    masses: tuple[tuple[float, FloatArray], ...] = ()
    tape_hz: tuple[float, float] = (np.inf, np.inf)
    tape_zeta: float = 0.0
    jumps: bool = False

    @property
    def tared(self) -> FloatArray:
        """Return what the sensor reads (6,) of plate and extra masses, level and at rest."""
        loads = [(self.plate.mass_kg, self.plate.cog_m), *self.masses]
        force = np.array([0.0, PLATFORM_GRAVITY_MPS2 * sum(mass for mass, _ in loads), 0.0])
        moment = sum((np.cross(place, [0.0, PLATFORM_GRAVITY_MPS2 * mass, 0.0]) for mass, place in loads), np.zeros(3))
        return self.read(np.concatenate((force, moment))[:, None])[:, 0]

    def read(self, wrench: FloatArray) -> FloatArray:
        """Return what the sensor makes of a wrench (6, n) in P about P's origin."""
        R_SP = _rotation(self.sensor_turn_rad).T
        about = wrench[3:] - np.cross(self.sensor_m, wrench[:3].T).T
        return np.vstack((R_SP @ wrench[:3], R_SP @ about))


@dataclass(frozen=True)
class Fine:
    """What happened at `t_s` (n,), 3500 a second, the first second before zero.

    `angles_rad`, `rates_radps` (2, n) of the joint, `tape_rad` (2, n) of the foot against the plate about z and x, and
    the `wrench` (6, n) on the sensor, its tare not yet taken off.
    """

    t_s: FloatArray
    angles_rad: FloatArray
    rates_radps: FloatArray
    tape_rad: FloatArray
    wrench: FloatArray

    def poses(self, mechanics: Mechanics) -> tuple[FloatArray, FloatArray]:
        """Return positions and Euler angles of plate and foot in I, each (12, n) and (6, n) if there is no foot."""
        none = np.zeros_like(self.t_s)
        R_IP = geometry.rotation_IP(none, *self.angles_rad)
        plate_m = R_IP @ mechanics.lever_m
        plate = np.vstack((plate_m.T, none, self.angles_rad))
        if mechanics.foot is None:
            return plate, np.zeros((0, len(none)))
        R_PF = geometry.rotation_IP(none, *self.tape_rad)
        foot_m = plate_m + (R_IP @ R_PF) @ mechanics.foot_origin_m
        return plate, np.vstack((foot_m.T, geometry.euler_of(R_IP @ R_PF).T))


def ran(mechanics: Mechanics, torques: Torques, duration_s: float) -> Fine:
    """Return what happens from rest under the torques, from a second before zero to half a second after the end."""
    steps = round((SETTLE_S + duration_s + 0.5) / STEP_S)
    t_s = STEP_S * np.arange(steps, dtype=np.float64) - SETTLE_S
    model = mujoco.MjModel.from_xml_string(_xml(mechanics))
    data = mujoco.MjData(model)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.empty(size)
    mujoco.mj_getState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    torque_nm = torques(t_s + 0.5 * STEP_S)
    _, sensors = rollout.rollout(model, data, start, torque_nm[None])
    rows: FloatArray = np.ascontiguousarray(sensors[0].T)
    if mechanics.jumps:
        _before_jumps(rows[4:10], torque_nm)
    tape = np.zeros((2, steps))
    place = 10
    for row, hz in enumerate(mechanics.tape_hz):
        if np.isfinite(hz):
            tape[row] = rows[place]
            place += 1
    return Fine(t_s, rows[:2], rows[2:4], tape, rows[4:10])


def _before_jumps(wrench: FloatArray, torque_nm: FloatArray) -> None:
    """Let the wrench (6, n) at the beginning of a step in which the torque jumps be what it was until then.

    The step is driven by the mean of both torques, as the motion at its end asks; its beginning knows only the first.
    """
    change = np.abs(np.diff(torque_nm, axis=0)).max(axis=1) > _SAME_NM
    at = np.flatnonzero(change[:-1] & change[1:]) + 1
    at = at[at >= 2]
    wrench[:, at] = 2.0 * wrench[:, at - 1] - wrench[:, at - 2]


def _xml(m: Mechanics) -> str:
    driven = ("theta", "phi") if m.jumps else ("theta_drive", "phi_drive")
    lag = "" if m.jumps else f'dyntype="filter" dynprm="{1.0 / (2.0 * np.pi * DRIVE_HZ)!r}"'
    masses = "".join(
        f'<body pos="{numbers(place)}"><inertial mass="{mass!r}" pos="0 0 0" diaginertia="1e-9 1e-9 1e-9"/></body>'
        for mass, place in m.masses
    )
    axes = [name for name, hz in zip(("delta", "epsilon"), m.tape_hz, strict=True) if np.isfinite(hz)]
    tape_sensors = "".join(f'<jointpos joint="{name}"/>' for name in axes)
    springs = f"<tendon>{drive_spring('theta')}{drive_spring('phi')}</tendon>"
    return f"""
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 {-PLATFORM_GRAVITY_MPS2!r} 0" timestep="{STEP_S!r}" integrator="RK4">
    <flag constraint="disable" contact="disable"/>
  </option>
  <worldbody>
    <body name="upper_frame">
      <joint name="theta" axis="0 0 1" stiffness="{_RIG.stiffness_nmprad[0]!r}" damping="{_RIG.damping_nmsprad[0]!r}"/>
      <joint name="phi" axis="1 0 0" stiffness="{_RIG.stiffness_nmprad[1]!r}" damping="{_RIG.damping_nmsprad[1]!r}"/>
      {inertial(_RIG.upper_frame)}
      <body name="plate" pos="{numbers(m.lever_m)}">
        {inertial(m.plate)}
        <site name="S" pos="{numbers(m.sensor_m)}" quat="{numbers(_quaternion(m.sensor_turn_rad))}"/>
        {masses}{_foot(m)}
      </body>
    </body>
    {"" if m.jumps else drive_body("theta", "0 0 1") + drive_body("phi", "1 0 0")}
  </worldbody>
  {"" if m.jumps else springs}
  <actuator><general joint="{driven[0]}" {lag}/><general joint="{driven[1]}" {lag}/></actuator>
  <sensor>
    <jointpos joint="theta"/><jointpos joint="phi"/><jointvel joint="theta"/><jointvel joint="phi"/>
    <force site="S"/><torque site="S"/>{tape_sensors}
  </sensor>
</mujoco>"""


def _foot(m: Mechanics) -> str:
    """Return the foot; on tape its frame is aligned with the plate's as it stands there at rest."""
    if m.foot is None:
        return ""
    own = m.foot.seen_from(np.eye(3), m.foot_origin_m)
    about = own.vector[4:7]
    weight = own.mass_kg * PLATFORM_GRAVITY_MPS2 * own.cog_m
    joints = ""
    for name, axis, moment, load, hz in (
        ("delta", "0 0 1", about[2], weight[0], m.tape_hz[0]),
        ("epsilon", "1 0 0", about[0], -weight[2], m.tape_hz[1]),
    ):
        if np.isfinite(hz):
            w = 2.0 * np.pi * hz
            stiffness, damping = float(moment * w**2), float(2.0 * m.tape_zeta * moment * w)
            rest = float(load) / stiffness
            joints += (
                f'<joint name="{name}" axis="{axis}" stiffness="{stiffness!r}" damping="{damping!r}" '
                f'springref="{rest!r}"/>'
            )
    return f'<body name="foot">{joints}{inertial(own)}</body>'


def _quaternion(turn_rad: FloatArray) -> tuple[float, ...]:
    angle = float(np.linalg.norm(turn_rad))
    if angle == 0.0:
        return (1.0, 0.0, 0.0, 0.0)
    return (float(np.cos(0.5 * angle)), *(np.sin(0.5 * angle) / angle * turn_rad).tolist())


def _rotation(turn_rad: FloatArray) -> FloatArray:
    w, x, y, z = _quaternion(turn_rad)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )

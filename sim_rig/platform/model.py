"""The platform as a MuJoCo model, with the sensors of the laboratory and exact ones beside them."""

from typing import Final

import mujoco
import numpy as np

from impedance.body.geometry import PLATFORM_GRAVITY_MPS2
from impedance.body.rigid_body import Inertia
from messages.arrays import FloatArray
from sim_rig.platform.rig import Rig

SENSORS: Final = {
    "angles": slice(0, 2),
    "rates": slice(2, 4),
    "wrench": slice(4, 10),
    "specific_force": slice(10, 13),
    "w": slice(13, 16),
    "alpha_I": slice(16, 19),
}
"""Where each quantity stands in a row of sensor data: joint angles and rates about Z and X; the wrench (f, T) on what
is above the sensor, a − g and ω at P's origin, all in P; and α in I."""


DRIVE_HZ: Final = 60.0
DRIVE_DAMPING_RATIO: Final = 0.7
DRIVE_KGM2: Final = 0.02
"""The moving part of either actuator, as seen at the joint, and how it is coupled to the platform: assumed."""


def model_of(rig: Rig, step_s: float, direct: bool) -> mujoco.MjModel:
    """Return the model, integrated by Runge and Kutta's fourth order in steps of `step_s`.

    The two controls are torques about Z and X. `direct` ones act on the joints as the steps they are. Otherwise a
    control passes a first-order lag of 60 Hz, moves the actuator's own inertia, and that acts through a damped spring
    of 60 Hz: the torque on the platform is continuous and smooth in time.
    """
    kz, kx = rig.stiffness_nmprad
    cz, cx = rig.damping_nmsprad
    foot = (
        "" if rig.foot is None else f'<body name="foot" pos="{numbers(rig.foot_origin_m)}">{inertial(rig.foot)}</body>'
    )
    driven = ("theta", "phi") if direct else ("theta_drive", "phi_drive")
    lag = "" if direct else f'dyntype="filter" dynprm="{1.0 / (2.0 * np.pi * DRIVE_HZ)!r}"'
    model: mujoco.MjModel = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 {-PLATFORM_GRAVITY_MPS2!r} 0" timestep="{step_s!r}" integrator="RK4">
    <flag constraint="disable" contact="disable"/>
  </option>
  <worldbody>
    <body name="upper_frame">
      <joint name="theta" axis="0 0 1" stiffness="{kz!r}" damping="{cz!r}"/>
      <joint name="phi" axis="1 0 0" stiffness="{kx!r}" damping="{cx!r}"/>
      {inertial(rig.upper_frame)}
      <body name="plate" pos="{numbers(rig.lever_m)}">
        {inertial(rig.plate)}
        <site name="P"/>
        {foot}
      </body>
    </body>
    {"" if direct else drive_body("theta", "0 0 1") + drive_body("phi", "1 0 0")}
  </worldbody>
  {"" if direct else f"<tendon>{drive_spring('theta')}{drive_spring('phi')}</tendon>"}
  <actuator>
    <general joint="{driven[0]}" {lag}/>
    <general joint="{driven[1]}" {lag}/>
  </actuator>
  <sensor>
    <jointpos joint="theta"/><jointpos joint="phi"/>
    <jointvel joint="theta"/><jointvel joint="phi"/>
    <force site="P"/><torque site="P"/>
    <accelerometer site="P"/><gyro site="P"/>
    <frameangacc objtype="site" objname="P"/>
  </sensor>
</mujoco>""")
    return model


def drive_body(axis: str, direction: str) -> str:
    """Return the MJCF of an actuator's own inertia, which turns about `direction`."""
    moment = repr(DRIVE_KGM2)
    return (
        f'<body name="{axis}_drive"><joint name="{axis}_drive" axis="{direction}"/>'
        f'<inertial mass="1" pos="0 0 0" diaginertia="{moment} {moment} {moment}"/></body>'
    )


def drive_spring(axis: str) -> str:
    """Return the MJCF of the damped spring between an actuator and its axis."""
    w_radps = 2.0 * np.pi * DRIVE_HZ
    stiffness, damping = DRIVE_KGM2 * w_radps**2, 2.0 * DRIVE_DAMPING_RATIO * DRIVE_KGM2 * w_radps
    return (
        f'<fixed name="{axis}_spring" stiffness="{stiffness!r}" damping="{damping!r}" springlength="0">'
        f'<joint joint="{axis}" coef="-1"/><joint joint="{axis}_drive" coef="1"/></fixed>'
    )


def inertial(body: Inertia) -> str:
    """Return the MJCF of a body's inertia about its centre of gravity."""
    J = body.inertia_kgm2
    full = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    return f'<inertial mass="{float(body.mass_kg)!r}" pos="{numbers(body.cog_m)}" fullinertia="{numbers(full)}"/>'


def numbers(values: FloatArray | tuple[float, ...]) -> str:
    """Return numbers as MJCF writes them, to the last bit."""
    return " ".join(repr(float(value)) for value in values)

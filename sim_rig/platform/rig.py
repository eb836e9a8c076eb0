"""The vibrating platform as it stands in the laboratory: bodies, springs, noise, sampling.

Source: the thesis's chapter 2, §2.2 and the references of its Tables 1 and 2. What it does not print is assumed here,
and says so.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from impedance.body.rigid_body import Inertia
from messages.arrays import FloatArray

MOTION_HZ: Final = 350.0
DURATION_S: Final = 60.0

PLATE: Final = Inertia.about(
    4.64,
    np.array([0.00503, -0.02620, -0.00097]),
    np.array([0.04040, 0.11807, 0.10527, 0.00137, -0.00047, 0.00813]),
)
FOOT: Final = Inertia.about(22.68, np.array([0.0, -0.0907, 0.0]), np.array([0.0811, 0.1270, 0.1372, 0.0, 0.0, 0.0]))
"""The calibrated weight. The thesis's §2.2.1 prints its products of inertia equal to its moments, which no body has;
Table 2's zeros are taken."""

UPPER_FRAME: Final = Inertia.about(9.0, np.array([0.010, 0.050, 0.005]), np.array([0.9, 0.9, 0.3, -0.2, -0.1, -0.1]))
"""What turns with the plate below the sensor, unseen by it; here in P's axes about the joint. Its printed products of
inertia (0.2, 0.1, 0.1) break the triangle inequality as entries of the tensor; as ∫ yz dm and so on they do not."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one sample of normally distributed noise."""

    position_m: float
    angle_rad: float
    force_n: float
    torque_nm: float


THESIS_NOISE: Final = Noise(position_m=1e-4, angle_rad=10e-6, force_n=0.1, torque_nm=0.05)


@dataclass(frozen=True)
class Rig:
    """A universal joint with springs, the upper frame on it, then sensor, plate and perhaps a foot.

    Pairs are (about I's Z, about P's X). `foot` is known in F, whose axes are P's and whose origin is at
    `foot_origin_m` (3,) in P. Assumed: the joint lies 0.12 m below the surface, and 60 N·m·s/rad of damping on either
    axis, ratios of 0.2 to 0.35 as linear drives and their guides plausibly have, which keep the resonances low.
    """

    plate: Inertia = PLATE
    foot: Inertia | None = None
    upper_frame: Inertia = UPPER_FRAME
    foot_origin_m: tuple[float, float, float] = (0.0, 0.1814, 0.0)
    joint_to_surface_m: float = 0.12
    stiffness_nmprad: tuple[float, float] = (float(np.rad2deg(270.0)), float(np.rad2deg(150.0)))
    damping_nmsprad: tuple[float, float] = (60.0, 60.0)

    @property
    def above_sensor(self) -> Inertia:
        """Return what the force plate carries, as one body in P."""
        if self.foot is None:
            return self.plate
        return self.plate.joined(self.foot.seen_from(np.eye(3), np.array(self.foot_origin_m)))

    @property
    def lever_m(self) -> FloatArray:
        """Return P's origin from the joint (3,), in P."""
        return np.array([0.0, self.joint_to_surface_m, 0.0])

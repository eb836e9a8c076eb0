"""One platform in one laboratory: its bodies, its noise, and the random torque steps of its actuators."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from impedance.body.rigid_body import Inertia
from messages.arrays import FloatArray
from sim_rig.platform.extended.mechanics import Torques
from sim_rig.platform.rig import THESIS_NOISE
from sim_rig.platform.run import STEP_S

_SETTLING_S: Final = 2.0  # of steps before the first sample, and after the last one
_HALF_S: Final = (-0.5 * STEP_S, 0.5 * STEP_S)


@dataclass(frozen=True)
class PlatformUnit:
    """One unit in one laboratory. `known`: an earlier run measured the plate's inertia.

    `amplitude` and `noise_factor` multiply the torques' span and the thesis's noise; `declared` noise is written into
    the recording's settings, `coloured` noise is that of a force plate at rest, else it is white.
    """

    plate: Inertia
    known: bool
    foot: Inertia | None
    foot_origin_m: FloatArray
    joint_to_surface_m: float
    amplitude: float
    update_hz: float
    noise_factor: float
    declared: bool
    coloured: bool

    @property
    def pose_noise(self) -> FloatArray:
        """Return the standard deviations (6,) of a pose."""
        return self.noise_factor * np.repeat((THESIS_NOISE.position_m, THESIS_NOISE.angle_rad), 3)

    @property
    def wrench_noise(self) -> FloatArray:
        """Return the standard deviations (6,) of a wrench."""
        return self.noise_factor * np.repeat((THESIS_NOISE.force_n, THESIS_NOISE.torque_nm), 3)


def stepped(random: np.random.Generator, update_hz: float, span_nm: FloatArray, duration_s: float) -> Torques:
    """Return torques drawn anew `update_hz` times a second within ± `span_nm` (2,), and held.

    A step of the mechanics gets the mean over it, so that no jump waits for the next one.
    """
    levels = random.uniform(-1.0, 1.0, (int((duration_s + 2.0 * _SETTLING_S) * update_hz) + 2, 2)) * span_nm
    drawn_s = np.arange(len(levels) + 1) / update_hz - _SETTLING_S
    sums = np.vstack((np.zeros(2), np.cumsum(levels, axis=0))) / update_hz

    def torques(t_s: FloatArray) -> FloatArray:
        ends = [np.column_stack([np.interp(t_s + half_s, drawn_s, each) for each in sums.T]) for half_s in _HALF_S]
        mean: FloatArray = (ends[1] - ends[0]) / STEP_S
        return mean

    return torques

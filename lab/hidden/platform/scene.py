"""The nuisances of a platform case: plate, foot, excitation, and the noise of its instruments."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from impedance.body.rigid_body import Inertia
from lab.hidden.case import log_uniform
from lab.hidden.platform.mechanics import STEP_S, Torques
from messages.arrays import FloatArray
from sim_rig.platform.rig import PLATE

SPAN_NM: Final = np.array([220.0, 120.0])
_POSITION_M, _ANGLE_RAD, _FORCE_N, _TORQUE_NM = 1e-4, 1e-5, 0.1, 0.05
_HALF_S: Final = (-0.5 * STEP_S, 0.5 * STEP_S)
_TONES: Final = 24
_TONES_HZ: Final = (0.5, 32.0)


@dataclass(frozen=True)
class Scene:
    """One unit in one laboratory. `known`: an earlier run told the plate's inertia. Noise is that of one sample."""

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
        return self.noise_factor * np.repeat((_POSITION_M, _ANGLE_RAD), 3)

    @property
    def wrench_noise(self) -> FloatArray:
        """Return the standard deviations (6,) of a wrench."""
        return self.noise_factor * np.repeat((_FORCE_N, _TORQUE_NM), 3)

    @property
    def nuisance(self) -> dict[str, float | bool | str]:
        """Return what was drawn, for a reader."""
        return {
            "foot_kg": 0.0 if self.foot is None else self.foot.mass_kg,
            "plate_known": self.known,
            "joint_to_surface_m": self.joint_to_surface_m,
            "amplitude": self.amplitude,
            "update_hz": self.update_hz,
            "noise_factor": self.noise_factor,
            "noise_declared": self.declared,
            "noise_colour": "plate at rest" if self.coloured else "white",
        }


def scene(random: np.random.Generator, *, with_foot: bool | None, known: bool | None) -> Scene:
    """Return a unit; `with_foot` and `known` where the case prescribes them."""
    stands = bool(random.random() < 0.6) if with_foot is None else with_foot
    told = bool(random.integers(2)) if known is None else known
    foot, origin_m = _foot(random)
    return Scene(
        plate=_plate(random),
        known=told or stands,
        foot=foot if stands else None,
        foot_origin_m=origin_m,
        joint_to_surface_m=round(float(random.uniform(0.08, 0.16)), 4),
        amplitude=log_uniform(random, 0.6, 1.3),
        update_hz=float(random.uniform(28.0, 70.0)),
        noise_factor=log_uniform(random, 0.5, 2.0),
        declared=bool(random.integers(2)),
        coloured=bool(random.integers(2)),
    )


def stepped(random: np.random.Generator, update_hz: float, span_nm: FloatArray, duration_s: float) -> Torques:
    """Return torques drawn anew `update_hz` times a second within ± `span_nm` (2,), and held.

    A step of the mechanics gets the mean over it, so that no jump waits for the next one.
    """
    levels = random.uniform(-1.0, 1.0, (int((duration_s + 4.0) * update_hz) + 2, 2)) * span_nm
    drawn_s = np.arange(len(levels) + 1) / update_hz - 2.0
    sums = np.vstack((np.zeros(2), np.cumsum(levels, axis=0))) / update_hz

    def torques(t_s: FloatArray) -> FloatArray:
        ends = [np.column_stack([np.interp(t_s + half_s, drawn_s, each) for each in sums.T]) for half_s in _HALF_S]
        mean: FloatArray = (ends[1] - ends[0]) / STEP_S
        return mean

    return torques


def tones(random: np.random.Generator, span_nm: FloatArray) -> Torques:
    """Return torques of two dozen tones of random frequency and phase, as strong as steps of ± `span_nm` (2,)."""
    f_hz = random.uniform(*_TONES_HZ, (_TONES, 2))
    phase = random.uniform(0.0, 2.0 * np.pi, (_TONES, 2))
    size = span_nm / np.sqrt(3.0) * np.sqrt(2.0 / _TONES)

    def torques(t_s: FloatArray) -> FloatArray:
        return np.column_stack(
            [size[k] * np.sin(2.0 * np.pi * np.outer(t_s, f_hz[:, k]) + phase[:, k]).sum(axis=1) for k in (0, 1)]
        )

    return torques


def _plate(random: np.random.Generator) -> Inertia:
    """Return the plate of the thesis's Table 1, scaled in mass and size, its centre of gravity shifted."""
    mass, length = random.uniform(0.85, 1.2), random.uniform(0.95, 1.08)
    cog_m = length * PLATE.cog_m + random.uniform(-0.004, 0.004, 3)
    return Inertia.about(mass * PLATE.mass_kg, cog_m, mass * length**2 * PLATE.about_cog()).checked()


def _foot(random: np.random.Generator) -> tuple[Inertia, FloatArray]:
    """Return a block of 4 to 25 kg, not quite even, and its frame's origin on top of it."""
    mass_kg = log_uniform(random, 4.0, 25.0)
    a, b, h = random.uniform((0.15, 0.12, 0.08), (0.28, 0.25, 0.2))
    cog_m = np.array([0.0, -0.5 * h, 0.0]) + random.uniform(-0.01, 0.01, 3)
    diagonal = mass_kg / 12.0 * np.array([b**2 + h**2, a**2 + b**2, a**2 + h**2])
    mixed = random.uniform(-0.04, 0.04, 3) * diagonal.min()
    origin_m = np.round(np.array([0.0, h, 0.0]) + random.uniform(-0.02, 0.02, 3) * np.array([1.0, 0.0, 1.0]), 4)
    return Inertia.about(mass_kg, cog_m, np.concatenate((diagonal, mixed))).checked(), origin_m

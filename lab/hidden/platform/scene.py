"""The nuisances of a platform case: plate, foot, excitation, and the noise of its instruments."""

from typing import Final

import numpy as np

from impedance.body.rigid_body import Inertia
from lab.hidden.case import log_uniform
from messages.arrays import FloatArray
from sim_rig.platform.extended.mechanics import Torques
from sim_rig.platform.extended.unit import PlatformUnit
from sim_rig.platform.rig import PLATE

_TONES: Final = 24
_TONES_HZ: Final = (0.5, 32.0)


def nuisance(unit: PlatformUnit) -> dict[str, float | bool | str]:
    """Return what was drawn of a unit, for a reader."""
    return {
        "foot_kg": 0.0 if unit.foot is None else unit.foot.mass_kg,
        "plate_known": unit.known,
        "joint_to_surface_m": unit.joint_to_surface_m,
        "amplitude": unit.amplitude,
        "update_hz": unit.update_hz,
        "noise_factor": unit.noise_factor,
        "noise_declared": unit.declared,
        "noise_colour": "plate at rest" if unit.coloured else "white",
    }


def platform_unit(random: np.random.Generator, *, with_foot: bool | None, known: bool | None) -> PlatformUnit:
    """Return a unit; `with_foot` and `known` where the case prescribes them."""
    stands = bool(random.random() < 0.6) if with_foot is None else with_foot
    told = bool(random.integers(2)) if known is None else known
    foot, origin_m = _foot(random)
    return PlatformUnit(
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

"""The true impedance of a simulated person, as an identification should come to it."""

import numpy as np

from impedance.ankle.table import AnkleTable, AxisTable
from impedance.ankle.trial import Perturbation
from messages.arrays import FloatArray
from sim_rig.platform.ankle import AnkleRun
from sim_rig.platform.ankle_known import FLAT_FOOT


def true_table(run: AnkleRun, points: int = 29) -> AnkleTable:
    """Return the true impedance as the table that an identification of the run should come to; no interval."""
    stance = np.linspace(*FLAT_FOOT, points)
    K, B, across = run.person.stiffness(stance), run.person.damping(stance), run.person.cross_stiffness(stance)
    moment, rest = run.person.usual_moment(stance), true_equilibrium(run, stance)
    first, second = (
        AxisTable(
            *(K[:, axis].tolist(),) * 3,
            *(B[:, axis].tolist(),) * 3,
            *(float(run.foot_about_ankle_kgm2[axis]),) * 3,
            [],
            *(0.0, 0.0),
            *(moment[:, axis].tolist(),) * 3,
            *(rest[:, axis].tolist(),) * 3,
            *(across.tolist(),) * 3,
        )
        for axis in range(2)
    )
    settings = run.settings
    return AnkleTable(
        manoeuvre=settings.manoeuvre,
        ground_slope_deg=settings.ground_slope_deg,
        subject=settings.subject.code,
        body_mass_kg=settings.subject.mass_kg,
        perturbed_cycles=sum(kind is not Perturbation.NONE for kind in run.perturbation),
        stance_percent=(100.0 * stance).round(6).tolist(),
        dorsi_plantarflexion=first,
        inversion_eversion=second,
    )


def true_equilibrium(run: AnkleRun, stance: FloatArray) -> FloatArray:
    """Return (k, 2): the angle of foot against shank, rad, at which the ankle's spring makes no moment."""
    slope = np.array([np.deg2rad(run.settings.ground_slope_deg), 0.0])
    person = run.person
    moment = person.usual_moment(stance)
    rest: FloatArray = slope - person.usual_shank(stance) - moment / person.stiffness(stance)
    return rest if person.shoe is None else rest - moment / person.shoe.stiffness

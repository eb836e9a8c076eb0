"""The true impedance of a simulated person, as an identification should come to it."""

import numpy as np

from impedance.ankle.table import AnkleTable, AxisTable, table_with
from messages.arrays import FloatArray
from sim_rig.platform.ankle import AnkleRun
from sim_rig.platform.ankle_known import FLAT_FOOT


def true_table(run: AnkleRun, points: int = 29) -> AnkleTable:
    """Return the true impedance as the table that an identification of the run should come to; no interval."""
    stance = np.linspace(*FLAT_FOOT, points)
    K, B, across = run.person.stiffness(stance), run.person.damping(stance), run.person.cross_stiffness(stance)
    moment, rest = run.person.usual_moment(stance), true_equilibrium(run, stance)
    axes = [
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
    ]
    return table_with(axes, stance, run.settings, run.perturbation)


def true_equilibrium(run: AnkleRun, stance: FloatArray) -> FloatArray:
    """Return (k, 2): the angle of foot against shank, rad, at which the ankle's spring makes no moment."""
    slope = np.array([np.deg2rad(run.settings.ground_slope_deg), 0.0])
    person = run.person
    moment = person.usual_moment(stance)
    rest: FloatArray = slope - person.usual_shank(stance) - moment / person.stiffness(stance)
    return rest if person.shoe is None else rest - moment / person.shoe.stiffness

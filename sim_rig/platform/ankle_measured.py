"""What the instruments make of a simulated trial: noise, and a wrench that is late."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from impedance.ankle.trial import AnkleTrial
from sim_rig.platform.ankle import AnkleRun
from sim_rig.platform.rig import THESIS_NOISE


@dataclass(frozen=True)
class AnkleNoise:
    """Standard deviations of white noise; `snr_db`, if any, sets the moments' noise from the perturbed moment
    instead."""

    plate_rad: float = THESIS_NOISE.angle_rad
    shank_rad: float = 3e-4
    foot_rad: float = 3e-4
    heel_m: float = 1e-4
    force_n: float = THESIS_NOISE.force_n
    torque_nm: float = THESIS_NOISE.torque_nm
    snr_db: float | None = None


SENSOR_NOISE: Final = AnkleNoise()
AT_15_DB: Final = AnkleNoise(snr_db=15.0)


def measured(run: AnkleRun, noise: AnkleNoise, seed: int) -> AnkleTrial:
    """Return the trial that the sensors record of the run; the signal of `snr_db` is the perturbed intrinsic moment."""
    rng = np.random.default_rng((seed, 3))
    torque_nm = np.full(3, noise.torque_nm)
    if noise.snr_db is not None:
        signal = np.sqrt((run.intrinsic_nm[run.perturbed] ** 2).mean(axis=0))
        torque_nm[[2, 0]] = signal / 10.0 ** (noise.snr_db / 20.0)
    deviations = np.concatenate((np.full(3, noise.force_n), torque_nm))
    trial = AnkleTrial(
        settings=run.settings,
        cycle=run.cycle,
        t_s=run.t_s,
        stance=run.stance,
        plate_rad=run.plate_rad + noise.plate_rad * rng.standard_normal(run.plate_rad.shape),
        shank_rad=run.shank_rad + noise.shank_rad * rng.standard_normal(run.shank_rad.shape),
        wrench=run.wrench + deviations * rng.standard_normal(run.wrench.shape),
        perturbation=run.perturbation,
        onset_s=run.onset_s,
    )
    if run.person.shoe is None:
        return trial
    return replace(
        trial,
        foot_rad=run.foot_rad + noise.foot_rad * rng.standard_normal(run.foot_rad.shape),
        heel_rise_m=run.heel_rise_m + noise.heel_m * rng.standard_normal(len(run.t_s)),
    )


def late(run: AnkleRun, delay_s: float) -> AnkleRun:
    """Return the run with its wrench stamped late by a constant time."""
    wrench = run.wrench.copy()
    for cycle in np.unique(run.cycle):
        own = run.cycle == cycle
        wrench[own] = CubicSpline(run.t_s[own], run.wrench[own])(run.t_s[own] - delay_s)
    return replace(run, wrench=wrench)

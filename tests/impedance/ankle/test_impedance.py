"""The ankle's impedance: simulated people whose stiffness and damping are known."""

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from impedance.ankle.impedance import AnkleImpedance, identify
from impedance.ankle.motion import bodies_of, motion_of
from impedance.ankle.shapes import spline
from impedance.ankle.smoothing import smooth_derivatives
from impedance.ankle.trial import AnkleTrial, Perturbation
from messages.arrays import FloatArray
from messages.errors import UserError
from sim_rig.platform.ankle import AnkleRun, walk
from sim_rig.platform.ankle_measured import AT_15_DB, AnkleNoise, measured
from sim_rig.platform.ankle_person import person
from sim_rig.platform.rig import PLATE

SEED = 21


@pytest.fixture(scope="module")
def run() -> AnkleRun:
    return walk(person(SEED), [Perturbation.RANDOM] * 10, SEED)


@pytest.fixture(scope="module")
def found(run: AnkleRun) -> AnkleImpedance:
    return identify(measured(run, AT_15_DB, SEED))


def test_stiffness_and_damping_come_back_at_15_db(run: AnkleRun, found: AnkleImpedance) -> None:
    for axis, one in enumerate(found.axes):
        for curve, truth in (
            (one.stiffness, run.person.stiffness(found.stance)[:, axis]),
            (one.damping, run.person.damping(found.stance)[:, axis]),
        ):
            assert np.abs(curve.value / truth - 1.0).mean() < 0.08
            assert np.abs((curve.value - truth) / curve.deviation).max() < 5.0


def test_the_inertia_keeps_to_the_data_and_narrows_what_was_known(run: AnkleRun, found: AnkleImpedance) -> None:
    for axis, one in enumerate(found.axes):
        truth = run.foot_about_ankle_kgm2[axis]
        assert abs(one.inertia_kgm2 - truth) < 4.0 * one.inertia_deviation_kgm2
        assert one.inertia_deviation_kgm2 < 0.3 * truth


def test_drift_and_reflex_are_seen_and_taken_off(found: AnkleImpedance) -> None:
    for one in found.axes:
        assert one.drift_nm > 0.3
        assert one.accounted > 0.9


def test_the_simulated_wrench_is_the_rigid_bodies_and_the_ankle() -> None:
    """The generator differentiates momenta; the estimator's equations must account for every newton metre of it."""
    quiet = walk(person(3), [Perturbation.RANDOM] * 2, 3)
    trial = measured(quiet, AnkleNoise(0.0, 0.0, 0.0, 0.0), 3)
    exact = _with_exact_bodies(trial, quiet)
    motion = motion_of(exact, bodies_of(exact.settings))
    d = quiet.foot_about_ankle_kgm2
    intrinsic = quiet.intrinsic_nm[motion.rows] - d * quiet.acceleration[motion.rows]
    rest = motion.moment - intrinsic - quiet.person.usual_moment(quiet.stance[motion.rows])
    for axis in range(2):
        slope = np.polyfit(quiet.acceleration[motion.rows, axis], rest[:, axis], 1)[0]
        assert abs(slope) < 0.15 * quiet.foot_about_ankle_kgm2[axis]


def test_no_perturbation_tells_nothing() -> None:
    trial = measured(walk(person(1), [Perturbation.NONE] * 2, 1), AnkleNoise(), 1)
    with pytest.raises(UserError, match="no cycle is perturbed"):
        identify(trial)


def test_ramps_are_used_only_before_the_reflex() -> None:
    """What happens 0.1 s and more after the onset may be anything: the estimate does not see it."""
    run = walk(person(4), [Perturbation.RAMP] * 6 + [Perturbation.NONE] * 4, 4)
    trial = measured(run, AnkleNoise(), 4)
    late = np.nan_to_num(run.onset_s, nan=np.inf)[run.cycle] + 0.1
    spoilt = trial.wrench + 50.0 * (run.t_s > late)[:, None]
    changed = replace(trial, wrench=spoilt)
    for one, other in zip(identify(trial).axes, identify(changed).axes, strict=True):
        np.testing.assert_allclose(one.stiffness.value, other.stiffness.value, rtol=1e-9)


def test_smooth_derivatives_are_exact_in_their_band_and_blind_above() -> None:
    t = np.arange(700) / 350.0
    w = 2.0 * np.pi * 20.0
    inside = slice(50, -50)
    got = smooth_derivatives(np.sin(w * t)[:, None], 350.0, (42.0, 65.0))[:, inside, 0]
    for order, truth in enumerate((np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t))):
        np.testing.assert_allclose(got[order], truth[inside], atol=2e-3 * w**order)
    high = smooth_derivatives(np.sin(2.0 * np.pi * 120.0 * t)[:, None], 350.0, (42.0, 65.0))[:, inside, 0]
    assert np.abs(high[0]).max() < 0.05


def test_splines_add_up_to_one_and_hold_a_cubic() -> None:
    s = np.linspace(0.1, 0.8, 60)
    shapes = spline(s, (0.1, 0.8), 8)
    np.testing.assert_allclose(shapes.sum(axis=1), 1.0, atol=1e-12)
    cubic = 1.0 - 2.0 * s + 3.0 * s**3
    np.testing.assert_allclose(shapes @ np.linalg.lstsq(shapes, cubic)[0], cubic, atol=1e-10)


def _with_exact_bodies(trial: AnkleTrial, run: AnkleRun) -> AnkleTrial:
    def exact(mass_kg: float, cog: FloatArray, J: FloatArray) -> dict[str, Any]:
        six = J[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
        return {"mass_kg": mass_kg, "cog_m": tuple(cog.tolist()), "inertia_kgm2": tuple(six.tolist())}

    settings, who = trial.settings, run.person
    plate = msgspec.structs.replace(settings.plate, **exact(PLATE.mass_kg, PLATE.cog_m, PLATE.inertia_kgm2))
    foot = msgspec.structs.replace(settings.foot, **exact(who.foot_kg, who.foot_cog_P_m, who.foot_kgm2))
    ankle = msgspec.structs.replace(settings.ankle, in_plate_m=tuple(who.ankle_P_m.tolist()))
    settings = msgspec.structs.replace(settings, plate=plate, foot=foot, ankle=ankle)
    return replace(trial, settings=settings)

"""The foot on shoe and heel pad, stiffness across the axes, the tare: hidden in the simulation, and found again."""

from dataclasses import replace

import numpy as np
import pytest

from impedance.ankle.impedance import AnkleImpedance, identify
from impedance.ankle.motion import bodies_of, motion_of
from impedance.ankle.trial import AnkleTrial, Perturbation, in_flat_foot, load_trial, save_trial
from messages.arrays import FloatArray
from messages.errors import UserError
from sim_rig.platform.ankle import AnkleRun, walk
from sim_rig.platform.ankle_measured import SENSOR_NOISE, AnkleNoise, measured
from sim_rig.platform.ankle_person import person
from sim_rig.platform.ankle_truth import true_equilibrium

SEED = 6


@pytest.fixture(scope="module")
def shod() -> AnkleRun:
    return walk(replace(person(SEED, shod=True), cross_share=0.15), [Perturbation.RANDOM] * 8, SEED)


@pytest.fixture(scope="module")
def trial(shod: AnkleRun) -> AnkleTrial:
    return measured(shod, SENSOR_NOISE, SEED)


@pytest.fixture(scope="module")
def found(trial: AnkleTrial) -> AnkleImpedance:
    return identify(trial)


def stiffness_errors(run: AnkleRun, found: AnkleImpedance) -> FloatArray:
    """Return the mean error (2,) as a share."""
    true = run.person.stiffness(found.stance)
    return np.array([np.abs(one.stiffness.value / true[:, k] - 1.0).mean() for k, one in enumerate(found.axes)])


def test_the_foots_angle_keeps_shoe_and_heel_pad_out_of_the_ankle(
    shod: AnkleRun, trial: AnkleTrial, found: AnkleImpedance
) -> None:
    unseen = identify(replace(trial, foot_rad=None, heel_rise_m=None))
    assert (stiffness_errors(shod, found) < (0.05, 0.08)).all()
    assert (stiffness_errors(shod, unseen) > 2.0 * stiffness_errors(shod, found)).all()
    assert (stiffness_errors(shod, unseen) > 0.06).all()


def test_a_step_counts_until_its_heel_rises(shod: AnkleRun, trial: AnkleTrial, found: AnkleImpedance) -> None:
    flat = in_flat_foot(trial)
    rises = shod.heel_rise_m > 0.008
    assert rises[shod.stance < 0.8].any()
    assert not (flat & rises).any()
    assert found.stance[-1] < 0.79
    assert trial.heel_rise_m is not None
    back = replace(trial, heel_rise_m=np.where(trial.stance > 0.75, 0.0, trial.heel_rise_m))
    assert (in_flat_foot(back) <= in_flat_foot(replace(trial, heel_rise_m=None))).all()
    for cycle in range(8):
        here = in_flat_foot(back)[trial.rows_of(cycle)]
        assert np.abs(np.diff(here.astype(int))).sum() <= 2


def test_stiffness_across_the_axes_comes_back_with_its_sign(shod: AnkleRun, found: AnkleImpedance) -> None:
    true = shod.person.cross_stiffness(found.stance)
    assert true.min() > 5.0
    for one in found.axes:
        curve = one.cross_stiffness
        assert np.abs(curve.value - true).mean() < 0.25 * true.mean()
        assert ((curve.low <= true) & (true <= curve.high)).mean() > 0.6


def test_the_equilibrium_angle_is_that_of_foot_against_shank(shod: AnkleRun, found: AnkleImpedance) -> None:
    """Under 100 N·m the shoe gives way by two degrees, which are no part of the ankle's angle."""
    rest = true_equilibrium(shod, found.stance)
    assert np.rad2deg(np.abs(found.axes[0].equilibrium.value - rest[:, 0])).mean() < 1.0


def test_the_tare_took_the_plates_weight() -> None:
    """The plate weighs 45 N: looked for in a tared wrench, it is 2.3 N·m at an ankle 50 mm behind the middle."""
    quiet = replace(person(3), reflex_nm_s=np.zeros(2), restless=1e-9)
    run = walk(quiet, [Perturbation.RANDOM] * 2, 3)
    seen = measured(run, AnkleNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 3)
    motion = motion_of(seen, bodies_of(seen.settings))
    off = motion.moment - quiet.usual_moment(run.stance[motion.rows])
    assert np.abs(off.mean(axis=0) - _of_lever(run, seen)).max() < 0.6


def _of_lever(run: AnkleRun, seen: AnkleTrial) -> FloatArray:
    """Return the mean moment (2,) about Z and X that the told place of the ankle adds."""
    off_m = np.array(seen.settings.ankle.in_plate_m) - run.person.ankle_P_m
    added: FloatArray = -np.cross(off_m, run.wrench[run.flat][:, :3]).mean(axis=0)[[2, 0]]
    return added


def test_a_trial_with_the_foot_survives_its_folder(trial: AnkleTrial, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("shod")
    save_trial(folder, trial)
    read = load_trial(folder)
    assert read.foot_rad is not None
    assert trial.foot_rad is not None
    np.testing.assert_allclose(read.foot_rad, trial.foot_rad, rtol=1e-8, atol=1e-9)
    text = (folder / "cycles.csv").read_text()
    (folder / "cycles.csv").write_text(text.replace("foot_phi_rad", "foot_phi", 1))
    with pytest.raises(UserError, match="column foot_phi_rad is missing"):
        load_trial(folder)
    assert trial.heel_rise_m is not None
    save_trial(folder, replace(trial, heel_rise_m=1e3 * trial.heel_rise_m))
    with pytest.raises(UserError, match=r"heel_rise_m reaches .*, allowed ±0.3 m: millimetres"):
        load_trial(folder)

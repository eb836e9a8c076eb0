"""What the wrench's delay and gain do to the ankle's impedance: told, taken out or in the intervals."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

pytest.importorskip("mujoco")

from impedance.ankle.impedance import identify
from impedance.ankle.table import MOST_HALF_SHARE, table_of
from impedance.ankle.trial import AnkleTrial, Perturbation
from messages.errors import UserError
from sim_rig.platform.ankle import AnkleRun, walk
from sim_rig.platform.ankle_measured import AT_15_DB, SENSOR_NOISE, late, measured
from sim_rig.platform.ankle_person import person
from sim_rig.platform.ankle_truth import true_equilibrium

SEED = 4


@pytest.fixture(scope="module")
def run() -> AnkleRun:
    return walk(person(SEED), [Perturbation.RANDOM] * 8, SEED)


def trial_of(run: AnkleRun, late_s: float, **told: float) -> AnkleTrial:
    """Return a trial whose wrench is late, and what its file tells of it."""
    trial = measured(late(run, late_s), SENSOR_NOISE, SEED)
    instruments = msgspec.structs.replace(trial.settings.instruments, **told)
    return replace(trial, settings=msgspec.structs.replace(trial.settings, instruments=instruments))


def damping_error(run: AnkleRun, trial: AnkleTrial) -> float:
    found = identify(trial)
    true = run.person.damping(found.stance)
    off = [np.abs(one.damping.value / true[:, axis] - 1.0).mean() for axis, one in enumerate(found.axes)]
    return float(np.max(off))


def test_a_delay_is_told_by_both_axes_and_costs_no_damping(run: AnkleRun) -> None:
    for delay_s in (-1e-3, 5e-4):
        shifted = trial_of(run, delay_s)
        found = identify(shifted)
        assert abs(found.delay_s - delay_s) < 4.0 * found.delay_deviation_s
        assert found.delay_deviation_s < 1e-4
        assert damping_error(run, shifted) < 0.03
    believed = trial_of(run, 5e-4, delay_deviation_s=0.0)
    assert damping_error(run, believed) > 0.12


def test_noise_does_not_draw_a_delay_to_zero(run: AnkleRun) -> None:
    late_s, early_s = (identify(measured(late(run, delay_s), AT_15_DB, SEED)).delay_s for delay_s in (8e-4, -8e-4))
    assert abs(late_s - early_s - 16e-4) < 2e-5


def test_a_delay_that_is_known_is_taken_out(run: AnkleRun) -> None:
    known = trial_of(run, 1e-3, delay_s=1e-3, delay_deviation_s=0.0)
    assert identify(known).delay_s == 1e-3
    assert damping_error(run, known) < 0.03


def test_a_delay_that_both_axes_refute_is_refused(run: AnkleRun) -> None:
    wrong = trial_of(run, 1e-3, delay_s=0.0, delay_deviation_s=2e-6)
    with pytest.raises(UserError, match=r"a delay of the wrench of \+(0.9|1.0)\d* ± .* ms, instruments.delay_s is 0 ±"):
        identify(wrong)


@pytest.mark.long
def test_the_gain_is_in_the_intervals_and_moves_nothing(run: AnkleRun) -> None:
    exact, unsure = (identify(trial_of(run, 0.0, gain_deviation_share=share)) for share in (0.0, 0.05))
    for one, other in zip(exact.axes, unsure.axes, strict=True):
        assert other.stiffness.value == pytest.approx(one.stiffness.value, rel=1e-3)
        assert (other.stiffness.deviation > 0.03 * other.stiffness.value).all()
        assert (one.stiffness.deviation < other.stiffness.deviation).all()


def test_set_points_lie_in_their_intervals(run: AnkleRun) -> None:
    """Of all four curves together: neighbouring points of one vary together, and may be off together."""
    found, inside = identify(trial_of(run, 0.0)), list[float]()
    moment, rest = run.person.usual_moment(found.stance), true_equilibrium(run, found.stance)
    for axis, one in enumerate(found.axes):
        for curve, true in ((one.mean_moment, moment[:, axis]), (one.equilibrium, rest[:, axis])):
            inside.append(float(((curve.low <= true) & (true <= curve.high)).mean()))
        assert np.rad2deg(np.abs(one.equilibrium.value - rest[:, axis])).mean() < 1.5
    assert np.mean(inside) > 0.9


@pytest.mark.long
def test_an_axis_that_is_too_wide_for_a_controller_is_refused() -> None:
    short = walk(person(SEED), [Perturbation.RAMP] * 3 + [Perturbation.NONE] * 3, SEED)
    trial = measured(short, AT_15_DB, SEED)
    axis = table_of(trial, identify(trial)).dorsi_plantarflexion
    assert axis.damping_half_share is not None
    assert axis.damping_half_share > MOST_HALF_SHARE["damping"]
    assert any(reason.startswith("damping refused") for reason in axis.not_identifiable)
    assert np.isnan(axis.damping_nms_per_rad).all()
    assert np.isfinite(axis.damping_nms_per_rad_high).all()

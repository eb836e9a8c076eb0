"""The platform as the discrepancy finder takes it: every effect against the rig that hides it, by other formulas."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from discrepancy import explain
from discrepancy.values import predicted
from impedance.body.rigid_body import Inertia
from impedance.recording.recording import PlatformRecording, Poses
from messages.arrays import FloatArray
from messages.errors import UserError
from sim_rig.platform.extended.flaws import CHANNELS, Flaws
from sim_rig.platform.extended.instruments import followed
from sim_rig.platform.extended.laboratory import Laboratory
from sim_rig.platform.extended.plate_noise import PlateNoise
from sim_rig.platform.extended.unit import PlatformUnit, stepped
from sim_rig.platform.run import SPAN_NM
from systems.platform import load
from systems.platform.effects import amplitudes
from systems.platform.memory import with_play
from systems.platform.sensor import lattice, rounded
from systems.platform.simulation import BODY, PlatformSimulation

SECONDS = 7.0
UNSEEN = 0.05 * np.repeat((0.1, 0.05, 1e-4, 1e-5), (3, 3, 6, 2))
"""A twentieth of the thesis's noise of a sample, by channel."""
NAMES = (
    "force_delay force_lag motion_smoothing aliasing force_gain crosstalk reference_height plate_rotation "
    "foot_marker_offset joint_offset parallel_spring parallel_damping coulomb_friction hidden_mass backlash "
    "tape_compliance tare_error clock_drift saturation quantisation dropped_samples position_scale"
)
FOOT = Inertia.about(12.0, np.array([0.004, -0.06, -0.003]), np.array([0.05, 0.08, 0.06, 0.001, -0.002, 0.0015]))


def unit(foot: bool) -> PlatformUnit:
    return PlatformUnit(
        plate=Inertia.about(4.6, np.array([0.005, -0.026, -0.001]), np.array([0.04, 0.118, 0.105, 0.001, 0.0, 0.008])),
        known=True,
        foot=FOOT if foot else None,
        foot_origin_m=np.array([0.0, 0.12, 0.0]),
        joint_to_surface_m=0.12,
        amplitude=1.0,
        update_hz=41.0,
        noise_factor=1e-5,
        declared=True,
        coloured=False,
    )


def recorded(flaws: Flaws, foot: bool) -> PlatformRecording:
    """Return a recording almost without noise of a unit with `flaws`."""
    laboratory = Laboratory(unit(foot), flaws, PlateNoise(6, np.random.default_rng(6)))
    torques = stepped(np.random.default_rng(5), laboratory.unit.update_hz, np.array(SPAN_NM), SECONDS)
    return laboratory.recorded(laboratory.ran(torques, SECONDS), np.random.default_rng(7), SECONDS)


@cache
def clean(foot: bool) -> PlatformRecording:
    return recorded(Flaws(), foot)


def simulation(recording: PlatformRecording) -> tuple[PlatformSimulation, dict[str, float]]:
    """Return the simulation and the true values of the base model's parameters."""
    bound = PlatformSimulation.of(recording)
    if recording.foot is None:
        return bound, {}
    return bound, dict(zip((f"foot_{name}" for name in BODY), FOOT.vector.tolist(), strict=True))


def left(recording: PlatformRecording, values: dict[str, float]) -> FloatArray:
    """Return the RMS (c,) of what the prediction misses."""
    bound, base = simulation(recording)
    missed: FloatArray = np.sqrt(
        np.nanmean((bound.channels.values - predicted(bound, {**base, **values})) ** 2, axis=0)
    )
    return missed


def matrix(of: str, source: str, share: float) -> FloatArray:
    m = np.eye(6)
    m[CHANNELS.index(of), CHANNELS.index(source)] += share
    return m


@pytest.mark.parametrize("foot", [False, True])
def test_the_base_model_meets_a_recording_in_which_nothing_is_hidden(foot: bool) -> None:
    bound, _ = simulation(clean(foot))
    assert (left(clean(foot), {}) < 5e-4 * np.maximum(bound.channels.values.std(axis=0), 1e-3)).all()


@pytest.mark.parametrize(
    ("flaws", "values", "foot", "share"),
    [
        (Flaws(delay_s=1e-3), {"force_delay.value_s": 1e-3}, True, 0.01),
        (Flaws(lag_s=1e-3), {"force_lag.value_s": 1e-3}, True, 0.01),
        (Flaws(drift=4e-4), {"clock_drift.rate": 4e-4}, True, 0.02),
        (Flaws(smoothing_hz=40.0), {"motion_smoothing.value_hz": 40.0}, True, 0.02),
        (Flaws(matrix=matrix("fz", "fz", 0.02)), {"force_gain.fz": 0.02}, True, 0.01),
        (Flaws(matrix=matrix("tx", "fy", -0.02)), {"crosstalk.tx_from_fy": -0.02}, True, 0.01),
        (Flaws(height_m=0.02), {"reference_height.value_m": 0.02}, True, 0.01),
        (Flaws(turn_rad=np.array([0.0, 0.03, 0.0])), {"plate_rotation.y_rad": 0.03}, True, 0.01),
        (Flaws(joint_m=np.array([0.0, 0.0, 0.01])), {"joint_offset.z_m": 0.01}, False, 0.01),
        (Flaws(foot_marker_m=np.array([0.005, 0.0, 0.0])), {"foot_marker_offset.x_m": 0.005}, True, 0.01),
        (Flaws(position_scale=0.01), {"position_scale.value": 0.01}, True, 0.01),
        (Flaws(spring_nmprad=np.array([90.0, 0.0])), {"parallel_spring.z_nmprad": 90.0}, False, 0.01),
        (Flaws(damper_nmsprad=np.array([0.0, 3.0])), {"parallel_damping.x_nmsprad": 3.0}, False, 0.01),
        (Flaws(friction_nm=np.array([1.0, 0.0])), {"coulomb_friction.z_nm": 1.0}, False, 0.15),
        (
            Flaws(masses=((0.4, np.array([0.1, 0.05, -0.06])),)),
            {"hidden_mass.mass_kg": 0.4, "hidden_mass.x_m": 0.1, "hidden_mass.y_m": 0.05, "hidden_mass.z_m": -0.06},
            False,
            0.01,
        ),
        (
            Flaws(tape_hz=(70.0, 55.0), tape_zeta=0.06),
            {
                "tape_compliance.z_hz": 70.0,
                "tape_compliance.x_hz": 55.0,
                "tape_compliance.zeta": 0.06,
                "tape_compliance.seen": 1.0,
            },
            True,
            0.01,
        ),
        (Flaws(tare=np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0])), {"tare_error.fy": 2.0}, True, 0.01),
        (
            Flaws(jumps=True),
            {"aliasing.share": 1.0, "aliasing.update_hz": 41.0, "aliasing.offset_s": -1e-5},
            True,
            0.2,
        ),
        (Flaws(lost_share=0.05), {"dropped_samples.held": 1.0}, True, 0.05),
    ],
    ids=lambda value: next(iter(value)).partition(".")[0] if isinstance(value, dict) else "",
)
def test_an_effect_at_its_true_size_explains_what_the_rig_does(
    flaws: Flaws, values: dict[str, float], foot: bool, share: float
) -> None:
    recording = recorded(flaws, foot)
    before, after, floor = left(recording, {}), left(recording, values), left(clean(foot), {})
    struck = before > 20.0 * floor + UNSEEN[: len(floor)]
    assert struck.any()
    assert (after[struck] < share * before[struck] + 2.0 * floor[struck]).all()
    assert (after[~struck] <= before[~struck] + 2.0 * floor[~struck] + UNSEEN[: len(floor)][~struck]).all()


@pytest.mark.long
def test_limits_play_and_rounding_are_met_as_far_as_samples_tell() -> None:
    deviation, largest = clean(False).wrench.std(axis=0), np.abs(clean(False).wrench).max(axis=0)
    for flaws, values, share in (
        (Flaws(limit=(0, 0.6 * largest[0])), {"saturation.fx": 0.6 * largest[0]}, 0.1),
        (Flaws(play=(5, 0.2 * deviation[5])), {"backlash.tz": 0.2 * deviation[5]}, 0.2),
        (Flaws(step=(20.0, 0.0)), {"quantisation.force_n": 20.0}, 0.15),
        (Flaws(jumps=True), {"aliasing.share": 1.0}, 0.4),
    ):
        recording = recorded(flaws, foot=False)
        before, after = left(recording, {}), left(recording, values)
        worst = int(np.argmax(before[:6] / deviation))
        assert after[worst] < share * before[worst], values


@given(data=st.data())
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_neutral_values_are_exactly_the_base_model(data: st.DataObject) -> None:
    bound, _ = simulation(clean(True))
    keys = [(effect.qualified(p.name), p.neutral) for effect in bound.effects for p in effect.parameters]
    chosen = data.draw(st.lists(st.sampled_from(keys), unique=True))
    assert predicted(bound, dict(chosen)).tobytes() == predicted(bound, {}).tobytes()


@given(st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=60), st.floats(0.0, 6.0))
@settings(max_examples=60, deadline=None)
def test_play_in_one_go_is_play_step_by_step(values: list[float], play: float) -> None:
    x = np.array(values)
    np.testing.assert_allclose(with_play(x, 0.5 * play, values[0]), followed(x, play), atol=1e-12)


def test_rounding_on_average_is_rounding_of_a_noisy_value() -> None:
    x = np.linspace(-3.0, 3.0, 41)
    noisy = x + 0.2 * np.random.default_rng(3).standard_normal((20_000, 41))
    np.testing.assert_allclose(rounded(x, 1.0, 0.2), np.floor(noisy + 0.5).mean(axis=0), atol=0.015)
    assert lattice(np.array([0.0, 2.0, 4.0, 2.0] * 20)) == 2.0
    assert lattice(x) is None


def test_the_library_has_the_names_and_no_foot_means_no_effect_of_it() -> None:
    with_foot = {effect.name: effect for effect in PlatformSimulation.of(clean(True)).effects}
    assert set(with_foot) == set(NAMES.split())
    assert [p.name for p in with_foot["force_gain"].parameters] == list(CHANNELS)
    assert len(with_foot["crosstalk"].parameters) == 30
    assert [p.name for p in with_foot["tape_compliance"].parameters][:3] == ["z_hz", "x_hz", "zeta"]
    for effect in with_foot.values():
        known = {p.name for p in effect.parameters}
        assert effect.explanation
        assert effect.remedy
        assert effect.experiment
        assert all(set(choice) <= known for choice in effect.choices)
        assert all(set(start) <= known for start in effect.starts)
    without = {effect.name for effect in PlatformSimulation.of(clean(False)).effects}
    assert set(with_foot) - without == {"tape_compliance", "foot_marker_offset"}


@pytest.mark.long
def test_both_steps_of_rounding_are_found_together() -> None:
    random = np.random.default_rng(11)
    noisy = replace(unit(False), noise_factor=1.0)
    torques = stepped(random, noisy.update_hz, np.array(SPAN_NM), 12.0)
    laboratory = Laboratory(noisy, Flaws(step=(12.0, 3.0)), PlateNoise(6, random))
    recording = laboratory.recorded(laboratory.ran(torques, 12.0), random, 12.0)
    verdict = explain(PlatformSimulation.of(recording), None, seed=1).verdict
    assert [cause.name for cause in verdict.causes] == ["quantisation"]
    for name, step in (("force_n", 12.0), ("torque_nm", 3.0)):
        assert verdict.causes[0].parameters[name].value == pytest.approx(step, rel=0.02)


def test_what_lies_near_a_gap_is_not_compared() -> None:
    whole = clean(False)
    gap = np.zeros(len(whole.t_s), dtype=bool)
    gap[1000:1010] = True
    holed = replace(whole, plate=Poses.from_columns(np.where(gap[:, None], np.nan, whole.plate.columns)))
    bound = PlatformSimulation.of(holed)
    near = np.abs(bound.channels.t_s - 1005 / 350.0) < 0.25
    for values in (bound.channels.values, predicted(bound, {}), predicted(bound, {"force_delay.value_s": 1e-3})):
        assert np.isnan(values[near]).all()
        assert np.isfinite(values[np.abs(bound.channels.t_s - 1005 / 350.0) > 0.3]).all()
    missed = np.nanmax(np.abs(bound.channels.values - predicted(bound, {})), axis=0)
    assert (missed[:6] < 1e-3 * np.nanstd(bound.channels.values[:, :6], axis=0)).all()


def test_what_cannot_be_bound_is_refused_in_one_line(tmp_path: Path) -> None:
    whole = clean(True)
    short = replace(
        whole,
        t_s=whole.t_s[:900],
        plate=Poses.from_columns(whole.plate.columns[:900]),
        foot=Poses.from_columns(whole.foot.columns[:900]) if whole.foot else None,
        force_t_s=whole.force_t_s[:900],
        wrench=whole.wrench[:900],
    )
    with pytest.raises(UserError, match=r"recording: lasts 2\.57 s, at least 5 s"):
        PlatformSimulation.of(short)
    whole.save(tmp_path)
    settings_file = tmp_path / "platform.toml"
    kept = [line for line in settings_file.read_text().splitlines() if not line.startswith(("cog_m", "inertia_kgm2"))]
    settings_file.write_text("\n".join(kept) + "\n")
    with pytest.raises(UserError, match=r"plate\.cog_m, plate\.inertia_kgm2"):
        load(tmp_path)


def test_a_channel_that_reads_zero_all_the_time_has_no_limit() -> None:
    largest = {name: 0.0 if name == "fy" else 10.0 for name in CHANNELS}
    library = {effect.name: effect for effect in amplitudes({"force_n": 1.0, "torque_nm": 1.0}, largest)}
    assert [p.name for p in library["saturation"].parameters] == [name for name in CHANNELS if name != "fy"]

"""Maximum likelihood with noise in motion and wrench: exact without noise, at its bound with it, honest about both."""

from dataclasses import replace

import numpy as np
import pytest

from impedance.body.geometry import rotation_IP
from impedance.identification.bound import propagated, true_information
from impedance.identification.fitted_run import BAND_SHARE, KnownBody, problem_of
from impedance.identification.identification import identify
from impedance.identification.mechanism import FreeBody, Mechanism, UniversalJoint
from impedance.identification.noise_level import NoiseLevel, noise_level
from impedance.identification.observability import NAMES, about_cog, about_cog_slope
from impedance.identification.spectra import Spectra
from impedance.recording.recording import PlatformRecording, Poses
from impedance.recording.synchronous import synchronous
from messages.arrays import FloatArray
from messages.constants import NORMAL_95
from messages.errors import UserError
from tests.bench.platform_motion import FOOT, L_M, PLATE, lines, noisy, recording, undeclared

THESIS = NoiseLevel(1e-4, 1e-5, 0.1, 0.05)


@pytest.fixture(scope="module")
def clean() -> PlatformRecording:
    return recording(lines(1), 8.0)


def _bound(clean: PlatformRecording, mechanism: Mechanism) -> FloatArray:
    streams = synchronous(clean)
    problem = problem_of(streams, mechanism, THESIS, None)
    spectra = Spectra.of(streams.rate_hz, streams.valid, BAND_SHARE * streams.rate_hz)
    slope = about_cog_slope(PLATE.vector)
    covariance = slope @ np.linalg.solve(true_information(problem, spectra, PLATE.vector), slope.T)
    return np.asarray(np.sqrt(np.diag(covariance)), dtype=np.float64)


@pytest.mark.parametrize("joint", [True, False])
def test_without_noise_plate_and_foot_are_exact(clean: PlatformRecording, joint: bool) -> None:
    plate = identify(clean, joint=joint, weighed=False)
    assert np.abs(plate.estimate - about_cog(PLATE.vector)).max() < 1e-6
    foot = identify(recording(lines(2), 8.0, FOOT), joint=joint)
    assert np.abs(foot.estimate - about_cog(FOOT.vector)).max() < 2e-6
    assert plate.fit.converged
    assert foot.fit.converged


@pytest.mark.long
@pytest.mark.parametrize(("joint", "draws"), [(True, 40), (False, 15)])
def test_errors_meet_the_bound_and_intervals_hold(clean: PlatformRecording, joint: bool, draws: int) -> None:
    mechanism = UniversalJoint(L_M) if joint else FreeBody()
    truth, bound = about_cog(PLATE.vector), _bound(clean, mechanism)
    found = [identify(noisy(clean, seed), joint=joint, weighed=False) for seed in range(1, draws + 1)]
    rms = np.sqrt(np.mean([(each.interval.mean(axis=1) - truth) ** 2 for each in found], axis=0))
    inside = [(each.interval[:, 0] <= truth) & (truth <= each.interval[:, 1]) for each in found]
    most = 1.0 + 2.6 / np.sqrt(2.0 * draws)  # so few draws scatter by themselves: 99.5 % of them lie below
    assert (rms < (most + 0.1) * bound).all(), dict(zip(NAMES, rms / bound, strict=True))
    assert 0.88 < np.mean(inside) <= 1.0
    assert all(each.body.is_consistent for each in found)
    assert np.mean([each.fit.chi2_ratio for each in found]) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("mechanism", [UniversalJoint(L_M), FreeBody()])
def test_propagated_noise_has_the_spread_that_the_information_says(
    clean: PlatformRecording, mechanism: Mechanism
) -> None:
    streams = synchronous(clean)
    problem = problem_of(streams, mechanism, THESIS, None)
    spectra = Spectra.of(streams.rate_hz, streams.valid, BAND_SHARE * streams.rate_hz)
    errors = np.array(list(propagated(problem, spectra, PLATE.vector, 300, 7))) @ about_cog_slope(PLATE.vector).T
    spread = errors.std(axis=0) / _bound(clean, mechanism)
    lost = np.sqrt(8.0 / spectra.counted_s)  # to the tapers
    assert spread == pytest.approx(np.full(10, lost), rel=0.16)


def test_one_axis_alone_leaves_J_y_unidentifiable_and_says_what_goes_with_it() -> None:
    found = identify(noisy(recording(lines(3, (0.7, 0.0)), 8.0), 3), weighed=False)
    told = dict(zip(NAMES, found.observability.identifiable, strict=True))
    assert not told["Jyy"]
    assert not told["Jxx"]
    assert told["Jzz"]
    assert found.body.is_consistent


def test_the_foot_carries_the_plates_uncertainty() -> None:
    loaded = noisy(recording(lines(2), 8.0, FOOT), 5)
    exact = identify(loaded)
    uncertain = identify(loaded, KnownBody(PLATE.vector, np.diag((0.01 * np.abs(PLATE.vector) + 1e-4) ** 2)))
    assert any("taken as exact" in note for note in exact.notes)
    assert not any("taken as exact" in note for note in uncertain.notes)
    assert (uncertain.observability.deviation > exact.observability.deviation).all()
    assert (np.abs(uncertain.estimate - exact.estimate) < 2.0 * uncertain.observability.deviation).all()


def test_the_foot_asks_for_the_plate(clean: PlatformRecording) -> None:
    loaded = recording(lines(2), 8.0, FOOT)
    plain = replace(
        loaded,
        settings=clean.settings.__class__(
            rates=loaded.settings.rates,
            plate=clean.settings.plate,
            foot=loaded.settings.foot,
            noise=loaded.settings.noise,
            uncertainty=loaded.settings.uncertainty,
        ),
    )
    with pytest.raises(UserError, match=r"plate\.cog_m"):
        identify(plain)


def test_markers_that_leave_the_joint_refute_it(clean: PlatformRecording) -> None:
    seen = noisy(clean, 4)
    shaken = seen.plate.p_m + 4e-4 * np.sin(2.0 * np.pi * 9.0 * seen.t_s)[:, None]
    found = identify(replace(seen, plate=Poses(shaken, seen.plate.euler_rad)))
    assert not found.constrained
    assert any("refute the joint" in note for note in found.notes)
    assert identify(seen).constrained


def test_a_joint_and_a_foot_that_are_elsewhere_are_named() -> None:
    seen = noisy(recording(lines(2), 8.0, FOOT), 11)
    assert seen.foot is not None
    lower = np.array([0.0, 2e-3, 0.0])
    up_I = rotation_IP(*seen.plate.euler_rad.T) @ lower
    moved = replace(seen, plate=Poses(seen.plate.p_m + up_I, seen.plate.euler_rad))
    found = identify(moved)
    assert not found.constrained
    assert any(note.startswith("joint_offset") and "122." in note for note in found.notes)
    assert any(note.startswith("foot_marker_offset") and "-2.0" in note for note in found.notes)
    assert not any("offset" in note for note in identify(seen).notes)


def test_the_markers_tell_the_height_of_the_joint(clean: PlatformRecording) -> None:
    test = identify(noisy(clean, 6)).test
    assert (np.abs(test.seen_m - np.array([0.0, L_M, 0.0])) < 4.0 * test.seen_deviation_m).all()
    assert test.seen_deviation_m[1] < 3e-4


def test_a_mass_that_the_motion_refutes_is_not_used(clean: PlatformRecording) -> None:
    seen = noisy(clean, 8)
    heavy = replace(
        seen,
        settings=recording(lines(1), 8.0).settings.__class__(
            rates=seen.settings.rates,
            plate=seen.settings.plate.__class__(mass_kg=5.2, joint_to_surface_m=L_M),
            noise=seen.settings.noise,
            uncertainty=seen.settings.uncertainty,
        ),
    )
    found = identify(heavy)
    assert found.estimate[0] == pytest.approx(PLATE.mass_kg, abs=0.1)
    assert any("plate.mass_kg" in note for note in found.notes)
    assert identify(seen).observability.deviation[0] < found.observability.deviation[0]


def test_a_gap_costs_its_length_and_no_accuracy(clean: PlatformRecording) -> None:
    seen = noisy(clean, 9)
    holed = seen.plate.p_m.copy()
    holed[1000:1100] = np.nan
    whole, found = (
        identify(seen, weighed=False),
        identify(replace(seen, plate=Poses(holed, seen.plate.euler_rad)), weighed=False),
    )
    assert found.spectra.counted_s < whole.spectra.counted_s - 0.2
    off = (found.interval.mean(axis=1) - about_cog(PLATE.vector)) / found.observability.deviation
    assert np.abs(off).max() < 4.0
    assert (np.abs(off) < NORMAL_95).sum() >= 7


def test_noise_that_nobody_declared_is_estimated(clean: PlatformRecording) -> None:
    level = noise_level(synchronous(undeclared(noisy(clean, 10))))
    assert level.estimated == ("position_m", "angle_rad", "force_n", "torque_nm")
    found = (level.position_m, level.angle_rad, level.force_n, level.torque_nm)
    assert found == pytest.approx((1e-4, 1e-5, 0.1, 0.05), rel=0.06)


def test_too_short_a_recording_is_refused() -> None:
    with pytest.raises(UserError, match="at least 3 s"):
        identify(recording(lines(1), 2.5))

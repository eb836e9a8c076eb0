"""The first estimator on motion made by formula: exact without noise, and each deviation does what its name says."""

from dataclasses import replace

import numpy as np
import pytest

from impedance.body import geometry
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia, wrench_transform
from impedance.recording.recording import (
    FootSettings,
    PlateSettings,
    PlatformRecording,
    PlatformSettings,
    Poses,
    RateSettings,
    TareSettings,
)
from impedance.thesis.descent import descended
from impedance.thesis.estimator import Variant, foot_residual, least_residual, mass_upright, plate_residual
from lab.thesis.printed import FOOT, PLATE, body_of, rows_of

RATE_HZ = 350.0
JOINT_M = 0.12
FOOT_ORIGIN_M = np.array([0.0, 0.1814, 0.0])
TRUE_PLATE, TRUE_FOOT = body_of(PLATE.reference), body_of(FOOT.reference)
UNFILTERED = Variant(filtered=False)


def _recording(*, foot: bool, with_foot: bool = False, samples: int = 1500) -> PlatformRecording:
    """Sines of 3 to 16 Hz on both axes, about 1°, exact wrench."""
    t_s = np.arange(samples) / RATE_HZ
    rng = np.random.default_rng(11)
    omega = 2 * np.pi * rng.uniform(3.0, 16.0, (2, 5))
    size, phase = rng.uniform(2e-3, 6e-3, (2, 5)), rng.uniform(0.0, 6.0, (2, 5))
    angles, rates, seconds = (
        (size * omega**k * np.sin(omega * t_s[:, None, None] + phase + k * np.pi / 2)).sum(axis=2) for k in range(3)
    )
    motion = Kinematics.on_joint(angles, rates, seconds, np.array([0.0, JOINT_M, 0.0]))
    level = Kinematics.at_rest(np.zeros((1, 3)))
    p_m, euler = geometry.joint_pose(angles[:, 0], angles[:, 1], JOINT_M)
    tare = (level.regressor @ TRUE_PLATE.vector)[0]
    wrench = motion.regressor @ TRUE_PLATE.vector
    poses = None
    if foot:
        X = wrench_transform(np.eye(3), FOOT_ORIGIN_M)
        wrench += motion.of_mounted(np.eye(3), FOOT_ORIGIN_M).regressor @ TRUE_FOOT.vector @ X.T
        if with_foot:
            tare = tare + X @ (level.regressor @ TRUE_FOOT.vector)[0]
        p_foot, _ = geometry.joint_pose(angles[:, 0], angles[:, 1], JOINT_M + FOOT_ORIGIN_M[1])
        poses = Poses(p_foot, euler)
    settings = PlatformSettings(
        rates=RateSettings(motion_hz=RATE_HZ, force_hz=RATE_HZ),
        plate=PlateSettings(mass_kg=4.64, joint_to_surface_m=JOINT_M),
        foot=FootSettings(present=foot),
        tare=TareSettings(with_foot=with_foot),
    )
    return PlatformRecording(settings, t_s, Poses(p_m, euler), poses, t_s, wrench - tare)


def _noisy(recording: PlatformRecording, position_m: float, seed: int) -> PlatformRecording:
    assert recording.foot is not None
    rng = np.random.default_rng(seed)
    noisy = [
        Poses(poses.p_m + position_m * rng.normal(size=poses.p_m.shape), poses.euler_rad)
        for poses in (recording.plate, recording.foot)
    ]
    return replace(recording, plate=noisy[0], foot=noisy[1])


def _plate(recording: PlatformRecording, variant: Variant) -> Inertia:
    return least_residual(plate_residual(recording, variant), 4.64, moments_bounded=False)


def _foot(recording: PlatformRecording, variant: Variant, *, bounded: bool = False) -> Inertia:
    return least_residual(foot_residual(recording, TRUE_PLATE, variant), None, moments_bounded=bounded)


def test_noise_free_plate_and_foot_are_exact() -> None:
    plate = least_residual(plate_residual(_recording(foot=False), UNFILTERED), 4.64, moments_bounded=False)
    np.testing.assert_allclose(rows_of(plate), PLATE.reference, rtol=1e-6, atol=1e-6)
    for with_foot, rounding in ((False, 1e-6), (True, 1e-5)):
        foot = _foot(_recording(foot=True, with_foot=with_foot), UNFILTERED)
        np.testing.assert_allclose(rows_of(foot), FOOT.reference, rtol=rounding, atol=rounding)


@pytest.mark.parametrize(
    "variant",
    [
        replace(UNFILTERED, printed_signs=True),
        replace(UNFILTERED, torque_twice=True),
        replace(UNFILTERED, lever=False),
        replace(UNFILTERED, tare_moment=False),
    ],
)
def test_every_deviation_spoils_what_is_exact_without_it(variant: Variant) -> None:
    errors = rows_of(_foot(_recording(foot=True), variant)) - FOOT.reference
    assert np.abs(errors).max() > 1.0


def test_printed_signs_are_read_as_they_are_written() -> None:
    recording = _recording(foot=True)
    residual = foot_residual(recording, TRUE_PLATE, replace(UNFILTERED, printed_signs=True, tare_moment=False))
    bodies = residual.body(residual.vector(TRUE_FOOT))
    np.testing.assert_allclose(rows_of(bodies), FOOT.reference, atol=1e-9)
    moved = np.linalg.norm(residual.vector(TRUE_FOOT)[4:] - TRUE_FOOT.vector[4:])
    assert moved == pytest.approx(np.sqrt(2) * 2 * 22.68 * 0.0907**2, rel=1e-6)


def test_a_moment_below_zero_is_pinned_at_zero_and_nothing_else_fits_better() -> None:
    noisy = _noisy(_recording(foot=True), 4e-4, 21)
    free, bounded = _foot(noisy, Variant()), _foot(noisy, Variant(), bounded=True)
    assert np.diag(free.inertia_kgm2).min() < -1e-3
    assert np.diag(bounded.inertia_kgm2).min() == pytest.approx(0.0, abs=1e-6)
    residual = foot_residual(noisy, TRUE_PLATE, Variant())
    cost = residual.mean_cost(bounded.vector)
    assert cost > residual.mean_cost(free.vector)
    rng = np.random.default_rng(22)
    for _ in range(200):
        near = Inertia.about(
            bounded.mass_kg * (1 + 1e-3 * rng.normal()),
            bounded.cog_m + 1e-4 * rng.normal(size=3),
            np.maximum(bounded.about_cog() + 1e-3 * rng.normal(size=6), [0, 0, 0, -1, -1, -1]),
        )
        assert residual.mean_cost(near.vector) >= cost * (1 - 1e-9)


def test_descent_stops_short_of_the_minimum_without_noise() -> None:
    residual = foot_residual(_recording(foot=True), TRUE_PLATE, UNFILTERED)
    start = Inertia.about(0.5 * TRUE_FOOT.mass_kg, 0.5 * TRUE_FOOT.cog_m, 0.5 * TRUE_FOOT.about_cog())
    stopped = descended(residual, None, start, moments_bounded=False)
    assert residual.mean_cost(stopped.vector) < 0.1 * residual.mean_cost(start.vector)
    assert residual.mean_cost(stopped.vector) > residual.mean_cost(TRUE_FOOT.vector)


def test_streams_that_are_not_sampled_together_are_refused() -> None:
    recording = _recording(foot=False)
    with pytest.raises(ValueError, match="together"):
        plate_residual(replace(recording, force_t_s=recording.force_t_s + 1e-3), Variant())
    with pytest.raises(ValueError, match="no foot"):
        foot_residual(recording, TRUE_PLATE, Variant())


def test_mass_is_read_with_the_plate_upright() -> None:
    tared_n = np.array([4.64 * 9.81, -4.64 * 9.81, 0.0])
    readings_n = tared_n + 0.1 * np.random.default_rng(23).normal(size=(350, 3))
    assert mass_upright(readings_n) == pytest.approx(4.64, abs=0.002)

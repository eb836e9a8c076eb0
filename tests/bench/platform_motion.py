"""Recordings of an ideal platform whose motion is known in closed form: two sums of lines on the joint."""

from dataclasses import replace

import msgspec
import numpy as np

from impedance.body import geometry
from impedance.body.rigid_body import Inertia
from impedance.identification.experiment import Multisine
from impedance.identification.mechanism import UniversalJoint, level_rest
from impedance.recording.recording import (
    FootSettings,
    NoiseSettings,
    PlateSettings,
    PlatformRecording,
    PlatformSettings,
    Poses,
    RateSettings,
    TareSettings,
    UncertaintySettings,
)
from messages.arrays import FloatArray

RATE_HZ = 350.0
L_M = 0.12
LEVER_M = np.array([0.0, 0.1814, 0.0])
NOISE = NoiseSettings(position_m=1e-4, angle_rad=1e-5, force_n=0.1, torque_nm=0.05)
PLATE = Inertia.about(4.64, 1e-3 * np.array([5.0, -26.0, -1.0]), 1e-3 * np.array([40.4, 118.1, 105.3, 1.4, -0.5, 8.1]))
FOOT = Inertia.about(22.7, 1e-3 * np.array([1.0, -90.0, 2.0]), 1e-3 * np.array([81.1, 127.0, 137.2, 2.0, 1.0, 3.0]))


def lines(seed: int, swing_deg: tuple[float, float] = (0.7, 0.7), count: int = 40) -> Multisine:
    """Return lines between 0.5 and 30 Hz on both axes, with root mean squares `swing_deg` of θ and φ."""
    rng = np.random.default_rng(seed)
    f_hz = rng.uniform(0.5, 30.0, count)
    amplitude = rng.normal(size=(2, count)) + 1j * rng.normal(size=(2, count))
    amplitude *= np.sqrt(2.0) * np.deg2rad(swing_deg)[:, None] / np.linalg.norm(amplitude, axis=1, keepdims=True)
    return Multisine(1.0, f_hz, amplitude)


def recording(motion: Multisine, seconds: float, foot: Inertia | None = None) -> PlatformRecording:
    """Return what sensors without noise record of plate, or plate and foot, tared by the bare plate at rest."""
    t_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    angles, rates, accelerations = motion.motion(t_s)
    whole = PLATE if foot is None else PLATE.joined(foot.seen_from(np.eye(3), LEVER_M))
    kinematics = UniversalJoint(L_M).kinematics(angles, rates, accelerations)
    wrench = kinematics.regressor @ whole.vector - level_rest() @ PLATE.vector
    p_m, euler_rad = geometry.joint_pose(angles[:, 0], angles[:, 1], L_M)
    foot_poses = Poses(p_m + geometry.rotation_IP(*euler_rad.T) @ LEVER_M, euler_rad)
    plate_settings = PlateSettings(
        mass_kg=PLATE.mass_kg,
        joint_to_surface_m=L_M,
        cog_m=None if foot is None else tuple(PLATE.cog_m.tolist()),
        inertia_kgm2=None if foot is None else tuple(PLATE.about_cog().tolist()),
    )
    settings = PlatformSettings(
        rates=RateSettings(motion_hz=RATE_HZ, force_hz=RATE_HZ),
        plate=plate_settings,
        foot=FootSettings(present=foot is not None),
        tare=TareSettings(at_rest=True),
        noise=NOISE,
        uncertainty=UncertaintySettings.none(),
    )
    return PlatformRecording(
        settings=settings,
        t_s=t_s,
        plate=Poses(p_m, euler_rad),
        foot=None if foot is None else foot_poses,
        force_t_s=t_s,
        wrench=wrench,
    )


def noisy(clean: PlatformRecording, seed: int) -> PlatformRecording:
    """Return `clean` with a draw of NOISE."""
    rng = np.random.default_rng(seed)
    n = len(clean.t_s)

    def seen(poses: Poses) -> Poses:
        return Poses(
            poses.p_m + 1e-4 * rng.standard_normal((n, 3)), poses.euler_rad + 1e-5 * rng.standard_normal((n, 3))
        )

    wrench_std: FloatArray = np.repeat((0.1, 0.05), 3)
    return replace(
        clean,
        plate=seen(clean.plate),
        foot=None if clean.foot is None else seen(clean.foot),
        wrench=clean.wrench + wrench_std * rng.standard_normal((n, 6)),
    )


def undeclared(known: PlatformRecording) -> PlatformRecording:
    """Return `known` without its declared noise."""
    return replace(known, settings=msgspec.structs.replace(known.settings, noise=NoiseSettings()))

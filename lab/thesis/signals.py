"""One run of the study as its instruments see it, and what can happen to motion and wrench on the way to a file.

Whatever an effect does to them is done to a stored run: the mechanics need not be simulated again, because a force from
outside on what stands above the sensor leaves the relation of motion to wrench to be altered, whatever motion the
actuators then bring about.
"""

from dataclasses import dataclass, replace

import msgspec
import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from impedance.body import geometry
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia, cross_matrix
from impedance.recording.recording import PlatformRecording, Poses
from messages.arrays import FloatArray
from sim_rig.platform.rig import FOOT, MOTION_HZ, THESIS_NOISE, Noise, Rig
from sim_rig.platform.run import SimulatedRun, measured

_MIRRORED = 700  # samples at either end, two seconds: a filter's start and end stay out of the run


@dataclass(frozen=True)
class Signals:
    """A run on its way to the file. `plate` and `foot` (n, 6) are poses in I, `wrench` (n, 6) is tared, in P.

    `angles_rad` (n, 2) are the joint's (θ, φ), `kinematics` the exact motion of P. `noise` is added by `noisy`, in the
    draws of `seed`.
    """

    recording: PlatformRecording
    angles_rad: FloatArray
    kinematics: Kinematics
    plate: FloatArray
    foot: FloatArray | None
    wrench: FloatArray
    seed: int
    noise: Noise = THESIS_NOISE

    @classmethod
    def of_run(cls, run: SimulatedRun, seed: int) -> "Signals":
        """Return a run as perfect instruments would see it; `seed` draws its noise later."""
        perfect = measured(run, None)
        return cls(
            recording=perfect,
            angles_rad=run.angles_rad,
            kinematics=run.kinematics,
            plate=perfect.plate.columns,
            foot=None if perfect.foot is None else perfect.foot.columns,
            wrench=perfect.wrench,
            seed=seed,
        )

    @property
    def recorded(self) -> PlatformRecording:
        """Return what the file holds."""
        return replace(
            self.recording,
            plate=Poses.from_columns(self.plate),
            foot=None if self.foot is None else Poses.from_columns(self.foot),
            wrench=self.wrench,
        )

    def noisy(self) -> "Signals":
        """Return the signals with their noise added; equal seeds draw equal noise, whatever its size."""
        draws = np.random.default_rng(self.seed).standard_normal((3, *self.wrench.shape))
        pose_std = np.repeat((self.noise.position_m, self.noise.angle_rad), 3)
        wrench_std = np.repeat((self.noise.force_n, self.noise.torque_nm), 3)
        return replace(
            self,
            plate=self.plate + pose_std * draws[0],
            foot=None if self.foot is None else self.foot + pose_std * draws[1],
            wrench=self.wrench + wrench_std * draws[2],
        )

    def with_motion(self, plate: FloatArray, foot: FloatArray | None) -> "Signals":
        """Return the signals with other poses."""
        return replace(self, plate=plate, foot=foot)

    def with_wrench(self, wrench: FloatArray) -> "Signals":
        """Return the signals with another wrench."""
        return replace(self, wrench=wrench)

    @property
    def axis_z(self) -> FloatArray:
        """Return the joint's first axis, I's Z, in P (n, 3): (0, sin φ, cos φ)."""
        phi = self.angles_rad[:, 1]
        return np.column_stack((np.zeros_like(phi), np.sin(phi), np.cos(phi)))

    @property
    def rates_radps(self) -> FloatArray:
        """Return (θ̇, φ̇) (n, 2)."""
        w = self.kinematics.w
        return np.column_stack(((w * self.axis_z).sum(axis=1), w[:, 0]))


def shaped(samples: FloatArray, response: FloatArray | NDArray[np.complexfloating]) -> FloatArray:
    """Return `samples` (n, k) through the frequency response at `frequencies_hz(n)`, mirrored at the ends."""
    mirrored = np.pad(samples, ((_MIRRORED, _MIRRORED), (0, 0)), mode="reflect", reflect_type="odd")
    length = scipy.fft.next_fast_len(len(mirrored), real=True)
    spectrum = scipy.fft.rfft(mirrored, length, axis=0) * response[:, None]
    through: FloatArray = scipy.fft.irfft(spectrum, length, axis=0)[_MIRRORED : _MIRRORED + len(samples)]
    return through


def frequencies_hz(samples: int) -> FloatArray:
    """Return the frequencies at which `shaped` wants the response for so many samples at 350 Hz."""
    length = scipy.fft.next_fast_len(samples + 2 * _MIRRORED, real=True)
    grid: FloatArray = scipy.fft.rfftfreq(length, 1.0 / MOTION_HZ)
    return grid


def delayed(samples: FloatArray, delay_s: float) -> FloatArray:
    """Return `samples` (n, k) late by `delay_s`."""
    return shaped(samples, np.exp(-2j * np.pi * frequencies_hz(len(samples)) * delay_s))


def lagged(samples: FloatArray, time_constant_s: float) -> FloatArray:
    """Return `samples` (n, k) through 1 / (1 + s τ)."""
    return shaped(samples, 1.0 / (1.0 + 2j * np.pi * frequencies_hz(len(samples)) * time_constant_s))


def smoothed(samples: FloatArray, inverse_cutoff_s: float) -> FloatArray:
    """Return `samples` (n, k) through 1 / (1 + (f / f_c)⁴): a second-order Butterworth, forward and back."""
    return shaped(samples, 1.0 / (1.0 + (frequencies_hz(len(samples)) * inverse_cutoff_s) ** 4))


def drifted(samples: FloatArray, rate: float) -> FloatArray:
    """Return `samples` (n, k) stamped by a clock that runs fast by `rate` and is right in the middle of the run."""
    t_s = np.arange(len(samples)) / MOTION_HZ
    middle_s = 0.5 * t_s[-1]
    inside: FloatArray = CubicSpline(t_s, samples)(np.clip(middle_s + (t_s - middle_s) / (1.0 + rate), 0.0, t_s[-1]))
    return inside


def external_moment(signals: Signals, about_z: FloatArray, about_x: FloatArray) -> Signals:
    """Return the signals when moments (n,) about I's Z and P's X act from outside on what is above the sensor.

    The sensor then gives that much less.
    """
    wrench = signals.wrench.copy()
    wrench[:, 3:] -= about_z[:, None] * signals.axis_z
    wrench[:, 3] -= about_x
    return signals.with_wrench(wrench)


def point_mass(signals: Signals, mass_kg: float, at_m: tuple[float, float, float], *, tared: bool) -> Signals:
    """Return the signals with a further mass at `at_m` in P, there at the tare or not."""
    vector = Inertia.about(mass_kg, np.array(at_m), np.zeros(6)).vector
    more = signals.kinematics.regressor @ vector
    if tared:
        more = more - Kinematics.at_rest(np.zeros((1, 3))).regressor[0] @ vector
    return signals.with_wrench(signals.wrench + more)


_ORIGIN_M = np.array(Rig().foot_origin_m)
_COG_M = _ORIGIN_M + FOOT.cog_m
_BELOW_ORIGIN_M = np.array([0.0, -_ORIGIN_M[1], 0.0])  # from F's origin to the tape


def on_sliding_tape(signals: Signals, axis: int, period_s: float, damping_ratio: float, *, seen: bool) -> Signals:
    """Return the signals when the foot, on its tape, slides along P's `axis` with a resonance of `period_s`.

    u = −f / m H with 1 / H = Ω₀² − Ω² + 2 i ζ Ω₀ Ω, f the force on the rigid foot; `seen` by the foot's markers or not.
    """
    if signals.foot is None or period_s == 0.0:
        return signals
    e = np.eye(3)[axis]
    rigid_n = _foot_wrench(signals)[:, axis]
    u, ddu = _oscillation(-(rigid_n - rigid_n.mean()) / FOOT.mass_kg, period_s, damping_ratio)
    wrench = signals.wrench.copy()
    wrench[:, :3] += FOOT.mass_kg * ddu[:, None] * e
    weight_n = -FOOT.mass_kg * signals.kinematics.g_P
    wrench[:, 3:] += FOOT.mass_kg * ddu[:, None] * np.cross(_COG_M, e) + u[:, None] * np.cross(e, weight_n)
    foot = signals.foot.copy()
    if seen:
        foot[:, :3] += u[:, None] * (geometry.rotation_IP(*signals.plate[:, 3:].T) @ e)
    return replace(signals, wrench=wrench, foot=foot)


def on_rocking_tape(signals: Signals, axis: int, period_s: float, damping_ratio: float, *, seen: bool) -> Signals:
    """Return the signals when the foot rocks on its tape about P's `axis` (0 or 2), on the plate's surface.

    As `on_sliding_tape`, with the moment on the rigid foot about P's origin and its inertia about that axis.
    """
    if signals.foot is None or period_s == 0.0:
        return signals
    e = np.eye(3)[axis]
    J_kgm2 = float(FOOT.seen_from(np.eye(3), _ORIGIN_M).vector[4 + axis])
    rigid_nm = _foot_wrench(signals)[:, 3 + axis]
    beta, ddbeta = _oscillation(-(rigid_nm - rigid_nm.mean()) / J_kgm2, period_s, damping_ratio)
    arm = np.cross(e, _COG_M)
    wrench = signals.wrench.copy()
    wrench[:, :3] += FOOT.mass_kg * ddbeta[:, None] * arm
    weight_n = -FOOT.mass_kg * signals.kinematics.g_P
    wrench[:, 3:] += J_kgm2 * ddbeta[:, None] * e + beta[:, None] * np.cross(arm, weight_n)
    foot = signals.foot.copy()
    if seen:
        R_IP = geometry.rotation_IP(*signals.plate[:, 3:].T)
        foot[:, :3] += beta[:, None] * (R_IP @ np.cross(e, -_BELOW_ORIGIN_M))
        small = np.eye(3) + beta[:, None, None] * cross_matrix(e[None])
        foot[:, 3:] = geometry.euler_of(R_IP @ small)
    return replace(signals, wrench=wrench, foot=foot)


def _foot_wrench(signals: Signals) -> FloatArray:
    """Return the wrench (n, 6) on the rigid foot, about P's origin in P."""
    wrench: FloatArray = signals.kinematics.regressor @ FOOT.seen_from(np.eye(3), _ORIGIN_M).vector
    return wrench


def _oscillation(drive: FloatArray, period_s: float, damping_ratio: float) -> tuple[FloatArray, FloatArray]:
    """Return x and ẍ (n,) of ẍ + 2 ζ Ω₀ ẋ + Ω₀² x = `drive` (n,)."""
    W0, W = 2.0 * np.pi / period_s, 2.0 * np.pi * frequencies_hz(len(drive))
    H = 1.0 / (W0**2 - W**2 + 2j * damping_ratio * W0 * W)
    x = shaped(drive[:, None], H)[:, 0]
    return x, shaped(drive[:, None], -(W**2) * H)[:, 0]


def level_foot_wrench() -> FloatArray:
    """Return the wrench (6,) that carries the foot, level and at rest."""
    wrench: FloatArray = Kinematics.at_rest(np.zeros((1, 3))).regressor[0] @ FOOT.seen_from(np.eye(3), _ORIGIN_M).vector
    return wrench


def tared_with_foot(recording: PlatformRecording) -> PlatformRecording:
    """Return the recording as one whose tare was taken with the foot on the plate."""
    tare = msgspec.structs.replace(recording.settings.tare, with_foot=True)
    return replace(recording, settings=msgspec.structs.replace(recording.settings, tare=tare))

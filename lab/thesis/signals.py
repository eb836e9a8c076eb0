"""One run of the study as its instruments see it, and the filters that motion and wrench may pass on the way to a file.

Whatever an effect does to them is done to a stored run: the mechanics need not be simulated again, because a force from
outside on what stands above the sensor leaves the relation of motion to wrench to be altered, whatever motion the
actuators then bring about.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from impedance.body.kinematics import Kinematics
from impedance.recording.recording import PlatformRecording, Poses
from messages.arrays import FloatArray
from sim_rig.platform.rig import MOTION_HZ, THESIS_NOISE, Noise
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

    def with_poses(self, change: Callable[[FloatArray], FloatArray]) -> "Signals":
        """Return the signals with the poses (n, 6) of plate and foot changed alike."""
        return self.with_motion(change(self.plate), None if self.foot is None else change(self.foot))

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

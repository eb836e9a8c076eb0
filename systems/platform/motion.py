"""How the plate moves, out of its two measured angles, and what follows from it by the universal joint.

Positions hold 0.1 mm of noise, the angles 10 µrad, at 0.12 m a micrometre: the angles alone tell the motion, and the
positions are compared with what follows from it (ψ = 0, r the lever from joint to P's origin):

    p_IP_I = R_IP(θ, φ) r,   a_O = α × r + ω × (ω × r)                                                            (1)
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from impedance.body import geometry
from impedance.body.kinematics import Kinematics
from messages.arrays import ComplexArray, FloatArray
from systems.platform.band import Band


@dataclass(frozen=True)
class Motion:
    """Angles (θ, φ), rates and accelerations, each (2, n)."""

    angles_rad: FloatArray
    rates_radps: FloatArray
    accelerations_radps2: FloatArray

    @classmethod
    def of(cls, spectrum: ComplexArray, band: Band) -> "Motion":
        """Return the motion whose angles have this spectrum (2, k)."""
        jw = 2j * np.pi * band.f_hz
        limited = spectrum * band.motion_limit
        all_six = band.full(np.concatenate((limited, jw * limited, jw**2 * limited)))
        return cls(all_six[:2], all_six[2:4], all_six[4:])

    @cached_property
    def R_IP(self) -> FloatArray:
        """Return R_IP (n, 3, 3)."""
        return geometry.rotation_IP(np.zeros(self.angles_rad.shape[1]), *self.angles_rad)

    def kinematics(self, lever_m: FloatArray) -> Kinematics:
        """Return the motion of P by (1), with the lever (3,) from the joint."""
        still = self._on_joint
        a_O = np.cross(still.alpha, lever_m) + np.cross(still.w, np.cross(still.w, lever_m))
        return Kinematics(a_O, still.w, still.alpha, still.g_P)

    def columns(self, lever_m: FloatArray, rest: FloatArray) -> FloatArray:
        """Return (Y − Y⁰) for a body in P, its ten columns first: (10, 6 n)."""
        Y = self.kinematics(lever_m).regressor - rest
        return np.ascontiguousarray(Y.transpose(2, 1, 0)).reshape(10, -1)

    def direction(self, row: int, rate_hz: float) -> FloatArray:
        """Return the sign (n,) of an angle's rate, on average over each sample: a reversal lies between two."""
        within = 0.5 * np.abs(self.accelerations_radps2[row]) / rate_hz
        sign: FloatArray = np.clip(self.rates_radps[row] / np.maximum(within, _LEAST_RADPS), -1.0, 1.0)
        return sign

    @cached_property
    def _on_joint(self) -> Kinematics:
        return Kinematics.on_joint(self.angles_rad.T, self.rates_radps.T, self.accelerations_radps2.T, np.zeros(3))


def unsmoothed(spectrum: ComplexArray, band: Band, cutoff_hz: float) -> ComplexArray:
    """Return the angles' spectrum before a Butterworth filter of second order, run forth and back, at `cutoff_hz`.

    Its gain is 1 / (1 + (tan πf/f_s / tan πf_c/f_s)⁴). Where less than `_FLOOR` is left, nothing more is restored.
    """
    f_s = band.rate_hz
    below = band.f_hz < _TAN_SHARE * f_s
    ratio = np.full(len(band.f_hz), np.inf)
    ratio[below] = np.tan(np.pi * band.f_hz[below] / f_s) / np.tan(np.pi * cutoff_hz / f_s)
    gain = 1.0 / (1.0 + ratio**4)
    return spectrum * (gain * (1.0 + _FLOOR**2) / (gain**2 + _FLOOR**2))


_FLOOR = 0.01
"""Gain below which a smoothing is not undone: so the angles' noise is raised fiftyfold at most."""
_LEAST_RADPS = 1e-6
"""Change of rate within a sample, as a divisor: slower reversals are taken for standing still."""
_TAN_SHARE = 0.49
"""Of the rate: the tangent of the Butterworth's gain grows without bound at half the rate."""

"""An IMU on a reference motion: what it should have read, with every cause of the library switched on by its values.

The chain, in the order in which it happens (all neutral leaves the first line alone):

    ω,  f = Rᵀ p̈ + g Rᵀ exp(φ×) e_z + (α× + ω× ω×) r        lever arm r, gravity g, world's tilt φ                (1)
    ω ← E ω,  f ← E f,  E = exp(θ×)                          the sensor's axes turned against the reference's     (2)
    f ← V f,  V(s) = (1 + 2ζ s/ω0) / (1 + 2ζ s/ω0 + s²/ω0²)  its mount vibrates, per axis                         (3)
    ω ← M ω + G f + b + ḃ (t − t0) + k (T − 25 °C)           gyroscope                                            (4)
    f ← N f + c                                              accelerometer                                        (5)
    ω, f ← H ω, H f                                          low pass of second order                             (6)
    ω, f ← clipped at ± a limit                                                                                   (7)
    stamp = t + τ + ρ (t − t0), for f by τf more             the IMU's clock against the reference's              (8)

Before (1) the motion is made as much sharper as the reference was smoothed, by √2 at its cut-off. Constant matrices
commute with the low pass that measured and predicted share; what is linear acts on the bins of a spectrum. All act on a
motion x̂ without the reference's noise, and what they change is added to the ideal reading with all noise:

    predicted = ideal + T x̂ − x̂,  x̂ = W ideal + (B − W) T⁻¹ read                                                  (9)

T being the chain, W and B those of systems.imu.smoothing. Were x̂ the reference alone, smoothing its noise would pass
for a filter of the sensor, and a delay for less than it is.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import BoolArray, ComplexArray, FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception import so3
from systems.imu.chain import Chain, vector
from systems.imu.effects import REFERENCE_DEGC, Facts, library
from systems.imu.motion import Reading
from systems.imu.periodic import Periodic
from systems.imu.recording import SF_COLUMNS, W_COLUMNS

_INPUT_NAMES: Final[tuple[str, ...]] = ("wx_radps", "wy_radps", "wz_radps", "fx_mps2", "fy_mps2", "fz_mps2")
_LOUD_ENOUGH: Final = 0.3
"""Of a filter's response: where less has passed, the IMU's noise would be raised with the motion, and the reference
tells it better."""


@dataclass(frozen=True, eq=False)
class ImuSimulation:
    """The `discrepancy.simulation.Simulation` of one recording. Its base model has no parameter of its own."""

    reading: Reading
    channels: Channels
    effects: tuple[Effect, ...]
    system: str = "imu"
    parameters: tuple[Parameter, ...] = ()

    @staticmethod
    def of(reading: Reading) -> "ImuSimulation":
        """Return the simulation of what a recording holds."""
        inputs, input_names = reading.inputs, _INPUT_NAMES
        if reading.temperature_degC is not None:
            inputs, input_names = (
                np.column_stack((inputs, reading.temperature_degC)),
                (*_INPUT_NAMES, "temperature_degC"),
            )
        names = (*W_COLUMNS, *SF_COLUMNS)
        channels = Channels(reading.t_s, reading.measured, names, inputs, input_names, shared_noise=True)
        return ImuSimulation(reading, channels, library(Facts.of(reading)))

    @property
    def band_hz(self) -> float:
        """Return to where the low pass that measured and predicted share leaves them alone."""
        return self.reading.band_hz

    def predicted(self, values: Values) -> FloatArray:
        """Return (1) to (8), (n, 6), behind the shared low pass; NaN where nothing was measured."""
        chain = Chain.of(values, self._periodic.f_hz)
        beside = self._beside(values)
        motion = self._motion(values, chain, beside)
        change = self._periodic.samples(self._told(values, chain, beside, motion) - motion)
        return np.where(self._masked, np.nan, self.reading.ideal + change)

    def _told(self, values: Values, chain: Chain, beside: ComplexArray | None, motion: ComplexArray) -> ComplexArray:
        """Return (2) to (8) on a motion whose ideal readings are `motion`, both as bins (k, 6)."""
        told = self._unlimited(values, chain, beside, motion)
        told = told + self._cut_off(values, told)
        if rate := values["clock_drift.rate"]:
            told = self._periodic.bins(self._periodic.at(told, self._since_s * rate / (1.0 + rate)))
        return told

    def _unlimited(
        self, values: Values, chain: Chain, beside: ComplexArray | None, motion: ComplexArray
    ) -> ComplexArray:
        """Return (2) to (6), with the constant delays of (8), as bins (k, 6)."""
        told = motion * chain.sharpened
        if beside is not None:
            told = np.hstack((told[:, :3], told[:, 3:] + beside))
        return self._with_offsets(values, chain.on_motion(told), 1.0) * chain.filter

    def _cut_off(self, values: Values, told: ComplexArray) -> ComplexArray | float:
        """Return what (7) adds to what is `told`, as bins (k, 6)."""
        limits = np.repeat((values["clipping.gyro_radps"], values["clipping.acc_mps2"]), 3)
        if not np.isfinite(limits).any():
            return 0.0
        y = self._periodic.samples(told)
        if not (np.abs(y) > limits).any():
            return 0.0
        fine = self.reading.fine(y)
        return self._periodic.bins(self.reading.low_passed(np.clip(fine, -limits, limits) - fine))

    def _motion(self, values: Values, chain: Chain, beside: ComplexArray | None) -> ComplexArray:
        """Return the ideal readings of the motion as bins (k, 6): as the reference tells them where its noise is low,
        elsewhere as what was read tells them when (2) to (8) are undone.
        """
        undone = self._read
        if rate := values["clock_drift.rate"]:
            undone = self._periodic.bins(self._periodic.at(undone, -rate * self._since_s))
        if np.isfinite(values["clipping.gyro_radps"]) or np.isfinite(values["clipping.acc_mps2"]):
            undone = undone - self._cut_off(values, self._unlimited(values, chain, beside, self._seen * self._whole))
        undone = chain.off_motion(self._with_offsets(values, undone / chain.filter, -1.0))
        if beside is not None:
            undone = np.hstack((undone[:, :3], undone[:, 3:] - beside))
        loud = np.minimum(1.0, (chain.passed / _LOUD_ENOUGH) ** 2)
        return self._by_reference * self._whole + (self._rest * loud / chain.sharpened) * undone

    def _beside(self, values: Values) -> ComplexArray | None:
        """Return what lever arm and gravity add to the specific force of (1), as bins (k, 3); None for nothing."""
        arm_m = vector(values, "lever_arm.{}_m")
        tilt = so3.exp(np.array((values["world_tilt.x_rad"], values["world_tilt.y_rad"], 0.0)))
        more_mps2 = values["gravity_magnitude.value_mps2"] * tilt[:, 2] - (0.0, 0.0, STANDARD_GRAVITY_MPS2)
        if not arm_m.any() and not more_mps2.any():
            return None
        found: ComplexArray = self._lever @ arm_m + more_mps2 @ self._world
        return found

    def _with_offsets(self, values: Values, told: ComplexArray, sign: float) -> ComplexArray:
        """Return bins (k, 6) with biases and their drifts, added or with the `sign` −1 taken away."""
        bias = np.concatenate((vector(values, "gyro_bias.{}_radps"), vector(values, "acc_bias.{}_mps2")))
        rise, since = self._warmth
        slopes = np.array((vector(values, "gyro_bias_drift.{}_radps2"), vector(values, rise)))
        if slopes.any():
            told = np.hstack((told[:, :3] + sign * since @ slopes, told[:, 3:]))
        elif bias.any():
            told = told.copy()
        if bias.any():
            told[0] += sign * self._periodic.constant(bias)
        return told

    @cached_property
    def _warmth(self) -> tuple[str, ComplexArray]:
        """Return the keys of k in (4), and as bins (k, 2) the time since t0 and what k is multiplied with: without a
        log, that time as well.
        """
        degC, since_s = self.reading.temperature_degC, self._since_s
        if degC is None:
            return "temperature.{}_radps2", self._periodic.bins(np.column_stack((since_s, since_s)))
        warmer = np.column_stack((since_s, degC - REFERENCE_DEGC))
        return "temperature.{}_radps_per_degC", self._periodic.bins(warmer)

    @cached_property
    def _periodic(self) -> Periodic:
        return Periodic(len(self.reading.t_s), self.channels.rate_hz)

    @cached_property
    def _since_s(self) -> FloatArray:
        """Return the time (n,) since t0."""
        return self.reading.t_s - self.reading.start_s

    @cached_property
    def _whole(self) -> ComplexArray:
        """Return (1) at neutral values as the reference tells it, as bins (k, 6)."""
        return self._periodic.bins(self.reading.whole)

    @cached_property
    def _read(self) -> ComplexArray:
        """Return what was read, as bins (k, 6)."""
        return self._periodic.bins(self.reading.read)

    @cached_property
    def _by_reference(self) -> FloatArray:
        """Return the share (k, 6) of the motion that the reference tells best."""
        return self.reading.smooth.by_reference(self._periodic.f_hz)

    @cached_property
    def _seen(self) -> FloatArray:
        """Return the share (k, 6) of the motion that the reference tells at all."""
        return self.reading.smooth.seen(self._periodic.f_hz)

    @cached_property
    def _rest(self) -> FloatArray:
        """Return the share (k, 6) of the motion that the IMU tells better than the reference."""
        return self._seen - self._by_reference

    @cached_property
    def _world(self) -> ComplexArray:
        """Return the world's axes in the sensor's as bins (k, 3, 3)."""
        return self._periodic.bins(self.reading.world.reshape(-1, 9)).reshape(-1, 3, 3)

    @cached_property
    def _lever(self) -> ComplexArray:
        """Return α× + ω× ω× of (1) as bins (k, 3, 3), from the turning rate that reference and gyroscope tell."""
        w_bins = (self._by_reference * self._whole + self._rest * self._read)[:, :3]
        w, alpha = (
            self._periodic.samples(each) for each in (w_bins, 2j * np.pi * self._periodic.f_hz[:, None] * w_bins)
        )
        lever = _skew(alpha) + _skew(w) @ _skew(w)
        return self._periodic.bins(lever.reshape(-1, 9)).reshape(-1, 3, 3)

    @cached_property
    def _masked(self) -> BoolArray:
        return np.isnan(self.reading.measured)


def _skew(v: FloatArray) -> FloatArray:
    """Return [v]× (n, 3, 3) of vectors (n, 3)."""
    x, y, z = v.T
    zero = np.zeros_like(x)
    return np.moveaxis(np.array(((zero, -z, y), (z, zero, -x), (-y, x, zero))), 2, 0)

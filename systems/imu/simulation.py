"""An IMU on a reference motion: what it should have read, with every cause of the library switched on by its values.

The chain, in the order in which it happens (all neutral leaves the first line alone):

    ω,  f = Rᵀ p̈ + g Rᵀ e_z + (α× + ω× ω×) r                lever arm r, gravity g                                (1)
    ω ← E ω,  f ← E f,  E = exp(θ×)                          the sensor's axes turned against the reference's     (2)
    f ← V f,  V(s) = (1 + 2ζ s/ω0) / (1 + 2ζ s/ω0 + s²/ω0²)  its mount vibrates, per axis                         (3)
    ω ← M ω + G f + b + ḃ (t − t0) + k (T − 25 °C)           gyroscope                                            (4)
    f ← N f + c                                              accelerometer                                        (5)
    ω, f ← H ω, H f                                          low pass of second order                             (6)
    ω, f ← clipped at ± a limit                                                                                   (7)
    stamp = t + τ + ρ (t − t0)                               the IMU's clock against the reference's              (8)

Constant matrices commute with the low pass that measured and predicted share; (3) and (6) act in frequency. All act on
the motion that stands above the reference's noise, and what they change is added to the ideal reading with all noise.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy import fft

from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import BoolArray, ComplexArray, FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception import so3
from systems.imu.effects import AXES, REFERENCE_DEGC, Facts, library
from systems.imu.motion import Reading
from systems.imu.recording import SF_COLUMNS, W_COLUMNS

_INPUT_NAMES: Final[tuple[str, ...]] = ("wx_radps", "wy_radps", "wz_radps", "fx_mps2", "fy_mps2", "fz_mps2")
_BLEND_S: Final = 1.0
"""Length of the bridge from a record's end to its beginning, which makes it periodic."""
_FINER: Final = 4
"""Times the sample rate at which a cubic between samples is exact enough for a late stamp."""
_MOST_LATE: Final = 0.2
"""Of the record, before its first and after its last sample: a fit may try stamps that far off, and no further."""


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
        channels = Channels(reading.t_s, reading.measured, (*W_COLUMNS, *SF_COLUMNS), inputs, input_names)
        return ImuSimulation(reading, channels, library(Facts.of(reading)))

    @property
    def band_hz(self) -> float:
        """Return to where the low pass that measured and predicted share leaves them alone."""
        return self.reading.band_hz

    def predicted(self, values: Values) -> FloatArray:
        """Return (1) to (8), (n, 6), behind the shared low pass; NaN where nothing was measured."""
        read = self.reading
        told = self._read(values)
        offset_s, rate = values["time_offset.value_s"], values["clock_drift.rate"]
        if offset_s or rate:
            since_s = read.t_s - read.start_s
            told = self._at(told, since_s - (since_s - offset_s) / (1.0 + rate))
        y = read.ideal + (told - self._still)
        return np.where(self._masked, np.nan, y)

    def _read(self, values: Values) -> FloatArray:
        """Return (1) to (7), (n, 6), of the motion without most of the reference's noise."""
        read = self.reading
        w, sf = read.w, read.free + values["gravity_magnitude.value_mps2"] * read.up
        if (arm_m := _vector(values, "lever_arm.{}_m")).any():
            sf = sf + read.lever @ arm_m
        if (turn_rad := _vector(values, "frame_rotation.{}_rad")).any():
            E = so3.exp(turn_rad)
            w, sf = w @ E.T, sf @ E.T
        if np.isfinite(mount_hz := _vector(values, "vibration.{}_hz")).any():
            sf = self._filtered(sf, self._vibration(mount_hz, values["vibration.zeta"]))
        M = _sensitivity(values, "gyro_scale", "gyro_misalignment")
        N = _sensitivity(values, "acc_scale", "acc_misalignment")
        gyroscope = w @ M.T + _vector(values, "gyro_bias.{}_radps")
        if (G := _square(values, "g_sensitivity")).any():
            gyroscope = gyroscope + sf @ G.T
        if (drift_radps2 := _vector(values, "gyro_bias_drift.{}_radps2")).any():
            gyroscope = gyroscope + np.outer(read.t_s - read.start_s, drift_radps2)
        rise, since = self._warmth
        if (per_rise := _vector(values, rise)).any():
            gyroscope = gyroscope + np.outer(since, per_rise)
        accelerometer = sf @ N.T + _vector(values, "acc_bias.{}_mps2")
        y = np.hstack((gyroscope, accelerometer))
        cut_off_hz = np.array((values["low_pass.gyro_hz"], values["low_pass.acc_hz"]))
        if np.isfinite(cut_off_hz).any():
            y = self._filtered(y, self._low_pass(cut_off_hz, values["low_pass.zeta"]))
        limits = np.repeat((values["clipping.gyro_radps"], values["clipping.acc_mps2"]), 3)
        if (np.abs(y) > limits).any():
            fine = read.fine(y)
            y = y + read.low_passed(np.clip(fine, -limits, limits) - fine)
        return y

    @cached_property
    def _warmth(self) -> tuple[str, FloatArray]:
        """Return the keys of k in (4) and what it is multiplied with (n,): without a log, a steady rise."""
        read = self.reading
        if read.temperature_degC is None:
            return "temperature.{}_radps2", read.t_s - read.start_s
        return "temperature.{}_radps_per_degC", read.temperature_degC - REFERENCE_DEGC

    def _vibration(self, mount_hz: FloatArray, zeta: float) -> ComplexArray:
        """Return V of (3) at the bins, (k, 3)."""
        s_over_w0 = 1j * self._f_hz[:, None] * (1.0 / mount_hz)
        damping = 2.0 * zeta * s_over_w0
        found: ComplexArray = (1.0 + damping) / (1.0 + damping + s_over_w0**2)
        return found

    def _low_pass(self, cut_off_hz: FloatArray, zeta: float) -> ComplexArray:
        """Return H of (6) at the bins, (k, 6): second order, −3 dB at the cut-offs (2,), whatever the damping."""
        lean = 2.0 * zeta**2 - 1.0
        w0_over_w3 = np.sqrt(lean + np.sqrt(lean**2 + 1.0))
        w3 = np.repeat(cut_off_hz, 3)
        s_over_w0 = 1j * self._f_hz[:, None] * (1.0 / (w3 * w0_over_w3))
        found: ComplexArray = 1.0 / (1.0 + 2.0 * zeta * s_over_w0 + s_over_w0**2)
        return found

    @cached_property
    def _still(self) -> FloatArray:
        """Return (1) of the motion without most of the reference's noise, all neutral: (n, 6)."""
        return np.hstack((self.reading.w, self.reading.free + STANDARD_GRAVITY_MPS2 * self.reading.up))

    @cached_property
    def _masked(self) -> BoolArray:
        return np.isnan(self.reading.measured)

    @cached_property
    def _length(self) -> int:
        """Return the samples of the record made periodic."""
        rate_hz = self.channels.rate_hz
        return int(fft.next_fast_len(len(self.reading.t_s) + round(_BLEND_S * rate_hz), real=True))

    @cached_property
    def _f_hz(self) -> FloatArray:
        return np.asarray(np.fft.rfftfreq(self._length, 1.0 / self.channels.rate_hz), dtype=np.float64)

    def _bins(self, y: FloatArray) -> ComplexArray:
        """Return the spectrum (k, c) of the record, bridged from its end to its beginning by reflections of both."""
        count = self._length - len(y)
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1)[:, None] / (count + 1))
        after = 2.0 * y[-1] - y[-2 : -count - 2 : -1]
        before = 2.0 * y[0] - y[count:0:-1]
        bins: ComplexArray = fft.rfft(np.concatenate((y, after + share * (before - after))), axis=0)
        return bins

    def _filtered(self, y: FloatArray, response: ComplexArray) -> FloatArray:
        found: FloatArray = fft.irfft(self._bins(y) * response, self._length, axis=0)[: len(y)]
        return found

    def _at(self, y: FloatArray, late_s: FloatArray) -> FloatArray:
        """Return y (n, c) as it was `late_s` (n,) before each sample: cubic between samples four times as dense."""
        n, length = len(y), self._length
        fine = _FINER * fft.irfft(self._bins(y), _FINER * length, axis=0)
        place = _FINER * np.clip(np.arange(n) - late_s * self.channels.rate_hz, -_MOST_LATE * n, (1.0 + _MOST_LATE) * n)
        below = np.floor(place).astype(np.int64)
        u = (place - below)[:, None]
        weights = (
            -u * (u - 1.0) * (u - 2.0) / 6.0,
            (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
            -(u + 1.0) * u * (u - 2.0) / 2.0,
            (u + 1.0) * u * (u - 1.0) / 6.0,
        )
        found: FloatArray = sum(  # type: ignore[assignment]
            weight * fine[(below + k) % len(fine)] for weight, k in zip(weights, (-1, 0, 1, 2), strict=True)
        )
        return found


def _vector(values: Values, form: str) -> FloatArray:
    """Return the parameters (3,) of the three axes."""
    return np.array([values[form.format(axis)] for axis in AXES])


def _square(values: Values, effect: str) -> FloatArray:
    """Return the parameters xx, xy, … (3, 3): row reads, column acts."""
    return np.array([[values[f"{effect}.{row}{column}"] for column in AXES] for row in AXES])


def _sensitivity(values: Values, scale: str, misalignment: str) -> FloatArray:
    """Return the sensitivity (3, 3) of a sensor."""
    return np.array(
        [
            [
                1.0 + values[f"{scale}.{row}"] if row == column else values[f"{misalignment}.{row}{column}"]
                for column in AXES
            ]
            for row in AXES
        ]
    )

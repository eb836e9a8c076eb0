"""From true motion to the counts an MPU-6050 would give: the unit's errors, noise, low-pass filter, quantisation."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear, lfilter, lfilter_zi

from drivers.imu.chips import ChipModel, FilterRow
from drivers.imu.registers import INTERNAL_RATE_HZ, RangeRow
from messages.arrays import BoolArray, FloatArray, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2
from sim_rig.imu.chip_unit import ChipUnit
from sim_rig.imu.drift import Drifting

Motion = Callable[[IntArray], tuple[FloatArray, FloatArray]]
"""`motion(t_ns)` gives the true sf_B (n, 3) in m/s² and w_WB_B (n, 3) in rad/s at the CLOCK_MONOTONIC times (n,).

It must depend on the time alone: it is asked in blocks, up to LOOK_AHEAD_S before the chip's samples come due.
"""

LOOK_AHEAD_S = 0.1
_COUNT_LIMITS = (-32768, 32767)
_AXIS_COLUMNS = np.array([0, 1, 2, 4, 5, 6])


def low_pass(bandwidth_hz: float, delay_s: float, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return (b, a) of a digital low-pass with exactly this −3 dB frequency and this group delay at DC.

    Its prototype is a double pole with one zero, H(s) = (1 + c·s)/(1 + p·s)², because a pair of poles alone cannot
    have the delays that the datasheet states: 2·p − c = delay and (1 + p²ω²)² = 2·(1 + c²ω²) at the band's edge. In
    P = p·ω and D = delay·ω that is P⁴ − 6·P² + 8·D·P − (1 + 2·D²) = 0. The bilinear transform keeps the delay at DC;
    ω is warped beforehand so that it keeps the edge.
    """
    omega = 2.0 * rate_hz * np.tan(np.pi * bandwidth_hz / rate_hz)
    D = delay_s * omega
    roots = np.roots([1.0, 0.0, -6.0, 8.0 * D, -(1.0 + 2.0 * D**2)])
    p = float(np.min(roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0)].real)) / omega
    b, a = bilinear([2.0 * p - delay_s, 1.0], [p * p, 2.0 * p, 1.0], rate_hz)
    return b, a


class _Filter:
    """One low-pass over three axes that carries its state from block to block, at rest on its first input."""

    def __init__(self, b: FloatArray, a: FloatArray) -> None:
        self._b, self._a = b, a
        self._state: FloatArray | None = None

    def __call__(self, x: FloatArray) -> FloatArray:
        if self._state is None:
            self._state = np.outer(lfilter_zi(self._b, self._a), x[0])
        y, self._state = lfilter(self._b, self._a, x, axis=0, zi=self._state)
        return y

    def settle_anew(self) -> None:
        """Start again from rest on the next input."""
        self._state = None


@dataclass(frozen=True)
class SignalSettings:
    """What the chip's registers ask of its signal chain.

    `accel_row` and `gyro_row` are the filters in use, the same one in an MPU-6050. `push_sf_mps2` and `push_w_radps`
    (3,) are what the self-test adds to the axes it is on for; axes on `standby` (6,), accelerometer first, give 0.
    """

    model: ChipModel
    accel_row: FilterRow
    gyro_row: FilterRow
    accel_range: RangeRow
    gyro_range: RangeRow
    divider: int
    push_sf_mps2: FloatArray
    push_w_radps: FloatArray
    standby: BoolArray


class SignalChain:
    """The output samples of one chip since `epoch_ns`, in order, settled on the motion at the epoch.

    Sample j (from 1) is complete at `epoch_ns` + j · `period_ns`. Beyond the range counts clip at int16.
    """

    def __init__(
        self,
        motion: Motion,
        unit: ChipUnit,
        drifting: Drifting,
        settings: SignalSettings,
        epoch_ns: int,
        clock_error: float,
        rng: np.random.Generator,
    ) -> None:
        accel_row, gyro_row = settings.accel_row, settings.gyro_row
        rate_hz = gyro_row.rate_hz
        self._motion = motion
        self._unit = unit
        self._drifting = drifting
        self._settings = settings
        self._epoch_ns = epoch_ns
        self._rng = rng
        self._tick_ns = 1e9 / (rate_hz * (1.0 + clock_error))
        self._accel_hold = rate_hz // INTERNAL_RATE_HZ
        self._accel_filter = _Filter(*low_pass(accel_row.accel_bandwidth_hz, accel_row.accel_delay_s, rate_hz))
        self._gyro_filter = _Filter(*low_pass(gyro_row.gyro_bandwidth_hz, gyro_row.gyro_delay_s, rate_hz))
        self._accel_noise = unit.sf_noise_density * np.sqrt(rate_hz / 2.0)
        self._gyro_noise = unit.w_noise_density * np.sqrt(rate_hz / 2.0)
        self._lsb_per_mps2 = settings.accel_range.lsb_per_unit / STANDARD_GRAVITY_MPS2
        self._lsb_per_radps = settings.gyro_range.lsb_per_unit * 180.0 / np.pi
        self._samples = 0
        self._ready = np.empty((0, 7), dtype=np.int16)
        self._held_sf: FloatArray | None = None

    @property
    def period_ns(self) -> float:
        """Return the true period of the output samples."""
        return self._tick_ns * (1 + self._settings.divider)

    def completed_at(self, t_ns: int) -> int:
        """Return how many samples are complete at `t_ns`."""
        return int((t_ns - self._epoch_ns) / self.period_ns)

    def sample_times_ns(self, first: int, last: int) -> IntArray:
        """Return the instants (n,) at which the samples `first` to `last` are complete."""
        since_epoch: IntArray = np.rint(np.arange(first, last + 1) * self.period_ns).astype(np.int64)
        return self._epoch_ns + since_epoch

    def change_clock(self, factor: float, completed: int) -> None:
        """Run `factor` times as fast after sample `completed`; what is ready by then stays as it is."""
        before_ns = self.period_ns
        self._tick_ns /= factor
        self._epoch_ns += round(completed * (before_ns - self.period_ns))

    def take(self, n: int) -> NDArray[np.int16]:
        """Return the counts (n, 7) of the next `n` samples: accelerometer xyz, temperature, gyroscope xyz."""
        if n > len(self._ready):
            look_ahead = int(np.ceil(LOOK_AHEAD_S * 1e9 / self.period_ns))
            self._ready = np.concatenate((self._ready, self._next_block(max(n, look_ahead))))
        taken, self._ready = self._ready[:n], self._ready[n:]
        return taken

    def skip(self, n: int) -> None:
        """Leave out the next `n` samples; the filters settle anew on what comes after."""
        beyond = max(0, n - len(self._ready))
        self._ready = self._ready[n:]
        if beyond:
            self._samples += beyond
            self._accel_filter.settle_anew()
            self._gyro_filter.settle_anew()

    def _next_block(self, n: int) -> NDArray[np.int16]:
        ticks_per_sample = 1 + self._settings.divider
        ticks = self._samples * ticks_per_sample + np.arange(1, n * ticks_per_sample + 1)
        t_ns = self._epoch_ns + np.rint(ticks * self._tick_ns).astype(np.int64)
        sf_B, w_B = self._motion(t_ns)
        unit = self._unit
        measured_sf = sf_B @ unit.sf_matrix.T + unit.sf_bias_mps2 + self._settings.push_sf_mps2
        measured_w = w_B @ unit.w_matrix.T + unit.w_bias_radps + sf_B @ unit.g_sensitivity.T
        measured_w += self._settings.push_w_radps
        rise_K = self._drifting.temperature_rise_K(t_ns)
        measured_sf += rise_K[:, None] * unit.sf_bias_mps2_per_K
        measured_w += rise_K[:, None] * unit.w_bias_radps_per_K + self._drifting.w_bias_radps(t_ns)
        measured_sf += self._accel_noise * self._rng.standard_normal(measured_sf.shape)
        measured_w += self._gyro_noise * self._rng.standard_normal(measured_w.shape)
        sf = self._hold(self._accel_filter(measured_sf), ticks)
        w = self._gyro_filter(measured_w)
        self._samples += n
        at_samples = slice(ticks_per_sample - 1, None, ticks_per_sample)
        counts = np.empty((n, 7))
        counts[:, 0:3] = sf[at_samples] * self._lsb_per_mps2
        counts[:, 3] = self._temperature_counts(unit.temperature_degC + rise_K[at_samples])
        counts[:, 4:7] = w[at_samples] * self._lsb_per_radps
        counts[:, _AXIS_COLUMNS[self._settings.standby]] = 0.0
        return np.clip(np.rint(counts), *_COUNT_LIMITS).astype(np.int16)

    def _temperature_counts(self, temperature_degC: FloatArray) -> FloatArray:
        model = self._settings.model
        return np.rint((temperature_degC - model.temperature_at_zero_degC) * model.temperature_lsb_per_degC)

    def _hold(self, sf: FloatArray, ticks: IntArray) -> FloatArray:
        """Repeat the accelerometer's values (n, 3) between its own, slower instants."""
        if self._accel_hold == 1:
            return sf
        before = sf[:1] if self._held_sf is None else self._held_sf
        source = np.maximum(ticks // self._accel_hold * self._accel_hold - ticks[0], -1)
        held: FloatArray = np.concatenate((before, sf))[source + 1]
        self._held_sf = held[-1:]
        return held

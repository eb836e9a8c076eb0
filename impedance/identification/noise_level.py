"""White noise of the sensors, from what a recording holds above all that moves."""

from dataclasses import dataclass

import numpy as np

from impedance.recording.synchronous import Synchronous
from messages.arrays import FloatArray

QUIET_SHARE = 0.372
"""Of the rate: nothing moves above 130 of 350 Hz."""
_LONGEST = 4096


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviations of one sample of white noise, and which of them nobody declared."""

    position_m: float
    angle_rad: float
    force_n: float
    torque_nm: float
    estimated: tuple[str, ...] = ()


def noise_level(streams: Synchronous) -> NoiseLevel:
    """Return what the settings declare; what they leave open is estimated from the content above 130 Hz (of 350)."""
    declared = streams.settings.noise
    poses = [streams.plate] if streams.foot is None else [streams.plate, streams.foot]
    found: dict[str, float] = {}
    estimated = []
    for name, channels in (
        ("position_m", np.hstack([pose.p_m for pose in poses])),
        ("angle_rad", np.hstack([pose.euler_rad for pose in poses])),
        ("force_n", streams.wrench[:, :3]),
        ("torque_nm", streams.wrench[:, 3:]),
    ):
        value = getattr(declared, name)
        if value is None:
            value = quiet_deviation(np.where(streams.valid[:, None], channels, 0.0), streams.valid)
            estimated.append(name)
        found[name] = value
    return NoiseLevel(**found, estimated=tuple(estimated))


def quiet_deviation(channels: FloatArray, valid: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> float:
    """Return the standard deviation of white noise of the same density as the quiet band's, pooled over channels (n,
    c).

    It averages windowed stretches without a gap; NaN where there is none as long as 64 samples.
    """
    length = min(_LONGEST, len(valid))
    while length >= 64:
        starts = np.arange(0, len(valid) - length + 1, max(1, length // 2))
        whole = starts[[bool(valid[start : start + length].all()) for start in starts]]
        if len(whole):
            window = np.hanning(length)[:, None]
            pieces = channels[whole[:, None] + np.arange(length)]
            spectra = np.abs(np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)) ** 2
            quiet = spectra[:, round(QUIET_SHARE * length) : length // 2]
            return float(np.sqrt(quiet.mean() / (window**2).sum()))
        length //= 2
    return float("nan")

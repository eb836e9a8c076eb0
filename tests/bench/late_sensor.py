"""A sensor that reads a sine late: one tone tells a delay from a lag as little as any, two recordings together do."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import FloatArray

NOISE_M = 0.01
DELAY = Effect(
    "delay", (Parameter("value_s", "s", 0.0, 0.0, 0.1, 2e-4),), "It reads late.", "Shift it.", "Use two frequencies."
)
LAG = Effect(
    "lag", (Parameter("value_s", "s", 0.0, 0.0, 0.1, 2e-4),), "It lags behind.", "Model it.", "Use two frequencies."
)
OFFSET = Parameter("offset_m", "m", 0.0, -10.0, 10.0, 1e-3, per_recording=True)
GAIN = Parameter("gain", "1", 1.0, 0.1, 10.0, 1e-3)


@dataclass(frozen=True)
class LateSensor:
    """Reads gain · u + offset late, u the sum of tones `f_hz`; by default the offset is that of each recording."""

    channels: Channels
    f_hz: tuple[float, ...]
    effects: tuple[Effect, ...] = (DELAY, LAG)
    parameters: tuple[Parameter, ...] = (GAIN, OFFSET)
    system: str = "late sensor"

    def predicted(self, values: Values) -> FloatArray:
        """Return the reading (n, 1): each tone behind the delay, and behind the lag's response."""
        t_s = self.channels.t_s
        read = np.zeros_like(t_s)
        for f_hz in self.f_hz:
            w = 2.0 * np.pi * f_hz
            response = np.exp(-1j * w * values["delay.value_s"]) / (1.0 + 1j * w * values["lag.value_s"])
            read += np.abs(response) * np.sin(w * t_s + np.angle(response))
        return np.asarray(values["gain"] * read + values["offset_m"])[:, None]


def late_sensor(
    f_hz: Sequence[float],
    seed: int,
    *,
    delay_s: float = 0.004,
    offset_m: float = 0.0,
    rate_hz: float = 100.0,
    seconds: float = 10.0,
) -> LateSensor:
    """Return a recording of a sensor with a delay, of gain 1.1."""
    random = np.random.default_rng(seed)
    t_s = np.arange(round(seconds * rate_hz)) / rate_hz
    u = sum(np.sin(2.0 * np.pi * f * t_s) for f in f_hz)
    inputs = np.asarray(u)[:, None]
    empty = LateSensor(Channels(t_s, np.zeros((len(t_s), 1)), ("y_m",), inputs, ("u_m",)), tuple(f_hz))
    clean = empty.predicted({"gain": 1.1, "offset_m": offset_m, "delay.value_s": delay_s, "lag.value_s": 0.0})
    values = clean + NOISE_M * random.standard_normal(clean.shape)
    return LateSensor(Channels(t_s, values, ("y_m",), inputs, ("u_m",)), tuple(f_hz))

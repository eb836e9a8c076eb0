"""A small rig to try the finder on: two masses on springs, moved along a known path; the forces needed are measured.

The path is a sum of sines, so that the truth is made by formulas of its own: shifted arguments for a delay, a
time-stepped oscillator for a resonance.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import FloatArray

RATE_HZ = 200.0
EDGE_S = 0.5
"""At either end of a record, where the rig's filters have no past or future."""
ComplexArray = NDArray[np.complexfloating]
NAMES = ("fx_n", "fz_n")
MASS_KG, STIFFNESS_NPM = 3.0, 900.0


@dataclass(frozen=True)
class Path:
    """Two independent motions: amplitudes and phases of lines."""

    f_hz: FloatArray
    amplitude_m: FloatArray  # (2, k)
    phase_rad: FloatArray

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "Path":
        """Draw a motion with lines from 0.4 to 18 Hz."""
        f_hz = np.sort(rng.uniform(0.4, 18.0, 24))
        return cls(
            f_hz, rng.uniform(0.3, 1.0, (2, 24)) * 0.02 / (1.0 + f_hz / 4.0) ** 2, rng.uniform(0.0, 6.28, (2, 24))
        )

    def at(self, t_s: FloatArray, order: int = 0, response: ComplexArray | FloatArray | None = None) -> FloatArray:
        """Return a derivative (n, 2) of the motion, behind a filter with this response (k,) at the lines."""
        w = 2.0 * np.pi * self.f_hz
        passed = 1.0 if response is None else response
        lines = passed * (1j * w) ** order * self.amplitude_m * np.exp(1j * self.phase_rad)
        return np.asarray((np.exp(1j * np.outer(t_s, w)) @ lines.T).real)


def forces(path: Path, t_s: FloatArray, response: ComplexArray | FloatArray | None = None) -> FloatArray:
    """Return the true forces (n, 2) of the rig, behind a filter with this response (k,) at the path's lines."""
    return np.asarray(MASS_KG * path.at(t_s, 2, response) + STIFFNESS_NPM * path.at(t_s, 0, response))


def coloured(rng: np.random.Generator, n: int, std: float, colour: float) -> FloatArray:
    """Return noise (n, 2): first-order, with some slow drift."""
    white = rng.normal(size=(n + 500, 2))
    noise = signal.lfilter([1.0], [1.0, -colour], white, axis=0)[500:]
    drift = signal.lfilter([1.0], [1.0, -0.998], rng.normal(size=(n + 4000, 2)), axis=0)[4000:]
    noise = noise / noise.std() + 0.3 * drift / 16.0
    return np.asarray(std * noise)


def _parameter(name: str, unit: str, scale: float, low: float, high: float, neutral: float = 0.0) -> Parameter:
    return Parameter(name, unit, neutral, low, high, scale)


def _effect(
    name: str,
    *parameters: Parameter,
    choices: tuple[tuple[str, ...], ...] = (),
    starts: tuple[Values, ...] = (),
) -> Effect:
    return Effect(name, parameters, f"{name} acts.", f"Remove {name}.", f"Vary what drives {name}.", choices, starts)


EFFECTS = (
    _effect("delay", _parameter("value_s", "s", 2e-5, -0.02, 0.02)),
    _effect("lag", _parameter("tau_s", "s", 2e-5, 0.0, 0.05)),
    _effect(
        "gain",
        _parameter("fx", "", 2e-4, -0.3, 0.3),
        _parameter("fz", "", 2e-4, -0.3, 0.3),
        choices=(("fx",), ("fz",), ("fx", "fz")),
    ),
    _effect(
        "offset",
        _parameter("fx_n", "N", 1e-3, -10.0, 10.0),
        _parameter("fz_n", "N", 1e-3, -10.0, 10.0),
        choices=(("fx_n",), ("fz_n",), ("fx_n", "fz_n")),
    ),
    _effect(
        "coulomb",
        _parameter("fx_n", "N", 2e-3, 0.0, 10.0),
        _parameter("fz_n", "N", 2e-3, 0.0, 10.0),
        choices=(("fx_n",), ("fz_n",), ("fx_n", "fz_n")),
    ),
    _effect(
        "damping",
        _parameter("x_nspm", "N s/m", 2e-2, -100.0, 100.0),
        _parameter("z_nspm", "N s/m", 2e-2, -100.0, 100.0),
        choices=(("x_nspm",), ("z_nspm",), ("x_nspm", "z_nspm")),
    ),
    _effect(
        "crosstalk",
        _parameter("fx_from_fz", "", 2e-4, -0.3, 0.3),
        _parameter("fz_from_fx", "", 2e-4, -0.3, 0.3),
        choices=(("fx_from_fz",), ("fz_from_fx",)),
    ),
    _effect(
        "resonance",
        _parameter("hz", "Hz", 0.2, 25.0, 90.0, np.inf),
        _parameter("zeta", "", 0.01, 0.005, 0.5, 0.05),
        starts=tuple({"hz": hz, "zeta": 0.05} for hz in (30.0, 40.0, 55.0, 75.0)),
    ),
    # Says exactly the same as offset on fx: the scale of a balance that was tared at another height.
    _effect("tare", _parameter("height_m", "m", 2e-4, -1.0, 1.0)),
)

_NEUTRAL = {"mass_kg": MASS_KG, "stiffness_npm": STIFFNESS_NPM} | {
    effect.qualified(p.name): p.neutral for effect in EFFECTS for p in effect.parameters
}


@dataclass(frozen=True)
class Rig:
    """The rig as a simulation; `withheld` effects are not in its library."""

    path: Path
    measured: FloatArray
    noise_std: FloatArray | None = None
    withheld: tuple[str, ...] = ()
    system: str = "rig"
    fitted: bool = True
    _cache: dict[str, FloatArray] = field(default_factory=dict)

    @property
    def t_s(self) -> FloatArray:
        return np.arange(len(self.measured)) / RATE_HZ

    @property
    def channels(self) -> Channels:
        inputs = np.column_stack([self._motion(order) for order in range(3)])
        names = tuple(f"{axis}{unit}" for unit in ("_m", "_mps", "_mps2") for axis in "xz")
        return Channels(self.t_s, self.measured, NAMES, inputs, names, self.noise_std)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        if not self.fitted:
            return ()
        return (
            _parameter("mass_kg", "kg", 0.01, 1.0, 5.0, 2.9),
            _parameter("stiffness_npm", "N/m", 1.0, 100.0, 2000.0, 880.0),
        )

    @property
    def effects(self) -> tuple[Effect, ...]:
        return tuple(each for each in EFFECTS if each.name not in self.withheld)

    def predicted(self, values: Values) -> FloatArray:
        values = {**_NEUTRAL, **values}  # the library or the base model may not hold all
        mass, stiffness = values["mass_kg"], values["stiffness_npm"]
        x, v, a = (self._motion(order) for order in range(3))
        out = mass * a + stiffness * x
        out = out + v * np.array([values["damping.x_nspm"], values["damping.z_nspm"]])
        out = out + np.sign(v) * np.array([values["coulomb.fx_n"], values["coulomb.fz_n"]])
        out = out @ np.array([[1.0, values["crosstalk.fz_from_fx"]], [values["crosstalk.fx_from_fz"], 1.0]])
        out = out * (1.0 + np.array([values["gain.fx"], values["gain.fz"]]))
        delay, lag, hz = values["delay.value_s"], values["lag.tau_s"], values["resonance.hz"]
        if delay or lag or np.isfinite(hz):
            out = self._filtered(out, delay, lag, hz, values["resonance.zeta"])
        tare = 5.0 * values["tare.height_m"]
        out = out + np.array([values["offset.fx_n"] + tare, values["offset.fz_n"]])
        edge = round(EDGE_S * RATE_HZ)
        out[:edge] = out[len(out) - edge :] = np.nan
        return np.asarray(out)

    def _filtered(self, out: FloatArray, delay: float, lag: float, hz: float, zeta: float) -> FloatArray:
        n = len(out)
        f = np.fft.rfftfreq(2 * n, 1.0 / RATE_HZ)[:, None]
        H = np.exp(-2j * np.pi * f * delay) / (1.0 + 2j * np.pi * f * lag)
        if np.isfinite(hz):
            H = H / (1.0 - (f / hz) ** 2 + 2j * zeta * f / hz)
        mirrored = np.concatenate((out, out[::-1]))
        return np.asarray(np.fft.irfft(np.fft.rfft(mirrored, axis=0) * H, 2 * n, axis=0)[:n])

    def _motion(self, order: int) -> FloatArray:
        key = str(order)
        if key not in self._cache:
            self._cache[key] = self.path.at(self.t_s, order)
        return self._cache[key]


def measured(path: Path, cause: str, size: float, n: int) -> FloatArray:
    """Return what is measured without noise, (n, 2), if `cause` acts; `size` is about 1."""
    t_s = np.arange(n) / RATE_HZ
    out = forces(path, t_s)
    x, v = path.at(t_s), path.at(t_s, 1)
    if cause == "delay":
        out = forces(path, t_s - 1e-3 * size)
    elif cause == "lag":
        out = forces(path, t_s, 1.0 / (1.0 + 2j * np.pi * path.f_hz * 1.5e-3 * size))
    elif cause == "gain":
        out = out * (1.0, 1.0 + 0.03 * size)
    elif cause == "offset":
        out = out + np.array([0.0, 0.8 * size])
    elif cause == "tare":
        out = out + np.array([0.8 * size, 0.0])
    elif cause == "coulomb":
        out = out + np.where(v > 0.0, 1.0, -1.0) * (0.3 * size, 0.0)
    elif cause == "damping":
        out = out + v * (0.0, 6.0 * size)
    elif cause == "crosstalk":
        out = out + out[:, 1:] * (0.02 * size, 0.0)
    elif cause == "resonance":
        share = path.f_hz * size / 48.0
        out = forces(path, t_s, 1.0 / (1.0 - share**2 + 2j * 0.04 * share))
    elif cause == "cubic":  # in no library: a spring that hardens
        out = out + x**3 * (2.0e5 * size, 0.0)
    elif cause == "gravity_wave":  # in no library: a product of both motions
        out = out + x[:, :1] * x[:, 1:] * (0.0, 3.0e3 * size)
    elif cause == "hum":  # in no library: one line that no input holds
        out = out + np.outer(np.sin(2.0 * np.pi * 50.0 * t_s), (0.4 * size, 0.0))
    elif cause == "stiction":  # in no library: a force that stays on for a while after each reversal
        out = out + np.where(np.abs(v) < 0.05, 1.0, 0.0) * (0.5 * size, 0.0)
    elif cause != "":
        raise ValueError(cause)
    return np.asarray(out)

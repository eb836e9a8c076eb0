"""Recordings of the systems to practise on: made from their own models, with effects that these do not have."""

import importlib.util
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from discrepancy.ports.simulation import PortedSimulation
from discrepancy.values import Neutral
from impedance.recording.table import write_columns
from messages.arrays import FloatArray
from messages.errors import UserError, unknown_name
from systems.own.table import Table

_FILES = Path(__file__).parent / "files"
FIT, HELD_OUT = "fit.csv", "held_out.csv"


@dataclass(frozen=True)
class Practice:
    """A system to practise on: the `file` that a user would write, how its inputs move, how often and how long it is
    recorded, the true values of its own parameters, and the noise of each measured channel (standard deviation).
    """

    file: Path
    inputs: Callable[[FloatArray, np.random.Generator], dict[str, FloatArray]]
    rate_hz: float
    seconds: float
    truth: dict[str, float]
    noise: dict[str, float]
    begun: dict[str, float]
    """What the channels read at the first sample."""

    @cached_property
    def simulation(self) -> Callable[[Table], PortedSimulation]:
        """Return the file's function."""
        spec = importlib.util.spec_from_file_location(f"practice_{self.file.stem}", self.file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        found: Callable[[Table], PortedSimulation] = module.simulation
        return found


def _tones(t_s: FloatArray, random: np.random.Generator, size: float, band_hz: tuple[float, float]) -> FloatArray:
    """Return six tones (n,) within a band, of random phase."""
    out = np.zeros_like(t_s)
    for f_hz in random.uniform(*band_hz, 6):
        out += size / 3.0 * np.sin(2.0 * np.pi * f_hz * t_s + random.uniform(0.0, 2.0 * np.pi))
    return out


def _steps(t_s: FloatArray, random: np.random.Generator, low: float, high: float, every_s: float) -> FloatArray:
    """Return levels (n,) drawn anew again and again."""
    place = (t_s / every_s).astype(int)
    out: FloatArray = random.uniform(low, high, place[-1] + 1)[place]
    return out


SYSTEMS: Mapping[str, Practice] = {
    "pendulum": Practice(
        _FILES / "pendulum.py",
        lambda t_s, random: {"drive_Nm": _tones(t_s, random, 0.25, (0.1, 1.2))},
        100.0,
        20.0,
        {"weight_Nm": 1.1, "damping_Nms": 0.04},
        {"angle_rad": 1e-3},
        {"angle_rad": 0.0},
    ),
    "motor": Practice(
        _FILES / "motor.py",
        lambda t_s, random: {"voltage_V": _steps(t_s, random, -2.0, 2.0, 0.3) + _tones(t_s, random, 1.0, (1.0, 8.0))},
        500.0,
        4.0,
        {"torque_per_A": 0.052, "viscous_Nms": 1.2e-4},
        {"speed_radps": 0.1, "current_A": 0.01},
        {"speed_radps": 0.0, "current_A": 0.0},
    ),
    "tanks": Practice(
        _FILES / "tanks.py",
        lambda t_s, random: {"pump_V": _steps(t_s, random, 1.0, 5.0, 80.0)},
        0.5,
        4000.0,
        {"pump": 0.0022, "upper_outlet": 0.0125, "lower_outlet": 0.0115},
        {"upper_m": 1e-3, "lower_m": 1e-3},
        {"upper_m": 0.2, "lower_m": 0.2},
    ),
}
"""By name."""


def effects_of(system: str) -> list[str]:
    """Return the names of a system's effects."""
    return [effect.name for effect in _plain(practice(system), 1).effects]


def practice(system: str) -> Practice:
    """Return a system to practise on; raises UserError, naming the nearest, where there is no such one."""
    if system not in SYSTEMS:
        raise unknown_name(f"practice: system {system}", system, SYSTEMS)
    return SYSTEMS[system]


def make(system: str, effects: Mapping[str, float], folder: Path, seed: int) -> dict[str, float]:
    """Write two recordings of a system with `effects`, the user's file beside them, and return all hidden values.

    An effect's name stands for its first parameter, `effect.parameter` for any. The recordings differ in inputs and
    noise, drawn from `seed`. Raises UserError for an unknown effect or parameter, a value beyond its bounds, or where
    the folder cannot be written.
    """
    made = practice(system)
    first = _plain(made, seed)
    library = first.library
    values = _values(first, effects)
    with_effects = {**made.truth, **values}
    for name, plain in ((FIT, first), (HELD_OUT, _plain(made, seed + 1))):
        whole = plain.with_terms(library)
        clean = whole.predicted(Neutral(whole).completed(with_effects))
        if not np.isfinite(clean).all():
            raise UserError(
                f"practice {system}: {', '.join(effects)}: the system diverges with it; choose a smaller value"
            )
        _write(folder / name, made, plain, clean)
    text = made.file.read_text(encoding="utf-8")
    try:
        (folder / f"{system}.py").write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}") from error
    return values


def simulated(system: str, effects: Mapping[str, float], seed: int) -> tuple[PortedSimulation, PortedSimulation]:
    """Return the system held against two recordings made as `make` does."""
    with tempfile.TemporaryDirectory() as name:
        make(system, effects, Path(name), seed)
        function = practice(system).simulation
        return function(Table.load(Path(name) / FIT)), function(Table.load(Path(name) / HELD_OUT))


def _plain(made: Practice, seed: int) -> PortedSimulation:
    """Return the system held against what it would measure itself, with its true parameters and noise."""
    random = np.random.default_rng(seed)
    t_s = np.arange(round(made.seconds * made.rate_hz)) / made.rate_hz
    columns = {"t_s": t_s, **made.inputs(t_s, random)}
    columns |= {name: np.full(len(t_s), value) for name, value in made.begun.items()}
    found = made.simulation(Table(made.file, columns))
    clean = found.with_terms(()).predicted(made.truth)
    noise = np.column_stack([made.noise[name] * random.standard_normal(len(t_s)) for name in found.channels.names])
    return replace(found, channels=replace(found.channels, values=clean + noise))


def _values(simulation: PortedSimulation, effects: Mapping[str, float]) -> dict[str, float]:
    """Return values by key, those that an effect needs beside the named ones filled in from its first start."""
    known = {effect.name: effect for effect in simulation.effects}
    values: dict[str, float] = {}
    for text, value in effects.items():
        name, _, parameter = text.partition(".")
        if name not in known:
            raise unknown_name(f"practice {simulation.system}: effect {name}", name, known)
        effect = known[name]
        names = [p.name for p in effect.parameters]
        parameter = parameter or names[0]
        if parameter not in names:
            raise unknown_name(f"practice {simulation.system}: {name}: parameter {parameter}", parameter, names)
        p = effect.parameters[names.index(parameter)]
        if not p.low <= value <= p.high:
            raise UserError(f"practice: {text}={value:g}: allowed {p.low:.3g} to {p.high:.3g} {p.unit}")
        values[effect.qualified(parameter)] = value
    return values


def _write(path: Path, made: Practice, plain: PortedSimulation, clean: FloatArray) -> None:
    channels = plain.channels
    told = plain.with_terms(()).predicted(made.truth)
    measured = clean + (channels.values - told)
    columns = ("t_s", *channels.input_names, *channels.names)
    write_columns(path, columns, np.column_stack((channels.t_s, channels.inputs, measured)))
